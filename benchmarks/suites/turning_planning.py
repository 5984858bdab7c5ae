"""Time to a first solution for a robot that turns, against shapely in the callback and motions in steps."""

from __future__ import annotations

import itertools
import math
import statistics
import time
from collections.abc import Callable
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

MAP = "maps/depot.yaml"
LENGTH, WIDTH = 0.6, 0.4
"""Sides of the robot, metres."""

ROTATIONS = 72

LIMIT = 60.0
"""Seconds that a search may take."""


def run(report: Report, seed: int) -> None:
    """RRTConnect in SE(2) with the same seeds and queries, the two in turns."""
    try:
        import planners  # noqa: F401 - whether it is there at all
    except ImportError as error:
        report.note(f"planning skipped: {error}")
        return
    workspace = inputs.real_map(MAP)
    if workspace is None:
        report.note(inputs.NO_DATA)
        return
    import shapely

    robot = Robot.rectangle(LENGTH, WIDTH)
    cspace.build(workspace, robot, rotations=ROTATIONS)  # compiles
    began = time.perf_counter()
    space = cspace.build(workspace, robot, rotations=ROTATIONS)
    built = time.perf_counter() - began
    began = time.perf_counter()
    obstacles = union_of_cells(workspace.outer, workspace.grid)
    shapely.prepare(obstacles)
    united = time.perf_counter() - began
    queries = _far_apart(space, 1 if report.quick else 3, np.random.default_rng(seed))
    seeds = 2 if report.quick else 10
    report.section(
        f"planning, {MAP}: {' x '.join(map(str, workspace.grid.shape))} cells of {workspace.grid.spacing:g} m x "
        f"{ROTATIONS} yaw cells, robot {LENGTH:g} m x {WIDTH:g} m, RRTConnect, {len(queries)} queries, {seeds} seeds "
        "each"
    )
    timings = {"ours": Timing([]), "OMPL with prepared shapely": Timing([])}
    makers = {"ours": _ours(space), "OMPL with prepared shapely": _peer(space, obstacles)}
    for query in queries:
        for number in range(seeds):
            for name, timing in timings.items():
                if not timing.seconds:
                    _solve(makers[name], query, number)  # not timed, so that neither pays for what a first call makes
                cpu = time.process_time()
                taken, path = _solve(makers[name], query, number)
                timing.cpu.append(time.process_time() - cpu)
                timing.seconds.append(taken)
                timing.value.append(path)
    ours, peer = timings.values()
    for name, timing in timings.items():
        report.timing(f"{name}, set-up and search", timing)
    report.ratio("OMPL with prepared shapely / ours", peer, ours, least=10.0)
    report.note(f"made once for each map: ours {built * 1e3:.3g} ms (build), the peer {united * 1e3:.3g} ms (polygons)")
    report.figure("with only our build charged to every search", peer.median / (ours.median + built))
    for number, (start, goal) in enumerate(queries):
        part = slice(number * seeds, (number + 1) * seeds)
        ratio = statistics.median(peer.seconds[part]) / statistics.median(ours.seconds[part])
        report.figure(f"query {number}: {_text(start)} to {_text(goal)}", ratio)
    solved = [path for path in ours.value if path is not None]
    report.check(len(solved) == len(ours.value), f"ours: {len(solved)} of {len(ours.value)} searches reach the goal")
    colliding = sum(_collides(obstacles, path) for path in solved)
    report.check(not colliding, f"ours: {colliding} of {len(solved)} paths collide, looked at every 2 mm")
    paths = [path for path in peer.value if path is not None]
    report.note(
        f"the peer: {len(paths)} of {len(peer.value)} searches reach the goal within {LIMIT:g} s, and "
        f"{sum(_collides(obstacles, path) for path in paths)} of these paths collide between the steps"
    )


def _ours(space: CSpace) -> Callable[[], Any]:
    import planners

    return lambda: planners.simple_setup(space)


