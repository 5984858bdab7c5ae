"""Exact queries in space, against arithmetic, manifold3d and FCL."""

import math
from itertools import product

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
from cspace.shapes.mesh import Mesh
from tests.helpers.handmade import fill_boxes, map_in
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
    free, state = space.is_free(q, exact=True), space.classify(q)
    assert not (free & (spare <= 0.0)).any()
    assert free[state == FREE].all() and not free[state == BLOCKED].any()
    decided = np.abs(spare) > ORACLE_BAND
    np.testing.assert_array_equal(free[decided], spare[decided] > 0.0)
    return free


def check_edges(space, q0, q1, gaps):
    """Fail unless proven edges keep their distance.

    Other edges must come close to obstacles.
    """
    free, by_map = space.motion_is_free(q0, q1, exact=True), space.motion_is_free(q0, q1)
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


@st.composite
def box_worlds(draw):
    """Draw boxes, the corner of a grid, and a generator."""
    rng = np.random.default_rng(draw(seeds))
    corner = rng.uniform(-2, 2, 3)
    low = corner + rng.uniform(-0.2, 2.2, (int(rng.integers(1, 6)), 3))
    high = low + rng.uniform(0.05, 0.8, low.shape)
    return np.stack([low, high], axis=1), corner, rng


# ---- against boxes and balls ---------------------------------------------------------------------


@pytest.mark.filterwarnings("ignore:the obstacles reach")
@settings(max_examples=15)
@given(
    box_worlds(), st.sampled_from(["blocked", "free"]), st.sampled_from([0.0, 0.07]), st.booleans()
)
def test_boxes_among_boxes_agree_with_arithmetic(world, outside, margin, inner):
    boxes, corner, rng = world
    if outside == "free":  # another test clips boxes
        boxes = np.clip(boxes, corner + 0.01, corner + 2.29)
        boxes = boxes[(boxes[:, 1] - boxes[:, 0] > 0.01).all(axis=1)]
        boxes = boxes if len(boxes) else np.array([[corner + 1.0, corner + 1.2]])
    workspace = Workspace.from_mesh(join_boxes(boxes), 0.1, (*corner, *(corner + 2.3)))
    size, center = rng.uniform(0.05, 0.6, 3), rng.uniform(-0.3, 0.3, 3)
    space = cspace.build(
        workspace, Robot.box(size, center), outside=outside, margin=margin, inner=inner
    )
    gaps = make_gaps(
        space, Blocks.boxes([center - size / 2, center + size / 2]), Blocks.boxes(boxes)
    )
    q0 = draw_near_mixed(space, rng, 150, share=0.75)
    check_points(space, q0, gaps(q0))
    q1 = q0 + rng.normal(0.0, 0.3, q0.shape) * rng.choice([0.1, 1.0, 3.0], (150, 1))
    q1[::7, :2] = q0[::7, :2]
    check_edges(space, q0[:40], q1[:40], gaps)


@settings(max_examples=15)
@given(
    seeds, st.sampled_from(["box", "ball", "balls"]), st.sampled_from([0.0, 0.05]), st.booleans()
)
def test_robots_among_balls_agree_with_arithmetic(seed, kind, margin, points):
    """Move robots of each kind among balls or points."""
    rng = np.random.default_rng(seed)
    centers, radii = (
        rng.uniform(0.2, 1.8, (9, 3)),
        np.zeros(9) if points else rng.uniform(0.02, 0.3, 9),
    )
    workspace = Workspace.from_balls(centers, radii, 0.1, (0, 0, 0, 2, 2, 2))
    size = rng.uniform(0.1, 0.5, 3)
    spots, reach = rng.uniform(-0.2, 0.2, (3, 3)), rng.uniform(0.05, 0.2, 3)
    robot, body = {
        "box": (Robot.box(size), Blocks.boxes([-size / 2, size / 2])),
        "ball": (Robot.ball(0.2, spots[0]), Blocks.balls(spots[:1], np.array([0.2]))),
        "balls": (Robot.from_balls(spots, reach), Blocks.balls(spots, reach)),
    }[kind]
    space = cspace.build(workspace, robot, margin=margin)
    gaps = make_gaps(space, body, Blocks.balls(centers, radii))
    q0 = draw_near_mixed(space, rng, 150, share=0.75)
    check_points(space, q0, gaps(q0))
    q1 = q0 + rng.normal(0.0, 0.2, q0.shape)
    check_edges(space, q0[:25], q1[:25], gaps)


