"""Triangles that are proven apart, against rational numbers and FCL."""

from fractions import Fraction
from itertools import product

import fcl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import solids
from cspace.compiling import kernel
from cspace.exact.triangles import MAX_PENDING_PAIRS, Motion, build_trees, crosses, free_fraction
from cspace.shapes import Pieces
from oracles import cross, dot, minus
from strategies import seeds

HERE, STILL = (0.0, 0.0, 0.0), np.eye(3)
ERROR = 2.0**-48
"""By how much a distance may be too large, in diameters of both triangles together."""


# ---- exact arithmetic ------------------------------------------------------------------------------------------------


def clamped(above, below):
    """A quotient between 0 and 1, as a number above a number."""
    return (0, 1) if above <= 0 else (1, 1) if above >= below else (above, below)


def segments_square(p, q, a, b):
    """Squared distance of two segments of whole numbers, exactly."""
    v, u, w = minus(q, p), minus(b, a), minus(p, a)
    vv, uu, uv, vw, uw = dot(v, v), dot(u, u), dot(u, v), dot(v, w), dot(u, w)
    area = vv * uu - uv * uv
    s, of_s = clamped(uv * uw - vw * uu, area) if area else (0, 1)
    t, of_t = clamped(uv * s + uw * of_s, uu * of_s) if uu else (0, 1)
    s, of_s = clamped(uv * t - vw * of_t, vv * of_t) if vv else (0, 1)
    gap = [x * of_s * of_t + s * of_t * y - t * of_s * z for x, y, z in zip(w, v, u, strict=True)]
    return Fraction(dot(gap, gap), (of_s * of_t) ** 2)


