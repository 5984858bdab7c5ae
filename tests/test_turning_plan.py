"""Plans of robots that turn: straight, along curves, and where only the geometry can tell."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ompl import base as ob

import planners
from cspace import BLOCKED, FREE, MIXED, ConfigurationError, CSpace, InputError, Robot, Workspace, build
from planners.curves import CURVES
from planners.registry import IGNORE_OBJECTIVES, NO_CURVES, SECOND_THREAD
from planners.states import TURNING
from planning import check_turning, room, turn_between, turning_halves, turning_room

NAMES = planners.planner_names()
ANYTIME = {"AORRTC", "BITstar", "InformedRRTstar", "PRMstar", "RRTstar", "SORRTstar"}
START, GOAL = (0.8, 0.8, 0.0), (5.0, 3.2, 2.0)
CAR = {"turning_radius": 0.4}


def able(curve: str) -> list[str]:
    """The planners that can plan along a curve."""
    return [name for name in NAMES if name not in NO_CURVES.get(curve, {})]


CURVED = [(curve, name) for curve in CURVES for name in able(curve)]


@pytest.fixture(scope="module")
def space() -> CSpace:
    return turning_room()


@pytest.fixture(scope="module")
def plane() -> CSpace:
    return room()


def state_at(si: Any, q: Any) -> Any:
    state = si.allocState()
    TURNING.write(state, [float(x) for x in q])
    return state


# ---- the pieces handed to OMPL ---------------------------------------------------------------------------------------


def configurations(space: CSpace, n: int, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    lower, upper = np.array(space.grid.lower), np.array(space.grid.upper)
    return np.column_stack([rng.uniform(lower - 0.2, upper + 0.2, (n, 2)), rng.uniform(-math.pi, math.pi, n)])


def test_states_are_those_of_the_map(space: CSpace) -> None:
    setup = planners.simple_setup(space)
    si, checker = setup.getSpaceInformation(), setup.getStateValidityChecker()
    q = configurations(space, 1500, 0)
    states = [state_at(si, each) for each in q]
    assert [TURNING.read(state) for state in states] == [tuple(each) for each in q.tolist()]
    assert [si.isValid(state) for state in states] == space.is_free(q).tolist()
    assert 0.1 < space.is_free(q).mean() < 0.9
    assert [checker.clearance(state) for state in states] == space.clearance(q).tolist()
    assert isinstance(checker, planners.StateValidityChecker)
    assert isinstance(setup.getStateSpace(), ob.SE2StateSpace)
    bounds = setup.getStateSpace().getBounds()
    assert [bounds.low[axis] for axis in range(2)] == list(space.grid.lower)
    assert [bounds.high[axis] for axis in range(2)] == list(space.grid.upper)


def test_motions_are_those_of_the_map(space: CSpace) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    rng = np.random.default_rng(1)
    a = space.sample_free(800, rng)
    b = a + rng.uniform(-1.0, 1.0, a.shape)
    a[:, 2], b[:, 2] = turn_between(0.0, a[:, 2]), turn_between(0.0, b[:, 2])
    asked = [si.checkMotion(state_at(si, p), state_at(si, q)) for p, q in zip(a, b, strict=True)]
    assert asked == space.motion_is_free(a, b).tolist()
    assert any(asked) and not all(asked)


@pytest.mark.parametrize("options", [{}, {"curve": "dubins", **CAR}])
def test_classes_made_for_another_kind_of_map_are_refused(space: CSpace, plane: CSpace, options: Any) -> None:
    class Mine(planners.MotionValidator):
        pass

    class Turning(type(planners.simple_setup(space).getSpaceInformation().getMotionValidator())):  # type: ignore[misc]
        pass

    flat, turning = (planners.simple_setup(each).getSpaceInformation() for each in (plane, space))
    assert type(Mine(flat, plane)) is Mine and type(Turning(turning, space, **options)) is Turning
    with pytest.raises(InputError, match=r"Mine derives.*\(x, y\),.*\(x, y, yaw\);.*TurningMotionValidator"):
        Mine(turning, space)
    with pytest.raises(InputError, match=r"Turning derives.*\(x, y, yaw\),.*\(x, y\);.*motion\.MotionValidator"):
        Turning(flat, plane)


def test_samples_are_free_and_spread_over_every_yaw(space: CSpace) -> None:
    si = planners.simple_setup(space, rng=np.random.default_rng(0)).getSpaceInformation()
    sampler, state, yaws = si.allocValidStateSampler(), si.allocState(), []
    for _ in range(3000):
        assert sampler.sample(state) and si.isValid(state) and si.satisfiesBounds(state)
        assert -math.pi <= state.getYaw() < math.pi
        yaws.append(state.getYaw())
    counts = np.histogram(yaws, bins=12, range=(-math.pi, math.pi))[0]
    assert counts.min() > 100


@pytest.mark.parametrize("near", [(0.8, 0.8, 0.0), (3.0, 2.0, 3.1), (0.4, 0.4, -3.1)])
@pytest.mark.parametrize("distance", [0.05, 0.4, 20.0])
def test_samples_near_a_state_are_free_and_near(space: CSpace, near: Any, distance: float) -> None:
    si = planners.simple_setup(space, rng=np.random.default_rng(1)).getSpaceInformation()
    sampler, state, centre = si.allocValidStateSampler(), state_at(si, (9.0, 9.0, 0.0)), state_at(si, near)
    yaws = []
    for _ in range(200):
        before = TURNING.read(state)
        if not sampler.sampleNear(state, centre, distance):
            assert TURNING.read(state) == before
            continue
        x, y, yaw = TURNING.read(state)
        assert si.isValid(state) and si.satisfiesBounds(state) and -math.pi <= yaw < math.pi
        assert max(abs(x - near[0]), abs(y - near[1])) <= distance
        assert abs(turn_between(near[2], yaw)) <= distance + 1e-12
        yaws.append(turn_between(near[2], yaw))
    if space.is_free(near):
        assert len(yaws) > 100 and np.ptp(yaws) > min(distance, math.pi)
    assert not sampler.sampleNear(state, state_at(si, (60.0, 1.0, 0.0)), 1.0)


@pytest.mark.parametrize("options", [{}, {"curve": "dubins", **CAR}, {"curve": "reeds-shepp", **CAR}])
def test_the_clearance_objective_is_an_integral_along_the_edge(space: CSpace, options: dict[str, Any]) -> None:
    setup = planners.simple_setup(space, **options)
    si, states = setup.getSpaceInformation(), setup.getStateSpace()
    objective = planners.ClearanceObjective(si, space, weight=6.0, comfort=0.4, **options)
    rng = np.random.default_rng(2)
    between = si.allocState()
    extra, ratios = False, []
    for a in space.sample_free(25, rng):
        b = a + rng.uniform(-1.0, 1.0, 3)
        first, second = state_at(si, (*a[:2], turn_between(0.0, a[2]))), state_at(si, (*b[:2], turn_between(0.0, b[2])))
        length = states.distance(first, second)
        points = []
        for share in (np.arange(400) + 0.5) / 400:
            states.interpolate(first, second, share, between)
            points.append(TURNING.read(between))
        short = np.maximum(0.0, 1.0 - space.clearance(np.array(points)) / 0.4)
        cost = objective.motionCost(first, second).value()
        assert cost >= length * (1 - 1e-9) and cost >= objective.motionCostHeuristic(first, second).value() - 1e-9
        ratios.append(cost / (length * (1.0 + 6.0 * (short**2).mean())))
        extra |= cost > 1.5 * length
        at = 1.0 + 6.0 * max(0.0, 1.0 - space.clearance(TURNING.read(first)) / 0.4) ** 2
        assert objective.stateCost(first).value() == pytest.approx(at)
    assert extra and np.median(np.abs(np.array(ratios) - 1.0)) < 0.03
    assert objective.motionCost(first, first).value() == 0.0


# ---- every planner ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_every_planner_finds_a_certified_path(space: CSpace, name: str) -> None:
    for simplify in (False, True):
        for limit in (0.3, 5.0):  # the second on a busy machine
            found = planners.plan(space, START, GOAL, planner=name, time_limit=limit, simplify=simplify, seed=1)
            if found.solved:
                break
        check_turning(space, found, START, GOAL)
        assert found.planner == name and found.status == "Exact solution" and found.path_exists is True
        assert (found.curve, found.turning_radius, found.exact, found.exact_counts) == (None, None, False, {})


@pytest.mark.parametrize(("curve", "name"), CURVED)
def test_every_planner_that_can_finds_a_certified_path_along_curves(space: CSpace, curve: str, name: str) -> None:
    goal = (5.0, 3.2, 0.5)  # which RRTConnect finds along Dubins curves too
    for limit in (0.5, 20.0):  # FMT draws all its samples first
        found = planners.plan(space, START, goal, planner=name, time_limit=limit, seed=1, curve=curve, **CAR)
        if found.solved:
            break
    check_turning(space, found, START, goal)
    assert (found.curve, found.turning_radius) == (curve, 0.4)
    assert curve != "dubins" or set(found.direction.tolist()) == {1}  # type: ignore[union-attr]


@pytest.mark.parametrize(("curve", "name"), [(c, n) for c, names in NO_CURVES.items() for n in names])
def test_planners_that_take_edges_from_their_ends_are_refused(space: CSpace, curve: str, name: str) -> None:
    with pytest.raises(InputError, match=rf"curve is '{curve}' and planner is '{name}'.*RRT"):
        planners.plan(space, START, GOAL, planner=name.lower(), curve=curve, **CAR)


@pytest.mark.parametrize("curve", [None, *CURVES])
def test_many_seeds_give_certified_paths(space: CSpace, curve: str | None) -> None:
    options: dict[str, Any] = {} if curve is None else {"curve": curve, **CAR}
    reverses = set()
    for seed in range(12):
        found = planners.plan(space, START, GOAL, seed=seed, time_limit=20.0, **options)
        check_turning(space, found, START, GOAL)
        if found.direction is not None:
            reverses |= set(found.direction.tolist())
    assert reverses == {None: set(), "dubins": {1}, "reeds-shepp": {1, -1}}[curve]


@pytest.mark.parametrize("curve", [None, *CURVES])
def test_the_single_edge_is_taken_where_it_is_free(space: CSpace, curve: str | None) -> None:
    options: dict[str, Any] = {} if curve is None else {"curve": curve, **CAR}
    for name in ("RRTConnect", "SORRTstar"):
        found = planners.plan(space, (0.6, 0.8, 0.0), (1.2, 0.95, 0.45), planner=name, **options)
        check_turning(space, found, (0.6, 0.8, 0.0), (1.2, 0.95, 0.45))
        assert len(found.waypoints) == 2 and "no search needed" in found.status and found.times.planning == 0.0
    assert len(found.path) > 4


def test_yaw_goes_along_the_shorter_arc_and_is_wrapped(space: CSpace) -> None:
    found = planners.plan(space, (0.8, 0.8, 3.0 + 4 * math.pi), (0.9, 0.8, -3.0))
    check_turning(space, found, (0.8, 0.8, 3.0), (0.9, 0.8, -3.0))
    turns = turn_between(found.path[:-1, 2], found.path[1:, 2])
    assert turns.sum() == pytest.approx(2 * math.pi - 6.0) and (turns > 0).all()
    assert planners.plan(space, (0.8, 0.8, math.pi), (0.8, 0.8, -math.pi)).path.tolist() == [[0.8, 0.8, -math.pi]]


def test_simplifying_makes_no_curve_longer(space: CSpace) -> None:
    for curve in CURVES:
        gains = []
        for seed in range(6):
            rough, short = (
                planners.plan(space, START, GOAL, simplify=simplify, seed=seed, curve=curve, time_limit=20.0, **CAR)
                for simplify in (False, True)
            )
            gains.append(rough.length / short.length)
        assert min(gains) >= 1 - 1e-9 and max(gains) > 1.02


def test_a_path_that_ompl_spoiled_is_not_called_certified(space: CSpace, monkeypatch: pytest.MonkeyPatch) -> None:
    from planners.motion import TurningMotionValidator

    monkeypatch.setattr(TurningMotionValidator, "checkMotion", lambda *_: True)
    for options in ({}, {"curve": "dubins", **CAR}):
        found = planners.plan(space, START, GOAL, simplify=False, **options)
        assert found.solved and not found.certified


# ---- no path ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("curve", [None, *CURVES])
def test_a_proof_that_no_path_exists_spares_the_search(curve: str | None) -> None:
    options: dict[str, Any] = {} if curve is None else {"curve": curve, **CAR}
    began = time.perf_counter()
    found = planners.plan(turning_halves(BLOCKED), (2.5, 4.5, 1.0), (16.5, 4.5, 0.0), time_limit=60.0, **options)
    assert time.perf_counter() - began < 10.0
    assert not found.solved and not found.certified and found.path_exists is False
    assert found.status == "infeasible (proven: no path exists)" and found.times.planning == 0.0
    assert found.path.shape == found.waypoints.shape == (0, 3)
    assert math.isnan(found.length) and math.isnan(found.clearance)


@pytest.mark.parametrize("curve", [None, *CURVES])
def test_where_nothing_is_proven_a_planner_searches_and_does_not_pretend(curve: str | None) -> None:
    options: dict[str, Any] = {} if curve is None else {"curve": curve, "turning_radius": 1.0}
    found = planners.plan(turning_halves(MIXED), (2.5, 4.5, 1.0), (16.5, 4.5, 0.0), time_limit=0.1, **options)
    assert not found.solved and found.path_exists is None and found.times.planning > 0.0
    assert found.status in {"Timeout", "Approximate solution"}


# ---- bad input -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"start": (1.0, 1.0)}, r"start has shape \(2,\).*3 numbers.*radians"),
        ({"goal": (1.0, 1.0, math.nan)}, r"goal\[2\] is nan"),
        ({"start": (1.0, 1.0, 1e9)}, "yaw of 1e.09 rad.*wrap"),
        ({"curve": "dubins"}, "turning_radius is None.*metres"),
        ({"curve": "dubins", "turning_radius": 0.0}, "turning_radius is 0.0"),
        ({"curve": "dubins", "turning_radius": -1.0}, "turning_radius is -1.0"),
        ({"curve": "dubins", "turning_radius": math.nan}, "turning_radius is nan"),
        ({"curve": "reeds-shepp", "turning_radius": math.inf}, "turning_radius is inf"),
        ({"curve": "reeds-shepp", "turning_radius": 1e-9}, "turning_radius is 1e-09.*on the spot"),
        ({"curve": "reeds-shepp", "turning_radius": "1m"}, "turning_radius is '1m'"),
        ({"curve": "clothoid", "turning_radius": 1.0}, "curve is 'clothoid'.*'dubins' or 'reeds-shepp'"),
        ({"curve": ["dubins"], "turning_radius": 1.0}, r"curve is \['dubins'\]"),
        ({"turning_radius": 1.0}, "turning_radius is 1.0 and curve is None"),
        ({"curve": "dubins", "turning_radius": 1.0, "exact": True}, "exact is True and curve is 'dubins'.*finer"),
        ({"exact": 3}, "exact is 3"),
    ],
)
def test_wrong_input_is_named(space: CSpace, wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        planners.plan(**{"space": space, "start": START, "goal": GOAL} | wrong)


def test_curves_need_a_map_with_rotations(plane: CSpace) -> None:
    for make in (planners.state_space, planners.simple_setup):
        with pytest.raises(InputError, match=r"no rotations.*rotations=72"):
            make(plane, curve="dubins", turning_radius=1.0)
    with pytest.raises(InputError, match="no rotations"):
        planners.plan(plane, (1.0, 1.0), (9.0, 5.0), curve="dubins", turning_radius=1.0)


@pytest.mark.parametrize(
    ("q", "words"),
    [((0.05, 0.8, 0.0), "BLOCKED|MIXED"), ((9.0, 1.0, 0.0), "outside the map"), ((1.9, 1.0, 1.0), "BLOCKED")],
)
def test_an_end_that_cannot_be_used_is_named_with_the_nearest_free_one(space: CSpace, q: Any, words: str) -> None:
    for name, ends in (("start", (q, GOAL)), ("goal", (START, q))):
        with pytest.raises(ConfigurationError, match=words) as caught:
            planners.plan(space, *ends)
        nearest = caught.value.nearest
        assert str(caught.value).startswith(name) and nearest is not None and len(nearest) == 3
        assert -math.pi <= nearest[2] < math.pi and space.is_free(nearest)
        assert planners.plan(space, nearest, nearest).solved


# ---- repeatable runs -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("curve", [None, *CURVES])
@pytest.mark.parametrize("name", ["RRT", "RRTConnect", "KPIECE1"])
def test_a_seed_repeats_a_run_with_others_in_between(space: CSpace, curve: str | None, name: str) -> None:
    options: dict[str, Any] = {} if curve is None else {"curve": curve, **CAR}

    goal = (5.0, 3.2, 0.5)

    def run(seed: int) -> list[list[float]]:
        found = planners.plan(space, START, goal, planner=name, seed=seed, time_limit=20.0, **options)
        path: list[list[float]] = found.path.tolist()
        return path

    first = run(7)
    planners.plan(space, START, (3.0, 3.2, 0.0), planner="RRT")
    assert run(8) != first == run(7)


# ---- exact -----------------------------------------------------------------------------------------------------------


def corridor(width: float) -> CSpace:
    """A corridor along x, of a width off the lattice, between two halls, for a robot of 0.5 m by 0.5 m."""
    from shapely import box

    low, high = 1.5 - width / 2, 1.5 + width / 2
    walls = [box(2.0, -0.1, 4.0, low), box(2.0, high, 4.0, 3.1)]
    return build(
        Workspace.from_polygons(walls, 0.1, bounds=(0.0, 0.0, 6.0, 3.0)), Robot.rectangle(0.7, 0.5), rotations=36
    )


def test_a_corridor_a_hair_wider_than_the_robot_is_solved_exactly() -> None:
    space = corridor(0.51)
    start, goal = (1.0, 1.5, 0.0), (5.0, 1.5, 0.0)
    coarse = planners.plan(space, start, goal, time_limit=0.2, seed=0)
    assert not coarse.solved and coarse.path_exists is None
    found = planners.plan(space, start, goal, exact=True, time_limit=20.0, seed=0)
    check_turning(space, found, start, goal)
    assert found.exact and found.clearance == 0.0 and sum(found.exact_counts.values()) > 0
    assert all(isinstance(count, int) and count >= 0 for count in found.exact_counts.values())
    # In the middle of the corridor too, where every cell is MIXED.
    inside = (3.0, 1.5, 0.0)
    assert space.classify(inside) == MIXED
    with pytest.raises(ConfigurationError, match="MIXED"):
        planners.plan(space, inside, goal)
    check_turning(space, planners.plan(space, inside, goal, exact=True, seed=1), inside, goal)
    with pytest.raises(ConfigurationError, match="collision"):
        planners.plan(space, (3.0, 1.51, 0.0), goal, exact=True)


def test_an_exact_plan_is_proven_against_the_geometry() -> None:
    import shapely

    space = corridor(0.52)
    found = planners.plan(space, (1.0, 2.3, 1.0), (5.0, 0.6, 2.0), exact=True, time_limit=30.0, seed=3)
    check_turning(space, found, (1.0, 2.3, 1.0), (5.0, 0.6, 2.0))
    walls = [shapely.box(2.0, -0.1, 4.0, 1.24), shapely.box(2.0, 1.76, 4.0, 3.1)]
    along = np.linspace(0.0, 1.0, 30)[:, None]
    for a, b in zip(found.path, found.path[1:], strict=False):
        for x, y, yaw in a + along * np.array([*(b - a)[:2], turn_between(a[2], b[2])]):
            turned = shapely.affinity.rotate(space.robot.geometry, yaw, origin=(0, 0), use_radians=True)
            robot = shapely.affinity.translate(turned, x, y)
            assert not any(robot.intersects(wall) for wall in walls)


def test_exact_plans_draw_from_the_whole_map() -> None:
    space = corridor(0.51)
    si = planners.simple_setup(space, exact=True).getSpaceInformation()
    sampler, state, states = si.allocValidStateSampler(), si.allocState(), set()
    for _ in range(1500):
        if sampler.sample(state):
            states.add(space.classify(TURNING.read(state)))
    assert states == {FREE, MIXED}
    with pytest.raises(InputError, match="rng"):
        planners.simple_setup(space, exact=True, rng=np.random.default_rng(0))


def test_exact_plans_in_the_plane() -> None:
    from shapely import box

    walls = [box(2.0, -0.1, 4.0, 1.295), box(2.0, 1.705, 4.0, 3.1)]
    space = build(Workspace.from_polygons(walls, 0.1, bounds=(0.0, 0.0, 6.0, 3.0)), Robot.disc(0.2))
    assert not planners.plan(space, (1.0, 1.0), (5.0, 2.0), time_limit=0.1).solved
    found = planners.plan(space, (1.0, 1.0), (5.0, 2.0), exact=True, time_limit=20.0, seed=1)
    assert found.solved and found.certified and found.exact


# ---- files -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("curve", [None, *CURVES])
def test_files_have_yaw_and_tell_the_direction_of_a_car(space: CSpace, tmp_path: Path, curve: str | None) -> None:
    options: dict[str, Any] = {} if curve is None else {"curve": curve, **CAR}
    found = planners.plan(space, START, GOAL, seed=4, time_limit=20.0, **options)
    found.to_csv(tmp_path / "path.csv")
    with (tmp_path / "path.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    assert names == ["x", "y", "yaw"] + ["direction"] * (curve is not None)
    assert np.array_equal(np.array(rows, dtype=float)[:, :3], found.path)
    if found.direction is not None:
        assert np.array_equal(np.array(rows, dtype=float)[:, 3], found.direction)
    found.to_json(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert (record["curve"], record["turning_radius"]) == (curve, 0.4 if curve else None)
    assert np.array_equal(record["path"], found.path) and np.array_equal(record["waypoints"], found.waypoints)
    assert record["direction"] == (None if found.direction is None else found.direction.tolist())


# ---- objectives ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(set(NAMES) - IGNORE_OBJECTIVES - SECOND_THREAD - {"FMT", "BFMT"}))
@pytest.mark.parametrize("curve", [None, *CURVES])
def test_planners_that_heed_an_objective_keep_away_from_walls(space: CSpace, curve: str | None, name: str) -> None:
    options: dict[str, Any] = {} if curve is None else {"curve": curve, **CAR}
    options |= {"planner": name, "time_limit": 10.0, "iterations": 60, "seed": 1, "objective": "clearance"}
    found = planners.plan(space, (0.6, 1.0, 0.0), (1.2, 3.3, 1.0), **options)
    check_turning(space, found, (0.6, 1.0, 0.0), (1.2, 3.3, 1.0))


# ---- nothing left behind ---------------------------------------------------------------------------------------------

SCRIPT = """
import gc
import numpy as np
import psutil
import cspace, planners

def main():
    occupied = np.zeros((60, 40), dtype=bool)
    occupied[30, :24] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.rectangle(0.4, 0.2), rotations=12)
    car = dict(turning_radius=0.3)
    heeding = dict(objective="clearance", planner="RRTstar", iterations=20)
    ways = [dict(), dict(planner="KPIECE1"), heeding, dict(exact=True), dict(curve="dubins", planner="RRT", **car),
            dict(curve="reeds-shepp", **car), dict(curve="reeds-shepp", **car, **heeding)]

    def resident(plans):
        for k in range(plans):
            planners.plan(space, (0.5, 0.5, 0.0), (5.5, 0.5, 0.0), seed=k, **ways[k % len(ways)])
        gc.collect()
        return psutil.Process().memory_info().rss

    before = resident(140)
    after = resident(350)
    print((after - before) / 2**20)

main()
"""


def test_plans_leave_nothing_behind() -> None:
    pytest.importorskip("psutil", reason="psutil is not installed; run: pip install psutil")
    run = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0 and run.stderr == "", run.stderr
    # One kept set-up is some 30 kB, so a leak of each would show as 10 MiB.
    assert float(run.stdout) < 3.0