@settings(max_examples=10)
@given(seeds, st.sampled_from([0.0, 0.05]))
def test_ball_among_boxes_agrees_with_arithmetic(seed, margin):
    rng = np.random.default_rng(seed)
    low = rng.uniform(0.1, 1.5, (4, 3))
    boxes = np.stack([low, low + rng.uniform(0.1, 0.4, low.shape)], axis=1)
    center = rng.uniform(-0.1, 0.1, 3)
    workspace = Workspace.from_mesh(join_boxes(boxes), 0.1, (0, 0, 0, 2, 2, 2))
    space = cspace.build(workspace, Robot.ball(0.2, center), margin=margin)
    gaps = make_gaps(space, Blocks.balls(center[None], np.array([0.2])), Blocks.boxes(boxes))
    q0 = draw_near_mixed(space, rng, 200, share=0.75)
    check_points(space, q0, gaps(q0))
    check_edges(space, q0[:40], q0[:40] + rng.normal(0.0, 0.3, (40, 3)), gaps)


@settings(max_examples=10)
@given(seeds, st.sampled_from(["blocked", "free"]))
def test_voxels_among_voxels_agree_with_arithmetic(seed, outside):
    rng = np.random.default_rng(seed)
    world, body = rng.random((14, 12, 10)) < 0.06, rng.random((3, 2, 4)) < 0.5
    body[1, 1, 1] = True
    low, side, lower = rng.uniform(-3, 3, 3), rng.choice([0.1, 0.137]), rng.uniform(-0.3, 0.1, 3)
    workspace = Workspace.from_array(world, 0.1, low)
    space = cspace.build(workspace, Robot.from_bitmap(body, side, lower), outside=outside)
    boxes = low + 0.1 * (np.argwhere(world)[:, None] + np.array([[0], [1]]))
    parts = lower + side * (np.argwhere(body)[:, None] + np.array([[0], [1]]))
    gaps = make_gaps(space, Blocks.boxes(parts), Blocks.boxes(boxes))
    q0 = draw_near_mixed(space, rng, 150, share=0.75)
    check_points(space, q0, gaps(q0))
    check_edges(space, q0[:20], q0[:20] + rng.normal(0.0, 0.15, (20, 3)), gaps)


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
    obstacle, body = draw_blob(rng, 0.7), draw_blob(rng, 0.3)
    space = cspace.build(
        Workspace.from_mesh(obstacle, 0.1, (-1.2, -1.2, -1.2, 1.2, 1.2, 1.2)),
        Robot.from_mesh(body),
        outside="free",
        margin=margin,
        inner=bool(rng.integers(2)),
    )
    fixed, moved = to_manifold(obstacle), to_manifold(body)

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


def test_box_meshes_agree_with_boxes():
    """Compare a box given as a mesh with the box."""
    rng = np.random.default_rng(3)
    low = rng.uniform(0.1, 1.6, (6, 3))
    boxes = np.stack([low, low + 0.25], axis=1)
    workspace = Workspace.from_mesh(join_boxes(boxes), 0.1, (0, 0, 0, 2, 2, 2))
    robot = (np.array([-0.1, -0.2, -0.05]), np.array([0.2, 0.1, 0.15]))
    space = cspace.build(workspace, Robot.from_mesh(trimesh.creation.box(bounds=robot)))
    gaps = make_gaps(space, Blocks.boxes(robot), Blocks.boxes(boxes))
    q0 = draw_near_mixed(space, rng, 200, share=0.75)
    check_points(space, q0, gaps(q0))
    free = check_edges(space, q0[:60], q0[:60] + rng.normal(0.0, 0.2, (60, 3)), gaps)
    assert free.any() and not free.all()
    plain = cspace.build(workspace, Robot.box(robot[1] - robot[0], (robot[0] + robot[1]) / 2))
    np.testing.assert_array_equal(space.is_free(q0, exact=True), plain.is_free(q0, exact=True))


