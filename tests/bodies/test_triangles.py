"""Distances and motions of triangles, against rational arithmetic and FCL."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace._bodies.triangle_proofs import (
    MAX_PENDING_PAIRS,
    Motion,
    build_trees,
    crosses,
    free_fraction,
)
from cspace._shapes import RoundedSimplices
from cspace._support.compiling import kernel
from tests.helpers.oracles import cross, dot, minus
from tests.helpers.strategies import examples, seeds

HERE = (0.0, 0.0, 0.0)
STILL = np.eye(3)
ERROR = 2.0**-48
"""Largest excess of a distance, relative to the diameter of both triangles together."""


# ---- exact arithmetic ----------------------------------------------------------------------------


def clamp(above, below):
    """Clamp a quotient to [0, 1]; return numerator and denominator."""
    return (0, 1) if above <= 0 else (1, 1) if above >= below else (above, below)


def squared_segment_distance(p, q, a, b):
    """Return the squared distance of segments with integer coordinates, exactly."""
    v = minus(q, p)
    u = minus(b, a)
    w = minus(p, a)
    vv = dot(v, v)
    uu = dot(u, u)
    uv = dot(u, v)
    vw = dot(v, w)
    uw = dot(u, w)
    area = vv * uu - uv * uv
    s, of_s = clamp(uv * uw - vw * uu, area) if area else (0, 1)
    t, of_t = clamp(uv * s + uw * of_s, uu * of_s) if uu else (0, 1)
    s, of_s = clamp(uv * t - vw * of_t, vv * of_t) if vv else (0, 1)
    gap = [x * of_s * of_t + s * of_t * y - t * of_s * z for x, y, z in zip(w, v, u, strict=True)]
    return Fraction(dot(gap, gap), (of_s * of_t) ** 2)


def is_over_face(p, triangle):
    """Return True if a point lies over a triangle."""
    n = cross(minus(triangle[1], triangle[0]), minus(triangle[2], triangle[0]))
    sides = [(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]
    return any(n) and all(dot(cross(n, minus(b, a)), minus(p, a)) >= 0 for a, b in sides)


def squared_triangle_distance(first, second):
    """Return the squared distance of two triangles, exactly."""
    # Scale to integers, because Python computes faster with them than with fractions.
    unit = max(float(x).as_integer_ratio()[1] for x in np.ravel([first, second]))
    one, two = (
        [[int(Fraction(float(x)) * unit) for x in point] for point in part]
        for part in (first, second)
    )
    best = min(
        squared_segment_distance(one[i], one[(i + 1) % 3], two[j], two[(j + 1) % 3])
        for i, j in product(range(3), repeat=2)
    )
    for points, face in ((one, two), (two, one)):
        n = cross(minus(face[1], face[0]), minus(face[2], face[0]))
        heights = [dot(n, minus(p, face[0])) for p in points]
        for k in range(3):
            if is_over_face(points[k], face):
                best = min(best, Fraction(heights[k] ** 2, dot(n, n)))
            p = points[k]
            q = points[(k + 1) % 3]
            a = heights[k]
            b = heights[(k + 1) % 3]
            if a * b < 0:  # scaled by (a - b), the triangle and the crossing point are integers
                through = [(a - b) * x + a * (y - x) for x, y in zip(p, q, strict=True)]
                if is_over_face(through, [[(a - b) * x for x in corner] for corner in face]):
                    return Fraction(0)
    return best / unit**2


@st.composite
def triangle_pairs(draw):
    """Draw pairs of triangles of any kind.

    They may cross, touch, share a plane, be slivers, have nearly parallel edges, differ in size,
    lie far from the origin, or degenerate to segments and points.
    """
    rng = np.random.default_rng(draw(seeds))
    first, second = rng.uniform(-1, 1, (2, 3, 3))
    kind = draw(
        st.sampled_from(
            ["any", "grid", "plane", "sliver", "parallel", "small", "over", "bare", "through"]
        )
    )
    if kind == "grid":
        first, second = rng.integers(-2, 3, (2, 3, 3)).astype(float)
    elif kind == "plane":
        first[:, 2] = second[:, 2] = rng.uniform(-1, 1)
    elif kind == "sliver":
        first[2] = (
            first[0]
            + rng.uniform(0, 1) * (first[1] - first[0])
            + rng.normal(0, 10.0 ** rng.integers(-17, -5), 3)
        )
    elif kind == "parallel":
        turn = 10.0 ** rng.uniform(-10, -3)
        direction, side = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        lift = np.cross(direction, side) * rng.choice([0.0, 1e-9, 1e-3])
        first[:2] = np.outer([-1, 1], direction)
        second[:2] = np.outer(rng.uniform(-1, 1, 2), direction + turn * side) + lift
        first[2], second[2] = (
            first[0] - np.cross(direction, side),
            second[0] + np.cross(direction, side) + side,
        )
    elif kind == "small":
        second = first.mean(axis=0) + 1e-5 * second
    elif kind == "over":
        second[0] = first.T @ rng.dirichlet(np.ones(3)) + 1e-4 * np.cross(
            first[1] - first[0], first[2] - first[0]
        )
    elif kind == "bare":  # segments and points, some touching
        first[rng.integers(1, 3)] = first[0]
        second[1:] = second[rng.integers(0, 2)]
        second += (
            first.T @ rng.dirichlet(np.ones(3))
            - second[0]
            + rng.choice([0.0, 1e-15, 1e-6]) * rng.normal(size=3)
        )
    elif kind == "through":  # with a common point, or nearly
        second += first.T @ rng.dirichlet(np.full(3, 0.3)) - second.T @ rng.dirichlet(
            np.full(3, 0.3)
        )
        second += rng.choice([0.0, 1e-16, 1e-12]) * rng.normal(size=3)
    shift = rng.uniform(-1, 1, 3) * draw(st.sampled_from([0.0, 1.0, 1e3]))
    return first + shift, second + shift


def to_pieces(triangles, radius=0.0):
    return RoundedSimplices(np.asarray(triangles, dtype=float), np.full(len(triangles), radius))


@kernel
def share(trees, roots, motion, enough, work):
    return free_fraction(trees, roots[0], (-1, roots[1]), motion, enough, work)


class Pair:
    """A robot and obstacles; ``work`` is reused."""

    def __init__(self, robot, obstacles):
        self.trees, roots = build_trees([robot, obstacles], False)
        self.roots, self.work = tuple(roots), np.full((MAX_PENDING_PAIRS, 2), -1)

    def share(self, place=HERE, turn=STILL, step=HERE, angle=0.0, required=0.0, enough=np.inf):
        matrix = tuple(tuple(row) for row in turn.tolist())
        motion = Motion(matrix, tuple(place), tuple(step), float(angle), float(required), 0.0)
        return share(self.trees, self.roots, motion, float(enough), self.work)

    def distance(self, place=HERE, turn=STILL, enough=np.inf):
        """Return the distance at a pose.

        It is the free fraction of a motion by one in every direction.
        """
        self.trees.boxes[:, 6] = 1.0
        return self.share(place, turn, angle=1.0, enough=enough)


# ---- triangles -----------------------------------------------------------------------------------


@examples(200)
@given(triangle_pairs())
def test_distances_are_never_too_large_and_at_most_slightly_too_small(pair):
    square = squared_triangle_distance(*pair)
    size = np.linalg.norm(np.ptp(np.concatenate(pair), axis=0))
    distance = Pair(*(to_pieces(part[None]) for part in pair)).distance()
    proven = Fraction(max(distance, 0.0)) - Fraction(ERROR * size)
    assert proven <= 0 or proven**2 <= square
    assert distance > float(square) ** 0.5 - 1e-7 * size or (
        distance < 0.0 and float(square) ** 0.5 < 1e-7 * size
    )
    assert square > 0 or distance <= ERROR * size


@examples(60)
@given(triangle_pairs(), seeds, st.sampled_from([0.0, 0.2]))
def test_distances_include_pose_and_radius(pair, seed, radius):
    first, second = pair
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    position = rng.uniform(-1, 1, 3)
    true = float(squared_triangle_distance(first @ turn.T + position, second)) ** 0.5 - radius
    distance = Pair(
        to_pieces(first[None], 0.75 * radius), to_pieces(second[None], 0.25 * radius)
    ).distance(position, turn)
    allowed = 1e-11 * np.abs(pair).sum()
    assert distance <= max(true, 0.0) + allowed and (distance > true - 1e-6 or true < 1e-6)


@examples(60)
@given(triangle_pairs(), seeds)
def test_free_fractions_hold_along_the_motion(pair, seed):
    first, second = pair
    rng = np.random.default_rng(seed)
    step = rng.uniform(-2, 2, 3)
    axis = rng.normal(size=3)
    angle = rng.choice([0.0, 0.3, 3.0])
    center = first.mean(axis=0)  # the center of rotation
    robot = first - center
    position = tuple(center)
    required = 1e-12 * np.abs(pair).sum()  # for rounding
    proven = Pair(to_pieces(robot[None]), to_pieces(second[None])).share(
        position, STILL, step, angle, required, enough=1.0
    )
    for t in max(proven, 0.0) * rng.uniform(-1.0, 1.0, 9):
        turn = Rotation.from_rotvec(t * angle * axis / np.linalg.norm(axis)).as_matrix()
        placed = robot @ turn.T + position + t * step
        assert proven < 0.0 or squared_triangle_distance(placed, second) > 0


# ---- trees ---------------------------------------------------------------------------------------


def test_trees_find_the_smallest_distance():
    rng = np.random.default_rng(1)
    body = trimesh.creation.box((0.3, 0.2, 0.1)).triangles
    triangles = rng.uniform(-2, 2, (100, 1, 3)) + rng.normal(0, 0.3, (100, 3, 3))
    radii = rng.choice(np.linspace(0.0, 0.1, 40), 100)
    every = Pair(to_pieces(body), RoundedSimplices(triangles, radii))
    singly = [
        Pair(to_pieces(body), to_pieces(part[None], r))
        for part, r in zip(triangles, radii, strict=True)
    ]
    for seed, q in enumerate(rng.uniform(-2, 2, (20, 3)).tolist()):
        turn = Rotation.random(random_state=seed).as_matrix()
        true = min(part.distance(q, turn) for part in singly)
        for enough in (0.01, 0.1, 0.5, np.inf):
            assert every.distance(q, turn, enough) == pytest.approx(min(true, enough), abs=1e-12)


@kernel
def cross_pairs(pairs, required, displacement, out):
    """Test which triangles (n, 2, 3, 3) are proven to cross, also after a displacement."""
    for n in range(len(pairs)):
        a = pairs[n, 0]
        b = pairs[n, 1]
        one = (a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2])
        two = (b[0, 0], b[0, 1], b[0, 2]), (b[1, 0], b[1, 1], b[1, 2]), (b[2, 0], b[2, 1], b[2, 2])
        out[n] = crosses(one, two, required, displacement)


@examples(150)
@given(triangle_pairs(), seeds, st.sampled_from([1e-12, 1e-3]))
def test_crosses_is_right_for_any_rounding(pair, seed, required):
    """Move the corners about as far as the rounding may be, then by less."""
    rng = np.random.default_rng(seed)
    away = required * 10.0 ** rng.uniform(-1.0, 3.0, (40, 1, 1, 1))
    pairs = np.stack(pair) + away * rng.normal(size=(40, 2, 3, 3))
    crossing = np.empty(40, dtype=np.bool_)
    cross_pairs(pairs, required, 0.0, crossing)
    off = rng.normal(size=pairs.shape)
    off *= 0.25 * required / np.linalg.norm(off, axis=-1, keepdims=True)
    for placed in (*pairs[crossing][:4], *(pairs + off)[crossing][:4]):
        assert not squared_triangle_distance(*placed)


@given(seed=seeds, displacement=st.floats(1e-3, 0.5), flat=st.booleans())
@examples(15)
def test_displaced_triangles_still_cross(seed, displacement, flat):
    """Move one of two triangles, also flat ones, by the largest displacements, in directions that
    separate them."""
    rng = np.random.default_rng(seed)
    pairs = rng.normal(size=(400, 2, 3, 3)) * 10.0 ** rng.uniform(-0.5, 0.5, (400, 2, 1, 1))
    if flat:
        pairs[:, 0, 2] = pairs[:, 0, :2].mean(axis=1) + 0.1 * rng.normal(size=(400, 3))
    crossing = np.empty(400, dtype=np.bool_)
    still = np.empty(400, dtype=np.bool_)
    cross_pairs(pairs, 1e-12, 0.0, crossing)
    cross_pairs(pairs, 1e-12, displacement, still)
    assert not (still & ~crossing).any()
    assert flat or all(squared_triangle_distance(*pair) > 0 for pair in pairs[~crossing][:15])
    for pair in pairs[still][:15]:
        for direction in (*np.eye(3), *rng.normal(size=(4, 3))):
            whole = np.tile(direction, (3, 1)) if rng.random() < 0.7 else rng.normal(size=(3, 3))
            shift = displacement * whole / np.linalg.norm(whole, axis=1, keepdims=True)
            for moved in (0, 1):
                for sign in (-1.0, 1.0):
                    placed = pair.copy()
                    placed[moved] += sign * shift
                    assert not squared_triangle_distance(*placed)
