"""What OMPL pays for one call of our validity checker and of our motion validator."""

from __future__ import annotations

from typing import Any

import numpy as np

import cspace
from benchmarks import inputs, motions
from benchmarks.motions import asker, edges_of, states_of
from benchmarks.report import Report
from benchmarks.timing import interleave
from cspace import CSpace, Robot, Workspace
from cspace.arrays import Floats

EDGE = 100
"""Cells across which the edges go."""


def run(report: Report, seed: int) -> None:
    """Both on a map of boxes, through OMPL's own space information."""
    if not report.has("ompl"):
        return
    from ompl import base as ob

    import planners

    class Empty(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            return True

    rng = np.random.default_rng(seed)
    space = cspace.build(Workspace.from_array(inputs.boxes(1024, 0.06, rng), 0.05), Robot.disc(0.3))
    ours = planners.simple_setup(space).getSpaceInformation()
    empty = motions.discrete(space, Empty)
    discrete = motions.discrete(space, lambda si: planners.StateValidityChecker(si, space))
    runs = 5 if report.quick else 15
    _states(report, space, ours, empty, rng.uniform(0, 1, (1000, 2)) * space.grid.upper, runs)
    _edges(report, space, ours, discrete, rng, runs)


def _states(report: Report, space: CSpace, ours: Any, empty: Any, points: Floats, runs: int) -> None:
    rounds = 10 if report.quick else 50
    number = rounds * len(points)
    report.section(f"isValid of {number} states, map of {space.grid.shape[0]} x {space.grid.shape[1]} cells")
    states = states_of(space, ours, points)

    asked = {"ours": ours, "empty Python checker": empty}
    timings = interleave({name: asker(si.isValid, states * rounds) for name, si in asked.items()}, runs)
    for name, timing in timings.items():
        report.timing(f"{name}, one call", timing.per(number))
    report.ratio("ours / empty Python checker", timings["ours"], timings["empty Python checker"], most=6.0)
    answers = np.array(timings["ours"].value[: len(points)])
    report.check(bool((answers == space.is_free(points)).all()), "isValid: equal to CSpace.is_free")


def _edges(report: Report, space: CSpace, ours: Any, discrete: Any, rng: np.random.Generator, runs: int) -> None:
    length = EDGE * space.grid.spacing
    starts = space.sample_free(20_000, rng)
    turns = rng.uniform(0, 2 * np.pi, len(starts))
    goals = starts + length * np.column_stack([np.cos(turns), np.sin(turns)])
    inside = space.grid.contains(goals)
    starts, goals = starts[inside], goals[inside]
    free = space.motion_is_free(starts, goals)

    report.section(f"checkMotion of free edges across {EDGE} cells, every one checked to its end")
    pairs = edges_of(space, ours, starts[free][:100], goals[free][:100])
    asked = {"ours": ours, "discrete at half a cell": discrete}
    timings = interleave({name: asker(si.checkMotion, pairs) for name, si in asked.items()}, runs)
    for name, timing in timings.items():
        report.timing(f"{name}, one edge", timing.per(len(pairs)))
    report.ratio("discrete at half a cell / ours", timings["discrete at half a cell"], timings["ours"], least=20.0)
    for name, timing in timings.items():
        report.check(all(timing.value), f"{name}: every edge free")

    pairs = edges_of(space, ours, starts[:2000], goals[:2000])
    exact, stepped = (np.array(asker(si.checkMotion, pairs)()) for si in asked.values())
    report.check(bool((exact == free[:2000]).all()), "random edges, ours: equal to CSpace.motion_is_free")
    report.check(not (exact & ~stepped).any(), "random edges: what ours calls free, the discrete validator does too")
    report.note(f"of {len(pairs)} random edges, {(stepped & ~exact).sum()} that are not proven pass the discrete one")
