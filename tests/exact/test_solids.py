"""Exact queries in space: cases solved by hand; tests/test_proofs.py draws cases."""

import math

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import cspace
from cspace import FREE, MIXED, Robot, Workspace
from tests.helpers.handmade import map_in
from tests.helpers.solids import rotation_of


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
        assert not space.exact.is_free([3.1, 3.0, 3.0])
        assert not space.exact.motion_is_free([2.9, 3.0, 3.0], [3.1, 3.0, 3.0])


def test_hollows_are_free():
    """Put a ball into a hollow robot, and a robot into a hollow obstacle."""
    shell = cube((4, 4, 4))
    hole = cube((2, 2, 2))
    hole.invert()
    hollow = trimesh.util.concatenate([shell, hole])
    pillar = Workspace.from_mesh(SPOT, 0.5, ROOM)
    carrier = cspace.build(pillar, Robot.from_mesh(hollow), inner=False)
    assert carrier.exact.motion_is_free([2.9, 3.0, 3.0], [3.1, 3.0, 3.1])
    assert not carrier.exact.is_free([4.5, 3.0, 3.0])
    house = Workspace.from_mesh(hollow.copy().apply_translation((3, 3, 3)), 0.5, ROOM)
    guest = cspace.build(house, Robot.box((1.9, 1.9, 1.9)), inner=False)
    assert guest.exact.is_free([3.0, 3.0, 3.04])
    assert not guest.exact.is_free([3.0, 3.0, 3.06])
    ball = cspace.build(house, Robot.ball(0.3), inner=False)
    assert not ball.exact.is_free([1.5, 3.0, 3.0])


def test_thin_robot_never_jumps_over_a_thin_obstacle():
    points = Workspace.from_points([[1.0, 1.0, 1.0]], 0.25, (0, 0, 0, 2, 2, 2))
    space = cspace.build(points, Robot.box((0.4, 0.4, 0.002)), inner=False)
    rng = np.random.default_rng(0)
    n = 400
    low = np.column_stack([rng.uniform(0.85, 1.15, (n, 2)), rng.uniform(0.7, 0.99, n)])
    high = np.column_stack([rng.uniform(0.85, 1.15, (n, 2)), rng.uniform(1.01, 1.3, n)])
    assert space.exact.is_free(low).all() and space.exact.is_free(high).all()
    assert not space.exact.motion_is_free(low, high).any()
    assert not space.exact.motion_is_free(high, low).any()


# ---- rotating robots -----------------------------------------------------------------------------

TURNS = {"yaw": 8, "any": cspace.Rotations.quaternions(3)}


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
        return space.exact.motion_is_free(q0, q1)

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
    slice_of = rotations._assign_slices(robot.shape)
    states = np.full((slice_of.max() + 1, *workspace.grid.shape), MIXED, dtype=np.uint8)
    space = map_in(workspace, robot, states.copy(), rotations, outside="free")
    assert space.exact.motion_is_free(q0, [*q0[:3], *q1[3:]])
    states[slice_of[rotations.cell_of(q1[3:])]] = FREE
    space = map_in(workspace, robot, states, rotations, outside="free")
    assert space.is_free(q1) and not space.exact.motion_is_free(q0, q1)


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("unit", [1e-6, 1e-3, 1.0, 1e3, 1e6])
@pytest.mark.parametrize("rotations", [1, 4])
def test_contacts_are_decided_alike_in_any_unit(unit, rotations):
    """Put a mesh beside a block; a yaw is off by a thousand millionth of the robot's size."""
    block = Robot.box((1.0 * unit, 0.8 * unit, 0.6 * unit)).shape
    bounds = np.array([-2, -2, -2, 2, 2, 2]) * unit
    workspace = Workspace.from_shapes([block], 0.1 * unit, bounds=bounds)
    robot = Robot.from_mesh(cube((0.5 * unit, 0.3 * unit, 0.2 * unit)))
    space = cspace.build(workspace, robot, rotations=rotations, outside="free", inner=False)
    for gap in (3e-9, -3e-9):
        q = np.zeros(space.size)
        q[0] = (0.75 + gap) * unit
        further = q + np.eye(space.size)[1] * 0.02 * unit
        assert space.exact.is_free(q) == space.exact.motion_is_free(q, further) == (gap > 0)


@pytest.mark.parametrize("margin", [0.0, 0.05])
def test_cells_prove_the_part_of_an_edge_below_a_beam(margin):
    """Drive a tall robot below a beam nearer than the margin, then past a wall."""
    cells = np.zeros((80, 60, 24), dtype=bool)
    cells[38:42, :, 15:] = True
    cells[54:58, :30] = True
    workspace = Workspace.from_array(cells, 0.05)
    robot = Robot.from_mesh(cube((0.4, 0.3, 0.73)).apply_translation((0, 0, 0.375)))
    space = cspace.build(workspace, robot, rotations=36, floor=0.0, margin=margin, outside="free")
    start, end = (1.5, 1.66 + margin, 0.0), (2.6, 1.66 + margin, 0.0)
    assert not space.motion_is_free(start, end)
    assert space.exact.motion_is_free(start, end)
    assert not space.exact.motion_is_free(start, (2.6, 1.6, 0.0))


def test_points_inside_a_robot_with_a_hole_block_it():
    """Move a torus whose tube holds a point, and one around the point."""
    ring = Robot.from_mesh(trimesh.creation.torus(0.5, 0.2))
    points = Workspace.from_points([[1.0, 1.0, 1.0]], 0.25, (0, 0, 0, 2, 2, 2))
    space = cspace.build(points, ring, rotations=8, inner=False, outside="free")
    for x, is_free in ((1.0, True), (1.5, False), (1.8, True)):
        assert space.exact.motion_is_free((x, 1.0, 1.0, 0.0), (x, 1.0, 1.0, 0.3)) == is_free
