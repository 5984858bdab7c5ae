"""Exact queries in space, against arithmetic, manifold3d and FCL."""

import math

import fcl
import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import cspace
from cspace import BLOCKED, FREE, MIXED, Robot, Workspace
from tests.helpers.handmade import map_in
from tests.helpers.placements import ORACLE_BAND, draw_near_mixed
from tests.helpers.solids import rotation_of, surface
from tests.helpers.strategies import seeds
from tests.soak.solids import Blocks, Pair, Walls

# ---- oracles -------------------------------------------------------------------------------------


def join_boxes(boxes):
    """Unite boxes (lower, upper) in one mesh."""
    return trimesh.util.concatenate(
        [trimesh.creation.box(bounds=box) for box in np.reshape(boxes, (-1, 2, 3))]
    )


def make_gaps(space, robot, obstacles):
    """Return a function from positions to (distance - margin)."""
    pairs = [Pair.of(robot, obstacles)]
    if space.outside == "blocked":
        pairs.append(Walls(robot, (np.array(space.grid.lower), np.array(space.grid.upper))))
    return lambda q: np.min([pair.gaps(q) for pair in pairs], axis=0) - space.margin


def check_points(space, q, spare):
    """Fail unless points are free at positive slack."""
    free = space.is_free(q, exact=True)
    state = space.classify(q)
    assert not (free & (spare <= 0.0)).any()
    assert free[state == FREE].all() and not free[state == BLOCKED].any()
    decided = np.abs(spare) > ORACLE_BAND
    np.testing.assert_array_equal(free[decided], spare[decided] > 0.0)
    return free


def check_edges(space, q0, q1, gaps):
    """Fail unless proven edges keep their distance.

    Other edges must come close to obstacles.
    """
    free = space.motion_is_free(q0, q1, exact=True)
    by_map = space.motion_is_free(q0, q1)
    assert free[by_map].all()
    for first, last, proven in zip(q0, q1, free, strict=True):
        points = first + np.linspace(0.0, 1.0, 1000 if proven else 100)[:, None] * (last - first)
        smallest = gaps(points).min()
        assert (
            smallest > 0.0
            if proven
            else smallest < 0.02 * np.linalg.norm(last - first) + ORACLE_BAND
        )
    return free


# ---- against boxes and balls ---------------------------------------------------------------------

LOW = np.array([-0.7, 0.3, 1.1])
HIGH = LOW + 2.0


def draw_obstacles(rng, kind):
    """Draw a workspace between LOW and HIGH, and its obstacles for the oracle."""
    bounds = (*LOW, *HIGH)
    if kind == "boxes":
        low = LOW + rng.uniform(0.05, 1.4, (int(rng.integers(1, 6)), 3))
        boxes = np.stack([low, low + rng.uniform(0.05, 0.5, low.shape)], axis=1)
        return Workspace.from_mesh(join_boxes(boxes), 0.1, bounds), Blocks.boxes(boxes)
    if kind == "balls":
        centers = LOW + rng.uniform(0.3, 1.7, (9, 3))
        radii = rng.uniform(0.0, 0.3, 9) * rng.integers(0, 2)
        return Workspace.from_balls(centers, radii, 0.1, bounds), Blocks.balls(centers, radii)
    cells = rng.random((14, 12, 10)) < 0.05
    boxes = LOW + 0.1 * (np.argwhere(cells)[:, None] + np.array([[0], [1]]))
    return Workspace.from_array(cells, 0.1, LOW), Blocks.boxes(boxes)


def draw_robot(rng, kind):
    """Draw a robot, and its parts for the oracle."""
    if kind == "boxes":
        size = rng.uniform(0.05, 0.6, 3)
        center = rng.uniform(-0.3, 0.3, 3)
        corners = np.array([center - size / 2, center + size / 2])
        if rng.random() < 0.5:
            return Robot.from_mesh(join_boxes(corners)), Blocks.boxes(corners)
        return Robot.box(size, center), Blocks.boxes(corners)
    if kind == "balls":
        centers = rng.uniform(-0.2, 0.2, (3, 3))
        radii = rng.uniform(0.05, 0.2, 3)
        return Robot.from_balls(centers, radii), Blocks.balls(centers, radii)
    cells = rng.random((3, 2, 4)) < 0.5
    cells[1, 1, 1] = True
    lower = rng.uniform(-0.3, 0.1, 3)
    parts = lower + 0.137 * (np.argwhere(cells)[:, None] + np.array([[0], [1]]))
    return Robot.from_bitmap(cells, 0.137, lower), Blocks.boxes(parts)


