"""Look-ups and edges, against numpy and OMPL's discrete motion validator."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ompl import base as ob

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import Timing, interleave, one_core
from cspace import BLOCKED, CSpace, Robot, Workspace
from cspace._support.arrays import Floats
from cspace._support.threads import count_cores
from planners._ompl.states import find_state_kind

EDGE_CELLS, CALLBACK_EDGE_CELLS = 50.0, 100.0
"""Lengths of edges in batches and in callbacks, cells."""

MAX_ROTATION = 0.5
"""Largest rotation along an edge, radians."""

ON_ONE_CORE = "ours, on one core"

# ---- queries through OMPL, also for other suites -------------------------------------------------


def discrete_setup(space: CSpace, checker: Callable[[Any], Any]) -> Any:
    """Set up a checker with OMPL's discrete motion validator at half a cell."""
    si = ob.SpaceInformation(planners.state_space(space))
    si.setStateValidityChecker(checker(si))
    at_half_a_cell(space, si)
    si.setup()
    return si


def at_half_a_cell(space: CSpace, si: Any) -> None:
    """Set OMPL's resolution to half a cell.

    OMPL counts a radian as half a metre, and no corner of the benchmarks' robots moves farther.
    """
    si.setStateValidityCheckingResolution(
        0.5 * space.grid.spacing / si.getStateSpace().getMaximumExtent()
    )


def states_of(space: CSpace, si: Any, q: Iterable[Floats]) -> list[Any]:
    """Return OMPL's states of configurations."""
    kind, states = find_state_kind(space), []
    for numbers in space.rotations.make_canonical(np.asarray(q)).tolist():
        states.append(si.getStateSpace().allocState())
        kind.write(states[-1], *numbers)
    return states


def edges_of(space: CSpace, si: Any, starts: Floats, goals: Floats) -> list[tuple[Any, Any]]:
    """Return OMPL's states of the ends of edges."""
    return list(zip(states_of(space, si, starts), states_of(space, si, goals), strict=True))


def query_all(call: Callable[..., bool], asked: list[Any]) -> Callable[[], list[bool]]:
    """Return a call that queries all states or edges with little overhead."""
    if isinstance(asked[0], tuple):
        return lambda: [call(first, last) for first, last in asked]
    return lambda: [call(state) for state in asked]


