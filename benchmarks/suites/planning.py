"""Time to a first solution on real maps, against shapely or FCL in the callback."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from ompl import base as ob
from ompl import geometric as og
from ompl import util as ou

import cspace
import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.lookups import at_half_a_cell, states_of
from benchmarks.suites.planning_peers import (
    SEARCH_SECONDS,
    PlanningPeer,
    Problem,
    Query,
    plane_problems,
)
from benchmarks.suites.solid_scenes import Fcl, Scene, building, cube_tunnel
from benchmarks.timing import Timing, once
from cspace import CSpace
from cspace._support.arrays import Floats
from planners._ompl.states import find_state_kind

Solver = Callable[[Query, int], tuple[float, Floats | None]]

TIMED_CONFIGURATIONS = 1000
"""Number of configurations on which FCL's models are timed."""

LONG_SEARCH_SECONDS = 10.0
"""Search time from which setup at the first call is negligible, seconds."""


def run(report: Report, seed: int) -> None:
    """Solve equal queries with equal seeds, alternating ours and the peer."""
    if inputs.data_folder() is None:
        report.note(inputs.NO_DATA)
        return
    rng = np.random.default_rng(seed)
    for problem in plane_problems(report, rng):
        _compare(report, problem)
    scenes = [*cube_tunnel(report), *building(report, rng, 3, False, "occupied")]
    for scene in scenes if report.quick else [*scenes, *building(report, rng, 3, False, "free")]:
        peer = partial(_fcl, scene=scene)
        _compare(
            report,
            Problem(scene.name, scene.workspace, scene.robot, None, peer, scene.queries, 20.0),
        )


def _fcl(report: Report, space: CSpace, scene: Scene) -> PlanningPeer:
    """Return FCL as a peer, after a check of FREE configurations."""
    q = space.sample_free(TIMED_CONFIGURATIONS, np.random.default_rng(0))
    fcl = Fcl(report, scene, q)
    wrong = sum(fcl.meets(each) for each in q)
    report.check(not wrong, f"{wrong} of {len(q)} FREE configurations collide by FCL, {fcl.what}")
    return fcl.peer()


def _compare(report: Report, problem: Problem) -> None:
    workspace = problem.workspace
    build = partial(cspace.build, workspace, problem.robot, rotations=problem.rotations)
    build()  # compiles
    built = once(build)
    space: CSpace = built.value
    queries = problem.queries(space)
    queries = queries[:1] if report.quick else queries
    seeds = 2 if report.quick else 10 if len(queries) > 1 else 30
    turns = f" x {len(space.rotations)} rotation cells" if space.rotations.names else ""
    report.section(
        f"{problem.name}: {' x '.join(map(str, workspace.grid.shape))} cells of {workspace.grid.spacing:g} m{turns}, "
        f"{len(queries)} queries, {seeds} seeds each"
    )
    ours: dict[str, Solver] = {
        "ours, planners.simple_setup and RRTConnect": partial(
            solve, space, lambda: planners.simple_setup(space)
        )
    }
    if space.grid.dim == 3:
        names = ("Grid", "RRTConnect")
        ours = {
            f"ours, planners.plan, {name}": partial(solve_by_plan, space, name) for name in names
        } | ours
    compare(
        report, space, built, problem.peer(report, space), ours, queries, seeds, least=problem.least
    )


