"""Maps to plan on in every space, and checks of plans."""

import math
import time
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from numba.core.event import trigger_event
from ompl import base as ob
from scipy import ndimage
from scipy.spatial import cKDTree

import planners
from cspace import BLOCKED, FREE, InputError, Robot, Rotations, Workspace, build
from cspace._support.compiling import clock
from planners._edges.car_curves import advance, find_shortest_words
from planners._ompl.states import find_state_kind
from planners._space_kinds import SUPPORTED
from tests.helpers.drives import CURVES, is_car, make_drive
from tests.helpers.handmade import build_empty, fill_boxes, map_of
from tests.helpers.placements import sample_edges, turn_between

SPACES = ("plane", "turning", "space", "yawing", "floating")
ENDPOINTS = {
    "plane": ((1.0, 1.0), (9.0, 5.0)),
    "turning": ((0.8, 0.8, 0.0), (5.0, 3.2, 2.0)),
    "space": ((0.5, 0.5, 0.4), (3.5, 1.4, 1.6)),
    "yawing": ((0.5, 0.5, 0.5, 0.0), (2.4, 0.5, 0.6, 1.0)),
    "floating": ((0.5, 0.5, 0.5, 0.0, 0.0, 0.0, 1.0), (1.9, 0.5, 0.6, 0.0, 0.6, 0.0, 0.8)),
}
"""Start and goal in each room."""

ANYTIME_PLANNERS = {"BITstar", "InformedRRTstar", "RRTstar", "SORRTstar"}
"""Planners that improve their path until the time limit."""

SPACES_WITH_CURVES = [*((name, None) for name in SPACES), *(("turning", curve) for curve in CURVES)]
"""Each space with straight edges, and the plane with the curves of cars."""

FEW_ROTATIONS = {"turning": 4, "yawing": 4, "floating": Rotations.quaternions(2)}
"""A few rotation cells for each space with rotations."""

ROOM_INPUTS = {
    "plane": (fill_boxes((100, 60), np.s_[30:33, :45], np.s_[65:68, 20:]), Robot.disc(0.2), None),
    "turning": (
        fill_boxes((60, 40), np.s_[18:20, :26], np.s_[40:42, 14:]),
        Robot.rectangle(0.6, 0.3),
        24,
    ),
    "yawing": (fill_boxes((30, 20, 12), np.s_[13:15, :14]), Robot.box((0.4, 0.2, 0.1)), 12),
    "floating": (
        fill_boxes((24, 16, 10), np.s_[11:13, :9]),
        Robot.box((0.3, 0.1, 0.2)),
        Rotations.quaternions(5),
    ),
    "space": (
        fill_boxes((40, 20, 20), np.s_[13:15, :, :13], np.s_[26:28, :11]),
        Robot.box((0.3, 0.3, 0.1)),
        None,
    ),
}
"""Obstacle cells of 0.1 m, robot and rotation cells of each room."""


def options_for(drive):
    """Return the options of a drive, with a turning radius for cars."""
    return {} if drive is None else {"drive": make_drive(drive)}


def compile_for(seconds):
    """Pretend to compile a function of the planners for some seconds."""
    compiled = {"dispatcher": SimpleNamespace(py_func=planners.plan)}
    with trigger_event("numba:compiler_lock"), trigger_event("numba:compile", compiled):
        end = time.process_time() + seconds
        while time.process_time() < end:
            pass


@cache
def build_room(name):
    """Build the map of a room with walls across it."""
    cells, robot, rotations = ROOM_INPUTS[name]
    return build(Workspace.from_array(cells, 0.1), robot, rotations=rotations)


@cache
def build_open_map(name):
    """Build a map without obstacles, with a free exterior."""
    dim = 2 if name in ("plane", "turning") else 3
    robot = Robot.ball(0.1) if dim == 3 else Robot.disc(0.1)
    options = {"outside": "free", "rotations": FEW_ROTATIONS.get(name)}
    return build_empty((9, 8, 7)[:dim], robot, 1.0, **options)


def build_from_states(state, turns=None, spacing=1.0):
    """Build a map of states (x, ...), or (rotation, x, ...) with ``turns``."""
    return map_of(
        state, turns, "blocked", spacing, occupied=(state if turns is None else state[0]) == BLOCKED
    )


