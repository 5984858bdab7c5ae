"""Exact queries in the plane, against shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

import cspace
from cspace import BLOCKED, FREE, Robot, Workspace
from cspace.shapes import Balls
from tests.helpers.placements import ORACLE_BAND, draw_near_mixed, obstacles_of
from tests.helpers.strategies import robots, seeds, stars
from tests.soak.plane import move_points

SIDE = 0.6


def make_corridor(share):
    """Build a corridor along x, ``share`` robots wide."""
    half = SIDE * share / 2
    blocks = [shapely.box(2, 0, 4, 2 - half), shapely.box(2, 2 + half, 4, 4)]
    return Workspace.from_polygons(blocks, SIDE / 5, (0, 0, 6, 4))


def measure_distances(space, q, shape):
    """Return distances from obstacles, negative for discs inside."""
    q = np.asarray(q, dtype=float).reshape(-1, space.size)
    if shape.is_empty:
        return np.full(len(q), np.inf)
    body = space.robot.shape
    if isinstance(body, Balls):
        centers = shapely.points(move_points(body.centers, q))
        return (shapely.distance(centers, shape) - body.radii).min(axis=1)
    robot = body.outline
    where = move_points(shapely.get_coordinates(robot), q).reshape(-1, 2)
    return shapely.distance(shapely.set_coordinates(np.array([robot] * len(q)), where), shape)


def interpolate(q0, q1, n=1000):
    """Interpolate between two configurations like OMPL."""
    t = np.linspace(0.0, 1.0, n)[:, None]
    step = np.asarray(q1, dtype=float) - q0
    step[2:] = (step[2:] + np.pi) % (2 * np.pi) - np.pi
    return q0 + t * step


@st.composite
def workspaces(draw):
    """Draw grids, or polygons, lines and points."""
    rng = np.random.default_rng(draw(seeds))
    low = rng.uniform(-3, 3, 2)
    if draw(st.booleans()):
        return Workspace.from_array(
            rng.random((24, 20)) < draw(st.sampled_from([0.0, 0.02, 0.1])), 0.2, low
        )
    shapes = [
        shapely.Polygon(draw(stars(0.8)) + low + rng.uniform(0, 4, 2))
        for _ in range(draw(st.integers(1, 4)))
    ]
    ring = shapely.Point(low + 2).buffer(1.6).difference(shapely.Point(low + 2).buffer(1.5))
    walls = [
        shapely.LineString(low + rng.uniform(-1, 5, (3, 2))),
        shapely.Point(low + rng.uniform(0, 4, 2)),
        ring,
    ]
    return Workspace.from_polygons([*shapes, walls[int(rng.integers(3))]], 0.2, (*low, *(low + 4)))


@st.composite
def spaces(draw):
    """Draw maps of small worlds."""
    return cspace.build(
        draw(workspaces()),
        draw(robots(draw(st.sampled_from([0.15, 0.4])))),
        rotations=draw(st.sampled_from([None, 24])),
        outside=draw(st.sampled_from(["blocked", "free"])),
        margin=draw(st.sampled_from([0.0, 0.07])),
        inner=draw(st.booleans()),
    )


# ---- against shapely -----------------------------------------------------------------------------


@settings(max_examples=40)
@given(spaces(), seeds)
def test_points_agree_with_shapely(space, seed):
    q = draw_near_mixed(space, np.random.default_rng(seed), 300)
    shape = obstacles_of(space)
    free = space.is_free(q, exact=True)
    spare = measure_distances(space, q, shape) - space.margin
    assert not (free & (spare <= 0.0)).any()
    state = space.classify(q)
    decided = (np.abs(spare) > ORACLE_BAND) & (state != BLOCKED)
    np.testing.assert_array_equal(free[decided], spare[decided] > 0.0)
    assert free[state == FREE].all() and not free[state == BLOCKED].any()


@settings(max_examples=25)
@given(spaces(), seeds, st.sampled_from([0.0, 0.2]), st.sampled_from([0.0, 0.3]))
def test_obstacle_distance_is_a_sharp_lower_bound(space, seed, length, turn):
    """Bound the pieces around several free configurations."""
    rng = np.random.default_rng(seed)
    q = draw_near_mixed(space, rng, 60)
    q = q[space.is_free(q, exact=True)][:8]
    if not len(q):
        return
    shape = obstacles_of(space)
    at_centers = measure_distances(space, q, shape).min()
    bound = space.obstacle_distance(q, length, turn)
    assert bound <= at_centers
    if length == turn == 0.0:
        assert bound >= at_centers - 1e-6 or at_centers == np.inf
    direction = rng.normal(size=(len(q), 40, 2))
    direction *= 0.5 * length / np.linalg.norm(direction, axis=2, keepdims=True)
    moved = np.repeat(q[:, None], 40, axis=1)
    moved[..., :2] += direction
    moved[..., 2:] += 0.5 * turn * rng.choice([-1.0, 1.0], moved[..., 2:].shape)
    nearest = measure_distances(space, moved, shape).min()
    assert bound <= nearest or nearest <= space.margin  # the bound is for free paths


@settings(max_examples=14)
@given(spaces(), seeds)
def test_free_edges_never_collide(space, seed):
    rng = np.random.default_rng(seed)
    q0 = draw_near_mixed(space, rng, 60)
    q1 = q0 + rng.normal(0.0, 0.3, q0.shape) * rng.choice([0.1, 1.0, 3.0], (60, 1))
    q1[::5, 2:] = q0[::5, 2:]
    q1[1::9, :2] = q0[1::9, :2]
    free = space.motion_is_free(q0, q1, exact=True)
    by_map = space.motion_is_free(q0, q1)
    assert free[by_map].all()
    shape = obstacles_of(space)
    for first, last, proven in zip(q0, q1, free, strict=True):
        smallest = (
            measure_distances(space, interpolate(first, last, 1000 if proven else 60), shape).min()
            - space.margin
        )
        if proven:
            assert smallest > 0.0
        else:  # the edge comes closer to an obstacle than 1 % of its length
            assert smallest < 0.01 * (np.abs(last - first).sum() + 1.0) + ORACLE_BAND


# ---- cases solved by hand ------------------------------------------------------------------------


@pytest.mark.parametrize(("turns", "yaw"), [(None, 0.0), (36, math.pi), (72, -4.0 * math.pi)])
def test_only_exact_queries_pass_a_barely_wider_corridor(turns, yaw):
    robot = Robot.rectangle(0.9, SIDE)
    wide = cspace.build(make_corridor(1.02), robot, rotations=turns)
    narrow = cspace.build(make_corridor(0.98), robot, rotations=turns)
    edge = ([1.0, 2.0], [5.0, 2.0]) if turns is None else ([1.0, 2.0, yaw], [5.0, 2.0, yaw])
    assert wide.motion_is_free(*edge, exact=True) and not wide.motion_is_free(*edge)
    assert wide.is_free(np.mean(edge, axis=0), exact=True) and not wide.is_free(
        np.mean(edge, axis=0)
    )
    assert not narrow.motion_is_free(*edge, exact=True)
    assert not narrow.is_free(np.mean(edge, axis=0), exact=True)


@pytest.mark.parametrize("share", [1.0, 1.0 + 1e-12])
def test_corridor_as_wide_as_the_robot_is_blocked(share):
    """Include a corridor wider by the allowed rounding."""
    space = cspace.build(make_corridor(share), Robot.rectangle(0.9, SIDE))
    assert not space.motion_is_free([1.0, 2.0], [5.0, 2.0], exact=True)
    assert not space.is_free([3.0, 2.0], exact=True)


def test_containment_counts_as_collision():
    """Put robots into obstacles, and obstacles into robots and holes."""
    block = cspace.build(
        Workspace.from_polygons(shapely.box(1, 1, 5, 5), 0.5, (0, 0, 6, 6)),
        Robot.disc(0.3),
        inner=False,
    )
    assert not block.is_free([3.0, 3.0], exact=True)
    assert not block.motion_is_free([2.9, 3.0], [3.1, 3.0], exact=True)
    pillar = Workspace.from_polygons([shapely.Point(3, 3)], 0.5, (0, 0, 6, 6))
    frame = shapely.box(-2, -2, 2, 2)
    solid = cspace.build(pillar, Robot.polygon(frame), inner=False)
    assert not solid.is_free([3.1, 3.0], exact=True)
    assert not solid.motion_is_free([2.9, 3.0], [3.1, 3.0], exact=True)
    hollow = cspace.build(
        pillar, Robot.polygon(frame.difference(shapely.box(-1, -1, 1, 1))), rotations=8, inner=False
    )
    assert hollow.is_free([3.1, 3.0, 0.3], exact=True)
    assert hollow.motion_is_free([2.9, 3.0, 0.0], [3.1, 3.0, 3.0], exact=True)
    yard = Workspace.from_polygons(shapely.box(0, 0, 6, 6).difference(shapely.box(2, 2, 4, 4)), 0.5)
    inside = cspace.build(yard, Robot.rectangle(1.98, 1.98))
    assert inside.is_free([3.0, 3.0], exact=True) and not inside.is_free([3.02, 3.0], exact=True)


def test_thin_robot_never_jumps_over_a_thin_obstacle():
    workspace = Workspace.from_polygons(shapely.Point(1.0, 1.0), 0.25, (0, 0, 2, 2))
    space = cspace.build(workspace, Robot.rectangle(0.4, 0.002), rotations=8, inner=False)
    rng = np.random.default_rng(0)
    below = rng.uniform(0.7, 0.99, 500)
    above = rng.uniform(1.01, 1.3, 500)
    low = np.column_stack([rng.uniform(0.85, 1.15, 500), below, rng.uniform(-0.1, 0.1, 500)])
    high = np.column_stack([low[:, 0], above, low[:, 2] + 0.01])
    endpoints_clear = space.is_free(low, exact=True) & space.is_free(high, exact=True)
    assert endpoints_clear.sum() > 300
    assert not space.motion_is_free(low, high, exact=True).any()
    assert not space.motion_is_free(high, low, exact=True).any()


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
    free = space.is_free(q, exact=True)
    assert not free[gap <= 0.0].any()
    assert free[gap > ORACLE_BAND].all()


@pytest.mark.parametrize("outside", ["blocked", "free"])
def test_far_configurations_are_decided(outside):
    space = cspace.build(
        make_corridor(1.02), Robot.rectangle(0.9, SIDE), rotations=8, outside=outside
    )
    for far in (1e3, 1.7e308):
        assert space.is_free([far, -far, 1.0], exact=True) == (outside == "free")
        assert (
            not space.motion_is_free([1.0, 2.0, 0.0], [far, -far, 1.0], exact=True)
            or outside == "free"
        )