def over_face(p, triangle):
    """Whether a point lies over a triangle, along its normal."""
    n = cross(minus(triangle[1], triangle[0]), minus(triangle[2], triangle[0]))
    sides = [(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]
    return any(n) and all(dot(cross(n, minus(b, a)), minus(p, a)) >= 0 for a, b in sides)


def triangles_square(first, second):
    """Squared distance of two triangles, exactly."""
    # In parts of a metre of which every number is a whole one: Python is quicker with these than with fractions.
    unit = max(float(x).as_integer_ratio()[1] for x in np.ravel([first, second]))
    one, two = ([[int(Fraction(float(x)) * unit) for x in point] for point in part] for part in (first, second))
    best = min(
        segments_square(one[i], one[(i + 1) % 3], two[j], two[(j + 1) % 3]) for i, j in product(range(3), repeat=2)
    )
    for points, face in ((one, two), (two, one)):
        n = cross(minus(face[1], face[0]), minus(face[2], face[0]))
        heights = [dot(n, minus(p, face[0])) for p in points]
        for k in range(3):
            if over_face(points[k], face):
                best = min(best, Fraction(heights[k] ** 2, dot(n, n)))
            p, q, a, b = points[k], points[(k + 1) % 3], heights[k], heights[(k + 1) % 3]
            if a * b < 0:  # as many times larger, the triangle and where the edge goes through its plane are whole
                through = [(a - b) * x + a * (y - x) for x, y in zip(p, q, strict=True)]
                if over_face(through, [[(a - b) * x for x in corner] for corner in face]):
                    return Fraction(0)
    return best / unit**2


@st.composite
def triangle_pairs(draw):
    """Triangles of any kind: crossing, touching, in one plane, slivers, edges that are all but parallel, small beside
    large, far from the origin, points and segments."""
    rng = np.random.default_rng(draw(seeds))
    first, second = rng.uniform(-1, 1, (2, 3, 3))
    kind = draw(st.sampled_from(["any", "grid", "plane", "sliver", "parallel", "small", "over", "bare", "through"]))
    if kind == "grid":
        first, second = rng.integers(-2, 3, (2, 3, 3)).astype(float)
    elif kind == "plane":
        first[:, 2] = second[:, 2] = rng.uniform(-1, 1)
    elif kind == "sliver":
        first[2] = (
            first[0] + rng.uniform(0, 1) * (first[1] - first[0]) + rng.normal(0, 10.0 ** rng.integers(-17, -5), 3)
        )
    elif kind == "parallel":
        turn = 10.0 ** rng.uniform(-10, -3)
        way, side = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
        lift = np.cross(way, side) * rng.choice([0.0, 1e-9, 1e-3])
        first[:2] = np.outer([-1, 1], way)
        second[:2] = np.outer(rng.uniform(-1, 1, 2), way + turn * side) + lift
        first[2], second[2] = first[0] - np.cross(way, side), second[0] + np.cross(way, side) + side
    elif kind == "small":
        second = first.mean(axis=0) + 1e-5 * second
    elif kind == "over":
        second[0] = first.T @ rng.dirichlet(np.ones(3)) + 1e-4 * np.cross(first[1] - first[0], first[2] - first[0])
    elif kind == "bare":  # segments and points, and what touches them
        first[rng.integers(1, 3)] = first[0]
        second[1:] = second[rng.integers(0, 2)]
        second += first.T @ rng.dirichlet(np.ones(3)) - second[0] + rng.choice([0.0, 1e-15, 1e-6]) * rng.normal(size=3)
    elif kind == "through":  # a point of both, or almost
        second += first.T @ rng.dirichlet(np.full(3, 0.3)) - second.T @ rng.dirichlet(np.full(3, 0.3))
        second += rng.choice([0.0, 1e-16, 1e-12]) * rng.normal(size=3)
    shift = rng.uniform(-1, 1, 3) * draw(st.sampled_from([0.0, 1.0, 1e3]))
    return first + shift, second + shift


def pieces(triangles, radius=0.0):
    return Pieces(np.asarray(triangles, dtype=float), np.full(len(triangles), radius))


@kernel
def share(trees, roots, motion, enough, work):
    return free_fraction(trees, roots[0], (-1, roots[1]), motion, enough, work)


class Pair:
    """A robot and obstacles; ``work`` is kept, as along an edge."""

    def __init__(self, robot, obstacles):
        self.trees, roots = build_trees([robot, obstacles], False)
        self.roots, self.work = tuple(roots), np.full(MAX_PENDING_PAIRS, -1)

    def share(self, place=HERE, turn=STILL, step=HERE, angle=0.0, least=0.0, enough=np.inf):
        matrix = tuple(tuple(row) for row in turn.tolist())
        motion = Motion(matrix, tuple(place), tuple(step), float(angle), float(least), 0.0)
        return share(self.trees, self.roots, motion, float(enough), self.work)

    def distance(self, place=HERE, turn=STILL, enough=np.inf):
        """That of the robot there: of a motion on which all moves by one, whichever way, it is the part."""
        self.trees.boxes[:, 6] = 1.0
        return self.share(place, turn, angle=1.0, enough=enough)


# ---- triangles -------------------------------------------------------------------------------------------------------


@settings(max_examples=200)
@given(triangle_pairs())
def test_distances_are_never_too_large_and_hardly_too_small(pair):
    square = triangles_square(*pair)
    size = np.linalg.norm(np.ptp(np.concatenate(pair), axis=0))
    distance = Pair(*(pieces(part[None]) for part in pair)).distance()
    proven = Fraction(max(distance, 0.0)) - Fraction(ERROR * size)
    assert proven <= 0 or proven**2 <= square
    assert distance > float(square) ** 0.5 - 1e-7 * size or (distance < 0.0 and float(square) ** 0.5 < 1e-7 * size)
    assert square > 0 or distance <= ERROR * size


@pytest.mark.parametrize("scale", [2.0**-400, 2.0**-150, 2.0**-20, 1.0])
@pytest.mark.parametrize("beside", [0.0, 1.0])
def test_what_touches_is_not_apart(scale, beside):
    """At the size of the map, or tiny, in the middle of it or not."""
    face = scale * np.array([[0.0, 0, 0], [4, 0, 0], [0, 4, 0]])
    touching = [
        [[1.0, 1, 0], [1, 1, 3], [2, 1, 3]],  # a corner on the face
        [[2, 2, 0], [3, 3, 1], [3, 3, -1]],  # a corner on an edge
        [[4, 0, 0], [5, 0, 0], [5, 1, 1]],  # a corner on a corner
        [[2, -1, 1], [2, 1, -1], [9, -9, 0]],  # an edge across an edge
        [[1, 1, -1], [1, 1, 1], [1, 1, 2]],  # no more than an edge, through the face
        [[1, 1, 0], [1, 1, 0], [1, 1, 0]],  # no more than a point
        [[0, 0, 0], [4, 0, 0], [0, -4, 0]],  # in one plane, along an edge
        [[0, 0, 0], [4, 0, 0], [0, 4, 0]],  # the same
        [[-9, -9, 0], [9, -9, 0], [0, 99, 0]],  # one within the other
    ]
    for other in touching:
        pair = [part + beside for part in (face, scale * np.array(other))]
        for first, second in (pair, pair[::-1]):
            assert Pair(pieces(first[None]), pieces(second[None])).distance() <= 0.0


@settings(max_examples=60)
@given(triangle_pairs(), seeds, st.sampled_from([0.0, 0.2]))
def test_a_robot_is_where_its_corners_are_grown_by_its_radius(pair, seed, radius):
    first, second = pair
    rng = np.random.default_rng(seed)
    turn, place = Rotation.random(random_state=seed).as_matrix(), rng.uniform(-1, 1, 3)
    true = float(triangles_square(first @ turn.T + place, second)) ** 0.5 - radius
    distance = Pair(pieces(first[None], 0.75 * radius), pieces(second[None], 0.25 * radius)).distance(place, turn)
    allowed = 1e-11 * np.abs(pair).sum()
    assert distance <= max(true, 0.0) + allowed and (distance > true - 1e-6 or true < 1e-6)


@settings(max_examples=60)
@given(triangle_pairs(), seeds)
def test_what_is_proven_of_a_motion_holds_all_along_it(pair, seed):
    first, second = pair
    rng = np.random.default_rng(seed)
    step, axis, angle = rng.uniform(-2, 2, 3), rng.normal(size=3), rng.choice([0.0, 0.3, 3.0])
    middle = first.mean(axis=0)  # it turns about it
    robot, place = first - middle, tuple(middle)
    least = 1e-12 * np.abs(pair).sum()  # for rounding
    proven = Pair(pieces(robot[None]), pieces(second[None])).share(place, STILL, step, angle, least, enough=1.0)
    for t in max(proven, 0.0) * rng.uniform(-1.0, 1.0, 9):
        turn = Rotation.from_rotvec(t * angle * axis / np.linalg.norm(axis)).as_matrix()
        placed = robot @ turn.T + place + t * step
        assert proven < 0.0 or triangles_square(placed, second) > 0


def test_a_motion_along_a_face_is_proven_in_one_step():
    plate = np.array([[[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]])
    body = np.array([[[-1.0, 0, 1e-6], [1, 0, 1e-6], [0, 0, 1]]])
    assert Pair(pieces(body), pieces(plate)).share(step=(4.0, 3.0, 0.0), enough=1.0) == 1.0


# ---- trees -----------------------------------------------------------------------------------------------------------


def test_trees_give_the_least_distance_of_all_pairs():
    rng = np.random.default_rng(1)
    body = trimesh.creation.box((0.3, 0.2, 0.1)).triangles
    triangles = rng.uniform(-2, 2, (100, 1, 3)) + rng.normal(0, 0.3, (100, 3, 3))
    radii = rng.choice(np.linspace(0.0, 0.1, 40), 100)
    every = Pair(pieces(body), Pieces(triangles, radii))
    singly = [Pair(pieces(body), pieces(part[None], r)) for part, r in zip(triangles, radii, strict=True)]
    for seed, q in enumerate(rng.uniform(-2, 2, (20, 3)).tolist()):
        turn = Rotation.random(random_state=seed).as_matrix()
        true = min(part.distance(q, turn) for part in singly)
        for enough in (0.01, 0.1, 0.5, np.inf):
            assert every.distance(q, turn, enough) == pytest.approx(min(true, enough), abs=1e-12)


def test_distances_agree_with_fcl():
    """Two meshes of some thousand triangles each, wherever one is."""

    def model(triangles):
        return solids.surface(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))

    rng = np.random.default_rng(2)
    body = np.array(trimesh.creation.torus(0.4, 0.1, major_sections=24, minor_sections=12).triangles)
    still = np.concatenate([trimesh.creation.icosphere(3, 0.3).triangles + rng.uniform(-2, 2, 3) for _ in range(9)])
    pair, robot, obstacles = Pair(pieces(body), pieces(still)), model(body), model(still)
    for seed, q in enumerate(rng.uniform(-2, 2, (60, 3)).tolist()):
        turn = Rotation.random(random_state=seed).as_matrix()
        robot.setTransform(fcl.Transform(turn, q))
        true = max(fcl.distance(robot, obstacles, fcl.DistanceRequest(), fcl.DistanceResult()), 0.0)
        assert max(pair.distance(q, turn), 0.0) == pytest.approx(true, abs=1e-9)


def test_a_corner_near_a_face_beside_edges_all_but_parallel() -> None:
    # coal takes the edges, which are 6.2e-7 apart, for what is nearest.
    moved = np.array(
        [
            [0.7879820706501715, -1.51380863626603, -1.3968812231991985],
            [-0.7879820706501715, 1.51380863626603, 1.3968812231991985],
            [-0.0001509077825400098, 4.2329339944818525e-05, -0.00012944372095702778],
        ]
    )
    still = np.array(
        [
            [0.2104916921857653, -0.4043803467734642, -0.3731464752609409],
            [-0.21049273177720212, 0.40438152797657406, 0.37314618671980027],
            [-0.00020352723140697567, 0.003455559411090747, 0.002587586194518794],
        ]
    )
    normal = np.cross(moved[1] - moved[0], moved[2] - moved[0])
    true = abs((still[0] - moved[0]) @ normal) / np.linalg.norm(normal)  # at most, as the corner is over the face
    assert 0.0 < Pair(pieces(moved[None]), pieces(still[None])).distance() <= true * (1.0 + 1e-12)


@kernel
def cross_each(pairs, least, out):
    """What is proven of pairs of triangles, shape (n, 2, 3, 3)."""
    for n in range(len(pairs)):
        a, b = pairs[n, 0], pairs[n, 1]
        one = (a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2])
        two = (b[0, 0], b[0, 1], b[0, 2]), (b[1, 0], b[1, 1], b[1, 2]), (b[2, 0], b[2, 1], b[2, 2])
        out[n] = crosses(one, two, least)