def compare(
    report: Report,
    space: CSpace,
    built: Timing,
    peer: PlanningPeer,
    ours: Mapping[str, Solver],
    queries: Sequence[Query],
    seeds: int,
    budget: float = math.inf,
    least: float | None = None,
    least_with_build: float | None = None,
) -> None:
    """Compare our solvers with a peer's, check our paths, and report one-time costs.

    Targets hold for our first solver: the ratio of the peer's time to ours, without and with
    one-time costs.
    """
    name = f"{peer.name}, set-up and RRTConnect"
    setup = peer_setup(space, peer.is_free)
    coarse = peer_setup(space, peer.is_free, in_half_cells=False)
    solvers = {
        **ours,
        name: partial(solve, space, setup),
        f"{name}, OMPL's default steps of 1 %": partial(solve, space, coarse),
    }
    timings = dict(zip(solvers, race(list(solvers.values()), queries, seeds, budget), strict=True))
    for way, timing in timings.items():
        paths = [path for path in timing.value if path is not None]
        colliding = sum(peer.collides(path) for path in paths)
        metres = np.mean([_measure_length(space, path) for path in paths]) if paths else math.nan
        report.timing(
            way,
            timing,
            solved=f"{len(paths)} of {len(timing.value)}",
            colliding=colliding,
            length=f"{metres:.2f} m in the mean",
        )
        if way in ours:
            report.check(
                not colliding, f"{way}: {colliding} of {len(paths)} paths collide, {peer.how}"
            )
            if budget == math.inf:
                report.check(
                    len(paths) == len(timing.value), f"{way}: every search reaches the goal"
                )
    report.note(f"a search that fails counts with {SEARCH_SECONDS:g} s")
    report.note(
        f"made once for each map: ours {built.median * 1e3:.3g} ms (build), the peer {peer.made * 1e3:.3g} ms "
        f"({peer.what})"
    )
    theirs = timings[name]
    for number, way in enumerate(ours):
        timing = timings[way]
        report.ratio(f"{peer.name} / {way}", theirs, timing, least=None if number else least)
        for count in (1, 100):
            gain = (count * theirs.median + peer.made) / (count * timing.median + built.median)
            target = least_with_build if (number, count) == (0, 1) else None
            report.figure(f"  {count} on one map, with one-time costs", gain, least=target)
            cpu = (count * theirs.median_cpu + peer.made) / (
                count * timing.median_cpu + built.median_cpu
            )
            report.figure("    the same in CPU time", cpu)


def race(
    solvers: Sequence[Solver], queries: Sequence[Query], seeds: int, budget: float = math.inf
) -> list[Timing]:
    """Solve all queries with equal seeds, alternating solvers; the values are paths or None.

    A solver stops after ``budget`` seconds of search.
    """
    timings = [Timing([]) for _ in solvers]
    for query, seed in itertools.product(queries, range(seeds)):
        for timing, solver in zip(timings, solvers, strict=True):
            if sum(timing.seconds) > budget:
                continue
            for again in (True, False):
                cpu = time.process_time()
                taken, path = solver(query, seed)
                # A short first search is repeated, because it includes setup.
                if not (again and not timing.seconds and taken < LONG_SEARCH_SECONDS):
                    break
            timing.cpu.append(time.process_time() - cpu)
            timing.seconds.append(taken)
            timing.value.append(path)
    return timings


def solve_by_plan(
    space: CSpace, planner: str, query: Query, seed: int, exact: bool = False
) -> tuple[float, Floats | None]:
    """Return the seconds to a first solution by ``plan``, and the path or None."""
    began = time.perf_counter()
    plan = planners.plan(
        (space.exact if exact else space),
        *query,
        planner=planners.Search(planner, simplify=False),
        time_limit=SEARCH_SECONDS,
        seed=seed,
    )
    taken = time.perf_counter() - began
    return taken, plan.path if plan else None


def _measure_length(space: CSpace, path: Floats) -> float:
    """Return how far the reference point moves along a path, metres."""
    return float(np.linalg.norm(np.diff(path[:, : space.grid.dim], axis=0), axis=1).sum())


def peer_setup(
    space: CSpace, is_free: Callable[[Any], bool], in_half_cells: bool = True
) -> Callable[[], Any]:
    """Return the setup of a plain OMPL script with a peer in the callback.

    OMPL tests edges in steps of half a cell, or else of 1 % of the extent, its default.
    """

    class Checker(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            return is_free(state)

    def setup() -> Any:
        made = og.SimpleSetup(planners.state_space(space))
        si = made.getSpaceInformation()
        made.setStateValidityChecker(Checker(si))
        if in_half_cells:
            at_half_a_cell(space, si)
        return made

    return setup


def solve(
    space: CSpace, make: Callable[[], Any], query: Query, seed: int
) -> tuple[float, Floats | None]:
    """Return the seconds to a first solution by RRTConnect, and the path or None."""
    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)
    began = time.perf_counter()
    setup = make()
    setup.setStartAndGoalStates(*states_of(space, setup.getSpaceInformation(), query))
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(SEARCH_SECONDS)
    taken = time.perf_counter() - began
    if not setup.haveExactSolutionPath():
        return taken, None
    kind = find_state_kind(space)
    return taken, np.array([kind.read(state) for state in setup.getSolutionPath().getStates()])
