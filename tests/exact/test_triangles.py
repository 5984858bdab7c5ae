"""Distances of triangles in space, against rational numbers and FCL."""

from fractions import Fraction
from itertools import product

import numpy as np
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cspace.exact.triangles import Distances
from cspace.shapes import Pieces
from strategies import seeds

HERE, STILL = (0.0, 0.0, 0.0), np.eye(3)


# ---- exact arithmetic ------------------------------------------------------------------------------------------------


def minus(a, b):
    return [x - y for x, y in zip(a, b, strict=True)]


def dot(a, b):
    return sum(x * y for x, y in zip(a, b, strict=True))


def cross(a, b):
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def clamped(x):
    return min(max(x, Fraction(0)), Fraction(1))


def segments_square(p, q, a, b):
    """Squared distance of two segments, exactly."""
    v, u, w = minus(q, p), minus(b, a), minus(p, a)
    vv, uu, uv, vw, uw = dot(v, v), dot(u, u), dot(u, v), dot(v, w), dot(u, w)
    area = vv * uu - uv * uv
    s = clamped((uv * uw - vw * uu) / area) if area else Fraction(0)
    t = clamped((uv * s + uw) / uu) if uu else Fraction(0)
    s = clamped((uv * t - vw) / vv) if vv else Fraction(0)
    gap = [x + s * y - t * z for x, y, z in zip(w, v, u, strict=True)]
    return dot(gap, gap)


def over_face(p, triangle):
    """Whether a point lies over a triangle, along its normal."""
    n = cross(minus(triangle[1], triangle[0]), minus(triangle[2], triangle[0]))
    sides = [(triangle[k], triangle[(k + 1) % 3]) for k in range(3)]
    return any(n) and all(dot(cross(n, minus(b, a)), minus(p, a)) >= 0 for a, b in sides)


def triangles_square(first, second):
    """Squared distance of two triangles, exactly."""
    one, two = ([[Fraction(float(x)) for x in point] for point in part] for part in (first, second))
    best = min(
        segments_square(one[i], one[(i + 1) % 3], two[j], two[(j + 1) % 3]) for i, j in product(range(3), repeat=2)
    )
    for points, face in ((one, two), (two, one)):
        n = cross(minus(face[1], face[0]), minus(face[2], face[0]))
        heights = [dot(n, minus(p, face[0])) for p in points]
        for k in range(3):
            if over_face(points[k], face):
                best = min(best, heights[k] ** 2 / dot(n, n))
            p, q, a, b = points[k], points[(k + 1) % 3], heights[k], heights[(k + 1) % 3]
            if a * b < 0 and over_face([x + a / (a - b) * (y - x) for x, y in zip(p, q, strict=True)], face):
                return Fraction(0)
    return best


@st.composite
def triangle_pairs(draw):
    """Triangles of any kind: crossing, touching, in one plane, slivers, edges that are all but parallel, small beside
    large, far from the origin."""
    rng = np.random.default_rng(draw(seeds))
    first, second = rng.uniform(-1, 1, (2, 3, 3))
    kind = draw(st.sampled_from(["any", "grid", "plane", "sliver", "parallel", "small", "over"]))
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
    shift = rng.uniform(-1, 1, 3) * draw(st.sampled_from([0.0, 1.0, 1e3]))
    return first + shift, second + shift


def pieces(triangles, radius=0.0):
    return Pieces(np.asarray(triangles, dtype=float), np.full(len(triangles), radius))


def moved(robot, obstacles):
    """Distances between triangles within some thousand metres."""
    return Distances(robot, obstacles, 4e3)


# ---- triangles -------------------------------------------------------------------------------------------------------


@settings(max_examples=200)
@given(triangle_pairs())
def test_distances_are_off_by_no_more_than_they_say(pair):
    first, second = pair
    distances, true = moved(*(pieces(part[None]) for part in pair)), float(triangles_square(first, second)) ** 0.5
    allowed = distances.error + 1e-12 * np.abs(pair).sum()
    assert abs(distances(HERE, STILL, np.inf) - true) <= allowed
    assert allowed < 1e-5
    for enough in (0.5 * true, 0.999 * true):  # what is farther than asked for is not looked at
        assert distances(HERE, STILL, enough) >= enough - allowed
    assert abs(distances(HERE, STILL, 1.001 * true + 1e-3) - true) <= allowed