def edges_inside(
    space: CSpace, number: int, length: float, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Draw edges of a length in cells, from FREE cells to the grid."""
    dim, found = space.grid.dim, list[Floats]()
    while sum(map(len, found)) < number:
        first, direction = space.sample_free(number, rng), rng.normal(size=(number, dim))
        last = first.copy()
        last[:, :dim] += (
            length * space.grid.spacing * direction / np.linalg.norm(direction, axis=1)[:, None]
        )
        last[:, dim:] += rng.uniform(-MAX_ROTATION, MAX_ROTATION, last[:, dim:].shape)
        found.append(np.stack([first, last], axis=1)[space.grid.contains(last[:, :dim])])
    edges = np.concatenate(found)[:number]
    return np.ascontiguousarray(edges[:, 0]), np.ascontiguousarray(edges[:, 1])


def _also_alone(calls: dict[str, Callable[[], Any]], runs: int) -> dict[str, Timing]:
    """Time calls alternately, then ours on one core."""
    timings = interleave(calls, runs)
    with one_core() as alone:
        return timings | interleave({ON_ONE_CORE: calls["ours"]}, runs) if alone else timings


# ---- look-ups ------------------------------------------------------------------------------------


def classify(report: Report, seed: int) -> None:
    """Look up random configurations, 10 % outside, on maps within and beyond a core's cache."""
    rng = np.random.default_rng(seed)
    number, runs = (10**6, 3) if report.quick else (10**7, 7)
    for size in (512, 1024) if report.quick else (1024, 4096):
        space = cspace.build(
            Workspace.from_array(inputs.boxes(size, 0.06, rng), 0.05), Robot.disc(0.3)
        )
        points = rng.uniform(-0.025, 1.025, (number, 2)) * space.grid.upper
        report.section(
            f"{number:.0e} random configurations, map of {size} x {size} cells, {count_cores()} workers"
        )
        calls: dict[str, Callable[[], Any]] = {
            "ours": partial(space.classify, points),
            "numpy": partial(_by_rows, space, points),
            "numpy, a column at a time": partial(_by_columns, space, points),
        }
        timings = _also_alone(calls, runs)
        report.timings(timings)
        for name, least in (("numpy", 8.0), ("numpy, a column at a time", 4.0)):
            report.ratio(f"{name} / ours", timings[name], timings["ours"], least=least)
            if ON_ONE_CORE in timings:
                report.ratio(f"{name} / {ON_ONE_CORE}", timings[name], timings[ON_ONE_CORE])
            report.check(
                bool((timings[name].value == timings["ours"].value).all()), f"{name}: equal to ours"
            )


def _by_rows(space: CSpace, points: Floats) -> NDArray[np.uint8]:
    """Look up with plain numpy: floor, bounds check, fancy index."""
    cells = np.floor((points - space.grid.lower) / space.grid.spacing).astype(np.int64)
    inside = ((cells >= 0) & (cells < space.grid.shape)).all(axis=-1)
    states = np.full(len(points), BLOCKED, dtype=np.uint8)
    states[inside] = space.cell_states[cells[inside, 0], cells[inside, 1]]
    return states


def _by_columns(space: CSpace, points: Floats) -> NDArray[np.uint8]:
    """Look up with contiguous temporaries and no masked copies."""
    (lower_x, lower_y), spacing, (nx, ny) = space.grid.lower, space.grid.spacing, space.grid.shape
    x = np.floor((points[:, 0] - lower_x) / spacing).astype(np.int64)
    y = np.floor((points[:, 1] - lower_y) / spacing).astype(np.int64)
    inside = (x >= 0) & (x < nx) & (y >= 0) & (y < ny)
    return np.where(
        inside, space.cell_states[np.where(inside, x, 0), np.where(inside, y, 0)], np.uint8(BLOCKED)
    )


# ---- edges ---------------------------------------------------------------------------------------


def edges(report: Report, seed: int) -> None:
    """Check edges in the plane, with rotations, and in space."""
    rng, quick = np.random.default_rng(seed), report.quick
    for size in (256, 512) if quick else (1024, 4096):
        space = cspace.build(
            Workspace.from_array(inputs.boxes(size, 0.06, rng), 0.05), Robot.disc(0.3)
        )
        _compare_edges(report, f"map of {size} x {size} cells", space, rng, least=100.0)
    size = 256 if quick else 512
    plane = Workspace.from_array(inputs.boxes(size, 0.06, rng), 0.05)
    space = cspace.build(plane, Robot.rectangle(0.8, 0.4), rotations=72)
    _compare_edges(
        report,
        f"map of 72 yaws x {size} x {size} cells, turns up to {MAX_ROTATION} rad",
        space,
        rng,
    )
    size = 64 if quick else 256
    space = cspace.build(
        Workspace.from_array(inputs.boxes(size, 0.06, rng, 3), 0.05), Robot.ball(0.2)
    )
    _compare_edges(report, f"map of {size}^3 cells", space, rng)


def _compare_edges(
    report: Report, title: str, space: CSpace, rng: np.random.Generator, least: float | None = None
) -> None:
    number, part, runs = (10**5, 500, 3) if report.quick else (10**6, 5000, 7)
    starts, goals = edges_inside(space, number, EDGE_CELLS, rng)
    report.section(f"{number:.0e} edges of {EDGE_CELLS:g} cells, {title}, {count_cores()} workers")
    space.motion_is_free(starts, goals)  # fills caches
    free = space.motion_is_free(starts, goals)
    report.note(f"{np.mean(free):.0%} of the edges are proven free")
    space_informations = {
        name: discrete_setup(space, make) for name, make in _checkers(space).items()
    }
    for kind, a, b in (("random", starts, goals), ("free", starts[free], goals[free])):
        calls: dict[str, Callable[[], Any]] = {"ours": partial(space.motion_is_free, a, b)}
        for name, si in space_informations.items():
            calls[name] = query_all(si.checkMotion, edges_of(space, si, a[:part], b[:part]))
        timings = _also_alone(calls, runs)
        each = {name: timing.per(len(timing.value)) for name, timing in timings.items()}
        for name, timing in each.items():
            report.timing(f"{kind} edges, {name}, one edge", timing)
            far = "" if name.startswith("ours") else f", extrapolated from {part}"
            report.figure(f"  all of them{far}", timing.median * len(a), "s")
        ours = timings["ours"].value[:part]
        for name in space_informations:
            stepped = name.startswith("discrete")
            report.ratio(
                f"{kind} edges: {name} / ours",
                each[name],
                each["ours"],
                least=least if stepped else None,
            )
            if stepped:
                missed = ours & ~np.array(timings[name].value)
                report.check(
                    not missed.any(), f"{kind} edges, {name}: refuses none that ours calls free"
                )
        one = [
            space.motion_is_free(first, last)
            for first, last in zip(a[:part], b[:part], strict=True)
        ]
        report.check(
            ours.tolist() == one, f"{kind} edges: equal to one call for each of {len(one)}"
        )


def _checkers(space: CSpace) -> dict[str, Callable[[Any], Any]]:
    """Return callbacks for OMPL's discrete validator: ours, a bare look-up, a constant."""
    checkers = {"discrete, our isValid": lambda si: planners.StateValidityChecker(si, space)}
    if space.grid.dim == 2 and not space.rotations.names:
        rows = [bytes(row) for row in space.cell_states]
        scale = 1.0 / space.grid.spacing

        class WorkspaceView(ob.StateValidityChecker):
            """A look-up without bounds, on a grid at the origin."""

            def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
                return not rows[int(state[0] * scale)][int(state[1] * scale)]

        checkers["discrete, the barest look-up"] = WorkspaceView
    checkers["OMPL's own yes to every state"] = ob.AllValidStateValidityChecker
    return checkers


# ---- callbacks -----------------------------------------------------------------------------------


class _Empty(ob.StateValidityChecker):
    def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
        return True


def callbacks(report: Report, seed: int) -> None:
    """Time single calls of our checker and motion validator through OMPL."""
    rng, runs, rounds = np.random.default_rng(seed), *((5, 10) if report.quick else (15, 50))
    space = cspace.build(Workspace.from_array(inputs.boxes(1024, 0.06, rng), 0.05), Robot.disc(0.3))
    ours = planners.simple_setup(space).getSpaceInformation()
    points = rng.uniform(0, 1, (1000, 2)) * space.grid.upper
    report.section(f"isValid of {rounds * len(points)} states, map of 1024 x 1024 cells")
    states = states_of(space, ours, points) * rounds
    asked = {"ours": ours, "empty Python checker": discrete_setup(space, _Empty)}
    timings = interleave({name: query_all(si.isValid, states) for name, si in asked.items()}, runs)
    report.timings(
        {f"{name}, one call": timing.per(len(states)) for name, timing in timings.items()}
    )
    report.ratio(
        "ours / empty Python checker", timings["ours"], timings["empty Python checker"], most=6.0
    )
    answers = np.array(timings["ours"].value[: len(points)])
    report.check(bool((answers == space.is_free(points)).all()), "isValid: equal to CSpace.is_free")

    starts, goals = edges_inside(space, 20_000, CALLBACK_EDGE_CELLS, rng)
    free = np.asarray(space.motion_is_free(starts, goals))
    report.section(
        f"checkMotion of 100 free edges across {CALLBACK_EDGE_CELLS:g} cells, each checked to its end"
    )
    stepped = "discrete at half a cell"
    asked = {
        "ours": ours,
        stepped: discrete_setup(space, lambda si: planners.StateValidityChecker(si, space)),
    }
    pairs = edges_of(space, ours, starts[free][:100], goals[free][:100])
    timings = interleave(
        {name: query_all(si.checkMotion, pairs) for name, si in asked.items()}, runs
    )
    report.timings(
        {f"{name}, one edge": timing.per(len(pairs)) for name, timing in timings.items()}
    )
    report.ratio(f"{stepped} / ours", timings[stepped], timings["ours"], least=20.0)
    report.check(
        all(all(timing.value) for timing in timings.values()), "every edge is free, by both"
    )
    pairs = edges_of(space, ours, starts[:2000], goals[:2000])
    exact, steps = (np.array(query_all(si.checkMotion, pairs)()) for si in asked.values())
    report.check(
        bool((exact == free[:2000]).all()), "random edges, ours: equal to CSpace.motion_is_free"
    )
    report.check(
        not (exact & ~steps).any(),
        "random edges: what ours calls free, the discrete validator does too",
    )
    report.note(
        f"of {len(pairs)} random edges, {(steps & ~exact).sum()} that are not proven pass the discrete one"
    )