KINDS = ["boxes", "balls", "cells"]


@settings(max_examples=12)
@given(seed=seeds, outside=st.sampled_from(["blocked", "free"]))
@pytest.mark.parametrize("robot_kind", KINDS)
@pytest.mark.parametrize("obstacle_kind", KINDS)
def test_points_and_edges_agree_with_arithmetic(robot_kind, obstacle_kind, seed, outside):
    rng = np.random.default_rng(seed)
    workspace, obstacles = draw_obstacles(rng, obstacle_kind)
    robot, body = draw_robot(rng, robot_kind)
    margin = rng.choice([0.0, 0.07])
    inner = bool(rng.integers(2))
    space = cspace.build(workspace, robot, outside=outside, margin=margin, inner=inner)
    gaps = make_gaps(space, body, obstacles)
    q0 = draw_near_mixed(space, rng, 100, share=0.75)
    check_points(space, q0, gaps(q0))
    q1 = q0 + rng.normal(0.0, 0.3, q0.shape) * rng.choice([0.1, 1.0, 3.0], (100, 1))
    q1[::7, :2] = q0[::7, :2]
    check_edges(space, q0[:15], q1[:15], gaps)


# ---- meshes, against manifold3d ------------------------------------------------------------------


def to_manifold(mesh):
    return manifold3d.Manifold(
        manifold3d.Mesh(
            np.asarray(mesh.vertices, dtype=np.float32), np.asarray(mesh.faces, dtype=np.uint32)
        )
    )


def round_to_single(mesh):
    """Round the coordinates of a mesh to single precision."""
    return trimesh.Trimesh(np.round(mesh.vertices * 1024) / 1024, mesh.faces, process=False)


def draw_blob(rng, size):
    """Draw a dented ball or a torus."""
    if rng.random() < 0.5:
        mesh = trimesh.creation.icosphere(2 if size > 0.5 else 1, size)
        mesh.vertices *= rng.uniform(0.6, 1.0, len(mesh.vertices))[:, None]
    else:
        mesh = trimesh.creation.torus(0.7 * size, 0.25 * size, major_sections=12, minor_sections=8)
    mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    return round_to_single(mesh)


@settings(max_examples=5)
@given(seeds, st.sampled_from([0.0, 0.0625]))
def test_meshes_agree_with_manifold3d(seed, margin):
    rng = np.random.default_rng(seed)
    obstacle = draw_blob(rng, 0.7)
    body = draw_blob(rng, 0.3)
    space = cspace.build(
        Workspace.from_mesh(obstacle, 0.1, (-1.2, -1.2, -1.2, 1.2, 1.2, 1.2)),
        Robot.from_mesh(body),
        outside="free",
        margin=margin,
        inner=bool(rng.integers(2)),
    )
    fixed = to_manifold(obstacle)
    moved = to_manifold(body)

    def gaps(q):
        # min_gap is zero if the meshes meet, and at most the search length, half a metre.
        return np.array([moved.translate(at.tolist()).min_gap(fixed, 0.5) for at in q]) - margin

    q0 = np.round(draw_near_mixed(space, rng, 40, share=0.75) * 1024) / 1024
    free = check_points(space, q0, gaps(q0))
    assert free.any() and not free.all()
    q1 = q0[:4] + rng.normal(0.0, 0.2, (4, 3))
    for first, last, proven in zip(
        q0, q1, space.motion_is_free(q0[:4], q1, exact=True), strict=False
    ):
        points = first + np.linspace(0.0, 1.0, 40)[:, None] * (last - first)
        if proven:
            assert gaps(points).min() > -ORACLE_BAND
        else:
            largest = 0.05 * np.linalg.norm(last - first) + ORACLE_BAND
            assert any(gaps(part).min() < largest for part in np.array_split(points, 20))


# ---- cases solved by hand ------------------------------------------------------------------------


def cube(size):
    return trimesh.creation.box(size)


SPOT = trimesh.creation.icosphere(1, 0.1).apply_translation((3, 3, 3))
ROOM = (0, 0, 0, 6, 6, 6)