def _peer(space: CSpace, obstacles: Any) -> Callable[[], Any]:
    """A plain OMPL script: shapely tells whether the turned rectangle is free, and motions are checked in steps.

    A step is half a cell, or as many radians of turn as move a corner of the robot by less than that.
    """
    import shapely
    from ompl import base as ob
    from ompl import geometric as og

    (left, low), (right, high) = space.grid.lower, space.grid.upper
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [LENGTH / 2, WIDTH / 2]

    class Checker(ob.StateValidityChecker):
        def isValid(self, state: Any) -> bool:  # noqa: N802 - OMPL's name
            cosine, sine = math.cos(state.getYaw()), math.sin(state.getYaw())
            x, y = state.getX(), state.getY()
            points = [(x + cosine * a - sine * b, y + sine * a + cosine * b) for a, b in outline]
            if not all(left < px < right and low < py < high for px, py in points):
                return False
            return not obstacles.intersects(shapely.Polygon(points))

    outline = corners.tolist()

    def setup() -> Any:
        states = ob.SE2StateSpace()
        bounds = ob.RealVectorBounds(2)
        for axis, (first, last) in enumerate(((left, right), (low, high))):
            bounds.setLow(axis, first)
            bounds.setHigh(axis, last)
        states.setBounds(bounds)
        made = og.SimpleSetup(states)
        si = made.getSpaceInformation()
        made.setStateValidityChecker(Checker(si))
        # OMPL counts a radian as half a metre, which is more than a corner moves.
        si.setStateValidityCheckingResolution(0.5 * space.grid.spacing / states.getMaximumExtent())
        return made

    return setup


def _solve(make: Callable[[], Any], query: Query, seed: int) -> tuple[float, Floats | None]:
    """Seconds until a first solution, and the path; None where none was found."""
    from ompl import geometric as og
    from ompl import util as ou

    ou.setLogLevel(ou.LOG_NONE)
    ou.RNG.setSeed(seed + 1)
    began = time.perf_counter()
    setup = make()
    states = []
    for x, y, yaw in np.asarray(query).tolist():
        state = setup.getStateSpace().allocState()
        state.setX(x)
        state.setY(y)
        state.setYaw(math.remainder(yaw, math.tau))  # OMPL refuses what is not within half a turn of zero
        states.append(state)
    setup.setStartAndGoalStates(*states)
    setup.setPlanner(og.RRTConnect(setup.getSpaceInformation()))
    setup.solve(LIMIT)
    taken = time.perf_counter() - began
    if not setup.haveExactSolutionPath():
        return taken, None
    path = setup.getSolutionPath().getStates()
    return taken, np.array([[state.getX(), state.getY(), state.getYaw()] for state in path])


def _collides(obstacles: Any, path: Floats) -> bool:
    """Whether the robot meets the obstacles at a place of a path, looked at so often that it moves by 2 mm at most."""
    import shapely

    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [LENGTH / 2, WIDTH / 2]
    for start, goal in itertools.pairwise(path):
        change = goal - start
        change[2] = (change[2] + np.pi) % (2 * np.pi) - np.pi  # the shorter way round
        moved = np.hypot(*change[:2]) + abs(change[2]) * np.hypot(*corners[0])
        x, y, yaw = (start + np.linspace(0, 1, 2 + int(moved / 0.002))[:, None] * change).T
        turned = [(x + a * np.cos(yaw) - b * np.sin(yaw), y + a * np.sin(yaw) + b * np.cos(yaw)) for a, b in corners]
        footprints = shapely.polygons(np.stack([np.stack(point, axis=-1) for point in turned], axis=1))
        if shapely.intersects(obstacles, footprints).any():
            return True
    return False


def _far_apart(space: CSpace, number: int, rng: np.random.Generator) -> list[Query]:
    """Random FREE pairs that a path joins, no straight edge does, and half the map's diagonal lies between."""
    least = 0.5 * np.hypot(*np.subtract(space.grid.upper, space.grid.lower))
    starts, goals = space.sample_free(5_000, rng), space.sample_free(5_000, rng)
    fit = np.hypot(*(starts - goals)[:, :2].T) >= least
    fit &= (space.path_exists(starts, goals) == True) & ~space.motion_is_free(starts, goals)  # noqa: E712 - of objects
    if fit.sum() < number:
        raise RuntimeError(f"only {fit.sum()} of 5000 random pairs are far apart, joined and out of sight")
    return list(zip(starts[fit][:number], goals[fit][:number], strict=True))


def _text(q: Floats) -> str:
    return f"({q[0]:.1f}, {q[1]:.1f}, {math.degrees(q[2]):.0f} deg)"