@settings(max_examples=100)
@given(triangle_pairs(), seeds)
def test_a_robot_that_turns_is_where_its_corners_are(pair, seed):
    first, second = pair
    rng = np.random.default_rng(seed)
    turn, place = Rotation.random(random_state=seed).as_matrix(), rng.uniform(-1, 1, 3)
    distances = moved(pieces(first[None]), pieces(second[None]))
    true = float(triangles_square(first @ turn.T + place, second)) ** 0.5
    assert abs(distances(place.tolist(), turn, np.inf) - true) <= distances.error + 1e-11 * np.abs(pair).sum()


@settings(max_examples=100)
@given(triangle_pairs())
def test_a_ball_is_its_middle_less_its_radius(pair):
    first, second = pair
    middle = np.repeat(first[:1], 3, axis=0)
    true = float(triangles_square(middle, second)) ** 0.5
    distances = moved(pieces(middle[None], 0.2), pieces(second[None]))
    assert abs(distances(HERE, STILL, np.inf) - max(true - 0.2, -0.2)) <= distances.error + 1e-12 * np.abs(pair).sum()


def test_many_trees_give_the_least_distance():
    rng = np.random.default_rng(1)
    body = trimesh.creation.box((0.3, 0.2, 0.1)).triangles
    triangles = rng.uniform(-2, 2, (200, 1, 3)) + rng.normal(0, 0.3, (200, 3, 3))
    radii = rng.choice(np.linspace(0.0, 0.1, 40), 200)
    distances = Distances(pieces(body), Pieces(triangles, radii), 8.0)
    singly = [Distances(pieces(body), pieces(part[None], r), 8.0) for part, r in zip(triangles, radii, strict=True)]
    for seed, q in enumerate(rng.uniform(-2, 2, (20, 3)).tolist()):
        turn = Rotation.random(random_state=seed).as_matrix()
        true = min(part(q, turn, np.inf) for part in singly)
        found = distances(q, turn, np.inf)
        assert abs(found - true) < 1e-9 or (found <= 0.0 and true <= 0.0)
        for enough in (0.01, 0.1, 0.5):
            bound = distances(q, turn, enough)
            assert abs(bound - min(true, enough)) < 1e-9 or (bound <= 0.0 and true <= 0.0)


def test_distances_agree_with_fcl():
    """Two meshes of some thousand triangles each, wherever one is."""
    import fcl

    def model(triangles):
        made = fcl.BVHModel()
        made.beginModel(3 * len(triangles), len(triangles))
        made.addSubModel(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3))
        made.endModel()
        return fcl.CollisionObject(made)

    rng = np.random.default_rng(2)
    body = np.array(trimesh.creation.torus(0.4, 0.1, major_sections=24, minor_sections=12).triangles)
    still = np.concatenate([trimesh.creation.icosphere(3, 0.3).triangles + rng.uniform(-2, 2, 3) for _ in range(9)])
    distances, robot, obstacles = Distances(pieces(body), pieces(still), 8.0), model(body), model(still)
    for seed, q in enumerate(rng.uniform(-2, 2, (60, 3)).tolist()):
        turn = Rotation.random(random_state=seed).as_matrix()
        robot.setTransform(fcl.Transform(turn, q))
        true = max(fcl.distance(robot, obstacles, fcl.DistanceRequest(), fcl.DistanceResult()), 0.0)
        assert abs(max(distances(q, turn, np.inf), 0.0) - true) < 1e-9


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
    distances = Distances(Pieces(moved[None], np.zeros(1)), Pieces(still[None], np.zeros(1)), 3.02761727253206)
    assert distances((0.0, 0.0, 0.0), np.eye(3), 1e4) <= true + distances.error
