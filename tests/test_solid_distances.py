"""Distances and separating planes of triangles in space, against rational numbers; and the surfaces they are for."""

import builtins
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction
from itertools import product

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage

import cspace
from cspace import InputError, MissingPackageError, Robot, Workspace
from cspace.shapes import Balls
from cspace.exact.distances import Distances
from cspace.raster.bitmaps import cell_boxes, cell_faces
from cspace.exact.surfaces import GROUP, Surface, anchors_of, clipped, groups_of
from cspace.exact.sweeps import _kernels
from cspace.exact.sweeps.convex import Convex, _scene
from strategies import seeds

SCALE = 2.0**38


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


def fcl_distance(first, second):
    return Distances([Surface(first[None])], [Surface(second[None])], SCALE)


# ---- triangles -------------------------------------------------------------------------------------------------------


@settings(max_examples=500)
@given(triangle_pairs())
def test_distances_are_off_by_no_more_than_they_say(pair):
    first, second = pair
    distances, true = fcl_distance(first, second), float(triangles_square(first, second)) ** 0.5
    allowed = distances.error + 1e-12 * np.abs(pair).sum()
    assert abs(distances.least(0.0, 0.0, 0.0, np.inf) - true) <= allowed
    assert allowed < 1e-5


@settings(max_examples=500)
@given(triangle_pairs(), st.sampled_from([0.0, 1e-9, 1e-3, 0.1]))
def test_planes_separate_no_triangles_that_meet(pair, least):
    first, second = pair
    body, still = (_scene([Surface(part[None])], SCALE) for part in pair)
    slack = 1e-12 * np.abs(pair).sum()
    true = float(triangles_square(first, second)) ** 0.5
    apart = _kernels.meshes_are_clear(still, body, *np.zeros(6), (least + slack) * SCALE)
    assert true > least if apart else least > 0.0 or true < 1e-6


@settings(max_examples=300)
@given(triangle_pairs(), seeds)
def test_what_is_swept_is_what_is_passed(pair, seed):
    """A triangle, a box and a ball along a vector: what is clear all the way is so at each place, and the converse."""
    first, second = pair
    rng = np.random.default_rng(seed)
    way = rng.normal(size=3) * rng.choice([1e-6, 0.1, 1.0])
    ball = np.array([[*first[0], 0.2]]) * SCALE
    box = np.array([[*first.min(axis=0), *first.max(axis=0)]]) * SCALE
    still, slack = _scene([Surface(second[None])], SCALE), 1e-12 * np.abs(pair).sum() * SCALE
    bodies = [
        (_kernels.meshes_are_clear, _scene([Surface(first[None])], SCALE)),
        (_kernels.boxes_are_clear, box),
        (_kernels.balls_are_clear, ball),
    ]
    for clear, body in bodies:
        steps = np.linspace(0.0, 1.0, 200)[:, None] * way * SCALE
        if clear(still, body, 0.0, 0.0, 0.0, *(way * SCALE), slack):
            assert all(clear(still, body, *step, *np.zeros(3), slack) for step in steps)
        else:  # between two places the body moves by half a hundredth of the way
            wide = slack + 0.01 * np.linalg.norm(way) * SCALE
            assert not all(clear(still, body, *step, *np.zeros(3), wide) for step in steps)


@settings(max_examples=200)
@given(triangle_pairs(), st.booleans())
def test_balls_that_move_keep_their_distance(pair, moves):
    """A ball along a segment against a triangle is a thin triangle grown by its radius."""
    first, second = pair
    end = first[1] if moves else first[0]
    path = np.array([first[0], end, end])
    true = float(triangles_square(path, second)) ** 0.5
    still = _scene([Surface(second[None])], SCALE)
    slack = 1e-12 * np.abs(pair).sum()
    for radius in (0.999 * true - 1e-6, true + 1e-9):
        if radius > 0.0:
            ball = np.array([[*first[0], radius]]) * SCALE
            clear = _kernels.balls_are_clear(still, ball, 0.0, 0.0, 0.0, *((end - first[0]) * SCALE), slack * SCALE)
            assert clear == (radius < true)


def test_groups_share_out_all_triangles():
    rng = np.random.default_rng(0)
    triangles = rng.normal(size=(1000, 3, 3))
    groups = list(groups_of(triangles))
    assert max(map(len, groups)) <= GROUP and len(groups) < 20
    together = np.concatenate(groups).reshape(1000, 9)
    np.testing.assert_array_equal(np.sort(together, axis=0), np.sort(triangles.reshape(1000, 9), axis=0))
    assert not list(groups_of(np.empty((0, 3, 3))))


