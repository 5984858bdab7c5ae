"""Plans in every space and along curves, by planners of OMPL and built-in searches."""

import itertools

import numpy as np
import pytest
from ompl import base as ob
from ompl import util as ou

import planners
from cspace import BLOCKED, FREE, MIXED, ConfigurationError
from tests.helpers.drives import make_drive
from tests.helpers.planning import (
    ANYTIME_PLANNERS,
    ENDPOINTS,
    SPACES_WITH_CURVES,
    build_from_states,
    build_room,
    check,
    make_state,
    options_for,
    plan_patiently,
)


def endpoints_in(name, curve):
    """Return a start and goal that every planner joins."""
    start, goal = ENDPOINTS[name]
    return (start, (3.0, 3.0, 0.0)) if curve else (start, goal)


# ---- paths ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "planner, name, curve",
    [
        ("RRTConnect", "plane", None),
        ("BKPIECE1", "space", None),
        ("KPIECE1", "yawing", None),
        ("BITstar", "floating", None),
        ("RRTstar", "turning", None),
        ("RRT", "turning", "dubins"),
        ("FMT", "turning", "reeds-shepp"),
    ],
)
def test_planners_find_certified_paths(planner, name, curve):
    space = build_room(name)
    endpoints = endpoints_in(name, curve)
    limits = (20.0,) if planner == "FMT" else (0.1, 1.0, 20.0)
    simplify = planner not in ANYTIME_PLANNERS
    options = options_for(curve)
    plan = plan_patiently(
        space, endpoints, limits, planner=planners.Search(planner, simplify=simplify), **options
    )
    check(space, plan, *endpoints)
    assert (plan.planner, plan.objective, plan.exact) == (planner, "length", False)
    assert plan.drive == make_drive(curve) and plan.is_connected
    assert curve != "dubins" or set(plan.direction.tolist()) == {1}


@pytest.mark.parametrize("name, curve", SPACES_WITH_CURVES)
def test_a_free_edge_or_no_motion_needs_no_search(name, curve):
    space = build_room(name)
    start = ENDPOINTS[name][0]
    near = (1.2, 0.95, 0.45) if name == "turning" else (start[0], start[1] + 0.2, *start[2:])
    # OMPL's SORRTstar would never return.
    for planner in (None, "SORRTstar"):
        plan = planners.plan(space, start, near, planner=planner, **options_for(curve))
        check(space, plan, start, near)
        assert len(plan.waypoints) == 2 and "no search needed" in plan.status
    plan = planners.plan(space, start, start, **options_for(curve))
    check(space, plan, start, start)
    assert plan.path.tolist() == [list(start)] and plan.length == 0.0
    assert plan.clearance == space.clearance(start) and "start is the goal" in plan.status


@pytest.mark.parametrize(
    "name, curve", [("floating", None), ("turning", "dubins"), ("turning", "reeds-shepp")]
)
def test_simplified_paths_are_certified_and_no_longer(name, curve):
    space = build_room(name)
    endpoints = endpoints_in(name, curve)
    weight = 0.5 if curve is None else 0.0
    planner = "RRT" if curve == "dubins" else "RRTConnect"
    gains = []
    for seed in range(3):
        options = {"planner": planner, "seed": seed, "time_limit": 20.0, **options_for(curve)}
        rough = planners.plan(
            space, *endpoints, **options | {"planner": planners.Search(planner, simplify=False)}
        )
        short = planners.plan(space, *endpoints, **options)
        check(space, short, *endpoints)
        lengths = [plan.length + weight * plan.total_rotation for plan in (rough, short)]
        gains.append(lengths[0] / lengths[1])
    assert min(gains) >= 1 - 1e-9 and max(gains) > 1.02


@pytest.mark.parametrize("name, curve", [("plane", None), ("turning", "reeds-shepp")])
def test_a_path_with_false_motions_is_not_certified(name, curve, monkeypatch):
    class Lenient(planners.MotionValidator):
        def checkMotion(self, *_):  # noqa: N802 - OMPL's name
            return True

    monkeypatch.setattr("planners._ompl.setup.MotionValidator", Lenient)
    options = {"planner": planners.Search("RRT", simplify=False), **options_for(curve)}
    endpoints = endpoints_in(name, curve)
    plans = [planners.plan(build_room(name), *endpoints, seed=k, **options) for k in range(4)]
    assert all(plans) and not all(plan.certified for plan in plans)
    for plan in plans:
        assert plan.certified == plan.recheck().all() == ("not certified" not in repr(plan))