# ---- cases solved by hand ------------------------------------------------------------------------


def make_corridor(share, side=0.6):
    """Build a corridor along x, ``share`` robots wide."""
    half = side * share / 2
    blocks = [[[2, 0, 0], [4, 2 - half, 4]], [[2, 2 + half, 0], [4, 4, 4]]]
    return Workspace.from_mesh(
        join_boxes(np.array(blocks, dtype=float)), side / 3, (0, 0, 0, 6, 4, 4)
    )


BODIES = {
    "box": Robot.box((0.9, 0.6, 0.5)),
    "mesh": Robot.from_mesh(trimesh.creation.box((0.9, 0.6, 0.5))),
    "ball": Robot.ball(0.3),
    "cells": Robot.from_bitmap(np.ones((3, 2, 1), dtype=bool), 0.3, (-0.45, -0.3, -0.15)),
}


@pytest.mark.parametrize("body", BODIES)
def test_only_exact_queries_pass_a_barely_wider_corridor(body):
    wide, narrow = (cspace.build(make_corridor(share), BODIES[body]) for share in (1.02, 0.98))
    edge = [1.0, 2.0, 2.0], [5.0, 2.0, 2.0]
    assert wide.motion_is_free(*edge, exact=True) and not wide.motion_is_free(*edge)
    assert wide.is_free([3.0, 2.0, 2.0], exact=True) and not wide.is_free([3.0, 2.0, 2.0])
    assert not narrow.motion_is_free(*edge, exact=True) and not narrow.is_free(
        [3.0, 2.0, 2.0], exact=True
    )
    assert wide.motion_is_free([1.0, 1.999, 2.0], [5.0, 2.001, 2.1], exact=True)
    assert not wide.motion_is_free([1.0, 1.985, 2.0], [5.0, 2.015, 2.1], exact=True)


@pytest.mark.parametrize("share", [1.0, 1.0 + 1e-13])
@pytest.mark.parametrize("body", BODIES)
def test_corridor_as_wide_as_the_robot_is_blocked(body, share):
    space = cspace.build(make_corridor(share), BODIES[body])
    assert not space.motion_is_free([1.0, 2.0, 2.0], [5.0, 2.0, 2.0], exact=True)
    assert not space.is_free([3.0, 2.0, 2.0], exact=True)


@pytest.mark.parametrize(
    "robot", [Robot.box((1, 1, 1)), Robot.from_mesh(trimesh.creation.box((1, 1, 1)))]
)
def test_touching_counts_as_collision(robot):
    space = cspace.build(Workspace.from_array(fill_boxes((10, 10, 10), np.s_[5, 5, 5]), 1.0), robot)
    for shift in product((-1.0, 0.0, 1.0), repeat=3):  # sides, edges and corners
        direction = np.array(shift)
        assert not space.is_free(5.5 + direction, exact=True)
        assert space.is_free(5.5 + direction * (1.0 + 1e-5), exact=True) or not direction.any()
    assert not space.motion_is_free([4.5, 3.0, 5.5], [4.5, 8.0, 5.5], exact=True)
    assert space.motion_is_free([4.5 - 1e-3, 3.0, 5.5], [4.5 - 1e-3, 8.0, 5.5], exact=True)
    assert not space.is_free([0.5, 2.5, 2.5], exact=True) and space.is_free(
        [0.5 + 1e-6, 2.5, 2.5], exact=True
    )


