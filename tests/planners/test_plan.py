"""Plans in every space and along curves, by planners of OMPL and built-in searches."""

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

import planners
from cspace import BLOCKED, FREE, MIXED, ConfigurationError, CSpace, InputError, Robot, Workspace
from cspace import build as build_map
from tests.helpers.planning import (
    ANYTIME_PLANNERS,
    ENDPOINTS,
    SPACES_WITH_CURVES,
    build_from_states,
    build_halves,
    build_open_map,
    build_room,
    check,
    check_failed,
    make_state,
    options_for,
    plan_patiently,
    turn_between,
)
from tests.helpers.refusals import refusals
from tests.helpers.strategies import seeds


def endpoints_in(name: str, curve: str | None) -> tuple[Any, Any]:
    """Return a start and goal that every planner joins."""
    start, goal = ENDPOINTS[name]
    return (start, (3.0, 3.0, 0.0)) if curve else (start, goal)


# ---- paths ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("planner", "name", "curve"),
    [
        ("RRTConnect", "plane", None),
        ("PRM", "space", None),
        ("KPIECE1", "yawing", None),
        ("BITstar", "floating", None),
        ("RRTstar", "turning", None),
        ("RRT", "turning", "dubins"),
        ("FMT", "turning", "reeds-shepp"),
    ],
)
def test_planners_find_certified_paths(planner: str, name: str, curve: str | None) -> None:
    space = build_room(name)
    endpoints = endpoints_in(name, curve)
    limits = (20.0,) if planner == "FMT" else (0.1, 1.0, 20.0)
    simplify = planner not in ANYTIME_PLANNERS
    options = options_for(curve)
    plan = plan_patiently(space, endpoints, limits, planner=planner, simplify=simplify, **options)
    check(space, plan, *endpoints)
    assert (plan.planner, plan.objective, plan.exact) == (planner, "length", False)
    assert plan.drive == (curve or "holonomic") and plan.is_connected
    assert plan.turning_radius == options.get("turning_radius")
    assert curve != "dubins" or set(plan.direction.tolist()) == {1}


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_a_free_edge_or_no_motion_needs_no_search(name: str, curve: str | None) -> None:
    space = build_room(name)
    start = ENDPOINTS[name][0]
    near = {
        "plane": (2.0, 4.0),
        "turning": (1.2, 0.95, 0.45),
        "space": (0.5, 1.5, 1.6),
        "yawing": (0.6, 1.0, 0.6, 0.2),
        "floating": (0.6, 0.7, 0.6, 0.1, 0.1, 0.1, math.sqrt(0.97)),
    }[name]
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
    ("name", "curve"), [("floating", None), ("turning", "dubins"), ("turning", "reeds-shepp")]
)
def test_simplified_paths_are_certified_and_no_longer(name: str, curve: str | None) -> None:
    space = build_room(name)
    endpoints = endpoints_in(name, curve)
    weight = 0.5 if curve is None else 0.0
    planner = "RRT" if curve == "dubins" else "RRTConnect"
    gains = []
    for seed in range(3):
        lengths = []
        for simplify in (False, True):
            options = {"planner": planner, "seed": seed, "time_limit": 20.0, **options_for(curve)}
            plan = planners.plan(space, *endpoints, simplify=simplify, **options)
            check(space, plan, *endpoints)
            assert (plan.times.simplification > 0.0) == simplify
            lengths.append(plan.length + weight * plan.total_rotation)
        gains.append(lengths[0] / lengths[1])
    assert min(gains) >= 1 - 1e-9 and max(gains) > 1.02


def test_yaw_takes_the_shorter_arc_and_z_is_not_wrapped() -> None:
    space = build_room("turning")
    plan = planners.plan(space, (0.8, 0.8, 3.0 + 4 * math.pi), (0.9, 0.8, -3.0))
    check(space, plan, (0.8, 0.8, 3.0), (0.9, 0.8, -3.0))
    turns = turn_between(plan.path[:-1, 2], plan.path[1:, 2])
    assert turns.sum() == pytest.approx(2 * math.pi - 6.0) and (turns > 0).all()
    same = planners.plan(space, (0.8, 0.8, math.pi), (0.8, 0.8, -math.pi))
    assert same.path.tolist() == [[0.8, 0.8, -math.pi]]
    tower = Workspace.from_array(np.zeros((6, 6, 12), dtype=bool), 1.0, lower=(0, 0, -6))
    plan = planners.plan(build_map(tower, Robot.ball(0.1)), (1.5, 1.5, -4.5), (4.5, 4.5, 4.5))
    assert plan.path.tolist() == [[1.5, 1.5, -4.5], [4.5, 4.5, 4.5]]
    assert plan.length == pytest.approx(math.sqrt(9 + 9 + 81))