@pytest.mark.parametrize("make", [Robot.box, lambda size: Robot.from_mesh(cube(size))])
def test_containment_counts_as_collision(make):
    """Put a robot into obstacles, and obstacles into a robot; no boundaries meet."""
    block = trimesh.creation.box(bounds=[[1, 1, 1], [5, 5, 5]])
    for size, workspace in (
        (0.5, Workspace.from_mesh(block, 0.5, ROOM)),
        (0.5, Workspace.from_array(np.pad(np.ones((8, 8, 8), dtype=bool), 2), 0.5)),
        (4.0, Workspace.from_points([[3.0, 3.0, 3.0]], 0.5, ROOM)),
        (4.0, Workspace.from_mesh(SPOT, 0.5, ROOM)),
        (4.0, Workspace.from_array(np.pad(np.ones((1, 1, 1), dtype=bool), 6), 6 / 13)),
    ):
        space = cspace.build(workspace, make((size,) * 3), inner=False)
        assert not space.is_free([3.1, 3.0, 3.0], exact=True)
        assert not space.motion_is_free([2.9, 3.0, 3.0], [3.1, 3.0, 3.0], exact=True)


def test_hollows_are_free():
    """Put a ball into a hollow robot, and a robot into a hollow obstacle."""
    shell = cube((4, 4, 4))
    hole = cube((2, 2, 2))
    hole.invert()
    hollow = trimesh.util.concatenate([shell, hole])
    pillar = Workspace.from_mesh(SPOT, 0.5, ROOM)
    carrier = cspace.build(pillar, Robot.from_mesh(hollow), inner=False)
    assert carrier.motion_is_free([2.9, 3.0, 3.0], [3.1, 3.0, 3.1], exact=True)
    assert not carrier.is_free([4.5, 3.0, 3.0], exact=True)
    house = Workspace.from_mesh(hollow.copy().apply_translation((3, 3, 3)), 0.5, ROOM)
    guest = cspace.build(house, Robot.box((1.9, 1.9, 1.9)), inner=False)
    assert guest.is_free([3.0, 3.0, 3.04], exact=True)
    assert not guest.is_free([3.0, 3.0, 3.06], exact=True)
    ball = cspace.build(house, Robot.ball(0.3), inner=False)
    assert not ball.is_free([1.5, 3.0, 3.0], exact=True)


def test_thin_robot_never_jumps_over_a_thin_obstacle():
    points = Workspace.from_points([[1.0, 1.0, 1.0]], 0.25, (0, 0, 0, 2, 2, 2))
    space = cspace.build(points, Robot.box((0.4, 0.4, 0.002)), inner=False)
    rng = np.random.default_rng(0)
    n = 400
    low = np.column_stack([rng.uniform(0.85, 1.15, (n, 2)), rng.uniform(0.7, 0.99, n)])
    high = np.column_stack([rng.uniform(0.85, 1.15, (n, 2)), rng.uniform(1.01, 1.3, n)])
    assert space.is_free(low, exact=True).all() and space.is_free(high, exact=True).all()
    assert not space.motion_is_free(low, high, exact=True).any()
    assert not space.motion_is_free(high, low, exact=True).any()


@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_obstacles_are_clipped_to_the_bounds(outside):
    bar = trimesh.creation.box(bounds=[[2, 1, 1], [9, 3, 3]])
    workspace = Workspace.from_mesh(bar, 0.25, (0, 0, 0, 4, 4, 4))
    for robot in (Robot.ball(0.3), Robot.from_mesh(trimesh.creation.icosphere(3, 0.3))):
        space = cspace.build(workspace, robot, outside=outside)
        assert space.is_free([4.301, 2.0, 2.0], exact=True) == (outside == "free")
        assert not space.is_free([4.29, 2.0, 2.0], exact=True)
        assert not space.is_free([3.6, 2.0, 2.0], exact=True)
        assert space.motion_is_free([4.301, 0.5, 2.0], [4.301, 3.5, 2.0], exact=True) == (
            outside == "free"
        )


# ---- rotating robots -----------------------------------------------------------------------------

TURNS = {"yaw": 8, "any": cspace.Rotations.quaternions(3)}


