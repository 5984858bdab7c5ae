"""Edges of robots that turn: against an exact walk of the lattice, OMPL's own interpolation, and points along them."""

import math

import numpy as np
import ompl.base as ob
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import cspace
import oracles
from checks import draw_turned, stack_of, turned_collides
from cspace import FREE, MIXED, InputError, Robot, Workspace
from cspace.rotations import TURN, YAW_SLACK, Rotations
from strategies import robots, rotation_cells, seeds

SIDE = 4
H = 0.25


def free_but(closed, rotations, **options):
    """A map in which all is FREE but some cells, given by numbers that are taken modulo the count of each axis."""
    state = np.full((Rotations.of(rotations).count, SIDE, SIDE), FREE, dtype=np.uint8)
    for k, i, j in closed:
        state[k % len(state), i, j] = MIXED
    return stack_of(state, rotations, spacing=H, **options)


def uniform(low, high):
    """Numbers without hypothesis's liking for round ones."""
    return seeds.map(lambda seed: float(np.random.default_rng(seed).uniform(low, high)))


coordinates = st.one_of(st.integers(0, 8).map(lambda k: k / 8), st.floats(0, 1), uniform(0, 1))
yaws = st.one_of(
    st.floats(-7, 7),
    uniform(-7, 7),
    uniform(-7, 7),
    st.tuples(st.just("border"), st.integers(0, 11), st.sampled_from([0.0, math.pi, -math.pi, TURN, -TURN])),
)
ends = st.tuples(coordinates, coordinates, yaws)
blocks = st.lists(st.tuples(st.integers(0, 11), st.integers(0, SIDE - 1), st.integers(0, SIDE - 1)), max_size=16)


def configuration(end, borders):
    """An end as numbers; a yaw may be drawn as a border of a rotation cell, plus half or whole turns."""
    x, y, yaw = end
    if isinstance(yaw, tuple):
        yaw = borders[yaw[1] % len(borders)] + yaw[2]
    return (x, y, yaw)


@settings(max_examples=150)
@given(rotation_cells(6), blocks, ends, ends)
@example(4, [(2, 1, 1)], (0.3, 0.3, 3.0), (0.3, 0.3, -3.0))  # through the wrap at pi
@example(4, [(0, 1, 1)], (0.3, 0.3, 3.0), (0.3, 0.3, -3.0))
@example(4, [(0, 1, 1)], (0.3, 0.3, -0.5), (0.3, 0.3, 0.5))
@example(4, [(1, 1, 1)], (0.3, 0.3, ("border", 1, 0.0)), (0.7, 0.3, ("border", 1, 0.0)))  # along a border
@example(4, [(0, 1, 1)], (0.3, 0.3, ("border", 1, 0.0)), (0.7, 0.3, ("border", 1, 0.0)))
@example(8, [(1, 1, 1)], (0.1, 0.1, 0.0), (0.1, 0.1, math.pi))  # half a turn: either way
@example(8, [(7, 0, 0)], (0.1, 0.1, 0.0), (0.1, 0.1, math.pi))
@example(1, [(0, 3, 3)], (0.0, 0.0, 1.0), (0.6, 0.6, -2.0))
@example(2, [(1, 2, 1)], (0.25, 0.25, 1.0), (0.75, 0.75, 2.0))  # a corner in x, y and yaw at once
def test_free_means_that_every_touched_cell_is_free(rotations, closed, start, end):
    space = free_but(closed, rotations)
    borders = space.rotations.borders
    q0, q1 = configuration(start, borders), configuration(end, borders)
    walk = (q0, q1, H, (0, 0), (SIDE, SIDE), borders)
    answer = space.motion_is_free(q0, q1)
    assert answer == space.motion_is_free(q1, q0) == space.edge_checker()(*q0, *q1)
    closed_cells = set(map(tuple, np.argwhere(space.state != FREE).tolist()))
    if answer:
        assert not closed_cells & oracles.touched_turned_cells(*walk)
    else:  # a closed cell is touched, but for the slack
        assert closed_cells & oracles.touched_turned_cells(*walk, slack=1e-8)


