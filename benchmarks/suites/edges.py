"""A million edges in one call against OMPL's discrete motion validator, which asks a callback twice a cell."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

import cspace
from benchmarks import inputs, motions
from benchmarks.report import Report
from benchmarks.timing import interleave, one_core
from cspace import CSpace, Robot, Workspace
from cspace.arrays import Floats
from cspace.threads import cores

LENGTH = 50.0
"""Cells across which the edges go."""

TURN = 0.5
"""Most radians by which they turn, where the robot does."""


@dataclass(frozen=True)
class Edges:
    """Edges of a map, which start in FREE cells and end anywhere in the grid."""

    starts: Floats
    goals: Floats

    @classmethod
    def draw(cls, space: CSpace, number: int, rng: np.random.Generator) -> Edges:
        """As many as that, in all directions."""
        dim = space.grid.dim
        lower, upper = np.asarray(space.grid.lower), np.asarray(space.grid.upper)
        starts: list[Floats] = []
        goals: list[Floats] = []
        while sum(len(part) for part in starts) < number:
            first = space.sample_free(number, rng)
            way = rng.normal(size=(number, dim))
            last = first.copy()
            last[:, :dim] += LENGTH * space.grid.spacing * way / np.linalg.norm(way, axis=1)[:, None]
            last[:, dim:] += rng.uniform(-TURN, TURN, last[:, dim:].shape)
            inside = ((last[:, :dim] >= lower) & (last[:, :dim] <= upper)).all(axis=1)
            starts.append(first[inside])
            goals.append(last[inside])
        return cls(np.concatenate(starts)[:number], np.concatenate(goals)[:number])

    def those(self, which: Any) -> Edges:
        return Edges(self.starts[which], self.goals[which])

    def __len__(self) -> int:
        return len(self.starts)


def run(report: Report, seed: int) -> None:
    """In the plane on maps that fit and do not fit a core's cache, with turns, and in space."""
    if not report.has("ompl"):
        return
    rng = np.random.default_rng(seed)
    quick = report.quick
    for size in (256, 512) if quick else (1024, 4096):
        space = cspace.build(Workspace.from_array(inputs.boxes(size, 0.06, rng), 0.05), Robot.disc(0.3))
        _compare(report, f"map of {size} x {size} cells", space, rng, least=100.0)
    size = 256 if quick else 512
    plane = Workspace.from_array(inputs.boxes(size, 0.06, rng), 0.05)
    space = cspace.build(plane, Robot.rectangle(0.8, 0.4), rotations=72)
    _compare(report, f"map of 72 yaws x {size} x {size} cells, turns up to {TURN} rad", space, rng)
    size = 64 if quick else 256
    space = cspace.build(Workspace.from_array(inputs.boxes(size, 0.06, rng, 3), 0.05), Robot.ball(0.2))
    _compare(report, f"map of {size}^3 cells", space, rng)


def _compare(report: Report, title: str, space: CSpace, rng: np.random.Generator, least: float | None = None) -> None:
    number, part, runs = (10**5, 500, 3) if report.quick else (10**6, 5000, 7)
    edges = Edges.draw(space, number, rng)
    report.section(f"{number:.0e} edges of {LENGTH:g} cells, {title}, {cores()} workers")
    space.motion_is_free(edges.starts, edges.goals)  # marks blocks
    free = space.motion_is_free(edges.starts, edges.goals)
    report.note(f"{free.mean():.0%} of the edges are proven free")
    informations = {name: motions.discrete(space, make) for name, make in _checkers(space).items()}
    for kind, chosen in (("random", edges), ("free", edges.those(free))):
        sample = chosen.those(slice(part))
        calls: dict[str, Callable[[], Any]] = {"ours": partial(space.motion_is_free, chosen.starts, chosen.goals)}
        for name, si in informations.items():
            calls[name] = motions.asker(si.checkMotion, motions.edges_of(space, si, sample.starts, sample.goals))
        timings = interleave(calls, runs)
        with one_core() as alone:
            if alone:
                timings |= interleave({"ours, on one core": calls["ours"]}, runs)
        sizes = {name: len(chosen) if name.startswith("ours") else len(sample) for name in timings}
        each = {name: timing.per(sizes[name]) for name, timing in timings.items()}
        for name, timing in each.items():
            report.timing(f"{kind} edges, {name}, one edge", timing)
            far = "" if name.startswith("ours") else f", extrapolated from {len(sample)}"
            report.figure(f"  all of them{far}", timing.median * len(chosen), "s")
        for name in informations:
            wanted = least if name.startswith("discrete") else None
            report.ratio(f"{kind} edges: {name} / ours", each[name], each["ours"], least=wanted)
        ours = timings["ours"].value[: len(sample)]
        for name in informations:
            if name.startswith("discrete"):
                theirs = np.array(timings[name].value)
                report.check(not (ours & ~theirs).any(), f"{kind} edges, {name}: refuses none that ours calls free")
        one = [space.motion_is_free(a, b) for a, b in zip(sample.starts, sample.goals, strict=True)]
        report.check(ours.tolist() == one, f"{kind} edges: equal to one call for each of {len(sample)}")


def _checkers(space: CSpace) -> dict[str, Callable[[Any], Any]]:
    """What OMPL's discrete validator asks: our checker, the barest one that looks a cell up, and one that says yes."""
    from ompl import base as ob

    import planners

    made = {"discrete, our isValid": lambda si: planners.StateValidityChecker(si, space)}
    if space.grid.dim == 2 and not space.rotations.dof:
        rows = [bytes(row) for row in space.state]
        scale = 1.0 / space.grid.spacing

        class Bare(ob.StateValidityChecker):
            """No borders, no corner of the grid elsewhere than at the origin."""

            def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
                return not rows[int(state[0] * scale)][int(state[1] * scale)]

        made["discrete, the barest look-up"] = Bare
    made["OMPL's own yes to every state"] = ob.AllValidStateValidityChecker
    return made