def build_halves(name, between):
    """Build two FREE halves around a wall; return a configuration in each."""
    turns = {"turning": 12, "yawing": 12, "floating": Rotations.quaternions(2)}.get(name)
    cells = (19, 9) if name in ("plane", "turning") else (19, 9, 9)
    state = np.full((len(Rotations.of(turns)), *cells), FREE, dtype=np.uint8)
    state[:, 9] = between
    rest = (
        *(4.5,) * (len(cells) - 1),
        *{1: (1.0,), 4: (0.0, 0.6, 0.0, 0.8)}.get(len(Rotations.of(turns).names), ()),
    )
    return (
        build_from_states(state[0] if turns is None else state, turns),
        (2.5, *rest),
        (16.5, *rest),
    )


def make_state(space, si, q):
    """Return the OMPL state of a configuration."""
    state = si.allocState()
    find_state_kind(space).write(state, *map(float, q))
    return state


def draw_around(space, n, seed):
    """Draw configurations in and around a map, some on corners of cells."""
    rng = np.random.default_rng(seed)
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    corners = lower + space.grid.spacing * rng.integers(
        0, np.array(space.grid.shape) + 1, (n // 4, space.grid.dim)
    )
    q = np.concatenate([rng.uniform(lower - 0.2, upper + 0.2, (n, space.grid.dim)), corners])
    angles = rng.uniform(-math.pi, math.pi, (len(q), space.size - space.grid.dim))
    return wrap_rotations(space, np.column_stack([q, angles]))


def draw_edges(space, n, seed, reach=1.0):
    """Draw FREE configurations, and a configuration near each."""
    rng = np.random.default_rng(seed)
    starts = space.sample_free(n, rng)
    return wrap_rotations(space, starts), wrap_rotations(
        space, starts + rng.uniform(-reach, reach, starts.shape)
    )


def wrap_rotations(space, q):
    """Wrap the yaws of configurations to [-pi, pi), and normalise their quaternions."""
    turns = q[:, space.grid.dim :]
    if "qw" in space.axes:
        turns = turns / np.linalg.norm(turns, axis=1, keepdims=True)
    return np.column_stack(
        [q[:, : space.grid.dim], turns if "qw" in space.axes else turn_between(0.0, turns)]
    )


def boundary_corners(space):
    """Return lower corners and a tree of centers of boundary cells that are not FREE."""
    shut = space.cell_states != FREE
    boundary = np.argwhere(shut & ~ndimage.binary_erosion(shut, border_value=1)).reshape(
        -1, space.grid.dim
    )
    corners = np.array(space.grid.lower) + space.grid.spacing * boundary
    return corners, cKDTree(corners + space.grid.spacing / 2.0)


def min_distance(space, points):
    """Return the distance of points to cells that are not FREE."""
    lower, upper, (corners, tree) = (
        np.array(space.grid.lower),
        np.array(space.grid.upper),
        boundary_corners(space),
    )
    least = float(np.minimum(points - lower, upper - points).min())
    if len(corners):
        # The center of a cell is at most half a diagonal farther than the cell.
        reach = min(least, float(tree.query(points)[0].min())) + space.grid.spacing * math.sqrt(
            space.grid.dim
        )
        near = cKDTree(points).sparse_distance_matrix(tree, reach, output_type="coo_matrix")
        first, at = corners[near.col], points[near.row]
        apart = np.maximum(first - at, at - first - space.grid.spacing)
        least = min(
            least, float(np.linalg.norm(np.maximum(apart, 0.0), axis=1).min(initial=math.inf))
        )
    return least


def shortest_word(curves, first, last):
    """Return steering and lengths of the shortest curve, and its gap at the goal."""
    ends = tuple(first.tolist()), tuple(last.tolist())
    words = find_shortest_words(curves.curves, *ends, 0.0)
    return words.steering[0], words.lengths[0], words.gap


def points_along(curves, first, last, positions):
    """Return configurations (n, 3) at distances from the start of a curve, metres."""
    steering, lengths, _ = shortest_word(curves, first, last)
    rows = []
    for left in (positions / curves.radius).tolist():
        pose = (0.0, 0.0, float(first[2]))
        for steer, length in zip(steering.tolist(), lengths.tolist(), strict=True):
            part = min(left, abs(length))
            pose = advance(pose, steer, math.copysign(part, length))
            left -= part
        rows.append(pose)
    points = np.array(rows).reshape(-1, 3)
    points[:, :2] = first[:2] + curves.radius * points[:, :2]
    return points


def plan_patiently(space, endpoints, limits, **options):
    """Plan with growing time limits until a plan is solved."""
    for seed, limit in enumerate(limits, 1):
        plan = planners.plan(space, *endpoints, time_limit=limit, seed=seed, **options)
        if plan:
            break
    return plan


def check(space, plan, start, goal):
    """Check a solved plan by look-ups of configurations."""
    dim, path, waypoints = space.grid.dim, plan.path, plan.waypoints
    assert plan and plan.certified and plan.status.startswith("path found") and not plan.hint
    for rows in (path, waypoints):
        assert (
            rows.dtype == np.float64
            and rows.shape[1:] == (space.size,)
            and not rows.flags.writeable
        )
        both = np.array([start, goal], dtype=float)
        assert np.array_equal(rows[[0, -1], :dim], both[:, :dim])
        assert (sample_edges(space, rows[[0, -1]], both, np.zeros(1))[1] < 1e-7).all()
    assert plan.axes == space.axes
    assert (path[:, dim:] >= -math.pi).all() and (path[:, dim:] < math.pi).all()
    known = {tuple(row) for row in path.tolist()}
    assert all(tuple(row) in known for row in waypoints.tolist())
    angles = sample_edges(space, path[:-1], path[1:], np.zeros(1))[1]
    steps = np.linalg.norm(np.diff(path[:, :dim], axis=0), axis=1)
    if not is_car(plan):
        assert (plan.direction is None) == (plan.drive is None)
        assert plan.length == pytest.approx(steps.sum())
        assert plan.total_rotation == pytest.approx(angles.sum(), abs=1e-6)
    else:
        assert len(plan.direction) == len(path) and set(plan.direction.tolist()) <= {1, -1}
        assert steps.sum() * (1 - 1e-9) <= plan.length <= steps.sum() * 1.01 + 1e-9
    if space.size > dim:
        assert (angles <= math.radians(5) + 1e-7).all()
        assert (steps[angles > 1e-7] <= space.grid.spacing * (1 + 1e-9)).all()
        least = space.clearance(path).min() + 1.5 * space.grid.spacing
        assert 0.0 <= plan.clearance <= least + 1e-9
    times = plan.times
    assert min(times.planning, times.checking) >= 0.0, times


def check_failed(space, plan):
    """Check a plan without a path."""
    assert (
        not plan
        and not plan.certified
        and plan.path.shape == plan.waypoints.shape == (0, space.size)
    )
    assert all(math.isnan(value) for value in (plan.length, plan.total_rotation, plan.clearance))


def check_support(kind, space, given, **ends):
    """Check that a space takes the goals and options that the table gives its kind, and no others."""
    assert given.keys() == SUPPORTED.keys()
    for option, changes in given.items():
        arguments = {**ends, **changes}
        if kind in SUPPORTED[option]:
            assert planners.plan(space, **arguments).certified, (kind, option)
            continue
        with pytest.raises(InputError) as caught:
            planners.plan(space, **arguments)
        assert caught.value.argument in arguments
        rule = "the space of an arm" if option == "`cspace.PoseGoal`" else "it is for "
        assert caught.value.rule.startswith(rule)


def bounds_of(states):
    """Return the bounds of a state space, all lower bounds first."""
    part = (
        states.getSubspace(0)
        if isinstance(states, ob.CompoundStateSpace) and not hasattr(states, "getBounds")
        else states
    )
    bounds, dim = part.getBounds(), part.getBounds().low
    return [*(bounds.low[k] for k in range(len(dim))), *(bounds.high[k] for k in range(len(dim)))]


def plan_in_time(space, endpoints, limit, **options):
    """Plan, and check that the plan ends within its limit plus a quarter of a second.

    Compiling takes none of it; the clock does not count it.
    """
    began = clock()
    plan = planners.plan(space, *endpoints, time_limit=limit, **options)
    assert clock() - began < limit + 0.25, plan
    assert plan.times.planning < limit + 0.25, plan
    return plan


def make_poses(states, *rows):
    """Return states of SE(2), or of a space of curves, for configurations (x, y, yaw)."""
    made = [states.allocState() for _ in rows]
    for state, (x, y, yaw) in zip(made, rows, strict=True):
        state.setXY(float(x), float(y))
        state.setYaw(float(yaw))
    return made


def interpolate_poses(states, first, last, shares):
    """Return configurations (x, y, yaw) at shares of OMPL's motion."""
    between = states.allocState()
    rows = []
    for share in np.asarray(shares).tolist():
        states.interpolate(first, last, share, between)
        rows.append((between.getX(), between.getY(), between.getYaw()))
    return np.array(rows)


def weighted_length(plan):
    """Return the length of a plan in metres, with half a metre for each radian."""
    return plan.length + 0.5 * plan.total_rotation
