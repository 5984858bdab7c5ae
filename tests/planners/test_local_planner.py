"""Differential drives: edges that turn, drive straight and turn, and their plans."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings

import planners
from cspace import MIXED, CSpace, Robot, Workspace, build
from planners.local_planner import local_planner
from tests.helpers.handmade import fill_boxes
from tests.helpers.maps import proven_paths
from tests.helpers.placements import collides
from tests.helpers.planning import (
    ENDPOINTS,
    build_from_states,
    build_open_map,
    build_room,
    check,
    make_state,
    plan_patiently,
    turn_between,
)
from tests.helpers.strategies import seeds

EACH_DRIVE = pytest.mark.parametrize("drive", ["differential", "differential-reverse"])


def find_turns(first: np.ndarray, last: np.ndarray, drive: str) -> np.ndarray:
    """Return the yaw of the straight part and both rotations.

    Of two directions, the least rotation wins. Shares no arithmetic with the planners.
    """
    step = complex(*(last - first)[:2])
    begin, end = np.exp(1j * first[2]), np.exp(1j * last[2])
    headings = [step, -step] if drive == "differential-reverse" else [step]
    if step == 0.0:
        headings = [begin]
    candidates = [np.angle([heading, heading / begin, end / heading]) for heading in headings]
    return min(candidates, key=lambda turns: np.round(np.abs(turns[1:]).sum(), 12))


def drive_edge(first: np.ndarray, last: np.ndarray, drive: str, count: int = 60) -> np.ndarray:
    """Return ``count`` configurations along each part of an edge."""
    heading, begin, end = find_turns(first, last, drive)
    shares = np.linspace(0.0, 1.0, count)[:, None]
    parts = [
        first + shares * (0.0, 0.0, begin),
        (*first[:2], heading) + shares * [*(last - first)[:2], 0.0],
        (*last[:2], heading) + shares * (0.0, 0.0, end),
    ]
    return np.concatenate(parts)


def draw_edge(space: CSpace, seed: int) -> np.ndarray:
    """Draw two FREE configurations, mostly near each other, some at one place or yaw."""
    rng = np.random.default_rng(seed)
    first, last = space.sample_free(2, rng)
    if rng.random() < 0.8:
        last[:2] = first[:2] + rng.uniform(-0.7, 0.7, 2)
    kind = rng.integers(7)
    if kind == 0:
        last[:2] = first[:2]
    if kind == 1:
        last[2] = first[2]
    return np.array([first, last])


def check_driven(plan: planners.Plan, drive: str) -> None:
    """Check that a path never moves sideways or rotates while it moves."""
    path = plan.path
    dx, dy = np.diff(path[:, :2], axis=0).T
    cos, sin = np.cos(path[:-1, 2]), np.sin(path[:-1, 2])
    metres = np.hypot(dx, dy)
    turns = np.abs(turn_between(path[:-1, 2], path[1:, 2]))
    ahead = dx * cos + dy * sin
    assert np.abs(dx * sin - dy * cos).max() < 1e-9 and (np.minimum(metres, turns) == 0.0).all()
    assert plan.drive == drive
    assert np.array_equal(plan.direction[1:], np.sign(np.round(ahead, 12)))
    assert drive == "differential-reverse" or ahead.min() >= 0.0
    assert plan.length == pytest.approx(metres.sum())


# ---- edges ---------------------------------------------------------------------------------------


@EACH_DRIVE
@settings(max_examples=200)
@given(seed=seeds)
def test_an_edge_is_proven_if_its_configurations_are_free_with_clearance(
    drive: str, seed: int
) -> None:
    space = build_room("turning")
    edges = local_planner(space, drive=drive)
    first, last = draw_edge(space, seed)
    points = drive_edge(first, last, drive)
    is_proven = edges.edge_checker()(*first, *last)
    assert not is_proven or space.is_free(points).all()
    assert is_proven or not space.is_free_around(points, 0.04, 0.06).all()
    # Its three parts are straight edges, with the same proofs and lengths.
    corners = edges.insert_breakpoints(np.array([first, last]))
    np.testing.assert_array_equal(corners[[0, -1]], [first, last])
    np.testing.assert_array_equal(edges.insert_breakpoints(corners), corners)
    assert is_proven == bool(space.certify_path(corners).all()) == edges.are_free(corners)
    radians = np.abs(find_turns(first, last, drive)[1:]).sum()
    assert edges.measure(corners) == pytest.approx((math.dist(first[:2], last[:2]), radians))
    length = edges.edge_lengths(first[None], last[None])[0]
    assert length == pytest.approx(math.dist(first[:2], last[:2]) + 0.5 * radians, abs=1e-9)


@EACH_DRIVE
def test_ompls_interpolation_lies_on_the_edge(drive: str) -> None:
    space = build_room("turning")
    si = planners.simple_setup(space, drive=drive).getSpaceInformation()
    states = si.getStateSpace()
    between = states.allocState()
    for seed in range(200):
        first, last = draw_edge(space, seed)
        a, b = make_state(space, si, first), make_state(space, si, last)
        metres = math.dist(first[:2], last[:2])
        assert states.distance(a, b) == pytest.approx(metres, abs=1e-6)
        for share in (0.01, 0.3, 0.99) if metres else ():
            states.interpolate(a, b, share, between)
            position = first[:2] + share * (last - first)[:2]
            assert (between.getX(), between.getY()) == pytest.approx(position, abs=1e-6)
            heading = find_turns(first, last, drive)[0]
            assert abs(turn_between(between.getYaw(), heading)) < 1e-6


def test_a_reversing_robot_backs_out_of_a_narrow_corridor() -> None:
    occupied = np.ones((60, 60), dtype=bool)
    occupied[5:55, 26:34] = False  # a corridor of 0.8 m
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(1.2, 0.4), rotations=72)
    start, goal = (4.0, 3.0, 0.0), (2.0, 3.0, 0.0)
    plan = planners.plan(space, start, goal, drive="differential-reverse")
    check(space, plan, start, goal)
    assert plan.length == 2.0 and set(plan.direction.tolist()) == {-1}
    for bidirectional in (False, True):
        options = {"drive": "differential", "bidirectional": bidirectional}
        si = planners.simple_setup(space, **options).getSpaceInformation()
        ends = make_state(space, si, start), make_state(space, si, goal)
        assert not si.checkMotion(*ends)
        assert si.checkMotion(*reversed(ends)) == (not bidirectional)


def test_a_rotation_takes_only_the_shorter_direction() -> None:
    # A post blocks the rotation to the left; the longer rotation to the right is not tried.
    states = np.zeros((36, 5, 5), np.uint8)
    states[build_from_states(states, 36).rotations.cell_of(0.5)] = MIXED
    check_edge = local_planner(build_from_states(states, 36), drive="differential").edge_checker()
    assert not check_edge(2.5, 2.5, 0.1, 2.5, 2.5, 1.0)
    assert check_edge(2.5, 2.5, 0.1, 2.5, 2.5, -1.5) and check_edge(2.5, 2.5, -2.8, 2.5, 2.5, 1.0)


# ---- plans ---------------------------------------------------------------------------------------


@EACH_DRIVE
@pytest.mark.parametrize("planner", [None, "RRTConnect", "PRM"])
def test_paths_can_be_driven_and_no_point_collides(drive: str, planner: str | None) -> None:
    # Rectangles along the path avoid every obstacle, by shapely.
    space = build_room("turning")
    ends = ENDPOINTS["turning"]
    lengths = []
    for simplify in (False, True):
        options = {"drive": drive, "planner": planner, "simplify": simplify}
        plan = plan_patiently(space, ends, (0.5, 20.0), **options)
        check(space, plan, *ends)
        check_driven(plan, drive)
        assert space.certify_path(plan.path).all() and space.certify_path(plan.waypoints).all()
        for first, last in itertools.pairwise(plan.waypoints):
            assert not collides(space, drive_edge(first, last, drive, 20)).any()
        lengths.append(plan.length + 0.5 * plan.total_rotation)
    assert lengths[1] <= lengths[0] * (1 + 1e-9) or planner == "PRM"  # its runs do not repeat


@EACH_DRIVE
def test_remove_turns_keeps_the_yaw_of_arrival(drive: str) -> None:
    edges = local_planner(build_open_map("turning"), drive=drive)
    path = np.array([(1.0, 1.0, 0.5), (3.0, 1.5, -2.0), (5.0, 4.0, 1.0), (5.0, 6.0, 0.0)])
    settled = edges.remove_turns(path)
    np.testing.assert_array_equal(settled[[0, -1]], path[[0, -1]])
    np.testing.assert_array_equal(settled[:, :2], path[:, :2])
    assert edges.measure(settled)[1] < edges.measure(path)[1] - 1.0 and edges.are_free(settled)
    assert len(edges.insert_breakpoints(settled)) == 8  # three lines, and four rotations


def test_exact_geometry_proves_a_path_through_mixed_cells() -> None:
    gap = np.s_[18:22, 18:22]  # of 0.4 m in a wall
    occupied = fill_boxes((40, 40), np.s_[18:22], but=[gap])
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(0.5, 0.36), rotations=72)
    ends = (1.0, 2.0, 0.0), (3.0, 2.0, 0.0)
    assert proven_paths(space, *ends) is None
    plan = planners.plan(space, *ends, drive="differential", exact=True)
    assert plan.certified and plan.exact and space.certify_path(plan.path, exact=True).all()
    check_driven(plan, "differential")
