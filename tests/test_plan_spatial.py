"""Plans of robots that translate in space."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ompl import geometric as og

import planners
from cspace import BLOCKED, FREE, MIXED, ConfigurationError, CSpace, InputError, Robot, Workspace, build
from planners.registry import IGNORE_OBJECTIVES, SECOND_THREAD
from planners.result import least_clearance
from planners.states import SPACE
from planning import (
    check_spatial,
    spatial_distances,
    spatial_halves,
    spatial_room,
    spatial_with_state,
    voxels_meet_box,
)
from strategies import seeds

NAMES = planners.planner_names()
ANYTIME = {"AORRTC", "BITstar", "InformedRRTstar", "PRMstar", "RRTstar", "SORRTstar"}
START, GOAL = (0.5, 0.5, 0.4), (3.5, 1.4, 1.6)


@pytest.fixture(scope="module")
def space() -> CSpace:
    return spatial_room()


@pytest.fixture(scope="module")
def open_space() -> CSpace:
    """A map that is open to all sides."""
    return build(Workspace.from_array(np.zeros((9, 8, 7), dtype=bool), 1.0), Robot.ball(0.1), outside="free")


def state_at(si: Any, q: Any) -> Any:
    state = si.allocState()
    SPACE.write(state, [float(x) for x in q])
    return state


# ---- every planner ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_every_planner_finds_a_certified_path(space: CSpace, name: str) -> None:
    for simplify in (False, True):
        for limit in (0.3, 5.0):  # the second on a busy machine
            found = planners.plan(space, START, GOAL, planner=name, time_limit=limit, simplify=simplify, seed=1)
            if found.solved:
                break
        check_spatial(space, found, START, GOAL)
        assert found.planner == name and found.status == "Exact solution" and found.objective == "length"


@pytest.mark.parametrize("name", NAMES)
def test_the_single_edge_is_taken_where_it_is_free(space: CSpace, name: str) -> None:
    found = planners.plan(space, START, (0.5, 1.5, 1.6), planner=name)
    check_spatial(space, found, START, (0.5, 1.5, 1.6))
    assert found.path.tolist() == [list(START), [0.5, 1.5, 1.6]]
    assert "no search needed" in found.status and found.times.planning == 0.0
    stay = planners.plan(space, START, START, planner=name)
    check_spatial(space, stay, START, START)
    assert stay.path.tolist() == [list(START)] and stay.length == 0.0 and "start is the goal" in stay.status


@settings(max_examples=25)
@given(seeds, st.sampled_from(["box", "ball", "voxels"]))
def test_no_point_of_a_path_collides_in_any_world(seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    occupied = rng.random(rng.integers(6, 12, 3)) < rng.uniform(0.0, 0.12)
    lower = rng.uniform(-50.0, 50.0, 3)
    sides, center = rng.uniform(0.02, 0.9, 3), rng.uniform(-0.2, 0.2, 3)
    robot = {
        "box": lambda: Robot.box(sides, center),
        "ball": lambda: Robot.ball(sides[0] / 2, center),
        "voxels": lambda: Robot.cells(np.ones((2, 1, 3), dtype=bool), sides[0] / 3, center - sides[0] / 2),
    }[kind]()
    space = build(Workspace.from_array(occupied, 0.3, lower=lower), robot)
    if not (space.state == FREE).any():
        return
    ends = space.sample_free(2, rng)
    exists = space.path_exists(*ends)
    found = planners.plan(space, *ends, seed=seed, time_limit=2.0 if exists else 0.05)
    assert found.solved or not exists
    if found.solved:
        check_spatial(space, found, *ends)
        if kind == "ball":
            low, high = center - sides[0] / 2 / math.sqrt(3), center + sides[0] / 2 / math.sqrt(3)
        else:
            low, high = robot.body.bounds
        assert not voxels_meet_box(space, found.path, low, high).any()


def test_many_seeds_give_certified_paths_and_simplifying_makes_none_longer(space: CSpace) -> None:
    gains = []
    for seed in range(10):
        rough, short = (planners.plan(space, START, GOAL, simplify=simplify, seed=seed) for simplify in (False, True))
        for found in (rough, short):
            check_spatial(space, found, START, GOAL)
        gains.append(rough.length / short.length)
    assert min(gains) >= 1 - 1e-12 and max(gains) > 1.05


def test_a_path_that_ompl_spoiled_is_not_called_certified(space: CSpace, monkeypatch: pytest.MonkeyPatch) -> None:
    from planners.motion import SpatialMotionValidator

    monkeypatch.setattr(SpatialMotionValidator, "checkMotion", lambda *_: True)
    found = planners.plan(space, START, GOAL, simplify=False)
    assert found.solved and not found.certified and found.clearance == 0.0


# ---- start and goal, and other input ---------------------------------------------------------------------------------


def strip() -> CSpace:
    """Cells of 1 m, one above another: FREE, FREE, MIXED, BLOCKED, FREE."""
    return spatial_with_state(np.array([[[FREE, FREE, MIXED, BLOCKED, FREE]]], dtype=np.uint8))


@pytest.mark.parametrize(
    ("q", "words", "nearest"),
    [
        ((0.5, 0.5, 2.4), r"\(0.5, 0.5, 2.4\) lies in a MIXED", (0.5, 0.5, 1.5)),
        ((0.5, 0.5, 3.6), "BLOCKED", (0.5, 0.5, 4.5)),
        ((0.5, 0.5, -3.0), r"outside the map, which reaches from \(0, 0, 0\) to \(1, 1, 5\)", (0.5, 0.5, 0.5)),
        ((0.5, 1.5, 4.5), "outside the map", (0.5, 0.5, 4.5)),
        ((0.3, 0.5, 2.0), "MIXED", (0.5, 0.5, 1.5)),
        ((0.3, 0.5, 4.0), "border", (0.5, 0.5, 4.5)),
    ],
)
def test_an_end_that_cannot_be_used_is_named_with_its_state_and_the_nearest_free_one(
    q: Any, words: str, nearest: tuple[float, ...]
) -> None:
    space = strip()
    for name, ends in (("start", (q, (0.5, 0.5, 0.5))), ("goal", ((0.5, 0.5, 0.5), q))):
        with pytest.raises(ConfigurationError, match=words) as caught:
            planners.plan(space, *ends)
        assert str(caught.value).startswith(name)
        assert caught.value.nearest == nearest
        assert f"({nearest[0]:g}, {nearest[1]:g}, {nearest[2]:g})" in str(caught.value)
        assert planners.plan(space, nearest, nearest).solved


def test_a_z_beyond_pi_is_not_wrapped_as_a_yaw_would_be() -> None:
    space = build(Workspace.from_array(np.zeros((6, 6, 12), dtype=bool), 1.0, lower=(0, 0, -6)), Robot.ball(0.1))
    found = planners.plan(space, (1.5, 1.5, -4.5), (4.5, 4.5, 4.5))
    assert found.path.tolist() == [[1.5, 1.5, -4.5], [4.5, 4.5, 4.5]]
    assert found.length == pytest.approx(math.sqrt(9 + 9 + 81))
    assert least_clearance(space, found.path) == found.clearance
    with pytest.raises(ConfigurationError, match=r"\(1.5, 1.5, 6.5\).*nearest is \(1.5, 1.5, 4.5\)"):
        planners.plan(space, (1.5, 1.5, 6.5), (4.5, 4.5, 4.5))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"start": (math.nan, 1.0, 1.0)}, r"start\[0\] is nan"),
        ({"goal": (1.0, 1.0, math.inf)}, r"goal\[2\] is inf"),
        ({"start": (1.0, 2.0)}, r"start has shape \(2,\).*3 numbers; pass x, y and z, in metres"),
        ({"goal": [(1.0, 1.0, 1.0)]}, r"goal has shape \(1, 3\).*x, y and z"),
        ({"curve": "dubins", "turning_radius": 1.0}, "curve is 'dubins'.*no rotations.*in space only translates"),
        ({"curve": "reeds-shepp"}, "curve is 'reeds-shepp'.*no rotations"),
        ({"turning_radius": 1.0}, "turning_radius is 1.0"),
        ({"objective": "clearance"}, "RRTConnect heeds no objective"),
        ({"exact": 1}, "exact is 1"),
    ],
)
def test_wrong_input_is_named(space: CSpace, wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        planners.plan(**{"space": space, "start": START, "goal": GOAL} | wrong)


# ---- no path ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_a_proof_that_no_path_exists_spares_the_search(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    space = spatial_halves(BLOCKED)
    monkeypatch.setattr(og.SimpleSetup, "solve", lambda *_: pytest.fail("OMPL was run"))
    began = time.perf_counter()
    found = planners.plan(space, (2.5, 4.5, 4.5), (2.5, 4.5, 16.5), planner=name, time_limit=60.0)
    assert time.perf_counter() - began < 10.0
    assert not found.solved and not found.certified and found.path.shape == (0, 3)
    assert math.isnan(found.length) and math.isnan(found.clearance)
    assert found.path_exists is False and found.status == "infeasible (proven: no path exists)"


@pytest.mark.parametrize("name", ["RRTConnect", "RRT", "KPIECE1", "BITstar"])
def test_where_nothing_is_proven_a_planner_searches_and_does_not_pretend(name: str) -> None:
    found = planners.plan(spatial_halves(MIXED), (2.5, 4.5, 4.5), (2.5, 4.5, 16.5), planner=name, time_limit=0.05)
    assert not found.solved and not found.certified and found.path.shape == (0, 3)
    assert found.path_exists is None and found.status in {"Timeout", "Approximate solution"}


# ---- repeatable runs and objectives ----------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(set(NAMES) - SECOND_THREAD))
def test_a_seed_repeats_a_run(space: CSpace, name: str) -> None:
    limits: dict[str, Any] = {"time_limit": 60.0} | ({"iterations": 1000} if name in ANYTIME else {})

    def run(seed: int) -> list[list[float]]:
        return planners.plan(space, START, GOAL, planner=name, seed=seed, **limits).path.tolist()

    first = run(7)
    assert run(8) != first == run(7)
    assert len(first)


def test_the_clearance_objective_keeps_away_from_walls(space: CSpace) -> None:
    options: dict[str, Any] = {"planner": "RRTstar", "time_limit": 60.0, "iterations": 600, "seed": 1}
    short = planners.plan(space, START, GOAL, **options)
    wide = planners.plan(space, START, GOAL, objective="clearance", **options)
    for found in (short, wide):
        check_spatial(space, found, START, GOAL)
    assert wide.clearance > short.clearance + 0.05 and wide.length > short.length
    assert (short.objective, wide.objective) == ("length", "clearance")


@pytest.mark.parametrize("name", sorted(set(NAMES) - IGNORE_OBJECTIVES - SECOND_THREAD - {"FMT", "BFMT"}))
def test_the_planners_that_heed_an_objective_find_a_cheaper_path(space: CSpace, name: str) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space)

    def cost(found: planners.Plan) -> float:
        states = [state_at(si, q) for q in found.path]
        return sum(objective.motionCost(a, b).value() for a, b in itertools.pairwise(states))

    iterations = 3000 if name == "BITstar" else 400  # an iteration of BITstar is one edge
    options: dict[str, Any] = {"planner": name, "time_limit": 60.0, "iterations": iterations, "seed": 1}
    short = planners.plan(space, START, GOAL, **options)
    wide = planners.plan(space, START, GOAL, objective="clearance", **options)
    check_spatial(space, wide, START, GOAL)
    assert cost(wide) < 0.95 * cost(short)


# ---- what a plan says, and writes ------------------------------------------------------------------------------------


def test_the_clearance_of_a_path_is_a_bound_for_each_of_its_points(space: CSpace) -> None:
    rng = np.random.default_rng(0)
    along = np.linspace(0.0, 1.0, 101)[:, None, None]
    some = 0
    for a in space.sample_free(40, rng):
        path = np.array([a, a + rng.uniform(-0.3, 0.3, 3), a + rng.uniform(-0.3, 0.3, 3)])
        bound = least_clearance(space, path)
        if not space.grid.contains(path).all():
            assert bound == 0.0
            continue
        least = spatial_distances(space, (path[:-1] + along * (path[1:] - path[:-1])).reshape(-1, 3)).min()
        assert max(0.0, least - 2.3 * space.grid.spacing) <= bound <= least
        some += bound > 0.0
    assert some > 5


def test_the_clearance_of_a_path_is_the_least_one_of_its_pieces() -> None:
    space = spatial_halves(BLOCKED)
    path = np.array([(2.5, 4.5, 4.5), (2.7, 4.5, 8.0)])
    length = float(np.linalg.norm(path[1] - path[0]))
    count = math.ceil(length / 0.5)
    middles = path[0] + (np.arange(count) + 0.5)[:, None] / count * (path[1] - path[0])
    expected = space.clearance(middles).min() - 0.5 * length / count
    assert least_clearance(space, path) == pytest.approx(expected, abs=1e-12) and expected > 0.0


def test_clearance_is_infinite_where_every_configuration_is_free(open_space: CSpace) -> None:
    found = planners.plan(open_space, (1.5, 1.5, 0.5), (7.5, 7.5, 6.5))
    assert found.solved and found.clearance == math.inf


@pytest.fixture(scope="module")
def found(space: CSpace) -> planners.Plan:
    return planners.plan(space, START, GOAL, seed=4)


def test_a_path_is_read_back_from_csv_to_the_last_bit(found: planners.Plan, tmp_path: Path) -> None:
    found.to_csv(tmp_path / "path.csv")
    with (tmp_path / "path.csv").open(newline="") as file:
        names, *rows = csv.reader(file)
    assert names == ["x", "y", "z"]
    assert np.array_equal(np.array(rows, dtype=float), found.path)


def test_a_plan_is_read_back_from_json(found: planners.Plan, tmp_path: Path) -> None:
    found.to_json(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert set(record) == {field.name for field in dataclasses.fields(planners.Plan)}
    assert record["axes"] == ["x", "y", "z"] and record["direction"] is record["curve"] is None
    assert np.array_equal(record["path"], found.path) and np.array_equal(record["waypoints"], found.path)
    assert record["length"] == found.length and record["clearance"] == found.clearance


def test_an_unsolved_plan_is_written(tmp_path: Path) -> None:
    found = planners.plan(spatial_halves(BLOCKED), (2.5, 4.5, 4.5), (2.5, 4.5, 16.5))
    found.to_csv(tmp_path / "path.csv")
    assert (tmp_path / "path.csv").read_text() == "x,y,z\n"
    found.to_json(tmp_path / "plan.json")
    record = json.loads((tmp_path / "plan.json").read_text())
    assert record["path"] == [] and record["length"] is None and record["path_exists"] is False