def test_many_groups_give_the_least_distance(monkeypatch):
    monkeypatch.setattr("cspace.exact.surfaces.GROUP", 4)
    rng = np.random.default_rng(1)
    body = trimesh.creation.box((0.3, 0.2, 0.1)).triangles
    triangles = rng.uniform(-2, 2, (400, 1, 3)) + rng.normal(0, 0.3, (400, 3, 3))
    distances = Distances([Surface(body)], [Surface(triangles), Surface(triangles[:9] + 1.0, 0.1)], SCALE)
    surfaces = [Surface(part[None]) for part in triangles] + [Surface(part[None] + 1.0, 0.1) for part in triangles[:9]]
    singly = [Distances([Surface(body)], [surface], SCALE) for surface in surfaces]
    for q in rng.uniform(-2, 2, (20, 3)):
        true = min(part.least(*q, np.inf) for part in singly)
        found = distances.least(*q, np.inf)
        assert abs(found - true) < 1e-9 or (found <= 0.0 and true <= 0.0)
        for enough in (0.01, 0.1, 0.5):
            bound = distances.least(*q, enough)
            assert min(true, enough) - 1e-9 <= bound <= true + 1e-9 or true <= 0.0


def areas(triangles):
    return 0.5 * np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)


# ---- surfaces --------------------------------------------------------------------------------------------------------


@settings(max_examples=40)
@given(seeds)
def test_faces_of_cells_are_their_border(seed):
    rng = np.random.default_rng(seed)
    cells = rng.random(rng.integers(1, 7, 3)) < 0.5
    triangles = cell_faces(cells, 1.0, (0.0, 0.0, 0.0))
    padded = np.pad(cells, 1)
    area = sum(int((np.diff(padded.astype(int), axis=axis) != 0).sum()) for axis in range(3))
    assert areas(triangles).sum() == pytest.approx(area)
    for triangle in triangles:  # each lies between cells that are set and ones that are not
        axis = int(np.argmin(np.ptp(triangle, axis=0)))
        point = triangle.T @ (0.52, 0.27, 0.21)
        sides = [padded[tuple(np.floor(point + sign * np.eye(3)[axis] / 2).astype(int) + 1)] for sign in (-1, 1)]
        assert sides[0] != sides[1]
    boxes = cell_boxes(cells, 1.0, (0.0, 0.0, 0.0))
    rebuilt = np.zeros(cells.shape, dtype=int)
    for x0, y0, z0, x1, y1, z1 in boxes.astype(int):
        rebuilt[x0:x1, y0:y1, z0:z1] += 1
    np.testing.assert_array_equal(rebuilt, cells)
    assert len(anchors_of(Surface(triangles))) >= ndimage.label(cells, np.ones((3, 3, 3)))[1]


@settings(max_examples=40)
@given(seeds)
def test_clipping_leaves_what_is_in_the_box(seed):
    rng = np.random.default_rng(seed)
    grid = cspace.Grid((0.0, 0.0, 0.0), 0.5, (2, 2, 2))
    triangles = rng.uniform(-1, 2, (5, 3, 3))
    triangles[0, :, 0] = 1.0  # on a border of the box
    parts = clipped(triangles, grid)
    assert (parts >= 0.0).all() and (parts <= 1.0).all()

    weights = rng.dirichlet(np.ones(3), 20_000)
    for triangle in triangles:
        inside = (np.abs(weights @ triangle - 0.5) <= 0.5 + 1e-9).all(axis=1).mean()
        whole = areas(triangle[None])[0]
        assert areas(clipped(triangle[None], grid)).sum() == pytest.approx(inside * whole, abs=0.03 * whole)


# ---- errors, counts, threads -----------------------------------------------------------------------------------------


def points_space(robot, **options):
    rng = np.random.default_rng(5)
    workspace = Workspace.from_balls(rng.uniform(0, 2, (12, 3)), 0.05, 0.1, (0, 0, 0, 2, 2, 2))
    return cspace.build(workspace, robot, **options)


def undecided(space):
    """Middles of the MIXED cells."""
    return space.grid.center_of(np.argwhere(space.state == cspace.MIXED))


def test_a_missing_package_is_named(monkeypatch):
    real = builtins.__import__

    def without(name, *rest, **more):
        if name == "fcl":
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    space = points_space(Robot.box((0.3, 0.3, 0.3)))
    q = undecided(space)
    calls = (
        lambda: space.is_free(q, exact=True),
        lambda: space.motion_is_free(q, q + 0.01, exact=True),
        lambda: space.point_checker(exact=True),
        lambda: space.edge_checker(exact=True),
    )
    for call in calls:
        with pytest.raises(MissingPackageError, match=r'pip install "cspace\[exact\]"'):
            call()
    balls = points_space(Robot.ball(0.1))
    assert balls.is_free(undecided(balls), exact=True).any()


