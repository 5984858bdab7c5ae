"""Time to a first solution on real maps, against the usual way: shapely in the callback, motions in steps."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.soak.plane_geometry import union_of_cells
from benchmarks.timing import Timing
from cspace import CSpace, Robot

Floats = NDArray[np.float64]
Query = tuple[Floats, Floats]
Solver = Callable[[Query, int], tuple[float, Floats | None]]

LIMIT = 60.0
"""Seconds that a search may take."""


def run(report: Report, seed: int) -> None:
    """RRTConnect with the same seeds and queries, the two in turns."""
    try:
        import planners  # noqa: F401 - whether it is there at all
    except ImportError as error:
        report.note(f"skipped: {error}")
        return
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA)
        return
    rng = np.random.default_rng(seed)
    _compare(report, "maps/depot.yaml", 0.3, lambda space: far_apart(space, 3, rng))
    _compare(report, "movingai/Berlin_1_1024.map", 2.0, lambda space: _from_scenarios(space, 3))


def _compare(report: Report, name: str, radius: float, choose: Callable[[CSpace], list[Query]]) -> None:
    import shapely

    workspace = inputs.real_map(name)
    if workspace is None:
        report.note(f"{name} skipped: not in the folder of real maps")
        return
    robot = Robot.disc(radius)
    cspace.build(workspace, robot)  # compiles
    began = time.perf_counter()
    space = cspace.build(workspace, robot)
    built = time.perf_counter() - began
    began = time.perf_counter()
    obstacles = union_of_cells(workspace.outer, workspace.grid)
    shapely.prepare(obstacles)
    united = time.perf_counter() - began
    queries = choose(space)
    seeds = 3 if report.quick else 10
    queries = queries[:1] if report.quick else queries
    report.section(
        f"{name}: {workspace.grid.shape[0]} x {workspace.grid.shape[1]} cells of {workspace.grid.spacing:g} m, disc of "
        f"radius {radius:g} m, RRTConnect, {len(queries)} queries, {seeds} seeds each"
    )
    solvers = [partial(solve, make) for make in (our_setup(space), _peer(space, obstacles, radius))]
    ours, peer = race(solvers, queries, seeds)
    report.timing("ours, set-up and search", ours)
    report.timing("OMPL with prepared shapely, set-up and search", peer)
    tell(report, "OMPL with prepared shapely", ours, peer, queries, 10.0)
    tell_made(report, ours, peer, built, united, "polygons")
    check_paths(
        report, ours, peer, lambda path: _collides(obstacles, path, radius), "by the whole path's exact distance"
    )


def race(solvers: Sequence[Solver], queries: Sequence[Query], seeds: int) -> list[Timing]:
    """All solve all queries with the same seeds, in turns; the paths, or None, are the timings' values."""
    timings = [Timing([]) for _ in solvers]
    for query in queries:
        for seed in range(seeds):
            # A first search that is not timed, so that neither pays for what is made at the first call.
            for timing, solver in zip(timings, solvers, strict=True):
                if not timing.seconds:
                    solver(query, seed)
                cpu = time.process_time()
                taken, path = solver(query, seed)
                timing.cpu.append(time.process_time() - cpu)
                timing.seconds.append(taken)
                timing.value.append(path)
    return timings


def tell(report: Report, name: str, ours: Timing, peer: Timing, queries: Sequence[Query], least: float | None) -> None:
    """Ratios of a race, in all and query by query."""
    report.ratio(f"{name} / ours", peer, ours, least=least)
    seeds = len(ours.seconds) // len(queries)
    for number, (start, goal) in enumerate(queries):
        part = slice(number * seeds, (number + 1) * seeds)
        ratio = statistics.median(peer.seconds[part]) / statistics.median(ours.seconds[part])
        report.figure(f"query {number}: {_text(start)} to {_text(goal)}", ratio)


def tell_made(report: Report, ours: Timing, peer: Timing, built: float, made: float, what: str) -> None:
    """What each makes once for a map, and the ratio with that charged to every search."""
    report.note(f"made once for each map: ours {built * 1e3:.3g} ms (build), the peer {made * 1e3:.3g} ms ({what})")
    report.figure("with both charged to every search", (peer.median + made) / (ours.median + built))
    report.figure("with only our build charged to every search", peer.median / (ours.median + built))