@pytest.mark.parametrize("turns", TURNS)
@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_rotating_robots_agree_with_fcl(outside, turns):
    """Compare configurations, and 500 along each proven edge."""
    rng = np.random.default_rng(0)
    low = rng.uniform(0.2, 1.6, (5, 3))
    boxes = np.stack([low, low + 0.2], axis=1)
    mesh = trimesh.creation.box(bounds=[[-0.1, -0.05, -0.1], [0.5, 0.1, 0.1]])
    workspace = Workspace.from_mesh(join_boxes(boxes), 0.2, (0, 0, 0, 2, 2, 2))
    space = cspace.build(workspace, Robot.from_mesh(mesh), rotations=TURNS[turns], outside=outside)
    moved, still = (surface(part.vertices, part.faces) for part in (mesh, join_boxes(boxes)))

    corners = np.array(mesh.vertices)

    def gaps(positions, matrices):
        apart = np.empty(len(positions))
        for k, (position, matrix) in enumerate(zip(positions, matrices, strict=True)):
            moved.setTransform(fcl.Transform(matrix, position))
            apart[k] = fcl.distance(moved, still, fcl.DistanceRequest(), fcl.DistanceResult())
        at = corners @ matrices.swapaxes(1, 2) + positions[:, None]
        return (
            apart
            if outside == "free"
            else np.minimum(apart, np.minimum(at, 2.0 - at).min(axis=(1, 2)))
        )

    rotations = (
        rng.uniform(-9.0, 9.0, (150, 1))
        if turns == "yaw"
        else Rotation.random(150, random_state=1).as_quat()
    )
    q0 = np.column_stack([rng.uniform(0.0, 2.0, (150, 3)), rotations])
    free = space.is_free(q0, exact=True)
    true = gaps(q0[:, :3], np.array([rotation_of(q).as_matrix() for q in q0]))
    decided = np.abs(true) > ORACLE_BAND
    np.testing.assert_array_equal(free[decided], true[decided] > 0.0)
    assert 20 < free.sum() < 145
    proven = 0
    t = np.linspace(0.0, 1.0, 500)
    for first in q0[free][:16]:
        rotation = (
            rng.normal(0.0, 0.6, 3) * (0.0, 0.0, 1.0) if turns == "yaw" else rng.normal(0.0, 0.6, 3)
        )
        step = rng.normal(0.0, 0.2, 3)
        after = Rotation.from_rotvec(rotation) * rotation_of(first)
        last = (
            [first[3] + rotation[2]]
            if turns == "yaw"
            else after.as_quat() * rng.choice([-1.0, 1.0])
        )
        answer = space.motion_is_free(first, [*(first[:3] + step), *last], exact=True)
        shares = (t if answer else t[::9])[:, None]
        turned = Rotation.from_rotvec(shares * rotation) * rotation_of(first)
        smallest = gaps(first[:3] + shares * step, turned.as_matrix()).min()
        assert (
            smallest > 0.0
            if answer
            else smallest < 0.03 * (np.abs(step).sum() + np.abs(rotation).sum() + 1.0)
        )
        proven += answer
    assert proven > 3


@pytest.mark.parametrize("turns", TURNS)
def test_half_turns_are_proven_along_both_arcs(turns):
    """Rotate a rod beside a post, which blocks one arc."""
    workspace = Workspace.from_points([[1.0, 1.5, 1.0]], 0.25, (0, 0, 0, 2, 2, 2))
    rod = Robot.box((1.4, 0.1, 0.1), (0.5, 0.0, 0.0))
    space = cspace.build(workspace, rod, rotations=TURNS[turns], outside="free", inner=False)

    def edge(end):
        yaws = np.radians([0.0, end])
        rotation = (
            yaws[:, None]
            if turns == "yaw"
            else Rotation.from_rotvec(yaws[:, None] * [0, 0, 1]).as_quat()
        )
        q0, q1 = np.hstack([np.ones((2, 3)) * (0.9, 0.9, 1.0), rotation])
        return space.motion_is_free(q0, q1, exact=True)

    assert edge(-179.0) and not edge(179.0)
    assert not edge(180.0) and not edge(-180.0)


def test_rotation_jumps_of_ompl_count_as_whole_arcs():
    """Keep the first rotation along the edge, like OMPL.

    A far tip then meets a ball, although the cell of the last rotation is FREE.
    """
    angles = math.pi / 4 + np.array([-1e-5, 1e-5])
    q0, q1 = (
        np.array([x, 50.0, 50.0, 0.0, 0.0, math.sin(a), math.cos(a)])
        for x, a in zip((1.0, 8.0), angles, strict=True)
    )
    tip = np.array([0.0, -1000.0, 0.0])
    rotations = cspace.Rotations.quaternions(1)
    ball = rotation_of(q0).apply(tip) + q1[:3] - (0.1, 0.0, 0.0)
    workspace = Workspace.from_balls([ball], 0.004, 100.0, (0, 0, 0, 1200, 100, 100))
    robot = Robot.ball(0.004, tip)
    slice_of = rotations.assign_slices(robot.shape)
    states = np.full((slice_of.max() + 1, *workspace.grid.shape), MIXED, dtype=np.uint8)
    space = map_in(workspace, robot, states.copy(), rotations, outside="free")
    assert space.motion_is_free(q0, [*q0[:3], *q1[3:]], exact=True)
    states[slice_of[rotations.cell_of(q1[3:])]] = FREE
    space = map_in(workspace, robot, states, rotations, outside="free")
    assert space.is_free(q1) and not space.motion_is_free(q0, q1, exact=True)
