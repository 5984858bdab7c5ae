"""Limits of plans: time, kept within a quarter of a second, and work."""

import math
import time
from functools import cache, partial

import numpy as np
import pytest
from ompl import base as ob

import planners
from cspace import MIXED, Robot, Workspace, build, build_joint_map
from cspace._support.compiling import clock
from cspace._support.deadlines import Effort, now
from planners._edges.cars import CarCurves
from planners._edges.differential import TurnDriveTurn
from planners._ompl.search import GRACE_SECONDS, Deadline, OutOfTime
from tests.helpers.planning import (
    ENDPOINTS,
    build_halves,
    build_room,
    compile_for,
    options_for,
    plan_in_time,
    weighted_length,
)
from tests.helpers.strategies import few
from tests.helpers.urdfs import space_of


@pytest.mark.parametrize(
    "planner, name, curve, objective",
    [
        ("RRTConnect", "floating", None, "length"),
        ("KPIECE1", "yawing", None, "length"),
        ("FMT", "turning", "reeds-shepp", "clearance"),
    ],
)
def test_planners_of_ompl_end_in_time(planner, name, curve, objective):
    parted, *apart = build_halves(name, MIXED)
    for space, endpoints in ((build_room(name), ENDPOINTS[name]), (parted, apart)):
        planners.plan(space, endpoints[0], endpoints[0])  # fills the caches of the map
        space.clearance(endpoints[0])
        options = {"planner": planner, "objective": objective, **options_for(curve)}
        plan = plan_in_time(space, endpoints, 0.015, **options)
        assert space is not parted or not plan


def test_built_in_searches_keep_the_time_limit():
    # A maze misleads the search of the grid.
    occupied = np.zeros((240, 240), dtype=bool)
    for k in range(1, 8):
        occupied[30 * k : 30 * k + 3] = True
        occupied[30 * k : 30 * k + 3, slice(0, 24) if k % 2 else slice(-24, None)] = False
    space = build(Workspace.from_array(occupied, 0.05), Robot.rectangle(0.6, 0.3), rotations=72)
    start, goal = (0.7, 6.0, 0.0), (11.3, 6.0, 1.5)
    planners.plan(space, start, start, planner="Grid")
    plan = plan_in_time(space, (start, goal), 1e-3, planner="Grid")
    assert plan.status == "no path found within 0.001 s; a path exists"
    assert plan.hint == "more time (time_limit=0.01)"
    limit = 1e-3
    while not plan and limit < 100.0:  # follow the hint
        limit *= 10.0
        plan = planners.plan(space, start, goal, planner="Grid", time_limit=limit)
    assert plan.certified


@pytest.mark.parametrize(
    "options, owner, seconds",
    [
        ({"drive": planners.Car(turning_radius=0.1, reverse=True)}, CarCurves, 0.0003),
        ({"drive": planners.Differential()}, TurnDriveTurn, 0.001),
    ],
)
def test_shortening_a_path_of_the_lattice_keeps_the_time_limit(
    options, owner, seconds, monkeypatch
):
    # Only the lengths of edges take time.
    now = [0.0]
    edge_length = owner.edge_length

    def measure_slowly(*args):
        now[0] += seconds
        return edge_length(*args)

    monkeypatch.setattr(owner, "edge_length", measure_slowly)
    monkeypatch.setattr(type(clock), "__call__", lambda _: now[0])
    space = build_room("turning")
    lengths = []
    for simplify, limit in ((True, 1000.0), (True, 0.01), (False, 0.01)):
        options |= {"planner": planners.Search("Lattice", simplify=simplify), "time_limit": limit}
        plan = planners.plan(space, *ENDPOINTS["turning"], **options)
        assert plan.certified and (plan.times.planning < 0.01 + 0.25) == (limit < 1.0)
        lengths.append(weighted_length(plan))
    # The waypoints that were not reached in time stay.
    assert lengths[0] < lengths[1] < lengths[2] + 1e-9


def test_a_planner_step_that_takes_too_long_is_cut_off(monkeypatch):
    # FMT computes costs between all near samples before it checks the time.
    now = [0.0]
    calls = []

    class Slow(ob.OptimizationObjective):
        def motionCost(self, first, second):  # noqa: N802 - OMPL's name
            calls.append(now)
            now[0] += 0.002
            return ob.Cost(self.getSpaceInformation().distance(first, second))

    monkeypatch.setattr(type(clock), "__call__", lambda _: now[0])
    options = {"planner": "FMT", "objective": Slow, "time_limit": 0.1}
    plan = planners.plan(build_room("plane"), *ENDPOINTS["plane"], **options)
    assert plan.status.startswith("path found: the first one, by RRTConnect")
    assert 0 < len(calls) < 200


