"""Time to a first solution on real maps, against the usual way: shapely or FCL in the callback, motions in steps."""

from __future__ import annotations

import itertools
import math
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites import lookups
from benchmarks.suites.planning_peers import LIMIT, Peer, Problem, Query, problems
from benchmarks.timing import Timing
from cspace import CSpace
from cspace.arrays import Floats

Solver = Callable[[Query, int], tuple[float, Floats | None]]


def run(report: Report, seed: int) -> None:
    """The same queries and seeds in every space, ours and the peer's in turns."""
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA)
        return
    for problem in problems(report, np.random.default_rng(seed)):
        _compare(report, problem)


def _compare(report: Report, problem: Problem) -> None:
    workspace = problem.workspace
    build = partial(cspace.build, workspace, problem.robot, rotations=problem.rotations)
    build()  # compiles
    began = time.perf_counter()
    space = build()
    built = time.perf_counter() - began
    queries = problem.queries(space)
    queries = queries[:1] if report.quick else queries
    seeds = 2 if report.quick else 10 if len(queries) > 1 else 30
    turns = f" x {space.rotations.count} rotation cells" if space.rotations.dof else ""
    report.section(
        f"{problem.name}: {' x '.join(map(str, workspace.grid.shape))} cells of {workspace.grid.spacing:g} m{turns}, "
        f"{len(queries)} queries, {seeds} seeds each"
    )
    peer = problem.peer(report, space)
    solvers = {
        **_ours(space),
        f"{peer.name}, set-up and RRTConnect": partial(solve, space, peer_setup(space, peer.is_free)),
    }
    timings = dict(zip(solvers, race(list(solvers.values()), queries, seeds), strict=True))
    for name, timing in timings.items():
        report.timing(name, timing)
    *ours, theirs = timings.values()
    for name, timing in zip(_ours(space), ours, strict=True):
        report.ratio(f"{peer.name} / {name}", theirs, timing, least=problem.least if timing is ours[0] else None)
    for number, (start, goal) in enumerate(queries):
        part = slice(number * seeds, (number + 1) * seeds)
        ratio = statistics.median(theirs.seconds[part]) / statistics.median(ours[0].seconds[part])
        report.figure(f"query {number}: {_text(start)} to {_text(goal)}", ratio)
    lengths = (f"{_length(timing, space.grid.dim):.1f} m" for timing in timings.values())
    report.note(f"median length of the paths: {', '.join(lengths)}")
    made = f"ours {built * 1e3:.3g} ms (build), the peer {peer.made * 1e3:.3g} ms ({peer.what})"
    report.note(f"made once for each map: {made}")
    report.figure("with both charged to every search", (theirs.median + peer.made) / (ours[0].median + built))
    report.figure("with only our build charged to every search", theirs.median / (ours[0].median + built))
    _check_paths(report, ours[0], theirs, peer)


def _ours(space: CSpace) -> dict[str, Solver]:
    """Our ways; the first is the one that targets are for."""
    import planners

    setup: dict[str, Solver] = {
        "ours, planners.simple_setup and RRTConnect": partial(solve, space, lambda: planners.simple_setup(space))
    }
    if space.grid.dim == 2:
        return setup
    names = ("Cubes", "RRTConnect")
    return {f"ours, planners.plan, {name}": partial(solve_by_plan, space, name) for name in names} | setup


LONG = 10.0
"""Seconds beside which what is made at the first call does not count."""


def race(solvers: Sequence[Solver], queries: Sequence[Query], seeds: int, budget: float = math.inf) -> list[Timing]:
    """All solve all queries with the same seeds, in turns; the paths, or None, are the timings' values.

    One that has searched for longer than ``budget``, in seconds, is asked no more.
    """
    timings = [Timing([]) for _ in solvers]
    for query, seed in itertools.product(queries, range(seeds)):
        for timing, solver in zip(timings, solvers, strict=True):
            if sum(timing.seconds) > budget:
                continue
            for again in (True, False):
                cpu = time.process_time()
                taken, path = solver(query, seed)
                # A short first search is made anew, so that none pays for what is made at the first call.
                if not (again and not timing.seconds and taken < LONG):
                    break
            timing.cpu.append(time.process_time() - cpu)
            timing.seconds.append(taken)
            timing.value.append(path)
    return timings


def _check_paths(report: Report, ours: Timing, theirs: Timing, peer: Peer) -> None:
    """Our searches must reach the goal without a collision; the peer's paths are told."""
    solved = [path for path in ours.value if path is not None]
    report.check(len(solved) == len(ours.value), f"ours: {len(solved)} of {len(ours.value)} searches reach the goal")
    colliding = sum(peer.collides(path) for path in solved)
    report.check(not colliding, f"ours: {colliding} of {len(solved)} paths collide, {peer.how}")
    paths = [path for path in theirs.value if path is not None]
    report.note(
        f"the peer: {len(paths)} of {len(theirs.value)} searches reach the goal within {LIMIT:g} s, and "
        f"{sum(peer.collides(path) for path in paths)} of these paths collide between the steps"
    )


def solve_by_plan(
    space: CSpace, planner: str, query: Query, seed: int, exact: bool = False
) -> tuple[float, Floats | None]:
    """Seconds until a first solution by our planning function, and the path; None where none was found."""
    import planners

    began = time.perf_counter()
    plan = planners.plan(space, *query, planner=planner, time_limit=LIMIT, simplify=False, seed=seed, exact=exact)
    taken = time.perf_counter() - began
    return taken, plan.path if plan.solved else None


def peer_setup(space: CSpace, is_free: Callable[[Any], bool]) -> Callable[[], Any]:
    """Makes the set-up of a plain OMPL script: a callback that asks a peer, and motions checked at half a cell."""
    from ompl import base as ob
    from ompl import geometric as og

    import planners

    class Checker(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            return is_free(state)

    def setup() -> Any:
        made = og.SimpleSetup(planners.state_space(space))
        si = made.getSpaceInformation()
        made.setStateValidityChecker(Checker(si))
        lookups.at_half_a_cell(space, si)
        return made

    return setup


def solve(space: CSpace, make: Callable[[], Any], query: Query, seed: int) -> tuple[float, Floats | None]:
    """Seconds until a first solution by a set-up's RRTConnect, and the path; None where none was found."""
    from ompl import geometric as og
    from ompl import util as ou

    from planners.states import kind_of

    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)
    began = time.perf_counter()
    setup = make()
    setup.setStartAndGoalStates(*lookups.states_of(space, setup.getSpaceInformation(), query))
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(LIMIT)
    taken = time.perf_counter() - began
    if not setup.haveExactSolutionPath():
        return taken, None
    kind = kind_of(space)
    return taken, np.array([kind.read(state) for state in setup.getSolutionPath().getStates()])


def _length(timing: Timing, dim: int) -> float:
    """Median length of the paths that were found, in metres."""
    paths = [path[:, :dim] for path in timing.value if path is not None]
    return statistics.median(float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()) for path in paths)


def _text(point: Floats) -> str:
    return f"({', '.join(f'{value:.1f}' for value in point)})"
