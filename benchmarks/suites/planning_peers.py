"""Planning problems in the plane, and shapely as a peer."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import shapely

from benchmarks import inputs
from benchmarks.report import Report
from cspace import CSpace, Robot, Workspace
from cspace._support.arrays import Floats
from tests.helpers.regions import Flat, cell_boxes, place_polygon

Query = tuple[Floats, Floats]

SEARCH_SECONDS = 60.0
"""Time limit of a search, seconds."""

DISC_RADII = {"maps/depot.yaml": 0.3, "movingai/Berlin_1_1024.map": 2.0}
"""Radii of discs, metres."""

RECTANGLE_LENGTH, RECTANGLE_WIDTH, YAW_CELLS = 0.6, 0.4, 72
"""Sides of the rotating rectangle, metres, and its number of yaw cells."""


@dataclass(frozen=True)
class PlanningPeer:
    """Another library as a peer.

    Attributes
    ----------
    name : str
    is_free : callable
        Tests if the robot is free at a state of OMPL.
    collides : callable
        Tests if a path collides, by the method ``how``.
    how : str
    made : float
        Seconds to prepare ``what`` the peer needs.
    what : str
    """

    name: str
    is_free: Callable[[Any], bool]
    collides: Callable[[Floats], bool]
    how: str
    made: float
    what: str


@dataclass(frozen=True)
class Problem:
    """A robot in a workspace, and start and goal of each search.

    Attributes
    ----------
    name : str
    workspace : Workspace
    robot : Robot
    rotations : int or None
    peer : callable
        Makes the peer.
    queries : callable
        Draws starts and goals on the map.
    least : float
        Target ratio of the peer's time to ours.
    """

    name: str
    workspace: Workspace
    robot: Robot
    rotations: int | None
    peer: Callable[[Report, CSpace], PlanningPeer]
    queries: Callable[[CSpace], list[Query]]
    least: float


def plane_problems(report: Report, rng: np.random.Generator) -> Iterator[Problem]:
    """Yield the problems whose maps exist."""
    far = partial(far_apart, number=3, rng=rng)
    for name, radius in DISC_RADII.items():
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(f"{name} skipped: not in the folder of real maps")
            continue
        disc = partial(_disc, radius=radius)
        queries = far if name.endswith("yaml") else _from_scenarios
        yield Problem(
            f"{name}, disc of {radius:g} m",
            workspace,
            Robot.disc(radius),
            None,
            disc,
            queries,
            10.0,
        )
        if name.endswith("yaml"):
            title = f"{name}, rectangle of {RECTANGLE_LENGTH:g} m x {RECTANGLE_WIDTH:g} m"
            yield Problem(
                title,
                workspace,
                Robot.rectangle(RECTANGLE_LENGTH, RECTANGLE_WIDTH),
                YAW_CELLS,
                _rectangle,
                far,
                10.0,
            )


# ---- start and goal ------------------------------------------------------------------------------


def far_apart(space: CSpace, number: int, rng: np.random.Generator) -> list[Query]:
    """Draw connected FREE pairs, half the map's diagonal apart, without free edges."""
    least = 0.5 * np.linalg.norm(np.subtract(space.grid.upper, space.grid.lower))
    draws = 5_000 if space.rotations.names else 20_000
    starts, goals = space.sample_free(draws, rng), space.sample_free(draws, rng)
    fit = np.linalg.norm((starts - goals)[:, : space.grid.dim], axis=1) >= least
    fit &= space.is_connected(starts, goals) & ~space.motion_is_free(starts, goals)
    if fit.sum() < number:
        raise RuntimeError(
            f"only {fit.sum()} of {draws} random pairs are far apart, joined and out of sight"
        )
    return list(zip(starts[fit][:number], goals[fit][:number], strict=True))


def _from_scenarios(space: CSpace, number: int = 3) -> list[Query]:
    """Return the longest solvable problems of the map's scenario file."""
    rows = np.loadtxt(space.workspace.source + ".scen", skiprows=1, usecols=(4, 5, 6, 7, 8))
    queries: list[Query] = []
    for x0, y0, x1, y1, _ in rows[np.argsort(-rows[:, 4], kind="stable")]:
        # Rows are counted from the top of the map.
        start, goal = (
            np.array([x + 0.5, space.grid.shape[1] - y - 0.5]) for x, y in ((x0, y0), (x1, y1))
        )
        if space.is_connected(start, goal) and not space.motion_is_free(start, goal):
            queries.append((start, goal))
            if len(queries) == number:
                break
    return queries


# ---- the plane: shapely --------------------------------------------------------------------------


def _polygons(workspace: Workspace) -> tuple[Any, float]:
    """Return the prepared obstacles and the time of preparation, seconds."""
    began = time.perf_counter()
    grid = workspace.grid
    boxes = cell_boxes(workspace.outer, grid.lower, grid.spacing)
    obstacles = shapely.union_all(Flat.boxes(boxes).polygons)
    shapely.prepare(obstacles)
    return obstacles, time.perf_counter() - began


def _disc(report: Report, space: CSpace, radius: float) -> PlanningPeer:
    (left, low), (right, high) = space.grid.lower, space.grid.upper
    obstacles, made = _polygons(space.workspace)

    def is_free(state: Any) -> bool:
        x, y = state[0], state[1]
        inside = left + radius < x < right - radius and low + radius < y < high - radius
        return inside and not shapely.dwithin(obstacles, shapely.Point(x, y), radius)

    def collides(path: Floats) -> bool:
        return bool(shapely.dwithin(obstacles, shapely.LineString(path), radius))

    how = "by the whole path's exact distance"
    return PlanningPeer("OMPL with prepared shapely", is_free, collides, how, made, "polygons")


def _rectangle(report: Report, space: CSpace) -> PlanningPeer:
    (left, low), (right, high) = space.grid.lower, space.grid.upper
    obstacles, made = _polygons(space.workspace)
    corners = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [
        RECTANGLE_LENGTH / 2,
        RECTANGLE_WIDTH / 2,
    ]
    outline, footprint = corners.tolist(), shapely.Polygon(corners)

    def is_free(state: Any) -> bool:
        cosine, sine = math.cos(state.getYaw()), math.sin(state.getYaw())
        x, y = state.getX(), state.getY()
        points = [(x + cosine * a - sine * b, y + sine * a + cosine * b) for a, b in outline]
        if not all(left < px < right and low < py < high for px, py in points):
            return False
        return not obstacles.intersects(shapely.Polygon(points))

    def collides(path: Floats) -> bool:
        for start, goal in itertools.pairwise(path):
            change = goal - start
            change[2] = (change[2] + np.pi) % (2 * np.pi) - np.pi  # the shorter rotation
            moved = np.hypot(*change[:2]) + abs(change[2]) * np.hypot(*corners[0])
            q = start + np.linspace(0, 1, 2 + int(moved / 0.002))[:, None] * change
            if shapely.intersects(obstacles, place_polygon(footprint, q)).any():
                return True
        return False

    return PlanningPeer(
        "OMPL with prepared shapely", is_free, collides, "tested every 2 mm", made, "polygons"
    )
