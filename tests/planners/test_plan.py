"""Plans of every planner, in every space and along curves."""

import itertools
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

import planners
from cspace import (
    BLOCKED,
    FREE,
    MIXED,
    ConfigurationError,
    CSpace,
    InputError,
    Robot,
    Workspace,
    build,
)
from planners.catalogue import (
    BIDIRECTIONAL_PLANNERS,
    PLANNERS_WITHOUT_OBJECTIVE,
    THREADED_PLANNERS,
    make_planner,
)
from planners.local_planner import CURVES
from tests.helpers.planning import (
    ANYTIME_PLANNERS,
    CAR_OPTIONS,
    ENDPOINTS,
    SPACES,
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

OMPL_PLANNERS = planners.planner_names()
OPTIMIZING_PLANNERS = sorted(
    set(OMPL_PLANNERS) - PLANNERS_WITHOUT_OBJECTIVE - THREADED_PLANNERS - {"FMT", "BFMT"}
)


@pytest.fixture
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Give FMT and BFMT 300 samples; 1000 take two seconds along curves."""

    def make_with_few_samples(name: str, si: ob.SpaceInformation) -> ob.Planner:
        planner = make_planner(name, si)
        if name in ("FMT", "BFMT"):
            planner.setNumSamples(300)
        return planner

    monkeypatch.setattr("planners.search.make_planner", make_with_few_samples)


def endpoints_in(name: str, curve: str | None) -> tuple[Any, Any]:
    """Return a start and goal that every planner joins."""
    return (ENDPOINTS[name][0], (3.0, 3.0, 0.0)) if curve else ENDPOINTS[name]


# ---- every planner -------------------------------------------------------------------------------


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
@pytest.mark.parametrize("planner", OMPL_PLANNERS)
def test_every_planner_finds_a_certified_path(planner: str, name: str, curve: str | None) -> None:
    if curve == "dubins" and planner in BIDIRECTIONAL_PLANNERS:
        with pytest.raises(InputError, match="choose another planner"):
            planners.plan(build_room(name), *ENDPOINTS[name], planner=planner, **options_for(curve))
        return
    space, endpoints = build_room(name), endpoints_in(name, curve)
    limits = (20.0,) if planner.endswith("FMT") else (0.01, 0.1, 1.0, 20.0)
    plan = plan_patiently(
        space,
        endpoints,
        limits,
        planner=planner,
        simplify=planner not in ANYTIME_PLANNERS,
        **options_for(curve),
    )
    check(space, plan, *endpoints)
    assert (plan.planner, plan.objective, plan.drive, plan.exact) == (
        planner,
        "length",
        curve or "holonomic",
        False,
    )
    assert plan.is_connected and plan.turning_radius == (
        CAR_OPTIONS["turning_radius"] if curve else None
    )
    assert curve != "dubins" or set(plan.direction.tolist()) == {1}  # type: ignore[union-attr]


@pytest.mark.parametrize("planner", OMPL_PLANNERS)
def test_every_planner_returns_a_free_edge_without_a_search(planner: str) -> None:
    # OMPL's SORRTstar would never return.
    for objective in ("length", ob.PathLengthOptimizationObjective):
        if objective != "length" and planner in PLANNERS_WITHOUT_OBJECTIVE | THREADED_PLANNERS:
            continue
        for name, goal in (
            ("plane", (2.0, 4.0)),
            ("turning", (1.2, 0.95, 0.4)),
            ("space", (0.5, 1.5, 1.6)),
            ("yawing", (0.6, 1.0, 0.6, 0.2)),
            ("floating", (0.6, 0.7, 0.6, 0.1, 0.1, 0.1, math.sqrt(0.97))),
        ):
            plan = planners.plan(
                build_room(name), ENDPOINTS[name][0], goal, planner=planner, objective=objective
            )
            check(build_room(name), plan, ENDPOINTS[name][0], goal)
            assert (
                len(plan.waypoints) == 2
                and "no search needed" in plan.status
                and plan.times.planning == 0.0
            )


@pytest.mark.parametrize("curve", CURVES)
def test_a_free_curve_is_returned_without_a_search(curve: str) -> None:
    endpoints = (0.6, 0.8, 0.0), (1.2, 0.95, 0.45)
    plan = planners.plan(build_room("turning"), *endpoints, **options_for(curve))
    check(build_room("turning"), plan, *endpoints)
    assert len(plan.waypoints) == 2 and "no search needed" in plan.status and len(plan.path) > 4


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_a_plan_from_the_goal_stays_there(name: str, curve: str | None) -> None:
    space, start = build_room(name), ENDPOINTS[name][0]
    plan = planners.plan(space, start, start, **options_for(curve))
    check(space, plan, start, start)
    assert plan.path.tolist() == [list(map(float, start))] and plan.length == 0.0
    assert plan.clearance == space.clearance(start) and "start is the goal" in plan.status


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_simplified_paths_are_certified_and_no_longer(name: str, curve: str | None) -> None:
    space, endpoints, gains, directions = build_room(name), endpoints_in(name, curve), [], set()
    for seed in range(3):
        planner = "RRT" if curve == "dubins" else "RRTConnect"
        options = {"planner": planner, "seed": seed, "time_limit": 20.0, **options_for(curve)}
        rough, short = (
            planners.plan(space, *endpoints, simplify=simplify, **options)
            for simplify in (False, True)
        )
        for plan in (rough, short):
            check(space, plan, *endpoints)
            directions |= set() if plan.direction is None else set(plan.direction.tolist())
        assert rough.times.simplification == 0.0 < short.times.simplification
        weight = 0.5 if curve is None else 0.0
        gains.append(
            np.divide(*(plan.length + weight * plan.total_rotation for plan in (rough, short)))
        )
    assert min(gains) >= 1 - 1e-9 and max(gains) > 1.02
    assert directions == {None: set(), "dubins": {1}, "reeds-shepp": {1, -1}}[curve]


def test_yaw_takes_the_shorter_arc_and_is_wrapped() -> None:
    space = build_room("turning")
    plan = planners.plan(space, (0.8, 0.8, 3.0 + 4 * math.pi), (0.9, 0.8, -3.0))
    check(space, plan, (0.8, 0.8, 3.0), (0.9, 0.8, -3.0))
    turns = turn_between(plan.path[:-1, 2], plan.path[1:, 2])
    assert turns.sum() == pytest.approx(2 * math.pi - 6.0) and (turns > 0).all()
    assert planners.plan(space, (0.8, 0.8, math.pi), (0.8, 0.8, -math.pi)).path.tolist() == [
        [0.8, 0.8, -math.pi]
    ]


def test_a_z_beyond_pi_is_not_wrapped() -> None:
    space = build(
        Workspace.from_array(np.zeros((6, 6, 12), dtype=bool), 1.0, lower=(0, 0, -6)),
        Robot.ball(0.1),
    )
    plan = planners.plan(space, (1.5, 1.5, -4.5), (4.5, 4.5, 4.5))
    assert plan.path.tolist() == [[1.5, 1.5, -4.5], [4.5, 4.5, 4.5]]
    assert plan.length == pytest.approx(math.sqrt(9 + 9 + 81))


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_a_path_with_false_motions_is_not_certified(
    name: str, curve: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Lenient(planners.MotionValidator):
        def checkMotion(self, *_: object) -> bool:  # noqa: N802 - OMPL's name
            return True

    monkeypatch.setattr("planners.setup.MotionValidator", Lenient)
    options = {"planner": "RRT" if curve else "RRTConnect", **options_for(curve)}
    space, endpoints = build_room(name), endpoints_in(name, curve)
    plans = [
        planners.plan(space, *endpoints, simplify=False, seed=seed, **options)
        for seed in range(1, 6)
    ]
    assert not all(plan.certified for plan in plans)
    for plan in plans:
        assert plan.solved
        if plan.certified:  # by chance, its motions are free
            check(space, plan, *endpoints)
        else:
            assert "not certified" in repr(plan) and (plan.clearance == 0.0 or curve is not None)


@settings(max_examples=12)
@given(seeds, st.sampled_from(["box", "ball", "voxels"]))
def test_no_point_of_a_path_collides_in_any_world(seed: int, kind: str) -> None:
    # Points of every edge avoid every obstacle cell, by arithmetic independent of the map.
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(6, 12, 3)) < rng.uniform(0.0, 0.12)
    lower, side, center = (
        rng.uniform(-50.0, 50.0, 3),
        rng.uniform(0.02, 0.9),
        rng.uniform(-0.2, 0.2, 3),
    )
    robot = {
        "box": lambda: Robot.box((side, 0.3, 0.1), center),
        "ball": lambda: Robot.ball(side / 2, center),
        "voxels": lambda: Robot.from_bitmap(
            np.ones((2, 1, 3), dtype=bool), side / 3, center - side / 2
        ),
    }[kind]()
    half = side / 2 / math.sqrt(3)  # half the side of a cube in the ball
    low, high = {
        "box": (center - np.array([side, 0.3, 0.1]) / 2, center + np.array([side, 0.3, 0.1]) / 2),
        "ball": (center - half, center + half),
        "voxels": (center - side / 2, center - side / 2 + np.array([2, 1, 3]) * side / 3),
    }[kind]
    space = build(Workspace.from_array(occupied, 0.3, lower=lower), robot)
    if not (space.cell_states == FREE).any():
        return
    endpoints = space.sample_free(2, rng)
    exists = space.is_connected(*endpoints)
    plan = planners.plan(space, *endpoints, seed=seed % 1000, time_limit=2.0 if exists else 0.05)
    assert plan.solved or not exists
    if plan.solved:
        check(space, plan, *endpoints)
        along = np.linspace(0.0, 1.0, 300)[:, None, None]
        points = (plan.path[:-1] + along * np.diff(plan.path, axis=0)).reshape(-1, 3)
        corners = lower + 0.3 * np.argwhere(occupied)
        for part in np.array_split(points, len(points) // 500 + 1):
            first, last = (part + low)[:, None], (part + high)[:, None]
            assert not ((first < corners + 0.3 - 1e-9) & (last > corners + 1e-9)).all(axis=-1).any()


def test_a_path_that_exists_is_found_on_a_real_map(data: Path) -> None:
    space = build(Workspace.open(data / "maps" / "depot.yaml"), Robot.disc(0.3))
    endpoints = space.sample_free(16, np.random.default_rng(0))
    proofs = set()
    for seed, (start, goal) in enumerate(zip(endpoints[::2], endpoints[1::2], strict=True)):
        plan = planners.plan(space, start, goal, seed=seed, time_limit=20.0)
        proofs.add(plan.is_connected)
        assert not plan.is_connected or plan.certified
        assert not plan.is_disconnected or (not plan.solved and "proven" in plan.status)
    assert True in proofs


def test_grid_finds_paths_along_free_cells_only() -> None:
    for name in ("plane", "space"):
        plan = planners.plan(build_room(name), *ENDPOINTS[name], planner="grid")
        check(build_room(name), plan, *ENDPOINTS[name])
        rough = planners.plan(build_room(name), *ENDPOINTS[name], planner="Grid", simplify=False)
        check(build_room(name), rough, *ENDPOINTS[name])
        assert plan.planner == "Grid" and plan.length <= rough.length
        assert (
            plan.path.tolist()
            == planners.plan(
                build_room(name), *ENDPOINTS[name], planner="Grid", seed=3
            ).path.tolist()
        )
        space, start, goal = build_halves(name, MIXED)
        missed = planners.plan(space, start, goal, planner="Grid")
        check_failed(space, missed)
        assert (
            missed.status
            == "no chain of FREE cells joins start and goal; undecided whether one exists"
        )


def test_grid_rotates_only_if_necessary() -> None:
    state = np.zeros((4, 3, 3), np.uint8)
    state[1] = [[0, 1, 0], [0, 1, 0], [0, 1, 0]]
    space = build_from_states(state, 4)
    for yaw in (0.1, 1.6):
        plan = planners.plan(
            space, (0.5, 0.5, yaw), (2.5, 2.5, yaw), planner="Grid", simplify=False
        )
        assert plan.solved and plan.certified and (plan.path[:, 2] == yaw).all() == (yaw == 0.1)
    plan = planners.plan(space, (0.5, 0.5, 0.0), (2.5, 2.5, 1.6), planner="Grid")
    assert plan.certified and plan.path[-1].tolist() == [2.5, 2.5, 1.6]


@pytest.mark.parametrize("name", SPACES)
def test_max_clearance_has_at_least_the_clearance_of_other_planners(name: str) -> None:
    space, endpoints = build_room(name), ENDPOINTS[name]
    plan, other = (
        planners.plan(space, *endpoints, planner=each, seed=1, time_limit=20.0)
        for each in ("maxclearance", None)
    )
    check(space, plan, *endpoints)
    assert plan.planner == "MaxClearance" and plan.clearance >= other.clearance
    assert np.array_equal(
        plan.path,
        planners.plan(space, *endpoints, planner="MaxClearance", seed=2, time_limit=5.0).path,
    )
    rough = planners.plan(space, *endpoints, planner="MaxClearance", simplify=False)
    check(space, rough, *endpoints)
    assert len(rough.waypoints) > len(plan.waypoints)


# ---- no path -------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
@pytest.mark.parametrize("planner", [None, "PRM", "BITstar", "FMT"])
def test_a_proof_that_no_path_exists_prevents_the_search(
    name: str, curve: str | None, planner: str | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    if curve == "dubins" and planner in BIDIRECTIONAL_PLANNERS:
        return
    space, start, goal = build_halves(name, BLOCKED)
    monkeypatch.setattr(og.SimpleSetup, "solve", lambda *_: pytest.fail("OMPL was run"))
    plan = planners.plan(space, start, goal, planner=planner, time_limit=60.0, **options_for(curve))
    check_failed(space, plan)
    assert plan.is_disconnected and plan.times.planning < 60.0
    assert (plan.status, plan.hint) == ("no path exists: proven", "")


@pytest.mark.parametrize("name", ENDPOINTS)
def test_connectivity_is_queried_once(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    query, calls = CSpace.is_connected, list[Any]()
    monkeypatch.setattr(CSpace, "is_connected", lambda *q: calls.append(q) or query(*q))
    plan = planners.plan(
        build_room(name), *ENDPOINTS[name], planner="RRTConnect", time_limit=60.0, seed=1
    )
    assert plan.certified and len(calls) == 1


def test_the_status_says_if_a_path_exists() -> None:
    for name, curve in SPACES_WITH_CURVES:
        options = {"time_limit": 1e-6, "planner": "RRT", **options_for(curve)}
        plan = planners.plan(build_room(name), *endpoints_in(name, curve), **options)
        check_failed(build_room(name), plan)
        known = "one exists for a robot that also moves sideways" if curve else "a path exists"
        assert plan.status == f"no path found within 1e-06 s; {known}" and plan.is_connected
        assert "time_limit=1e-05" in plan.hint and (
            "planner='Grid', which finds one" in plan.hint
        ) == (not curve)


# ---- start and goal ------------------------------------------------------------------------------

ROW_STATES = np.array([FREE, FREE, MIXED, BLOCKED, FREE], dtype=np.uint8)
"""States of a row of cells of 1 m."""


@pytest.mark.parametrize(
    ("x", "other", "message", "nearest"),
    [
        (2.4, 0.5, "lies in a MIXED cell", 1.5),
        (3.6, 0.5, "lies in a BLOCKED cell", 4.5),
        (-3.0, 0.5, "lies outside the map, which reaches from", 0.5),
        (4.5, 1.5, "outside the map", 4.5),
        (2.0, 0.3, "MIXED", 1.5),
        (4.0, 0.3, "is FREE but lies on the border", 4.5),
    ],
)
@pytest.mark.parametrize("shape", [(5, 1), (5, 1, 1), (4, 5, 1)])
def test_an_unusable_endpoint_is_named_with_its_state_and_the_nearest_free_one(
    shape: tuple[int, ...], x: float, other: float, message: str, nearest: float
) -> None:
    turning = shape[0] == 4
    state = np.tile(ROW_STATES[:, None], (4, 1, 1)) if turning else ROW_STATES.reshape(shape)
    space = build_from_states(state, 4 if turning else None)
    rest = (0.1,) if turning else (0.5,) * (len(shape) - 2)
    bad, good = (x, other, *rest), (0.5, 0.5, *rest)
    for name, endpoints in (("start", (bad, good)), ("goal", (good, bad))):
        with pytest.raises(ConfigurationError, match=message) as caught:
            planners.plan(space, *endpoints)
        error = caught.value
        assert str(error).startswith(name) and error.argument == name and error.value == bad
        assert (
            error.nearest is not None
            and error.nearest[:2] == (nearest, 0.5)
            and len(error.nearest) == len(bad)
        )
        assert f"({nearest:g}, 0.5" in error.hint
        assert planners.plan(space, error.nearest, error.nearest).solved


def test_a_free_endpoint_outside_the_map_is_refused() -> None:
    space = build_open_map("plane")
    assert space.is_free((12.0, 4.5)) and space.motion_is_free((12.0, 4.5), (4.5, 4.5))
    with pytest.raises(ConfigurationError, match=r"goal .* outside the map") as caught:
        planners.plan(space, (4.5, 4.5), (12.0, 4.5))
    assert caught.value.nearest == (8.5, 4.5)


def test_a_map_without_free_cells_has_no_nearest_free_configuration() -> None:
    with pytest.raises(ConfigurationError, match="no FREE configuration at all") as caught:
        planners.plan(
            build_from_states(np.full((3, 3), MIXED, dtype=np.uint8)), (1.5, 1.5), (2.5, 2.5)
        )
    assert caught.value.nearest is None


# ---- wrong input ---------------------------------------------------------------------------------


@refusals(
    "name, wrong, message",
    ("plane", {"start": (math.nan, 1.0)}, r"start\[0\] is nan"),
    ("plane", {"goal": (1.0, math.inf)}, r"goal\[1\] is inf"),
    ("plane", {"start": (1.0, 2.0, 3.0)}, r"start has shape \(3,\).*pass \(x, y\), in metres"),
    ("plane", {"goal": [(1.0, 1.0)]}, r"goal has shape \(1, 2\)"),
    ("plane", {"goal": 3.0}, r"goal has shape \(\)"),
    ("plane", {"start": "here"}, "start is 'here'"),
    ("turning", {"start": (1.0, 1.0)}, r"start has shape \(2,\).*3 numbers.*radians"),
    ("turning", {"start": (1.0, 1.0, 1e9)}, "yaw of 1e.09 rad.*wrap"),
    (
        "space",
        {"start": (1.0, 2.0)},
        r"start has shape \(2,\).*3 numbers; pass .x, y, z., in metres",
    ),
    ("plane", {"time_limit": 0.0}, "time_limit is 0.0"),
    ("plane", {"time_limit": -1.0}, "time_limit is -1.0"),
    ("plane", {"time_limit": math.nan}, "time_limit is nan"),
    ("plane", {"time_limit": math.inf}, "time_limit is inf"),
    ("plane", {"objective": "speed"}, "objective is 'speed'.*'clearance'"),
    ("plane", {"objective": None}, "objective is None"),
    ("plane", {"objective": lambda si: 3, "planner": "RRTstar"}, "objective returned 3"),
    (
        "plane",
        {"objective": "clearance", "planner": "RRTConnect"},
        "RRTConnect ignores objectives.*RRTstar",
    ),
    (
        "plane",
        {"objective": "clearance", "exact": True},
        "exact is True and planner is 'Grid', the default for objective='clearance'; .* FREE cells .*RRTstar",
    ),
    (
        "plane",
        {"objective": "clearance", "iterations": 3},
        "iterations is 3 and planner is 'Grid', the default for objective='clearance'; .*RRTstar",
    ),
    (
        "turning",
        {"objective": "clearance", "drive": "differential"},
        "drive is 'differential' and planner is 'Grid', the default for obj.*is for holonomic robots; .*'RRTstar'",
    ),
    (
        "plane",
        {"objective": "overlap"},
        "objective is 'overlap'; it must be .*planners.OverlapObjective",
    ),
    ("plane", {"objective": lambda si: 3}, "is a function and no planner is named; .*'RRTstar'"),
    ("plane", {"objective": "clearance", "planner": "PRM"}, "second thread"),
    ("plane", {"iterations": 10, "planner": "prmstar"}, "second thread"),
    ("plane", {"iterations": 0}, "iterations is 0"),
    ("plane", {"iterations": 1.5}, "iterations is 1.5"),
    ("plane", {"seed": -1}, "seed is -1"),
    ("plane", {"seed": 2**32 - 1}, "seed is 4294967295"),
    ("plane", {"seed": True}, "seed is True"),
    ("plane", {"seed": "one"}, "seed is 'one'"),
    ("plane", {"planner": "RRTConect"}, r"did you mean RRTConnect.*KPIECE1"),
    (
        "plane",
        {"planner": "MaxClearance", "exact": True},
        "exact is True and planner is 'MaxClearance'; .* FREE cells; leave exact out.*'RRTConnect'",
    ),
    (
        "plane",
        {"planner": "Grid", "iterations": 3},
        "iterations is 3 and planner is 'Grid'; Grid counts none",
    ),
    (
        "yawing",
        {"drive": "dubins", "turning_radius": 1.0},
        "drive is 'dubins' and the axes are .x, y, z, yaw.*leave drive",
    ),
    ("yawing", {"start": (1.0, 2.0, 3.0)}, r"4 numbers; pass \(x, y, z, yaw\), in metres"),
    (
        "plane",
        {"planner": "Grid", "objective": "clearance", "exact": True},
        "exact is True and planner is 'Grid'; .* FREE cells for objective='clearance'; .*'RRTstar'",
    ),
    (
        "plane",
        {"planner": "MaxClearance", "objective": "clearance"},
        "objective is 'clearance' and.*'RRTstar'",
    ),
    (
        "turning",
        {"planner": "Grid", "drive": "dubins", "turning_radius": 1.0},
        "drive is 'dubins' and planner is 'Grid'; Grid is for holonomic robots; .*'RRT'",
    ),
    ("floating", {"start": (1.0, 2.0, 3.0)}, r"7 numbers; pass \(x, y, z, qx, qy, qz, qw\)"),
    (
        "floating",
        {"start": (0.5, 0.5, 0.5, 0, 0, 0, 2)},
        "start has a quaternion of norm 2; it must be 1",
    ),
    ("turning", {"drive": "dubins"}, "turning_radius is missing.*metres"),
    ("turning", {"drive": "dubins", "turning_radius": 0.0}, "turning_radius is 0.0"),
    ("turning", {"drive": "dubins", "turning_radius": math.nan}, "turning_radius is nan"),
    (
        "turning",
        {"drive": "reeds-shepp", "turning_radius": 1e-9},
        "turning_radius is 1e-09.*on the spot",
    ),
    ("turning", {"drive": "reeds-shepp", "turning_radius": "1m"}, "turning_radius is '1m'"),
    (
        "turning",
        {"drive": "clothoid", "turning_radius": 1.0},
        "drive is 'clothoid'.*'differential', .*'dubins' or 'reeds-shepp'",
    ),
    ("turning", {"drive": ["dubins"], "turning_radius": 1.0}, r"drive is \['dubins'\]"),
    ("turning", {"turning_radius": 1.0}, "turning_radius is 1.0 and drive is 'holonomic'"),
    (
        "turning",
        {"drive": "dubins", "turning_radius": 1.0, "exact": True},
        "exact is True and drive is 'dubins'",
    ),
    ("turning", {"exact": 3}, "exact is 3"),
    (
        "turning",
        {"drive": "differential", "turning_radius": 1.0},
        "1.0 and drive is 'differential'",
    ),
    (
        "turning",
        {"drive": "differential", "planner": "MaxClearance"},
        "drive is 'differential' and planner is 'MaxClearance'",
    ),
    (
        "turning",
        {"drive": "differential", "planner": "Grid"},
        "drive is 'differential' and planner is 'Grid'",
    ),
    (
        "yawing",
        {"drive": "differential"},
        "drive is 'differential' and .* .x, y, z, yaw.*leave drive",
    ),
    ("plane", {"drive": "differential-reverse"}, "are .x, y.;.*rotations=72"),
    ("turning", {"drive": None}, "drive is None"),
    (
        "space",
        {"drive": "reeds-shepp", "turning_radius": 1.0},
        "drive is 'reeds-shepp'.*are .x, y, z.",
    ),
)
def test_invalid_arguments_are_refused(name: str, wrong: dict[str, Any], message: str) -> None:
    start, goal = ENDPOINTS[name]
    with pytest.raises(InputError, match=message) as caught:
        planners.plan(**{"space": build_room(name), "start": start, "goal": goal} | wrong)
    assert caught.value.argument.split("[")[0].split()[0] in {*wrong, "turning_radius"}


# ---- repeatable runs -----------------------------------------------------------------------------


@pytest.mark.usefixtures("few_samples")
@pytest.mark.parametrize("planner", sorted(set(OMPL_PLANNERS) - THREADED_PLANNERS))
def test_a_seed_repeats_a_run_after_other_runs(planner: str) -> None:
    limits: dict[str, Any] = {"time_limit": 60.0} | (
        {"iterations": 200} if planner in ANYTIME_PLANNERS else {}
    )
    for name, curve in SPACES_WITH_CURVES:
        if planner not in ANYTIME_PLANNERS | {"RRT"} and (curve or name in ("space", "yawing")):
            continue

        def run(seed: int, name: str = name, curve: str | None = curve) -> list[list[float]]:
            options = {"planner": planner, "seed": seed, **limits, **options_for(curve)}
            plan = planners.plan(build_room(name), *endpoints_in(name, curve), **options)
            assert plan.seed == seed and plan.times.planning < 30.0
            path: list[list[float]] = plan.path.tolist()
            return path

        if curve == "dubins" and planner in BIDIRECTIONAL_PLANNERS:
            continue
        first = run(7)
        planners.plan(build_room("plane"), ENDPOINTS["plane"][0], (5.0, 3.0), planner="RRT")
        other = run(8)
        assert first == run(7) and (other != first or not first)


def test_ompl_prints_nothing_and_keeps_its_log_level(capfd: pytest.CaptureFixture[str]) -> None:
    ou.setLogLevel(ou.LOG_INFO)
    try:
        planners.plan(build_room("plane"), *ENDPOINTS["plane"], seed=3)
        with pytest.raises(ZeroDivisionError):
            planners.plan(
                build_room("plane"),
                *ENDPOINTS["plane"],
                planner="RRTstar",
                objective=lambda si: 1 // 0,
            )
        assert ou.getLogLevel() == ou.LOG_INFO
    finally:
        ou.setLogLevel(ou.LOG_WARN)
    assert capfd.readouterr() == ("", "")


# ---- objectives ----------------------------------------------------------------------------------


def test_a_custom_objective_is_called_and_widens_the_path() -> None:
    calls, space = [], build_room("plane")

    class Counted(planners.ClearanceObjective):
        def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
            calls.append(1)
            return super().motionCost(first, second)

    options: dict[str, Any] = {
        "planner": "RRTstar",
        "time_limit": 60.0,
        "iterations": 200,
        "seed": 1,
    }
    short = planners.plan(space, *ENDPOINTS["plane"], **options)
    wide = planners.plan(
        space, *ENDPOINTS["plane"], objective=lambda si: Counted(si, space), **options
    )
    same = planners.plan(space, *ENDPOINTS["plane"], objective="clearance", **options)
    for plan in (short, wide):
        check(space, plan, *ENDPOINTS["plane"])
    assert len(calls) > 300
    assert wide.clearance > short.clearance + 0.15 and wide.length > short.length
    assert wide.path.tolist() == same.path.tolist()
    assert (short.objective, wide.objective, same.objective) == ("length", "custom", "clearance")
    # Only the best quick path that a planner must beat is improved to the end.
    calls.clear()
    planners.plan(
        space,
        *ENDPOINTS["plane"],
        objective=lambda si: Counted(si, space),
        **options | {"iterations": 1},
    )
    assert 100 < len(calls) < 25_000


@pytest.mark.parametrize(
    ("planner", "name"), [*((each, "plane") for each in OPTIMIZING_PLANNERS), ("RRTstar", "space")]
)
def test_optimizing_planners_find_a_cheaper_path(planner: str, name: str) -> None:
    space = build_room(name)
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space)

    def cost(plan: planners.Plan) -> float:
        states = [make_state(space, si, q) for q in plan.path]
        return sum(objective.motionCost(a, b).value() for a, b in itertools.pairwise(states))

    iterations = 3000 if planner == "BITstar" else 250  # an iteration of BITstar is one edge
    options: dict[str, Any] = {
        "planner": planner,
        "time_limit": 60.0,
        "iterations": iterations,
        "seed": 1,
    }
    short = planners.plan(space, *ENDPOINTS[name], **options | {"iterations": iterations + 150})
    wide = planners.plan(space, *ENDPOINTS[name], objective="clearance", **options)
    check(space, wide, *ENDPOINTS[name])
    assert cost(wide) < (0.8 if name == "plane" else 0.95) * cost(short)
    if planner == "RRTstar":
        rough = planners.plan(
            space, *ENDPOINTS[name], objective="clearance", simplify=False, **options
        )
        assert cost(wide) <= cost(rough) * (1 + 1e-12)


@pytest.mark.parametrize(("name", "curve"), SPACES_WITH_CURVES)
def test_a_planner_without_a_path_improves_a_quick_path(name: str, curve: str | None) -> None:
    space, endpoints, drive = build_room(name), endpoints_in(name, curve), options_for(curve)
    si = planners.simple_setup(space, **drive).getSpaceInformation()
    objective, costs = planners.ClearanceObjective(si, space, **drive), []
    options: dict[str, Any] = {
        "planner": "RRTstar",
        "iterations": 1,
        "time_limit": 5.0,
        "seed": 1,
        **drive,
    }
    assert not planners.plan(space, *endpoints, **options).solved
    default = {"planner": "RRT" if curve == "dubins" else "RRTConnect", "iterations": None}
    quick = planners.plan(space, *endpoints, simplify=False, **options | default)
    for plan in (quick, planners.plan(space, *endpoints, objective="clearance", **options)):
        check(space, plan, *endpoints)
        states = [make_state(space, si, q) for q in plan.waypoints]
        costs.append(sum(objective.motionCost(a, b).value() for a, b in itertools.pairwise(states)))
    assert "the first one" in plan.status and costs[1] < 0.9 * costs[0]


@pytest.mark.parametrize("planner", OPTIMIZING_PLANNERS)
@pytest.mark.parametrize("curve", [None, *CURVES])
def test_optimizing_planners_work_with_rotations_and_curves(
    curve: str | None, planner: str
) -> None:
    options: dict[str, Any] = {
        "planner": planner,
        "objective": "clearance",
        "iterations": 60,
        **options_for(curve),
    }
    endpoints = (0.6, 1.0, 0.0), (1.2, 3.3, 1.0)
    plan = plan_patiently(build_room("turning"), endpoints, (0.1, 2.0, 20.0), **options)
    check(build_room("turning"), plan, *endpoints)


def test_an_error_in_a_callback_is_raised() -> None:
    class Broken(planners.ClearanceObjective):
        def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
            raise KeyError("broken")

    space = build_room("plane")
    with pytest.raises(KeyError, match="broken"):
        planners.plan(
            space, *ENDPOINTS["plane"], planner="RRTstar", objective=lambda si: Broken(si, space)
        )
