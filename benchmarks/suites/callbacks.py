"""What OMPL pays for one call of our validity checker and of our motion validator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import interleave
from cspace import CSpace, Robot, Workspace

Floats = NDArray[np.float64]

EDGE = 100
"""Cells across which the edges go."""


def run(report: Report, seed: int) -> None:
    """Both on a map of boxes, through OMPL's own space information."""
    try:
        import planners
    except ImportError as error:
        report.note(f"skipped: {error}")
        return
    from ompl import base as ob

    class Empty(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            return True

    rng = np.random.default_rng(seed)
    space = cspace.build(Workspace.from_array(inputs.boxes(1024, 0.06, rng), 0.05), Robot.disc(0.3))
    ours = planners.simple_setup(space).getSpaceInformation()
    empty = _information(space, Empty)
    discrete = _information(space, lambda si: planners.StateValidityChecker(si, space))
    runs = 5 if report.quick else 15
    _states(report, space, ours, empty, rng.uniform(0, 1, (1000, 2)) * space.grid.upper, runs)
    _edges(report, space, ours, discrete, rng, runs)


def _states(report: Report, space: CSpace, ours: Any, empty: Any, points: Floats, runs: int) -> None:
    rounds = 10 if report.quick else 50
    number = rounds * len(points)
    report.section(f"isValid of {number} states, map of {space.grid.shape[0]} x {space.grid.shape[1]} cells")
    states = [_state(ours, point) for point in points]

    def asker(si: Any) -> Callable[[], list[bool]]:
        is_valid = si.isValid
        return lambda: [is_valid(state) for _ in range(rounds) for state in states]

    timings = interleave({"ours": asker(ours), "empty Python checker": asker(empty)}, runs)
    for name, timing in timings.items():
        report.timing(f"{name}, one call", timing.per(number))
    report.ratio("ours / empty Python checker", timings["ours"], timings["empty Python checker"], most=6.0)
    answers = np.array(timings["ours"].value[: len(points)])
    report.check(bool((answers == space.is_free(points)).all()), "isValid: equal to CSpace.is_free")


def _edges(report: Report, space: CSpace, ours: Any, discrete: Any, rng: np.random.Generator, runs: int) -> None:
    length = EDGE * space.grid.spacing
    starts = space.sample_free(20_000, rng)
    turns = rng.uniform(0, 2 * np.pi, len(starts))
    ends = starts + length * np.column_stack([np.cos(turns), np.sin(turns)])
    kept = space.grid.contains(ends)
    starts, ends = starts[kept], ends[kept]
    free = space.motion_is_free(starts, ends)

    report.section(f"checkMotion of free edges across {EDGE} cells, every one checked to its end")
    pairs = [(_state(ours, a), _state(ours, b)) for a, b in zip(starts[free][:100], ends[free][:100], strict=True)]
    timings = interleave({"ours": _checker(ours, pairs), "discrete at half a cell": _checker(discrete, pairs)}, runs)
    for name, timing in timings.items():
        report.timing(f"{name}, one edge", timing.per(len(pairs)))
    report.ratio("discrete at half a cell / ours", timings["discrete at half a cell"], timings["ours"], least=20.0)
    for name, timing in timings.items():
        report.check(all(timing.value), f"{name}: every edge free")

    pairs = [(_state(ours, a), _state(ours, b)) for a, b in zip(starts[:2000], ends[:2000], strict=True)]
    exact, stepped = np.array(_checker(ours, pairs)()), np.array(_checker(discrete, pairs)())
    report.check(bool((exact == free[:2000]).all()), "random edges, ours: equal to CSpace.motion_is_free")
    report.check(not (exact & ~stepped).any(), "random edges: what ours calls free, the discrete validator does too")
    report.note(f"of {len(pairs)} random edges, {(stepped & ~exact).sum()} that are not proven pass the discrete one")


def _information(space: CSpace, checker: Callable[[Any], Any]) -> Any:
    """OMPL's space information with a checker and its own ways otherwise: discrete motions, here at half a cell."""
    from ompl import base as ob

    import planners

    states = planners.state_space(space)
    si = ob.SpaceInformation(states)
    si.setStateValidityChecker(checker(si))
    si.setStateValidityCheckingResolution(0.5 * space.grid.spacing / states.getMaximumExtent())
    si.setup()
    return si


def _state(si: Any, point: Floats) -> Any:
    state = si.getStateSpace().allocState()
    state[0], state[1] = float(point[0]), float(point[1])
    return state


def _checker(si: Any, pairs: list[tuple[Any, Any]]) -> Callable[[], list[bool]]:
    check = si.checkMotion
    return lambda: [check(first, second) for first, second in pairs]