@pytest.mark.parametrize(("name", "curve"), [("plane", None), ("turning", "reeds-shepp")])
def test_a_path_with_false_motions_is_not_certified(
    name: str, curve: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Lenient(planners.MotionValidator):
        def checkMotion(self, *_: object) -> bool:  # noqa: N802 - OMPL's name
            return True

    monkeypatch.setattr("planners.setup.MotionValidator", Lenient)
    options = {"planner": "RRT", "simplify": False, **options_for(curve)}
    endpoints = endpoints_in(name, curve)
    plans = [planners.plan(build_room(name), *endpoints, seed=k, **options) for k in range(4)]
    assert all(plan.solved for plan in plans) and not all(plan.certified for plan in plans)
    for plan in plans:
        assert plan.certified == plan.recheck().all() == ("not certified" not in repr(plan))


@settings(max_examples=12)
@given(seeds)
def test_no_point_of_a_path_collides_in_any_world(seed: int) -> None:
    # Points of every edge avoid every obstacle cell, by arithmetic independent of the map.
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(6, 12, 3)) < rng.uniform(0.0, 0.12)
    lower = rng.uniform(-50.0, 50.0, 3)
    sides = rng.uniform(0.02, 0.9, 3)
    center = rng.uniform(-0.2, 0.2, 3)
    workspace = Workspace.from_array(occupied, 0.3, lower=lower)
    space = build_map(workspace, Robot.box(sides, center))
    if not (space.cell_states == FREE).any():
        return
    endpoints = space.sample_free(2, rng)
    exists = space.is_connected(*endpoints)
    plan = planners.plan(space, *endpoints, seed=seed % 1000, time_limit=2.0 if exists else 0.05)
    assert plan.solved or not exists
    if plan.solved:
        check(space, plan, *endpoints)
        shares = np.linspace(0.0, 1.0, 300)[:, None, None]
        points = (plan.path[:-1] + shares * np.diff(plan.path, axis=0)).reshape(-1, 1, 3)
        corners = lower + 0.3 * np.argwhere(occupied)
        for part in np.array_split(points, len(points) // 500 + 1):
            starts_before_end = part + center - sides / 2 < corners + 0.3 - 1e-9
            ends_after_start = part + center + sides / 2 > corners + 1e-9
            assert not (starts_before_end & ends_after_start).all(axis=-1).any()


def test_grid_rotates_only_if_necessary() -> None:
    states = np.zeros((4, 3, 3), np.uint8)
    states[1, :, 1] = MIXED
    space = build_from_states(states, 4)
    for yaw in (0.1, 1.6):
        ends = (0.5, 0.5, yaw), (2.5, 2.5, yaw)
        plan = planners.plan(space, *ends, planner="grid", simplify=False)
        assert plan.certified and (plan.path[:, 2] == yaw).all() == (yaw == 0.1)
    plan = planners.plan(space, (0.5, 0.5, 0.0), (2.5, 2.5, 1.6), planner="Grid")
    assert plan.certified and plan.path[-1].tolist() == [2.5, 2.5, 1.6]


@pytest.mark.parametrize("name", ["plane", "turning", "space"])
def test_max_clearance_has_at_least_the_clearance_of_other_planners(name: str) -> None:
    space = build_room(name)
    plan, other = (
        planners.plan(space, *ENDPOINTS[name], planner=planner, seed=1, time_limit=20.0)
        for planner in ("maxclearance", None)
    )
    check(space, plan, *ENDPOINTS[name])
    assert plan.planner == "MaxClearance" and plan.clearance >= other.clearance
    rough = planners.plan(space, *ENDPOINTS[name], planner="MaxClearance", simplify=False)
    check(space, rough, *ENDPOINTS[name])
    assert len(rough.waypoints) > len(plan.waypoints)


@pytest.mark.parametrize("planner", [None, "PRM"])
@pytest.mark.parametrize(("name", "drive"), [("space", None), ("turning", "reeds-shepp")])
def test_a_proof_that_no_path_exists_prevents_the_search(
    name: str, drive: str | None, planner: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    queries = []
    ask = CSpace.is_disconnected
    monkeypatch.setattr(CSpace, "is_disconnected", lambda *q: queries.append(q) or ask(*q))
    monkeypatch.setattr(og.SimpleSetup, "solve", lambda *_: pytest.fail("OMPL was run"))
    space, *endpoints = build_halves(name, BLOCKED)
    plan = planners.plan(space, *endpoints, planner=planner, **options_for(drive))
    check_failed(space, plan)
    assert plan.is_disconnected and len(queries) == 1
    assert (plan.status, plan.hint) == ("no path exists: proven", "")


# ---- start and goal ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("x", "y", "message", "nearest"),
    [
        (2.4, 0.5, "lies in a MIXED cell", 1.5),
        (3.6, 0.5, "lies in a BLOCKED cell", 4.5),
        (4.5, 1.5, "lies outside the map, which reaches from", 4.5),
        (2.0, 0.3, "MIXED", 1.5),
        (4.0, 0.3, "is FREE but lies on the border", 4.5),
    ],
)
def test_an_unusable_endpoint_is_named_with_its_state_and_the_nearest_free_one(
    x: float, y: float, message: str, nearest: float
) -> None:
    row = np.array([[FREE], [FREE], [MIXED], [BLOCKED], [FREE]], dtype=np.uint8)
    for space, yaw in (
        (build_from_states(row), ()),
        (build_from_states(np.tile(row, (4, 1, 1)), 4), (0.1,)),
    ):
        bad = (x, y, *yaw)
        good = (0.5, 0.5, *yaw)
        for name, endpoints in (("start", (bad, good)), ("goal", (good, bad))):
            with pytest.raises(ConfigurationError, match=f"^{name}.*{message}") as caught:
                planners.plan(space, *endpoints)
            assert (caught.value.argument, caught.value.value) == (name, bad)
            assert caught.value.nearest[:2] == (nearest, 0.5)
            assert f"({nearest:g}, 0.5" in caught.value.hint
            assert planners.plan(space, caught.value.nearest, good[:2] + yaw).status


def test_endpoints_lie_in_the_grid_even_if_the_exterior_is_free() -> None:
    space = build_open_map("plane")
    assert space.motion_is_free((12.0, 4.5), (4.5, 4.5))
    with pytest.raises(ConfigurationError, match=r"goal .* outside the map") as caught:
        planners.plan(space, (4.5, 4.5), (12.0, 4.5))
    assert caught.value.nearest == (8.5, 4.5)
    shut = build_from_states(np.full((3, 3), MIXED, dtype=np.uint8))
    with pytest.raises(ConfigurationError, match="no FREE configuration at all") as caught:
        planners.plan(shut, (1.5, 1.5), (2.5, 2.5))
    assert caught.value.nearest is None


# ---- wrong input ---------------------------------------------------------------------------------

CAR = {"drive": "dubins", "turning_radius": 1.0}


@refusals(
    "name, wrong, message",
    ("plane", {"goal": (1.0, math.nan)}, r"goal\[1\] is nan"),
    ("plane", {"start": (1.0, 2.0, 3.0)}, r"start has shape \(3,\).*pass \(x, y\), in metres"),
    ("plane", {"start": "here"}, "start is 'here'"),
    ("turning", {"start": (1.0, 1.0, 1e9)}, "yaw of 1e.09 rad.*wrap"),
    ("floating", {"start": (0.5, 0.5, 0.5, 0, 0, 0, 2)}, "quaternion of norm 2; it must be 1"),
    ("plane", {"time_limit": 0.0}, "time_limit is 0.0"),
    ("plane", {"iterations": 0}, "iterations is 0"),
    ("plane", {"seed": 2**32 - 1}, "seed is 4294967295"),
    ("plane", {"exact": 3}, "exact is 3"),
    ("plane", {"objective": "speed"}, "objective is 'speed'; it must be .*OverlapObjective"),
    ("plane", {"objective": lambda si: 3, "planner": "RRTstar"}, "objective returned 3"),
    ("plane", {"objective": lambda si: 3}, "is a function and no planner is named; .*'RRTstar'"),
    ("plane", {"objective": "clearance", "planner": "RRT"}, "RRT ignores objectives.*RRTstar"),
    ("plane", {"objective": "clearance", "planner": "PRM"}, "objective is .*second thread"),
    ("plane", {"objective": "clearance", "planner": "MaxClearance"}, "minimises the length"),
    ("plane", {"iterations": 10, "planner": "prmstar"}, "iterations is 10 .*second thread"),
    ("plane", {"iterations": 3, "planner": "Grid"}, "planner is 'Grid'; Grid counts none"),
    (
        "plane",
        {"objective": "clearance", "exact": True},
        "planner is 'Grid', the default for objective='clearance'; .* FREE cells .*RRTstar",
    ),
    ("turning", {"planner": "Grid", **CAR}, "Grid is for holonomic robots; .*'RRT'"),
    ("turning", {"planner": "Lattice"}, "drive is 'holonomic'.*for all other drives.*'Grid'"),
    ("turning", {"drive": "dubins"}, "turning_radius is missing.*metres"),
    ("turning", {**CAR, "turning_radius": 1e-9}, "turning_radius is 1e-09.*on the spot"),
    ("turning", {"turning_radius": 1.0}, "turning_radius is 1.0 and drive is 'holonomic'"),
    ("turning", {"drive": "clothoid"}, "drive is 'clothoid'.*'differential', .*'dubins'"),
    ("turning", {**CAR, "exact": True}, "exact is True and drive is 'dubins'"),
    ("yawing", CAR, "drive is 'dubins' and .* .x, y, z, yaw.*rotations=72, or leave drive"),
)
def test_invalid_arguments_are_refused(name: str, wrong: dict[str, Any], message: str) -> None:
    start, goal = ENDPOINTS[name]
    with pytest.raises(InputError, match=message) as caught:
        planners.plan(**{"space": build_room(name), "start": start, "goal": goal} | wrong)
    assert caught.value.argument.split("[")[0].split()[0] in {*wrong, "turning_radius"}


# ---- repeatable runs, callbacks and objectives ---------------------------------------------------


@pytest.mark.parametrize(
    ("planner", "name", "iterations"),
    [("RRTConnect", "floating", None), ("KPIECE1", "space", None), ("RRTstar", "plane", 200)],
)
def test_a_seed_repeats_a_run_after_other_runs(
    planner: str, name: str, iterations: int | None
) -> None:
    paths = []
    for seed in (7, 8, 7):
        options = {"planner": planner, "iterations": iterations, "time_limit": 60.0}
        plan = planners.plan(build_room(name), *ENDPOINTS[name], seed=seed, **options)
        assert plan.seed == seed and plan.certified
        paths.append(plan.path.tolist())
    assert paths[0] == paths[2] != paths[1]


def test_ompl_is_silent_and_errors_in_callbacks_are_raised(
    capfd: pytest.CaptureFixture[str],
) -> None:
    class Broken(planners.ClearanceObjective):
        def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
            raise KeyError("broken")

    space = build_room("plane")
    ou.setLogLevel(ou.LOG_INFO)
    try:
        planners.plan(space, *ENDPOINTS["plane"], planner="RRTConnect", seed=3)
        with pytest.raises(KeyError, match="broken"):
            options = {"planner": "RRTstar", "objective": lambda si: Broken(si, space)}
            planners.plan(space, *ENDPOINTS["plane"], **options)
        assert ou.getLogLevel() == ou.LOG_INFO
    finally:
        ou.setLogLevel(ou.LOG_WARN)
    assert capfd.readouterr() == ("", "")


def sum_costs(space: CSpace, si: ob.SpaceInformation, objective: Any, rows: np.ndarray) -> float:
    """Return the cost of a path's edges."""
    states = [make_state(space, si, q) for q in rows]
    return sum(objective.motionCost(a, b).value() for a, b in itertools.pairwise(states))


@pytest.mark.parametrize(("planner", "name"), [("RRTstar", "plane"), ("BITstar", "plane")])
def test_planners_with_an_objective_find_a_cheaper_path(planner: str, name: str) -> None:
    space = build_room(name)
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space)
    iterations = 2000 if planner == "BITstar" else 200  # an iteration of BITstar is one edge
    options = {"planner": planner, "time_limit": 60.0, "iterations": iterations, "seed": 1}
    short = planners.plan(space, *ENDPOINTS[name], **options)
    wide = planners.plan(space, *ENDPOINTS[name], objective="clearance", **options)
    check(space, wide, *ENDPOINTS[name])
    costs = [sum_costs(space, si, objective, plan.path) for plan in (short, wide)]
    assert costs[1] < 0.8 * costs[0] and wide.clearance > short.clearance + 0.1
    own = {"objective": lambda si: planners.ClearanceObjective(si, space), **options}
    custom = planners.plan(space, *ENDPOINTS[name], **own)
    assert np.array_equal(custom.path, wide.path) and custom.objective == "custom"


@pytest.mark.parametrize("curve", [None, "dubins"])
def test_a_planner_without_a_path_improves_a_quick_path(curve: str | None) -> None:
    space = build_room("turning")
    endpoints = endpoints_in("turning", curve)
    drive = options_for(curve)
    si = planners.simple_setup(space, **drive).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space, **drive)
    options = {"planner": "RRTstar", "iterations": 1, "time_limit": 5.0, "seed": 1, **drive}
    assert not planners.plan(space, *endpoints, **options).solved
    first = {"planner": "RRT" if curve else "RRTConnect", "iterations": None, "simplify": False}
    quick = planners.plan(space, *endpoints, **options | first)
    plan = planners.plan(space, *endpoints, objective="clearance", **options)
    check(space, plan, *endpoints)
    costs = [sum_costs(space, si, objective, each.waypoints) for each in (quick, plan)]
    assert "the first one" in plan.status and costs[1] < 0.9 * costs[0]