@settings(max_examples=60)
@given(rotation_cells(6), ends, ends)
def test_only_touched_cells_matter(rotations, start, end):
    """With every other cell closed the edge is free, and with any one of those it crosses it is not."""
    borders = Rotations.of(rotations).borders
    q0, q1 = configuration(start, borders), configuration(end, borders)
    walk = (q0, q1, H, (0, 0), (SIDE, SIDE), borders)
    state = np.full((len(borders) - 1, SIDE, SIDE), MIXED, dtype=np.uint8)
    for cell in oracles.touched_turned_cells(*walk, slack=1e-8):
        state[cell] = FREE
    assert stack_of(state, rotations, spacing=H).motion_is_free(q0, q1)
    for cell in oracles.touched_turned_cells(*walk):
        one = state.copy()
        one[cell] = MIXED
        assert not stack_of(one, rotations, spacing=H).motion_is_free(q0, q1)


def test_the_shorter_way_is_walked_and_both_at_half_a_turn():
    start, ahead, back = (0.3, 0.3, 0.0), (0.3, 0.3, 2.0), (0.3, 0.3, -2.0)
    quarter = free_but([(2, 1, 1)], 8)  # closed at a quarter turn to the left
    assert not quarter.motion_is_free(start, ahead) and quarter.motion_is_free(start, back)
    half = (0.3, 0.3, math.pi)
    assert not quarter.motion_is_free(start, half)
    assert not free_but([(6, 1, 1)], 8).motion_is_free(start, half)
    for away, expected in ((1e-6, True), (-1e-6, False), (1e-11, False), (-1e-11, False)):
        assert quarter.motion_is_free(start, (0.3, 0.3, math.pi + away)) == expected
    assert quarter.motion_is_free(start, (0.3, 0.3, 40 * TURN - 2.0))


def test_borders_have_slack():
    space = free_but([(1, 1, 1)], [0.0, 1.0, 2.0, TURN])
    for yaw, expected in ((1.0 - 0.5 * YAW_SLACK, False), (1.0 - 1e-6, True), (2.0 + 1e-6, True), (2.0, False)):
        assert space.motion_is_free((0.3, 0.3, yaw), (0.4, 0.4, yaw)) == expected
    assert not space.motion_is_free((0.3, 0.3, -0.1), (0.3, 0.3, 1.0))
    assert space.motion_is_free((0.3, 0.3, -0.1), (0.3, 0.3, 1.0 - 1e-6))


# ---- OMPL ------------------------------------------------------------------------------------------------------------


def interpolate(q0, q1, times):
    """Configurations on the way from q0 to q1 as OMPL's SE(2) has it, shape (n, 3)."""
    space = ob.SE2StateSpace()
    bounds = ob.RealVectorBounds(2)
    bounds.setLow(-100.0)
    bounds.setHigh(100.0)
    space.setBounds(bounds)
    first, second, between = (space.allocState() for _ in range(3))
    for state, (x, y, yaw) in ((first, q0), (second, q1)):
        state.setX(x)
        state.setY(y)
        state.setYaw(yaw)
    found = []
    for t in times:
        space.interpolate(first, second, t, between)
        found.append((between.getX(), between.getY(), between.getYaw()))
    return np.array(found)