def test_a_deadline_makes_callbacks_refuse_then_raise(monkeypatch):
    now = [0.0]
    monkeypatch.setattr(type(clock), "__call__", lambda _: now[0])
    deadline = Deadline()
    answer = deadline.refuse_late(lambda state: state)
    cost = deadline.end_late(lambda *states: sum(states))
    now[0] = 1e9
    assert answer(True) and cost(1.0, 2.0) == 3.0
    deadline.end = Effort(math.inf, now[0] + 1.0)
    assert answer(True) and not answer(False)
    now[0] += 1.0 + 0.5 * GRACE_SECONDS
    assert not answer(True) and cost(1.0, 2.0) == 3.0
    now[0] += GRACE_SECONDS
    for late in (lambda: answer(True), lambda: cost(1.0, 2.0)):
        with pytest.raises(OutOfTime):
            late()


@pytest.mark.parametrize("iterations", few([None, 2]))
def test_compiling_takes_no_time_from_the_search(iterations, monkeypatch):
    seconds = [0.4]

    class Compiled(planners.MotionValidator):
        def checkMotion(self, first, second):  # noqa: N802 - OMPL's name
            if seconds:
                compile_for(seconds.pop())
            return super().checkMotion(first, second)

    monkeypatch.setattr("planners._ompl.setup.MotionValidator", Compiled)
    options = {
        "planner": planners.Search("RRTConnect", iterations=iterations),
        "time_limit": 0.2,
        "seed": 1,
    }
    query = build_room("plane"), *ENDPOINTS["plane"]
    plan, again = (planners.plan(*query, **options) for _ in range(2))
    assert not seconds and bool(plan) == (iterations is None)
    assert plan.times.setup >= 0.4 and plan.times.planning < 0.45
    np.testing.assert_array_equal(plan.path, again.path)


# ---- work ----------------------------------------------------------------------------------------

DEFAULT_PLANS = {
    "plane": ("plane", {}),
    "clearance": ("plane", {"objective": "clearance"}),
    "holonomic": ("turning", {}),
    "exact": ("turning", {"exact": True}),
    "differential": ("turning", {"drive": planners.Differential()}),
    "car": ("turning", {"drive": planners.Car(turning_radius=0.4, reverse=True)}),
    "any yaw": ("turning", {"drive": planners.Differential(), "goal": (5.0, 3.2, None)}),
    "space": ("space", {}),
    "arm": ("arm", {}),
    "joint map": ("joint map", {}),
}


def plan_by_default(kind, exact=False, **options):
    """Plan in a room, or for an arm beside a post; return the plan and its work."""
    if kind in ENDPOINTS:
        space, (start, goal) = build_room(kind), ENDPOINTS[kind]
    else:
        space, start, goal = build_beside_post(kind), (-0.5, 0.3), (1.5, -0.4)
    began = now()
    plan = planners.plan(space.exact if exact else space, start, **{"goal": goal, **options})
    return plan, (now() - began).work


@cache
def build_beside_post(kind):
    """Build the space of a planar arm beside a post, or the map of its joints."""
    space = space_of()
    return space if kind == "arm" else build_joint_map(space, 0.1)


def check_with_clocks(monkeypatch, factors, kind, options):
    """Check that a plan and its work are the same with clocks that run fast, or stand still."""
    plan, work = plan_by_default(kind, **options)
    assert plan.certified and 0.0 < work < 2e9
    for factor in factors:
        read = partial(lambda factor: factor * time.process_time(), factor)
        monkeypatch.setattr(type(clock), "read", staticmethod(read))
        again, equal_work = plan_by_default(kind, **options)
        np.testing.assert_array_equal(again.waypoints, plan.waypoints)
        assert equal_work == work and again.status == plan.status


@pytest.mark.parametrize("name", DEFAULT_PLANS)
def test_default_plans_end_by_their_work_whatever_the_clock(name, monkeypatch):
    check_with_clocks(monkeypatch, (50.0, 0.0), *DEFAULT_PLANS[name])


@pytest.mark.thorough
@pytest.mark.parametrize("planner", ["RRTstar", "BITstar"])
def test_planners_that_improve_a_path_end_by_their_work(planner, monkeypatch):
    check_with_clocks(monkeypatch, (10.0, 0.0), "plane", {"planner": planner, "seed": 1})


def test_a_plan_that_fails_ends_by_its_work(monkeypatch):
    # A clock that stands still ends nothing.
    monkeypatch.setattr(type(clock), "read", staticmethod(lambda: 0.0))
    for module in ("_plan", "_advice"):
        monkeypatch.setattr(f"planners.{module}.DEFAULT_SECONDS", 0.05)
    options = {"planner": "RRT", "drive": planners.Car(turning_radius=3.0), "seed": 1}
    plans = [planners.plan(build_room("turning"), *ENDPOINTS["turning"], **options) for _ in "ab"]
    assert plans[0].status == plans[1].status and plans[0].hint == plans[1].hint
    assert plans[0].status.startswith("no path found within 0.05 s of work; one exists for")
    assert "time_limit=0.5" in plans[0].hint