def test_what_depends_on_the_spacing_is_refused():
    mesh = trimesh.creation.box((0.3, 0.3, 0.3))
    space = points_space(Robot.mesh(mesh, solid="fill"))
    with pytest.raises(InputError, match=r"solid='fill'.*pass solid='auto'"):
        space.is_free(undecided(space), exact=True)


ROBOTS = {
    "box": (Robot.box((0.3, 0.2, 0.3)), 0.0),
    "mesh": (Robot.mesh(trimesh.creation.icosphere(1, 0.2)), 0.0),
    "balls": (Robot.balls([[0, 0, 0], [0.1, 0, 0]], [0.1, 0.15]), 0.02),
}


@pytest.mark.parametrize("kind", ROBOTS)
def test_batches_checkers_and_threads_answer_as_single_look_ups(kind):
    robot, margin = ROBOTS[kind]
    space, other = points_space(robot, margin=margin), points_space(robot, margin=margin)
    rng = np.random.default_rng(1)
    q0 = rng.uniform(-0.1, 2.1, (200, 3))
    q1 = q0 + rng.normal(0.0, 0.2, q0.shape)
    free, edges = space.is_free(q0, exact=True), space.motion_is_free(q0, q1, exact=True)
    assert 0 < free.sum() < 200 and 0 < edges.sum() < 200
    point, edge = other.point_checker(exact=True), other.edge_checker(exact=True)

    def ask(part):
        return [(point(*a), edge(*a, *b)) for a, b in part]

    pairs = list(zip(q0.tolist(), q1.tolist(), strict=True))
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(ask, [pairs[k::8] for k in range(8)]))
    for k in range(8):
        assert answers[k] == list(zip(free[k::8].tolist(), edges[k::8].tolist(), strict=True))
    assert space.exact_counts == other.exact_counts and space.exact_counts["point"] > 0
    for k in range(0, 200, 10):
        assert space.is_free(q0[k], exact=True) is bool(free[k])
        assert space.motion_is_free(q0[k], q1[k], exact=True) is bool(edges[k])
    assert space.is_free(np.empty((0, 3)), exact=True).shape == (0,)
    with pytest.raises(InputError, match="NaN, infinities"):
        space.is_free([np.nan, 0.0, 0.0], exact=True)
    with pytest.raises(InputError, match="NaN, infinities"):
        space.motion_is_free([0.0, 0.0, 0.0], [np.inf, 0.0, 0.0], exact=True)


def test_decided_cells_answer_without_geometry():
    space = points_space(Robot.ball(0.1))
    q = space.grid.center_of(np.argwhere(space.state != cspace.MIXED))
    np.testing.assert_array_equal(space.is_free(q, exact=True), space.classify(q) == cspace.FREE)
    assert space.exact_counts == {"point": 0, "edge": 0, "distance": 0}


def test_no_obstacles_at_all():
    space = cspace.build(Workspace.from_array(np.zeros((5, 5, 5), dtype=bool), 0.2), Robot.box((0.3, 0.3, 0.3)))
    assert space.is_free([0.15 + 1e-9, 0.5, 0.5], exact=True) and not space.is_free([0.15, 0.5, 0.5], exact=True)
    assert space.motion_is_free([0.2, 0.2, 0.2], [0.8, 0.8, 0.8], exact=True)
    bodies = [Balls(np.zeros((1, 3)), np.ones(1))]
    assert Convex(bodies[0], [], [], 1.0, 0.0).clear((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0)


# ---- real data -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mesh", [False, True])
def test_ztunnel_agrees_with_boxes(data, mesh):
    """Nine boxes along the axes and a cube, which paper and pencil decide."""
    folder = data / "solids" / "ZTunnel"
    obstacles = trimesh.load(folder / "obstacles.obj", force="mesh", process=True)
    boxes = np.array([part.bounds for part in obstacles.split(only_watertight=False)])
    cube = trimesh.load(folder / "robot.obj", force="mesh").bounds
    workspace = Workspace.from_mesh(folder / "obstacles.obj", 0.1)
    size = cube[1] - cube[0]
    robot = Robot.mesh(folder / "robot.obj") if mesh else Robot.box(size, cube.mean(axis=0))
    space = cspace.build(workspace, robot)
    rng = np.random.default_rng(0)
    cells = np.argwhere(space.state == cspace.MIXED)
    q = space.grid.lower + 0.1 * (cells[rng.integers(len(cells), size=2000)] + rng.random((2000, 3)))
    low, high = q[:, None] + cube[0], q[:, None] + cube[1]
    meets = ((low <= boxes[:, 1]) & (high >= boxes[:, 0])).all(axis=-1).any(axis=1)
    walls = ((q + cube[0] <= space.grid.lower) | (q + cube[1] >= space.grid.upper)).any(axis=1)
    np.testing.assert_array_equal(space.is_free(q, exact=True), ~(meets | walls))