# ---- start and goal ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "x, y, message, reason, nearest",
    [
        (2.4, 0.5, "lies in a MIXED cell", "mixed", 1.5),
        (3.6, 0.5, "lies in a BLOCKED cell", "blocked", 4.5),
        (4.5, 1.5, "lies outside the map, which reaches from", "outside", 4.5),
        (2.0, 0.3, "MIXED", "mixed", 1.5),
        (4.0, 0.3, "is FREE but lies on the border", "mixed", 4.5),
    ],
)
def test_an_unusable_endpoint_is_named_with_its_state_and_the_nearest_free_one(
    x, y, message, reason, nearest
):
    row = np.array([[FREE], [FREE], [MIXED], [BLOCKED], [FREE]], dtype=np.uint8)
    space = build_from_states(np.tile(row, (4, 1, 1)), 4)
    bad = (x, y, 0.1)
    good = (0.5, 0.5, 0.1)
    for name, endpoints in (("start", (bad, good)), ("goal", (good, bad))):
        with pytest.raises(ConfigurationError, match=f"^{name}.*{message}") as caught:
            planners.plan(space, *endpoints)
        assert caught.value.argument == caught.value.end == name
        assert caught.value.reason == reason
        assert caught.value.nearest[:2] == (nearest, 0.5)
        assert f"({nearest:g}, 0.5" in caught.value.hint


# ---- repeatable runs, callbacks and objectives ---------------------------------------------------


@pytest.mark.parametrize(
    "planner, name, iterations",
    [("RRTConnect", "floating", None), ("KPIECE1", "space", None), ("RRTstar", "plane", 200)],
)
def test_a_seed_repeats_a_run_after_other_runs(planner, name, iterations):
    paths = []
    for seed in (7, 8, 7):
        options = {"planner": planners.Search(planner, iterations=iterations), "time_limit": 60.0}
        plan = planners.plan(build_room(name), *ENDPOINTS[name], seed=seed, **options)
        assert plan.certified
        paths.append(plan.path.tolist())
    assert paths[0] == paths[2] != paths[1]


def test_ompl_is_silent_and_errors_in_callbacks_are_raised(
    capfd,
):
    class Broken(ob.OptimizationObjective):
        def motionCost(self, first, second):  # noqa: N802 - OMPL's name
            raise KeyError("broken")

    space = build_room("plane")
    ou.setLogLevel(ou.LOG_INFO)
    try:
        planners.plan(space, *ENDPOINTS["plane"], planner="RRTConnect", seed=3)
        with pytest.raises(KeyError, match="broken"):
            options = {"planner": "RRTstar", "objective": Broken}
            planners.plan(space, *ENDPOINTS["plane"], **options)
        assert ou.getLogLevel() == ou.LOG_INFO
    finally:
        ou.setLogLevel(ou.LOG_WARN)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("planner, iterations", [("RRTstar", 200), ("BITstar", 2000)])
def test_planners_with_an_objective_find_a_cheaper_path(planner, iterations):
    space = build_room("plane")
    setup = planners.simple_setup(space, objective=planners.ClearanceObjective())
    si, objective = setup.getSpaceInformation(), setup.getOptimizationObjective()
    options = {
        "planner": planners.Search(planner, iterations=iterations),
        "time_limit": 60.0,
        "seed": 1,
    }
    costs = []
    for minimised in ("length", "clearance"):
        plan = planners.plan(space, *ENDPOINTS["plane"], objective=minimised, **options)
        check(space, plan, *ENDPOINTS["plane"])
        states = [make_state(space, si, q) for q in plan.path]
        edges = itertools.pairwise(states)
        costs.append(sum(objective.motionCost(*edge).value() for edge in edges))
    assert costs[1] < 0.8 * costs[0]