@settings(max_examples=60)
@given(rotation_cells(12), seeds)
def test_edges_are_walked_as_ompl_interpolates(rotations, seed):
    """Every cell in which OMPL puts a configuration is touched; closing one closes the edge."""
    rng = np.random.default_rng(seed)
    borders = np.asarray(Rotations.of(rotations).borders)
    q0, q1 = (np.append(rng.uniform(0, 1, 2), rng.uniform(-math.pi, math.pi)) for _ in range(2))
    if rng.random() < 0.3:  # OMPL takes one way or the other at half a turn
        q0[2] = rng.uniform(-math.pi, 0.0)
        q1[2] = q0[2] + math.pi
    between = interpolate(q0.tolist(), q1.tolist(), np.linspace(0, 1, 60).tolist())
    place = np.clip((between[:, :2] // H).astype(int), 0, SIDE - 1)
    cells = np.column_stack([Rotations.of(rotations).cell_of(between[:, 2]), place])
    for cell in np.unique(cells, axis=0).tolist():
        assert not free_but([cell], rotations).motion_is_free(q0, q1)
    walk = (q0, q1, H, (0, 0), (SIDE, SIDE), borders)
    assert set(map(tuple, cells.tolist())) <= oracles.touched_turned_cells(*walk, slack=1e-8)


@settings(max_examples=25)
@given(robots(0.3), rotation_cells(16), seeds, st.sampled_from(["blocked", "free"]))
def test_points_of_a_free_edge_are_free(robot, rotations, seed, outside):
    rng = np.random.default_rng(seed)
    occupied = rng.random((20, 16)) < 0.03
    space = cspace.build(Workspace.from_array(occupied, 0.2), robot, rotations=rotations, outside=outside)
    q0 = draw_turned(space, rng, 400)
    reach = np.array([1.0, 1.0, 2.0]) * rng.choice([0.0, 0.3, 1.0, 2.0], (400, 1))
    q1 = q0 + rng.uniform(-1, 1, (400, 3)) * reach
    q1[:40, 2] = q0[:40, 2] + math.pi
    free = np.flatnonzero(space.motion_is_free(q0, q1))
    assert (space.motion_is_free(q1, q0) == space.motion_is_free(q0, q1)).all()
    for k in free[:4]:
        yaw0, yaw1 = ((q[k, 2] + math.pi) % TURN - math.pi for q in (q0, q1))
        ends = [[*q[k, :2].tolist(), yaw] for q, yaw in ((q0, yaw0), (q1, yaw1))]
        q = interpolate(*ends, np.linspace(0, 1, 101).tolist())
        # Rounding must not carry a point off the edge's own box, and with it out of the grid.
        q[:, :2] = np.clip(q[:, :2], np.minimum(*ends)[:2], np.maximum(*ends)[:2])
        assert space.is_free(q).all()
        assert not turned_collides(space, q, 0.0).any()


# ---- boxes of configurations -----------------------------------------------------------------------------------------


def meets_box(cell, borders, q, distance, angle, slack=0.0):
    """Whether a closed cell meets the box of configurations around q; yaws at all turns."""
    k, i, j = cell
    if not all(H * n - distance - slack <= v <= H * (n + 1) + distance + slack for n, v in ((i, q[0]), (j, q[1]))):
        return False
    low, high = borders[k] - angle - slack, borders[k + 1] + angle + slack
    return any(low <= q[2] + wraps * TURN <= high for wraps in range(-5, 6))


@settings(max_examples=60)
@given(
    rotation_cells(8),
    ends,
    st.sampled_from([0.0, 0.05, 0.125, 0.25, 0.6]),
    st.one_of(uniform(0, 3), st.sampled_from([0.0, 0.1, 2.0, math.pi, 9.0])),
)
def test_a_box_is_free_where_all_cells_that_meet_it_are(rotations, end, distance, angle):
    """With every other cell closed the box is free, and with any one of those that meet it, it is not."""
    borders = Rotations.of(rotations).borders
    q = configuration(end, borders)
    state = np.full((len(borders) - 1, SIDE, SIDE), MIXED, dtype=np.uint8)
    cells = list(np.ndindex(state.shape))
    for cell in cells:
        if meets_box(cell, borders, q, distance, angle, slack=1e-8):
            state[cell] = FREE
    assert stack_of(state, rotations, spacing=H).is_free_around(q, distance, angle)
    inside = [cell for cell in cells if meets_box(cell, borders, q, distance, angle)]
    for cell in {inside[0], inside[-1], *inside[:: 1 + len(inside) // 8]} if inside else ():
        assert not free_but([cell], rotations).is_free_around(q, distance, angle)


@settings(max_examples=20)
@given(robots(0.3), rotation_cells(16), seeds)
def test_every_configuration_of_a_free_box_is_free(robot, rotations, seed):
    rng = np.random.default_rng(seed)
    space = cspace.build(
        Workspace.from_array(rng.random((20, 16)) < 0.03, 0.2), robot, rotations=rotations, outside="free"
    )
    distance, angle = rng.uniform(0, 0.4), rng.uniform(0, 1.0)
    q = draw_turned(space, rng, 300)
    q = q[space.is_free_around(q, distance, angle)][:15]
    away = rng.choice([-1.0, 1.0], (len(q), 12, 3)) * rng.choice([1.0, 0.7, 0.2], (len(q), 12, 3))
    inside = (q[:, None] + away * [distance, distance, angle]).reshape(-1, 3)
    assert space.is_free(inside).all()
    assert not turned_collides(space, inside, 0.0).any()


def test_boxes_that_begin_on_a_border_far_off():
    space = stack_of(np.where(np.arange(63) == 40, MIXED, FREE)[:, None, None] * np.ones((1, 3, 3)), 63)
    borders, closed = np.asarray(space.rotations.borders), space.rotations.representatives[40]
    angle = 1.0
    for wraps in (2, 10, 1000):
        yaw = borders + wraps * TURN + angle + YAW_SLACK
        for nudged in (yaw, np.nextafter(yaw, 0.0), np.nextafter(yaw, 1e9)):
            near = np.abs((nudged - closed + math.pi) % TURN - math.pi) < angle
            q = np.column_stack([np.full((64, 2), 0.3), nudged])
            assert not space.is_free_around(q, 0.0, angle)[near].any()


@pytest.mark.parametrize(("distance", "angle"), [(-0.1, 0.0), (0.1, -1e-9), (math.nan, 0.0), (0.0, math.inf)])
def test_refuses_boxes_that_are_none(distance, angle):
    with pytest.raises(InputError):
        free_but([], 4).is_free_around((0.1, 0.1, 0.1), distance, angle)


def test_batches_broadcast():
    space = free_but([], 4)
    assert space.motion_is_free((0.1, 0.1, 0.0), np.full((3, 5, 3), 0.9)).shape == (3, 5)
    assert space.motion_is_free(np.full((3, 1, 3), 0.2), np.full((5, 3), 0.9)).shape == (3, 5)
    assert space.motion_is_free(np.empty((0, 3)), (0.1, 0.1, 0.0)).shape == (0,)
    assert space.is_free_around(np.zeros((2, 0, 3)), 0.1).shape == (2, 0)
    with pytest.raises(InputError, match="broadcast"):
        space.motion_is_free(np.zeros((3, 3)), np.zeros((4, 3)))


def test_edges_beyond_the_grid_follow_the_policy():
    robot = Robot.rectangle(0.4, 0.1, (0.1, 0.0))
    occupied = np.zeros((10, 10), dtype=bool)
    occupied[0, 5] = True
    workspace = Workspace.from_array(occupied, 0.1)
    free = cspace.build(workspace, robot, rotations=16, outside="free")
    blocked = cspace.build(workspace, robot, rotations=16)
    assert free.motion_is_free((-1.0, -1.0, 0.0), (-1.0, 2.0, 3.0))
    assert not free.motion_is_free((-0.25, -1.0, 0.0), (-0.25, 2.0, 0.0))  # the front reaches 0.3 m ahead
    assert free.motion_is_free((-0.25, -1.0, math.pi), (-0.25, 2.0, math.pi))  # and the back 0.1 m
    assert not blocked.motion_is_free((0.5, 0.2, 0.0), (1.5, 0.2, 0.0))
    check = free.edge_checker()
    for hole in range(6):
        numbers = [-1.0, -1.0, 0.0, -1.0, 2.0, 0.1]
        numbers[hole] = math.nan
        assert not check(*numbers)