def check_paths(report: Report, ours: Timing, peer: Timing, collides: Callable[[Floats], bool], how: str) -> None:
    """Our searches must reach the goal without a collision; the peer's paths are told."""
    solved = [path for path in ours.value if path is not None]
    report.check(len(solved) == len(ours.value), f"ours: {len(solved)} of {len(ours.value)} searches reach the goal")
    colliding = sum(collides(path) for path in solved)
    report.check(not colliding, f"ours: {colliding} of {len(solved)} paths collide, {how}")
    paths = [path for path in peer.value if path is not None]
    report.note(
        f"the peer: {len(paths)} of {len(peer.value)} searches reach the goal within {LIMIT:g} s, and "
        f"{sum(collides(path) for path in paths)} of these paths collide between the steps"
    )


def our_setup(space: CSpace) -> Callable[[], Any]:
    """Makes OMPL's set-up with all that the map answers."""
    import planners

    return lambda: planners.simple_setup(space)


def _peer(space: CSpace, obstacles: Any, radius: float) -> Callable[[], Any]:
    """A plain OMPL script: shapely tells whether the disc is free, and motions are checked at half a cell."""
    import shapely
    from ompl import base as ob
    from ompl import geometric as og

    (left, low), (right, high) = space.grid.lower, space.grid.upper

    class Checker(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            x, y = state[0], state[1]
            inside = left + radius < x < right - radius and low + radius < y < high - radius
            return inside and not shapely.dwithin(obstacles, shapely.Point(x, y), radius)

    def setup() -> Any:
        import planners

        states = planners.state_space(space)
        made = og.SimpleSetup(states)
        si = made.getSpaceInformation()
        made.setStateValidityChecker(Checker(si))
        si.setStateValidityCheckingResolution(0.5 * space.grid.spacing / states.getMaximumExtent())
        return made

    return setup


def solve(make: Callable[[], Any], query: Query, seed: int) -> tuple[float, Floats | None]:
    """Seconds until a first solution, and the path; None where none was found."""
    from ompl import geometric as og
    from ompl import util as ou

    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)
    began = time.perf_counter()
    setup = make()
    states = [setup.getStateSpace().allocState() for _ in query]
    for state, point in zip(states, query, strict=True):
        _write(state, point.tolist())
    setup.setStartAndGoalStates(*states)
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(LIMIT)
    taken = time.perf_counter() - began
    if not setup.haveExactSolutionPath():
        return taken, None
    return taken, np.array([_read(state, len(query[0])) for state in setup.getSolutionPath().getStates()])


def _write(state: Any, q: list[float]) -> None:
    if hasattr(state, "setXY"):
        state.setXY(q[0], q[1])
        state.setYaw(math.remainder(q[2], math.tau))  # OMPL refuses what is not within half a turn of zero
        return
    for axis, value in enumerate(q):
        state[axis] = value


def _read(state: Any, dof: int) -> list[float]:
    if hasattr(state, "setXY"):
        return [state.getX(), state.getY(), state.getYaw()]
    return [state[axis] for axis in range(dof)]


def _collides(obstacles: Any, path: Floats, radius: float) -> bool:
    import shapely

    return bool(shapely.dwithin(obstacles, shapely.LineString(path), radius))


def far_apart(space: CSpace, number: int, rng: np.random.Generator) -> list[Query]:
    """Random FREE pairs that a path joins, no straight edge does, and half the map's diagonal lies between."""
    least = 0.5 * np.linalg.norm(np.subtract(space.grid.upper, space.grid.lower))
    draws = 20_000 if not space.rotations.dof else 5_000
    starts, goals = space.sample_free(draws, rng), space.sample_free(draws, rng)
    fit = np.linalg.norm((starts - goals)[:, : space.grid.dim], axis=1) >= least
    fit &= (space.path_exists(starts, goals) == True) & ~space.motion_is_free(starts, goals)  # noqa: E712 - of objects
    if fit.sum() < number:
        raise RuntimeError(f"only {fit.sum()} of {draws} random pairs are far apart, joined and out of sight")
    return list(zip(starts[fit][:number], goals[fit][:number], strict=True))


def _from_scenarios(space: CSpace, number: int) -> list[Query]:
    """The longest problems of the map's scenario file that the disc can solve."""
    source = space.workspace.source + ".scen"
    rows = np.loadtxt(source, skiprows=1, usecols=(4, 5, 6, 7, 8))
    found: list[Query] = []
    for x0, y0, x1, y1, _ in rows[np.argsort(-rows[:, 4], kind="stable")]:
        # Rows are counted from the top of the map.
        start, goal = (np.array([x + 0.5, space.grid.shape[1] - y - 0.5]) for x, y in ((x0, y0), (x1, y1)))
        if space.path_exists(start, goal) is True and not space.motion_is_free(start, goal):
            found.append((start, goal))
            if len(found) == number:
                break
    return found


def _text(point: Floats) -> str:
    return f"({', '.join(f'{value:.1f}' for value in point)})"
