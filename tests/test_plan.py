"""A plan is right, says what it is, and can be repeated."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ompl import base as ob
from ompl import util as ou

import planners
from cspace import BLOCKED, FREE, MIXED, ConfigurationError, CSpace, InputError, Robot, Workspace, build
from planners.registry import IGNORE_OBJECTIVES, SECOND_THREAD
from planning import GOAL, START, check, halves, room, with_state

NAMES = planners.planner_names()
ANYTIME = {"AORRTC", "BITstar", "InformedRRTstar", "PRMstar", "RRTstar", "SORRTstar"}
LAZY_OBJECTIVES = sorted(set(NAMES) - IGNORE_OBJECTIVES - SECOND_THREAD - {"FMT", "BFMT"})


@pytest.fixture(scope="module")
def space() -> CSpace:
    return room()


@pytest.fixture(scope="module")
def empty() -> CSpace:
    return build(Workspace.from_array(np.zeros((60, 40), dtype=bool), 0.1), Robot.disc(0.15))


# ---- every planner ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", NAMES)
def test_every_planner_finds_a_certified_path(space: CSpace, name: str) -> None:
    for simplify in (False, True):
        found = planners.plan(space, START, GOAL, planner=name, time_limit=0.3, simplify=simplify, seed=1)
        if not found.solved:  # a busy machine
            found = planners.plan(space, START, GOAL, planner=name, time_limit=5.0, simplify=simplify, seed=1)
        check(space, found)
        assert found.planner == name and found.status == "Exact solution" and found.objective == "length"


@pytest.mark.parametrize("name", NAMES)
def test_every_planner_takes_the_straight_edge_where_it_is_free(empty: CSpace, name: str) -> None:
    # OMPL's SORRTstar would never return from here, and its AORRTC call the goal invalid.
    for objective in ("length", ob.PathLengthOptimizationObjective):
        if objective != "length" and name in IGNORE_OBJECTIVES | SECOND_THREAD:
            continue
        found = planners.plan(empty, (1.0, 1.0), (5.0, 3.0), planner=name, objective=objective)
        check(empty, found, (1.0, 1.0), (5.0, 3.0))
        assert found.path.tolist() == [[1.0, 1.0], [5.0, 3.0]]
        assert found.status.startswith("Exact solution") and "straight" in found.status


@pytest.mark.parametrize("name", NAMES)
def test_every_planner_stays_where_the_start_is_the_goal(space: CSpace, name: str) -> None:
    found = planners.plan(space, START, START, planner=name)
    check(space, found, START, START)
    assert found.path.tolist() == [list(START)] and found.length == 0.0
    assert found.clearance == space.clearance(START)
    assert "start is the goal" in found.status


def test_names_are_found_in_any_case_and_wrong_ones_listed(space: CSpace) -> None:
    assert planners.plan(space, START, GOAL, planner="rrtCONNECT").planner == "RRTConnect"
    with pytest.raises(InputError, match=r"did you mean RRTConnect.*KPIECE1"):
        planners.plan(space, START, GOAL, planner="RRTConect")


def test_simplifying_makes_no_path_longer(space: CSpace) -> None:
    gains = []
    for seed in range(10):
        rough, short = (planners.plan(space, START, GOAL, simplify=simplify, seed=seed) for simplify in (False, True))
        gains.append(rough.length / short.length)
        assert rough.times.simplification == 0.0 < short.times.simplification
    assert min(gains) >= 1 - 1e-12 and max(gains) > 1.05


def test_a_path_that_ompl_spoiled_is_not_called_certified(space: CSpace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(planners.MotionValidator, "checkMotion", lambda *_: True)
    found = planners.plan(space, START, GOAL, simplify=False)
    assert found.solved and not found.certified and found.clearance == 0.0


def test_on_a_real_map_a_path_is_found_where_one_is_proven_to_exist(data: Path) -> None:
    space = build(Workspace.open(data / "maps" / "depot.yaml"), Robot.disc(0.3))
    ends = space.sample_free(30, np.random.default_rng(0))
    proofs = set()
    for seed, (start, goal) in enumerate(zip(ends[::2], ends[1::2], strict=True)):
        found = planners.plan(space, start, goal, seed=seed, time_limit=20.0)
        proofs.add(found.path_exists)
        if found.path_exists is not None:
            assert found.solved is found.certified is found.path_exists
            assert found.solved or "proven" in found.status
    assert True in proofs


# ---- start and goal --------------------------------------------------------------------------------------------------


def strip() -> CSpace:
    """Cells of 1 m: FREE, FREE, MIXED, BLOCKED, FREE."""
    return with_state(np.array([[FREE], [FREE], [MIXED], [BLOCKED], [FREE]], dtype=np.uint8))


@pytest.mark.parametrize(
    ("q", "words", "nearest"),
    [
        ((2.4, 0.5), "MIXED", (1.5, 0.5)),
        ((3.6, 0.5), "BLOCKED", (4.5, 0.5)),
        ((-3.0, 0.5), "outside the map", (0.5, 0.5)),
        ((4.5, 1.5), "outside the map", (4.5, 0.5)),
        ((2.0, 0.3), "MIXED", (1.5, 0.5)),
        ((4.0, 0.3), "border", (4.5, 0.5)),
    ],
)
def test_an_end_that_cannot_be_used_is_named_with_its_state_and_the_nearest_free_one(
    q: tuple[float, float], words: str, nearest: tuple[float, float]
) -> None:
    space = strip()
    for name, ends in (("start", (q, (0.5, 0.5))), ("goal", ((0.5, 0.5), q))):
        with pytest.raises(ConfigurationError, match=words) as caught:
            planners.plan(space, *ends)
        assert str(caught.value).startswith(name)
        assert caught.value.nearest == nearest
        assert f"({nearest[0]:g}, {nearest[1]:g})" in str(caught.value)
        assert planners.plan(space, nearest, nearest).solved


def test_an_end_outside_the_map_cannot_be_used_even_where_it_is_free() -> None:
    space = build(Workspace.from_array(np.zeros((9, 9), dtype=bool), 1.0), Robot.disc(0.1), outside="free")
    assert space.is_free((12.0, 4.5)) and space.motion_is_free((12.0, 4.5), (4.5, 4.5))
    with pytest.raises(ConfigurationError, match=r"goal .* outside the map") as caught:
        planners.plan(space, (4.5, 4.5), (12.0, 4.5))
    assert caught.value.nearest == (8.5, 4.5)


def test_a_map_without_free_cells_has_no_nearest_one() -> None:
    with pytest.raises(ConfigurationError, match="no FREE configuration at all") as caught:
        planners.plan(with_state(np.full((3, 3), MIXED, dtype=np.uint8)), (1.5, 1.5), (2.5, 2.5))
    assert caught.value.nearest is None


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"start": (math.nan, 1.0)}, r"start\[0\] is nan"),
        ({"goal": (1.0, math.inf)}, r"goal\[1\] is inf"),
        ({"start": (1.0, 2.0, 3.0)}, r"start has shape \(3,\)"),
        ({"goal": [(1.0, 1.0)]}, r"goal has shape \(1, 2\)"),
        ({"goal": 3.0}, r"goal has shape \(\)"),
        ({"start": "here"}, "start is 'here'"),
        ({"time_limit": 0.0}, "time_limit is 0.0"),
        ({"time_limit": -1.0}, "time_limit is -1.0"),
        ({"time_limit": math.nan}, "time_limit is nan"),
        ({"time_limit": math.inf}, "time_limit is inf"),
        ({"objective": "speed"}, "objective is 'speed'.*'clearance'"),
        ({"objective": None}, "objective is None"),
        ({"objective": lambda si: 3, "planner": "RRTstar"}, "objective returned 3"),
        ({"objective": "clearance"}, "RRTConnect heeds no objective.*RRTstar"),
        ({"objective": "clearance", "planner": "PRM"}, "second thread"),
        ({"iterations": 10, "planner": "prmstar"}, "second thread"),
        ({"iterations": 0}, "iterations is 0"),
        ({"iterations": 1.5}, "iterations is 1.5"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 2**32 - 1}, "seed is 4294967295"),
        ({"seed": True}, "seed is True"),
        ({"seed": "one"}, "seed is 'one'"),
    ],
)
def test_wrong_input_is_named(space: CSpace, wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        planners.plan(**{"space": space, "start": START, "goal": GOAL} | wrong)


# ---- no path ---------------------------------------------------------------------------------------------------------


def no_path(found: planners.Plan) -> None:
    assert not found.solved and not found.certified
    assert found.path.shape == (0, 2)
    assert math.isnan(found.length) and math.isnan(found.clearance)


@pytest.mark.parametrize("name", NAMES)
def test_a_proof_that_no_path_exists_spares_the_search(name: str) -> None:
    space = halves(BLOCKED)
    began = time.perf_counter()
    found = planners.plan(space, (2.5, 4.5), (16.5, 4.5), planner=name, time_limit=60.0)
    assert time.perf_counter() - began < 10.0
    no_path(found)
    assert found.path_exists is False and found.status == "infeasible (proven: no path exists)"
    assert found.times.planning == 0.0


@pytest.mark.parametrize("name", NAMES)
def test_where_nothing_is_proven_a_planner_searches_and_does_not_pretend(name: str) -> None:
    # RRT and others come close and call that an approximate solution.
    found = planners.plan(halves(MIXED), (2.5, 4.5), (16.5, 4.5), planner=name, time_limit=0.05)
    no_path(found)
    assert found.path_exists is None and found.status in {"Timeout", "Approximate solution"}
    assert found.times.planning > 0.0


def test_some_planner_did_come_close() -> None:
    statuses = {
        planners.plan(halves(MIXED), (2.5, 4.5), (16.5, 4.5), planner=name, time_limit=0.05).status
        for name in ("RRT", "RRTConnect", "RRTstar")
    }
    assert "Approximate solution" in statuses


# ---- repeatable runs -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(set(NAMES) - ANYTIME - SECOND_THREAD))
def test_a_seed_repeats_a_run_with_others_in_between(space: CSpace, name: str) -> None:
    def run(seed: int) -> list[list[float]]:
        found = planners.plan(space, START, GOAL, planner=name, seed=seed, time_limit=20.0)
        assert found.seed == seed
        return found.path.tolist()

    first = run(7)
    planners.plan(space, START, (5.0, 3.0), planner="RRT")
    assert run(8) != first == run(7)


@pytest.mark.parametrize("name", sorted(ANYTIME - SECOND_THREAD))
def test_a_seed_and_iterations_repeat_a_run_that_would_use_up_its_time(space: CSpace, name: str) -> None:
    def run(seed: int) -> list[list[float]]:
        found = planners.plan(space, START, GOAL, planner=name, seed=seed, iterations=1500, time_limit=60.0)
        assert found.times.planning < 30.0
        return found.path.tolist()

    first = run(7)
    assert run(8) != first == run(7)
    assert len(first)


def test_a_seed_repeats_a_run_in_another_process() -> None:
    script = """
