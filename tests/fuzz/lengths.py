"""Lower bounds of the length of paths, in random worlds with exact shortest paths."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from functools import partial

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import cspace
from benchmarks.report import Report
from cspace import CSpace, Robot, Workspace
from cspace._support.arrays import Floats
from tests.fuzz.scenes import Rng

SLACK = 1e-7
"""Error of lengths, relative and in metres, and of distances from contact in the oracle."""

HEIGHT = 0.4
"""Height of the box among columns, in metres; the columns are 2 m high."""

Outcome = tuple[float, float, float]
"""Distance of start and goal, lower bound, and length of a collision-free path, the shortest in
plane and space."""


def check(report: Report, seed: int, worlds: int) -> None:
    """Compare lower bounds in random worlds, equally many of each kind."""
    for number, (kind, draw) in enumerate(WORLDS.items()):
        outcomes = []
        for world in range(worlds // len(WORLDS)):
            outcomes += draw(np.random.default_rng([seed, number, world]))
        straight, bound, length = np.reshape(outcomes, (-1, 3)).T
        above = (bound > straight * 1.001).mean()
        report.section(f"lower bounds of lengths: {kind}, {above:.0%} exceed the distance")
        title = f"{len(bound)} bounds exceed no path and are at least the distance"
        report.check(is_between(straight, bound, length), title)


def is_between(straight: Floats, bound: Floats, length: Floats) -> bool:
    """Return whether all bounds are at least the distance and at most the length."""
    return bool(
        np.all((straight * (1.0 - SLACK) - SLACK <= bound) & (bound <= length * (1.0 + SLACK)))
    )


def draw_world(rng: Rng, kind: str) -> list[Outcome]:
    """Draw a rectangle among blocks of side 1, in a plane or among columns from floor to ceiling.

    If it rotates, the path is that of a disc around it.
    """
    cells = rng.random(rng.integers(3, 8, 2)) < rng.uniform(0.1, 0.4)
    half, parts = rng.uniform(0.05, 0.6, 2), int(rng.integers(4, 10))
    outside = "blocked" if kind == "columns in space" else str(rng.choice(["blocked", "free"]))
    occupied = np.kron(cells, np.ones((parts, parts), dtype=np.bool_))
    robot, rotations = Robot.rectangle(2.0 * half[0], 2.0 * half[1]), None
    if kind == "columns in space":
        occupied = np.repeat(occupied[..., None], 2 * parts, axis=2)
        robot = Robot.box((*(2.0 * half), HEIGHT))
    if kind == "plane with rotations":
        half = half / 2.0
        robot, rotations = Robot.rectangle(2.0 * half[0], 2.0 * half[1]), int(rng.integers(4, 9))
    workspace = Workspace.from_array(occupied, 1.0 / parts)
    space = cspace.build(workspace, robot, rotations=rotations, outside=outside)
    corners = np.argwhere(cells)
    if rotations is None:
        grown = [shapely.box(*(corner - half), *(corner + 1.0 + half)) for corner in corners]
    else:  # the buffer's circle of 8 corners a quarter contains a circle of 0.5025
        half = np.full(2, 1.02 * math.hypot(*half))
        blocks = [shapely.box(*corner, *(corner + 1.0)) for corner in corners]
        grown = [block.buffer(half[0], quad_segs=8) for block in blocks]
    if outside == "blocked":
        inner = shapely.box(*half, *np.maximum(np.array(cells.shape) - half, half))
        grown.append(shapely.box(-9, -9, 99, 99) - inner)
    return _compare(space, shapely.union_all(grown), rng)


WORLDS: dict[str, Callable[[Rng], list[Outcome]]] = {
    kind: partial(draw_world, kind=kind)
    for kind in ("plane", "columns in space", "plane with rotations")
}
"""Functions that draw a world and compare a few pairs of points, by kind of world."""


def _compare(space: CSpace, obstacles: shapely.Geometry, rng: Rng) -> list[Outcome]:
    """Compare bounds with lengths between a few points outside of obstacles."""
    inner = shapely.box(*space.grid.lower[:2], *space.grid.upper[:2]) - obstacles
    points = rng.uniform(space.grid.lower, space.grid.upper, (20, space.grid.dim))
    points = points[shapely.contains_xy(inner, *points[:, :2].T)][:3]
    points[:, 2:] = points[:, 2:].clip(
        0.5 * HEIGHT, 2.0 - 0.5 * HEIGHT
    )  # clear of floor and ceiling
    yaw = [0.0] * (len(space.axes) - space.grid.dim)
    outcomes = []
    for start, goal in itertools.pairwise(points):
        length = math.hypot(shortest_length(obstacles, start[:2], goal[:2]), *(goal - start)[2:])
        bound = space.min_path_length((*start, *yaw), (*goal, *yaw))
        outcomes.append((float(np.linalg.norm(goal - start)), bound, length))
    return outcomes


def shortest_length(obstacles: shapely.Geometry, start: Floats, goal: Floats) -> float:
    """Return the length of the shortest path around open polygons, by a visibility graph; infinity
    if none exists."""
    parts = shapely.get_parts(obstacles)
    corners = [tuple(start), tuple(goal)]
    for part in parts:
        for ring in (part.exterior, *part.interiors):
            corners += [tuple(corner) for corner in ring.coords[:-1]]
    points = np.unique(np.array(corners[2:]).reshape(-1, 2), axis=0)
    points = np.vstack([start, goal, points])
    pairs = np.array(list(itertools.combinations(range(len(points)), 2)))
    inside = shapely.buffer(obstacles, -1e-7, join_style="mitre")
    first, last = pairs[~shapely.intersects(inside, shapely.linestrings(points[pairs]))].T
    lengths = np.linalg.norm(points[first] - points[last], axis=1)
    graph = coo_array((lengths, (first, last)), shape=(len(points),) * 2).tocsr()
    return float(dijkstra(graph, directed=False, indices=0)[1])