@pytest.mark.parametrize("mesh", [False, True])
def test_containment_counts_as_collision(mesh):
    """Put a robot into obstacles, and obstacles into a robot."""

    def robot(size):
        return Robot.from_mesh(trimesh.creation.box(size)) if mesh else Robot.box(size)

    block = Workspace.from_mesh(
        trimesh.creation.box(bounds=[[1, 1, 1], [5, 5, 5]]), 0.5, (0, 0, 0, 6, 6, 6)
    )
    within = cspace.build(block, robot((0.5, 0.5, 0.5)), inner=False)
    assert not within.is_free([3.0, 3.1, 3.0], exact=True)
    assert not within.motion_is_free([2.9, 3.0, 3.0], [3.1, 3.0, 3.0], exact=True)
    cells = Workspace.from_array(np.pad(np.ones((8, 8, 8), dtype=bool), 2), 0.5)
    assert not cspace.build(cells, robot((0.5, 0.5, 0.5)), inner=False).is_free(
        [3.0, 3.1, 3.0], exact=True
    )
    for pillar in (
        Workspace.from_points([[3.0, 3.0, 3.0]], 0.5, (0, 0, 0, 6, 6, 6)),
        Workspace.from_mesh(
            trimesh.creation.icosphere(1, 0.1).apply_translation((3, 3, 3)), 0.5, (0, 0, 0, 6, 6, 6)
        ),
        Workspace.from_array(np.pad(np.ones((1, 1, 1), dtype=bool), 6), 6 / 13),
    ):
        around = cspace.build(pillar, robot((4.0, 4.0, 4.0)), inner=False)
        assert not around.is_free([3.1, 3.0, 3.0], exact=True)
        assert not around.motion_is_free([2.9, 3.0, 3.0], [3.1, 3.0, 3.0], exact=True)


def test_hollows_are_free():
    """Put a pillar into a robot, and a robot into obstacles."""
    shell, hole = trimesh.creation.box((4, 4, 4)), trimesh.creation.box((2, 2, 2))
    hole.invert()
    hollow = trimesh.util.concatenate([shell, hole])
    pillar = Workspace.from_mesh(
        trimesh.creation.icosphere(1, 0.1).apply_translation((3, 3, 3)), 0.5, (0, 0, 0, 6, 6, 6)
    )
    carrier = cspace.build(pillar, Robot.from_mesh(hollow), inner=False)
    assert carrier.is_free([3.1, 3.0, 3.0], exact=True)
    assert carrier.motion_is_free([2.9, 3.0, 3.0], [3.1, 3.0, 3.1], exact=True)
    assert not carrier.is_free([4.5, 3.0, 3.0], exact=True)
    house = Workspace.from_mesh(hollow.copy().apply_translation((3, 3, 3)), 0.5, (0, 0, 0, 6, 6, 6))
    guest = cspace.build(house, Robot.box((1.9, 1.9, 1.9)), inner=False)
    assert guest.is_free([3.0, 3.0, 3.04], exact=True) and not guest.is_free(
        [3.0, 3.0, 3.06], exact=True
    )
    assert not cspace.build(house, Robot.ball(0.3), inner=False).is_free(
        [1.5, 3.0, 3.0], exact=True
    )
    skin = Workspace.from_mesh(
        shell.copy().apply_translation((3, 3, 3)), 0.5, (0, 0, 0, 6, 6, 6), solid="surface"
    )
    assert cspace.build(skin, Robot.ball(0.3), inner=False).is_free([1.5, 3.0, 3.0], exact=True)


def test_robot_parts_inside_an_obstacle_collide():
    occupied = np.zeros((40, 3, 3), dtype=bool)
    occupied[[0, 39]] = True
    block = Workspace.from_mesh(
        trimesh.creation.box(bounds=[[3, 0, 0], [6, 6, 6]]), 0.5, (0, 0, 0, 6, 6, 6)
    )
    space = cspace.build(block, Robot.from_bitmap(occupied, 0.1, (-2.0, 0.0, 0.0)), inner=False)
    assert not space.is_free([2.6, 3.0, 3.0], exact=True)


