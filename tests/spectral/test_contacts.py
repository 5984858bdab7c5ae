"""Verdicts about ball sets and shapes, against exact fractions, shapely and FCL."""

from fractions import Fraction

import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st

from cspace.spectral import ContactTest, Verdict, decompose
from tests.helpers.balls import draw_rotations
from tests.helpers.strategies import examples, seeds

dims = st.sampled_from([2, 3])


def draw_sets(rng, dim):
    """Draw two ball sets of radii that differ by orders of magnitude; some balls coincide."""
    sets = []
    for _ in range(2):
        number = int(rng.integers(1, 9))
        centers = rng.normal(size=(number, dim)) + rng.choice([0.0, 5.0])
        centers[rng.random(number) < 0.2] = centers[0]
        sets.append((centers, 10.0 ** rng.uniform(-3.0, 0.0, number)))
    return sets


def draw_contacts(rng, a, b, number):
    """Draw placements of a at which two balls just touch, or nearly, or not."""
    i = rng.integers(len(a[1]), size=number)
    j = rng.integers(len(b[1]), size=number)
    directions = rng.normal(size=(number, a[0].shape[1]))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    gaps = rng.choice([-1.0, 0.0, 1.0], number) * 10.0 ** rng.uniform(-17.0, 0.0, number)
    distances = a[1][i] + b[1][j] + gaps
    return b[0][j] - a[0][i] + distances[:, None] * directions


def compute_exact_depth(a, b, t):
    """Return the largest ``(r + s)^2 - distance^2`` over all pairs of balls, without rounding."""
    depths = []
    for p, r in zip(*a, strict=True):
        for q, s in zip(*b, strict=True):
            steps = [
                Fraction(x) + Fraction(m) - Fraction(y) for x, m, y in zip(p, t, q, strict=True)
            ]
            square = sum(step * step for step in steps)
            depths.append((Fraction(r) + Fraction(s)) ** 2 - square)
    return max(depths)


@examples(40)
@given(seeds, dims)
def test_verdicts_about_balls_are_proofs(seed, dim):
    rng = np.random.default_rng(seed)
    a, b = draw_sets(rng, dim)
    placements = draw_contacts(rng, a, b, 12)
    verdicts = ContactTest(a, b, a, b).separated(placements)
    for t, verdict in zip(placements, verdicts, strict=True):
        depth = compute_exact_depth(a, b, t)
        assert verdict != Verdict.MISS or depth < 0
        assert verdict != Verdict.HIT or depth > 0
        assert verdict != Verdict.UNDECIDED or abs(depth) < 1e-11


def rotate(balls, matrix):
    """Rotate balls about the origin."""
    return balls[0] @ matrix.T, balls[1]


@examples(25)
@given(seeds, dims)
def test_outer_balls_prove_misses_and_inner_balls_hits(seed, dim):
    rng = np.random.default_rng(seed)
    a, b = draw_sets(rng, dim)
    inner_a, inner_b = (a[0], 0.5 * a[1]), (b[0], 0.5 * b[1])
    first, second = draw_rotations(rng, 2, dim)
    matrix = second @ first
    test, blind_test = (
        ContactTest(*sets).rotated(first).rotated(second)
        for sets in ((a, b, inner_a, inner_b), (a, b))
    )
    a, inner_a = rotate(a, matrix), rotate(inner_a, matrix)
    placements = np.vstack([draw_contacts(rng, a, b, 6), draw_contacts(rng, inner_a, inner_b, 6)])
    verdicts = test.separated(placements)
    blind_verdicts = blind_test.separated(placements)
    for t, verdict, blind in zip(placements, verdicts, blind_verdicts, strict=True):
        # Rotated centers round.
        outer_depth = compute_exact_depth(a, b, t)
        inner_depth = compute_exact_depth(inner_a, inner_b, t)
        assert verdict != Verdict.MISS or outer_depth < 1e-10
        assert verdict != Verdict.HIT or inner_depth > -1e-10
        assert verdict != Verdict.UNDECIDED or (outer_depth > -1e-10 and inner_depth < 1e-10)
        assert blind in (Verdict.MISS, Verdict.UNDECIDED)
        assert blind != Verdict.MISS or outer_depth < 1e-10


def test_verdicts_about_polygons_agree_with_shapely():
    robot = shapely.Polygon([(-0.4, -0.3), (0.5, -0.2), (0.1, 0.0), (0.4, 0.4)])
    room = shapely.box(0.0, 0.0, 2.0, 1.6) - shapely.box(0.2, 0.2, 1.8, 1.4)
    outer = [decompose(shape, kind="outer", number=60) for shape in (robot, room)]
    inner = [decompose(shape, kind="inner", number=60) for shape in (robot, room)]
    test = ContactTest(*outer, *inner)
    rng = np.random.default_rng(0)
    counts = np.zeros(3, dtype=int)
    for angle in (0.0, 1.0, -2.5):
        turned = test.rotated(angle)
        shape = shapely.affinity.rotate(robot, angle, origin=(0, 0), use_radians=True)
        placements = rng.uniform((-0.6, -0.6), (2.6, 2.2), (200, 2))
        verdicts = turned.separated(placements)
        moved = [shapely.affinity.translate(shape, *t) for t in placements]
        collides = shapely.intersects(moved, room)
        assert turned.separated(placements[0].tolist()) == Verdict(verdicts[0])
        assert not collides[verdicts == Verdict.MISS].any()
        assert collides[verdicts == Verdict.HIT].all()
        counts += np.bincount(verdicts, minlength=3)
    assert (counts > 10).all()
