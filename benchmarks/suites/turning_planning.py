"""Time to a first solution for a robot that turns, against shapely in the callback and motions in steps."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.soak.plane_geometry import union_of_cells
from benchmarks.suites.planning import check_paths, far_apart, our_setup, race, solve, tell, tell_made
from cspace import CSpace, Robot

Floats = NDArray[np.float64]

MAP = "maps/depot.yaml"
LENGTH, WIDTH = 0.6, 0.4
"""Sides of the robot, metres."""

ROTATIONS = 72


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
    queries = far_apart(space, 1 if report.quick else 3, np.random.default_rng(seed))
    seeds = 2 if report.quick else 10
    report.section(
        f"planning, {MAP}: {' x '.join(map(str, workspace.grid.shape))} cells of {workspace.grid.spacing:g} m x "
        f"{ROTATIONS} yaw cells, robot {LENGTH:g} m x {WIDTH:g} m, RRTConnect, {len(queries)} queries, {seeds} seeds "
        "each"
    )
    solvers = [partial(solve, make) for make in (our_setup(space), _peer(space, obstacles))]
    ours, peer = race(solvers, queries, seeds)
    report.timing("ours, set-up and search", ours)
    report.timing("OMPL with prepared shapely, set-up and search", peer)
    tell(report, "OMPL with prepared shapely", ours, peer, queries, 10.0)
    tell_made(report, ours, peer, built, united, "polygons")
    check_paths(report, ours, peer, lambda path: _collides(obstacles, path), "looked at every 2 mm")


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