@pytest.mark.parametrize("mesh", [False, True])
def test_thin_robot_never_jumps_over_a_thin_obstacle(mesh):
    points = Workspace.from_points([[1.0, 1.0, 1.0]], 0.25, (0, 0, 0, 2, 2, 2))
    plate = trimesh.creation.box((0.4, 0.4, 0.002))
    space = cspace.build(
        points, Robot.from_mesh(plate) if mesh else Robot.box((0.4, 0.4, 0.002)), inner=False
    )
    rng = np.random.default_rng(0)
    n = 40 if mesh else 400
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


@pytest.mark.parametrize("low", [-1e-310, -5e-324, 1e-310])
def test_denormal_bounds_clip_like_zero(low):
    boxes = np.array([[[-0.5, -0.5, 0.2], [0.4, 0.7, 0.9]], [[0.6, -1.0, -1.0], [0.9, 0.5, 0.3]]])
    workspace = Workspace.from_mesh(join_boxes(boxes), 0.1, (0, low, 0, 2, 2, 2))
    space = cspace.build(workspace, Robot.ball(0.004), outside="free", inner=False)
    rng = np.random.default_rng(0)
    q = rng.uniform(0, 1, (3000, 3)) * rng.choice([1.0, 0.03, 1e-9], (3000, 3))
    point = Blocks.balls(np.zeros((1, 3)), np.zeros(1))
    spare = Pair.of(point, Blocks.boxes(np.maximum(boxes, 0.0))).gaps(q) - 0.004
    assert not space.is_free(q, exact=True)[spare <= 0.0].any()
    away = (q > 0.11).all(axis=1)  # the caps are faces of outer cells
    check_points(space, q[away], spare[away])


@pytest.mark.parametrize("outside", ["blocked", "free"])
@pytest.mark.parametrize("body", BODIES)
def test_far_configurations_are_decided(body, outside):
    space = cspace.build(make_corridor(1.02), BODIES[body], outside=outside)
    for far in (1e3, 1e9, 1e200, 1.7e308):
        assert space.is_free([far, -far, 1.0], exact=True) == (outside == "free")
        assert (
            not space.motion_is_free([1.0, 2.0, 2.0], [far, -far, 1.0], exact=True)
            or outside == "free"
        )


@pytest.mark.parametrize("size", [1e-90, 1e-6, 1e6, 1e90])
def test_results_do_not_depend_on_the_unit_of_length(size):
    half = 0.306 * size
    blocks = np.array([[[2, 0, 0], [4, 2, 4]], [[2, 2, 0], [4, 4, 4]]]) * size
    blocks[0, 1, 1] -= half
    blocks[1, 0, 1] += half
    mesh = Mesh(join_boxes(blocks / size).vertices * size, join_boxes(blocks / size).faces)
    workspace = Workspace.from_mesh(mesh, 0.2 * size, np.array([0, 0, 0, 6, 4, 4]) * size)
    for robot in (Robot.box(np.array([0.9, 0.6, 0.5]) * size), Robot.ball(0.3 * size)):
        space = cspace.build(workspace, robot)
        assert space.motion_is_free(
            np.array([1, 2, 2]) * size, np.array([5, 2, 2]) * size, exact=True
        )
        assert not space.motion_is_free(
            np.array([1, 1.993, 2]) * size, np.array([5, 1.993, 2]) * size, exact=True
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
    proven, t = 0, np.linspace(0.0, 1.0, 500)
    for first in q0[free][:16]:
        rotation = (
            rng.normal(0.0, 0.6, 3) * (0.0, 0.0, 1.0) if turns == "yaw" else rng.normal(0.0, 0.6, 3)
        )
        step, after = rng.normal(0.0, 0.2, 3), Rotation.from_rotvec(rotation) * rotation_of(first)
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
    tip, rotations = np.array([0.0, -1000.0, 0.0]), cspace.Rotations.quaternions(1)
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
