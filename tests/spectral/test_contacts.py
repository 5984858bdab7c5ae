"""Verdicts about ball sets and shapes, against exact fractions, shapely and FCL."""

from fractions import Fraction

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from cspace import InputError
from cspace.spectral import FourierOverlap, Verdict, decompose
from tests.helpers.strategies import seeds
from tests.spectral.balls import draw_rotations

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


@settings(max_examples=40)
@given(seeds, dims)
def test_verdicts_about_balls_are_proofs(seed, dim):
    rng = np.random.default_rng(seed)
    a, b = draw_sets(rng, dim)
    overlap = FourierOverlap(a, b, band=1.0)
    placements = draw_contacts(rng, a, b, 12)
    for t, verdict in zip(placements, overlap.separated(placements).verdict, strict=True):
        depth = compute_exact_depth(a, b, t)
        assert verdict != Verdict.MISS or depth < 0
        assert verdict != Verdict.HIT or depth > 0
        assert verdict != Verdict.UNDECIDED or abs(depth) < 1e-11


def rotate(balls, matrix):
    """Rotate balls about the origin."""
    return balls[0] @ matrix.T, balls[1]


@settings(max_examples=25)
@given(seeds, dims, st.floats(0.0, 0.2), st.integers(1, 4))
def test_outer_balls_prove_misses_and_inner_balls_hits(seed, dim, swell, classes):
    rng = np.random.default_rng(seed)
    a, b = draw_sets(rng, dim)
    inner_a, inner_b = (a[0], 0.5 * a[1]), (b[0], 0.5 * b[1])
    (matrix,) = draw_rotations(rng, 1, dim)
    options = {"swell": swell, "classes": classes, "tolerance": 0.3}
    overlap = FourierOverlap.of_shapes(a, b, inner_a, inner_b, **options).rotated(matrix)
    without_inner = FourierOverlap.of_shapes(a, b, **options).rotated(matrix)
    a, inner_a = rotate(a, matrix), rotate(inner_a, matrix)
    placements = np.vstack([draw_contacts(rng, a, b, 6), draw_contacts(rng, inner_a, inner_b, 6)])
    verdicts = overlap.separated(placements).verdict
    blind_verdicts = without_inner.separated(placements).verdict
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
    overlap = FourierOverlap.of_shapes(*outer, *inner, swell=0.05, tolerance=0.1)
    rng = np.random.default_rng(0)
    counts = np.zeros(3, dtype=int)
    for angle in (0.0, 1.0, -2.5):
        turned = overlap.rotated(angle)
        shape = shapely.affinity.rotate(robot, angle, origin=(0, 0), use_radians=True)
        placements = rng.uniform(*turned.domain, (200, 2))
        verdicts = turned.separated(placements).verdict
        moved = [shapely.affinity.translate(shape, *t) for t in placements]
        collides = shapely.intersects(moved, room)
        assert not collides[verdicts == Verdict.MISS].any()
        assert collides[verdicts == Verdict.HIT].all()
        counts += np.bincount(verdicts, minlength=3)
    assert (counts > 20).all()


def test_verdicts_are_neither_true_nor_false():
    for verdict in Verdict:
        with pytest.raises(InputError, match="neither true nor false; compare it"):
            bool(verdict)