import sys
import numpy as np
import cspace, planners

def main():
    occupied = np.zeros((40, 40), dtype=bool)
    occupied[20, :30] = True
    space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.15))
    for seed in sys.argv[1:]:
        found = planners.plan(space, (0.5, 0.5), (3.5, 0.5), seed=int(seed), time_limit=20.0)
    print(found.path.tolist())

main()
"""
    runs = [
        subprocess.run([sys.executable, "-c", script, *seeds], capture_output=True, text=True, check=True)
        for seeds in (["5"], ["1", "2", "5"], ["0"])
    ]
    assert runs[0].stdout == runs[1].stdout != runs[2].stdout
    # Neither OMPL nor its bindings have anything to complain about.
    assert all(run.stderr == "" and run.stdout.count("\n") == 1 for run in runs)


def test_ompl_is_quiet_and_its_log_level_is_left_as_it_was(space: CSpace, capfd: pytest.CaptureFixture[str]) -> None:
    ou.setLogLevel(ou.LOG_INFO)
    try:
        planners.plan(space, START, GOAL, seed=3)
        with pytest.raises(ZeroDivisionError):
            planners.plan(space, START, GOAL, planner="RRTstar", objective=lambda si: 1 // 0)
        assert ou.getLogLevel() == ou.LOG_INFO
    finally:
        ou.setLogLevel(ou.LOG_WARN)
    assert capfd.readouterr() == ("", "")


# ---- objectives ------------------------------------------------------------------------------------------------------


def test_the_clearance_objective_is_called_and_keeps_away_from_walls(space: CSpace) -> None:
    calls = []

    class Counted(planners.ClearanceObjective):
        def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
            calls.append(1)
            return super().motionCost(first, second)

    options: dict[str, Any] = {"planner": "RRTstar", "time_limit": 60.0, "iterations": 500, "seed": 1}
    short = planners.plan(space, START, GOAL, **options)
    wide = planners.plan(space, START, GOAL, objective=lambda si: Counted(si, space), **options)
    same = planners.plan(space, START, GOAL, objective="clearance", **options)
    for found in (short, wide):
        check(space, found)
    assert len(calls) > 500
    assert wide.clearance > short.clearance + 0.15 and wide.length > short.length
    assert wide.path.tolist() == same.path.tolist()
    assert (short.objective, wide.objective, same.objective) == ("length", "custom", "clearance")


@pytest.mark.parametrize("name", LAZY_OBJECTIVES)
def test_the_planners_that_heed_an_objective_find_a_cheaper_path(space: CSpace, name: str) -> None:
    si = planners.simple_setup(space).getSpaceInformation()
    objective = planners.ClearanceObjective(si, space)

    def cost(found: planners.Plan) -> float:
        states = [si.allocState() for _ in found.path]
        for state, (x, y) in zip(states, found.path.tolist(), strict=True):
            state[0], state[1] = x, y
        return sum(objective.motionCost(a, b).value() for a, b in itertools.pairwise(states))

    iterations = 3000 if name == "BITstar" else 400  # an iteration of BITstar is one edge
    options: dict[str, Any] = {"planner": name, "time_limit": 60.0, "iterations": iterations, "seed": 1}
    short = planners.plan(space, START, GOAL, **options)
    wide = planners.plan(space, START, GOAL, objective="clearance", **options)
    rough = planners.plan(space, START, GOAL, objective="clearance", simplify=False, **options)
    check(space, wide)
    assert cost(wide) < 0.8 * cost(short)
    assert cost(wide) <= cost(rough) * (1 + 1e-12)


def test_an_error_in_a_callback_comes_out(space: CSpace) -> None:
    class Broken(planners.ClearanceObjective):
        def motionCost(self, first: Any, second: Any) -> Any:  # noqa: N802 - OMPL's name
            raise KeyError("broken")

    with pytest.raises(KeyError, match="broken"):
        planners.plan(space, START, GOAL, planner="RRTstar", objective=lambda si: Broken(si, space))