@pytest.mark.parametrize("least", [1e-12, 1e-3])
@pytest.mark.parametrize("case", ["any", "slivers", "touching", "one plane"])
def test_triangles_that_are_proven_to_cross_do_wherever_rounding_puts_them(case, least):
    """Near-degenerate ones too: flat, long, with a corner on the other one, or all but in its plane."""
    rng = np.random.default_rng(7)
    number = 300
    pairs = rng.normal(size=(number, 2, 3, 3)) * 10.0 ** rng.uniform(-1.5, 0.5, (number, 2, 1, 1))
    near = least * 10.0 ** rng.uniform(-1.0, 3.0, (number, 1))
    within = rng.dirichlet((1.0, 1.0, 1.0), number)
    if case == "slivers":
        pairs[:, 0, 2] = pairs[:, 0, 0] + 0.4 * (pairs[:, 0, 1] - pairs[:, 0, 0]) + near * rng.normal(size=(number, 3))
        pairs[:, 1] += (np.einsum("nk,nkj->nj", within, pairs[:, 0]) - pairs[:, 1].mean(axis=1))[:, None]
    elif case == "touching":
        at = np.einsum("nk,nkj->nj", within, pairs[:, 1])
        pairs[:, 0] += (at - pairs[:, 0, 0] + near * rng.normal(size=(number, 3)))[:, None]
    elif case == "one plane":
        flat = np.einsum("nkj,njl->nkl", rng.normal(size=(number, 3, 2)), pairs[:, 1, :2])
        pairs[:, 1, 2] = pairs[:, 1, 0] + pairs[:, 1, 1]
        pairs[:, 1, 0] = 0.0
        pairs[:, 0] = flat + near[:, None] * rng.normal(size=(number, 3, 3))
    crossing = np.empty(number, dtype=np.bool_)
    cross_each(pairs, least, crossing)
    off = rng.normal(size=pairs.shape)
    off *= 0.25 * least / np.linalg.norm(off, axis=-1, keepdims=True)
    assert crossing.sum() > 10
    for chosen in (pairs[crossing][:40], (pairs + off)[crossing][:40]):
        assert not any(triangles_square(*pair) for pair in chosen)
    if case == "any" and least < 1e-6:
        assert all(triangles_square(*pair) > 0 for pair in pairs[~crossing][:40])
