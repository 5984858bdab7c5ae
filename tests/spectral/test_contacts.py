"""Verdicts about ball sets and shapes, against exact fractions, shapely and FCL."""

from contextlib import suppress
from fractions import Fraction
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace._shapes.mesh import Mesh
from cspace.errors import InputError
from cspace.spectral import ContactTest, Verdict, decompose
from tests.helpers.balls import draw_directions, draw_pairs, draw_rotations, move
from tests.helpers.regions import Body, Flat
from tests.helpers.scenes import Scale, draw_polygon, draw_solid
from tests.helpers.strategies import examples, few, seeds

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
    placements, radii = draw_pairs(rng, a, b, number)
    directions = draw_directions(rng, number, a[0].shape[1])
    gaps = rng.choice([-1.0, 0.0, 1.0], number) * 10.0 ** rng.uniform(-17.0, 0.0, number)
    return placements + (radii + gaps)[:, None] * directions


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
    a, inner_a = move(a, 0.0, matrix), move(inner_a, 0.0, matrix)
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


# ---- shapes --------------------------------------------------------------------------------------

PLACEMENTS = 500
"""Placements tested per rotation, a third near contact."""


class Part(NamedTuple):
    """A polygon or the triangles of a mesh, and balls around it and inside, if any fit."""

    shape: Any
    outer: tuple
    inner: tuple | None

    def place(self, scale, matrix, away):
        """Scale, rotate and translate."""

        def move(points):
            return scale * points @ matrix.T + away

        shape = shapely.transform(self.shape, move) if len(matrix) == 2 else move(self.shape)
        balls = [each and (move(each[0]), scale * each[1]) for each in self[1:]]
        return Part(shape, *balls)


def draw_part(rng, dim):
    """Draw a body about 1 m across."""
    metres = Scale(1.0, 0.0, 0.0)
    if dim == 2:
        shape = solid = draw_polygon(rng, np.zeros(2), 1.0, metres)
    else:
        shape = draw_solid(rng, str(rng.choice(["boxes", "hull", "stars"])), 1.0, metres)
        shape = shape - shape.mean(axis=(0, 1))
        solid = Mesh(shape.reshape(-1, 3), np.arange(3 * len(shape)).reshape(-1, 3))
    balls = []
    for kind in ("outer", "inner"):
        with suppress(InputError):  # no ball fits
            found = decompose(solid, kind=kind, number=int(rng.integers(10, 60)))
            balls.append((found.centers, found.radii))
    return Part(shape, *balls, *[None] * (2 - len(balls)))


def unite(parts):
    """Return the exact region of parts."""
    shapes = [part.shape for part in parts]
    return Body.join(shapes) if isinstance(shapes[0], np.ndarray) else Flat(shapes)


def join(balls):
    """Return sets of balls as one, or None if one is None."""
    return None if None in balls else tuple(map(np.concatenate, zip(*balls, strict=True)))


def meet(moving, fixed, rotation, ts):
    """Return whether regions meet at placements with one rotation."""
    q = np.column_stack([ts, np.tile(rotation, (len(ts), 1))])
    return moving.within(fixed, q, np.zeros(len(ts)))


def draw_near_contacts(collide, rng, touching, size, number):
    """Draw placements near contact, beyond placements that touch."""
    starts = touching[rng.integers(len(touching), size=number // 5)]
    directions = rng.normal(size=starts.shape)
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    near, far = np.zeros(len(starts)), np.full(len(starts), 2.0 * size)
    for _ in range(45):
        center = 0.5 * (near + far)
        meets = collide(starts + center[:, None] * directions)
        near, far = np.where(meets, center, near), np.where(meets, far, center)
    picked = rng.integers(len(starts), size=number)
    off = size * 10.0 ** rng.uniform(-11.0, -0.7, number) * rng.choice([-1.0, 1.0], number)
    return starts[picked] + (far[picked] + off)[:, None] * directions[picked]


@pytest.mark.parametrize("dim", few([2, 3]))
@examples(4)
@given(seeds)
def test_verdicts_about_shapes_agree_with_exact_geometry(dim, seed):
    rng = np.random.default_rng(seed)
    size = float(10.0 ** rng.uniform(-2.0, 2.0))
    drawn = [draw_part(rng, dim) for _ in range(2)]
    a = drawn[0].place(size, np.eye(dim), size * rng.choice([0.0, 3.0]) * rng.normal(size=dim))
    corner = size * rng.choice([0.0, 30.0]) * rng.normal(size=dim)
    b = [
        drawn[part].place(
            size * rng.uniform(0.5, 2.0), turn, corner + size * rng.uniform(-1.5, 1.5, dim)
        )
        for part, turn in zip(rng.integers(2, size=3), draw_rotations(rng, 3, dim), strict=True)
    ][: rng.integers(1, 4)]
    inner = join([each.inner for each in b]), a.inner
    sets = [a.outer, join([each.outer for each in b])]
    sets += [] if None in inner or rng.random() < 0.1 else inner[::-1]
    test, moving, fixed = ContactTest(*sets), unite([a]), unite(b)
    for _ in range(3):
        yaw = float(rng.uniform(-np.pi, np.pi))
        turn = Rotation.from_rotvec((0.0, 0.0, yaw) if dim == 2 else rng.normal(size=3))
        rotated = test.rotated(yaw if dim == 2 else turn)
        collide = partial(meet, moving, fixed, [yaw] if dim == 2 else turn.as_quat())
        centers, radii = sets[1]
        around = turn.apply(np.pad(sets[0][0], [(0, 0), (0, 3 - dim)]))[:, :dim]
        reach = sets[0][1].max() + radii.max()
        low = centers.min(axis=0) - around.max(axis=0) - reach
        high = centers.max(axis=0) - around.min(axis=0) + reach
        ts = rng.uniform(low, high, (PLACEMENTS, dim))
        ts[:: PLACEMENTS // 10] += rng.choice([-1.0, 1.0]) * (high - low)
        touching = ts[collide(ts)]
        if len(touching):
            extent = float(np.linalg.norm(high - low))
            ts[::3] = draw_near_contacts(collide, rng, touching, extent, len(ts[::3]))
        meets, verdicts = collide(ts), rotated.separated(ts)
        assert not meets[verdicts == Verdict.MISS].any()
        assert meets[verdicts == Verdict.HIT].all()
        assert rotated.separated(ts[0].tolist()) == verdicts[0]
        assert (verdicts == Verdict.MISS).any()
