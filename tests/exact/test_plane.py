"""Exact queries in the plane: cases solved by hand; tests/test_proofs.py draws cases."""

import math

import numpy as np
import pytest
import shapely

import cspace
from cspace import Robot, Workspace
from cspace.inside import proofs_of
from tests.helpers.placements import ORACLE_BAND

SIDE = 0.6


def make_corridor(share):
    """Build a corridor along x, ``share`` robots wide."""
    half = SIDE * share / 2
    blocks = [shapely.box(2, 0, 4, 2 - half), shapely.box(2, 2 + half, 4, 4)]
    return Workspace.from_polygons(blocks, SIDE / 5, (0, 0, 6, 4))


@pytest.mark.parametrize("turns, yaw", [(None, 0.0), (36, math.pi), (72, -4.0 * math.pi)])
def test_only_exact_queries_pass_a_barely_wider_corridor(turns, yaw):
    robot = Robot.rectangle(0.9, SIDE)
    wide = cspace.build(make_corridor(1.02), robot, rotations=turns)
    narrow = cspace.build(make_corridor(0.98), robot, rotations=turns)
    edge = ([1.0, 2.0], [5.0, 2.0]) if turns is None else ([1.0, 2.0, yaw], [5.0, 2.0, yaw])
    assert wide.exact.motion_is_free(*edge) and not wide.motion_is_free(*edge)
    assert wide.exact.is_free(np.mean(edge, axis=0)) and not wide.is_free(np.mean(edge, axis=0))
    assert not narrow.exact.motion_is_free(*edge)
    assert not narrow.exact.is_free(np.mean(edge, axis=0))


@pytest.mark.parametrize("share", [1.0, 1.0 + 1e-12])
def test_corridor_as_wide_as_the_robot_is_blocked(share):
    """Include a corridor wider by the allowed rounding."""
    space = cspace.build(make_corridor(share), Robot.rectangle(0.9, SIDE))
    assert not space.exact.motion_is_free([1.0, 2.0], [5.0, 2.0])
    assert not space.exact.is_free([3.0, 2.0])


def test_containment_counts_as_collision():
    """Put robots into obstacles, and obstacles into robots and holes."""
    block = cspace.build(
        Workspace.from_polygons(shapely.box(1, 1, 5, 5), 0.5, (0, 0, 6, 6)),
        Robot.disc(0.3),
        inner=False,
    )
    assert not block.exact.is_free([3.0, 3.0])
    assert not block.exact.motion_is_free([2.9, 3.0], [3.1, 3.0])
    pillar = Workspace.from_polygons([shapely.Point(3, 3)], 0.5, (0, 0, 6, 6))
    frame = shapely.box(-2, -2, 2, 2)
    solid = cspace.build(pillar, Robot.polygon(frame), inner=False)
    assert not solid.exact.is_free([3.1, 3.0])
    assert not solid.exact.motion_is_free([2.9, 3.0], [3.1, 3.0])
    hollow = cspace.build(
        pillar, Robot.polygon(frame.difference(shapely.box(-1, -1, 1, 1))), rotations=8, inner=False
    )
    assert hollow.exact.is_free([3.1, 3.0, 0.3])
    assert hollow.exact.motion_is_free([2.9, 3.0, 0.0], [3.1, 3.0, 3.0])
    yard = Workspace.from_polygons(shapely.box(0, 0, 6, 6).difference(shapely.box(2, 2, 4, 4)), 0.5)
    inside = cspace.build(yard, Robot.rectangle(1.98, 1.98))
    assert inside.exact.is_free([3.0, 3.0]) and not inside.exact.is_free([3.02, 3.0])


@pytest.mark.parametrize("low", [-1e-310, -5e-324, 1e-310])
def test_denormal_bounds_clip_like_zero(low):
    """Test bounds at which GEOS would clip wrongly."""
    triangle = shapely.Polygon([(0.32, -0.03), (-0.45, 0.37), (1.95, 3.55)])
    workspace = Workspace.from_polygons(triangle, 0.1, (0, low, 3, 3))
    space = cspace.build(workspace, Robot.disc(0.004), outside="free", inner=False)
    rng = np.random.default_rng(0)
    q = rng.uniform(0, 3, (4000, 2)) * rng.choice([1.0, 0.03, 1e-9], (4000, 2))
    gap = (
        shapely.distance(triangle.intersection(shapely.box(0, 0, 3, 3)), shapely.points(q)) - 0.004
    )
    free = space.exact.is_free(q)
    assert not free[gap <= 0.0].any()
    assert free[gap > ORACLE_BAND].all()


@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_far_configurations_are_decided(outside):
    space = cspace.build(
        make_corridor(1.02), Robot.rectangle(0.9, SIDE), rotations=8, outside=outside
    )
    for far in (1e3, 1.7e308):
        assert space.exact.is_free([far, -far, 1.0]) == (outside == "free")
        assert (
            not space.exact.motion_is_free([1.0, 2.0, 0.0], [far, -far, 1.0]) or outside == "free"
        )


def test_proofs_of_a_grown_robot_keep_its_distance():
    # The cells beside the wall are FREE, but prove nothing about a larger robot.
    occupied = np.zeros((60, 40), dtype=np.bool_)
    occupied[:, 30:] = True
    workspace = cspace.Workspace.from_array(occupied, 0.1)
    space = cspace.build(workspace, cspace.Robot.rectangle(0.6, 0.4), rotations=36)
    start, end = np.array([[2.0, 2.0, 0.0]]), np.array([[4.0, 2.0, 0.0]])
    for growth, is_free in ((0.0, True), (0.79, True), (0.81, False), (9.0, False)):
        found = proofs_of(space).are_free(start, end, growth)
        assert found.tolist() == [is_free], growth
    assert space.exact.motion_is_free(start, end).all()
