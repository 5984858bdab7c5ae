"""Differential drives: edges that turn, drive straight and turn, and their plans."""

import math

import numpy as np
import pytest
from hypothesis import given

import planners
from cspace import InputError, Robot, Workspace, build
from planners._edges.drives import local_planner
from tests.helpers.drives import make_drive
from tests.helpers.placements import is_free_around
from tests.helpers.planning import (
    ENDPOINTS,
    build_open_map,
    build_room,
    interpolate_poses,
    make_poses,
    make_state,
    turn_between,
)
from tests.helpers.strategies import examples, seeds

EACH_DRIVE = pytest.mark.parametrize("drive", ["differential", "differential-reverse"])


def find_turns(first, last, drive):
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


def drive_edge(first, last, drive, count=60):
    """Return ``count`` configurations along each part of an edge."""
    heading, begin, end = find_turns(first, last, drive)
    shares = np.linspace(0.0, 1.0, count)[:, None]
    parts = [
        first + shares * (0.0, 0.0, begin),
        (*first[:2], heading) + shares * [*(last - first)[:2], 0.0],
        (*last[:2], heading) + shares * (0.0, 0.0, end),
    ]
    return np.concatenate(parts)


def draw_edge(space, seed):
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


# ---- edges ---------------------------------------------------------------------------------------


@EACH_DRIVE
@examples(60)
@given(seed=seeds)
def test_an_edge_is_proven_if_its_configurations_are_free_with_clearance(drive, seed):
    space = build_room("turning")
    edges = local_planner(space, drive=make_drive(drive))
    first, last = draw_edge(space, seed)
    points = drive_edge(first, last, drive)
    is_proven = edges.edge_checker()(*first, *last)
    assert not is_proven or space.is_free(points).all()
    assert is_proven or not is_free_around(space, points, 0.04, 0.06).all()
    # Its three parts are straight edges, with the same proofs and lengths.
    corners = edges.insert_breakpoints(np.array([first, last]))
    np.testing.assert_array_equal(corners[[0, -1]], [first, last])
    np.testing.assert_array_equal(edges.insert_breakpoints(corners), corners)
    assert is_proven == bool(space.certify_path(corners).all()) == edges.are_free(corners)
    radians = np.abs(find_turns(first, last, drive)[1:]).sum()
    assert edges.measure(corners) == pytest.approx((math.dist(first[:2], last[:2]), radians))
    length = edges.edge_lengths(first[None], last[None])[0]
    assert length == pytest.approx(math.dist(first[:2], last[:2]) + 0.5 * radians, abs=1e-9)


def test_a_reversing_robot_backs_out_of_a_narrow_corridor():
    occupied = np.ones((60, 60), dtype=bool)
    occupied[5:55, 26:34] = False  # a corridor of 0.8 m
    space = build(Workspace.from_array(occupied, 0.1), Robot.rectangle(1.2, 0.4), rotations=72)
    start, goal = (4.0, 3.0, 0.0), (2.0, 3.0, 0.0)
    plan = planners.plan(space, start, goal, drive=planners.Differential(reverse=True))
    assert plan.certified and plan.length == 2.0 and set(plan.direction.tolist()) == {-1}
    for bidirectional in (False, True):
        drive = planners.Differential()
        si = planners.simple_setup(space, drive=drive).getSpaceInformation()
        validator = planners.MotionValidator(si, space, drive=drive, bidirectional=bidirectional)
        ends = make_state(space, si, start), make_state(space, si, goal)
        assert not validator.checkMotion(*ends)
        assert validator.checkMotion(*reversed(ends)) == (not bidirectional)


@EACH_DRIVE
def test_ompls_interpolation_lies_on_the_edge(drive):
    space = build_room("turning")
    states = planners.state_space(space, drive=make_drive(drive))
    shares = np.array([0.01, 0.3, 0.99])
    for seed in range(200):
        first, last = draw_edge(space, seed)
        ends = make_poses(states, first, last)
        metres = math.dist(first[:2], last[:2])
        assert states.distance(*ends) == pytest.approx(metres, abs=1e-6)
        if metres:
            points = interpolate_poses(states, *ends, shares)
            positions = first[:2] + shares[:, None] * (last - first)[:2]
            np.testing.assert_allclose(points[:, :2], positions, atol=1e-6)
            turns = turn_between(points[:, 2], find_turns(first, last, drive)[0])
            np.testing.assert_allclose(turns, 0.0, atol=1e-6)


# ---- plans ---------------------------------------------------------------------------------------


@EACH_DRIVE
def test_remove_turns_keeps_the_yaw_of_arrival(drive):
    edges = local_planner(build_open_map("turning"), drive=make_drive(drive))
    path = np.array([(1.0, 1.0, 0.5), (3.0, 1.5, -2.0), (5.0, 4.0, 1.0), (5.0, 6.0, 0.0)])
    settled = edges.remove_turns(path)
    np.testing.assert_array_equal(settled[[0, -1]], path[[0, -1]])
    np.testing.assert_array_equal(settled[:, :2], path[:, :2])
    assert edges.measure(settled)[1] < edges.measure(path)[1] - 1.0 and edges.are_free(settled)
    assert len(edges.insert_breakpoints(settled)) == 8  # three lines, and four rotations


@pytest.mark.parametrize("drive", ["dubins", planners.Car, 0.5], ids=repr)
def test_what_is_no_drive_is_refused(drive):
    room = build_room("turning")
    for call in (planners.plan, planners.state_space, planners.warm_up):
        ends = ENDPOINTS["turning"] if call is planners.plan else ()
        with pytest.raises(InputError, match=r"drive is .*; it must be a planners\.Car\(\.\.\.\)"):
            call(room, *ends, drive=drive)
