"""Lower bounds of the length of paths, in random worlds with exact shortest paths."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable

import numpy as np
import shapely
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

import cspace
from benchmarks.report import Report
from cspace import CSpace, Robot, Workspace
from cspace.support.arrays import Bools, Floats
from tests.soak.scenes import Rng

SLACK = 1e-7
"""Error of lengths, relative and in metres, and of distances from contact in the oracle."""

HEIGHT = 0.4
"""Height of the box among columns, in metres; the columns are 2 m high."""

MAX_WORLDS = 10_000
QUICK_WORLDS = 200

Outcome = tuple[float, float, float]
"""Distance of start and goal, lower bound, and length of a collision-free path, the shortest in
plane and space."""


def check(report: Report, seed: int, worlds: int) -> None:
    """Compare lower bounds in random worlds, equally many of each kind."""
    for number, (kind, draw) in enumerate(WORLDS.items()):
        outcomes = [
            o
            for world in range(worlds // len(WORLDS))
            for o in draw(np.random.default_rng([seed, number, world]))
        ]
        straight, bound, length = np.reshape(outcomes, (-1, 3)).T
        report.section(
            f"lower bounds of lengths: {worlds // len(WORLDS)} worlds, {kind}, {len(bound)} pairs of points"
        )
        report.check(
            is_between(straight, bound, length),
            "no bound exceeds a path or is less than the distance",
        )
        shown = np.isfinite(bound) & np.isfinite(length)
        if shown.any():
            gap = np.median(length[shown] / bound[shown] - 1.0)
            report.note(
                f"{(bound > straight * 1.001).mean():.0%} of bounds exceed the distance; median gap {gap:.1%}"
            )


def is_between(straight: Floats, bound: Floats, length: Floats) -> bool:
    """Return whether all bounds are at least the distance and at most the length."""
    return bool(
        np.all((straight * (1.0 - SLACK) - SLACK <= bound) & (bound <= length * (1.0 + SLACK)))
    )


def draw_plane(rng: Rng) -> list[Outcome]:
    """Draw a rectangle among square blocks; lengths are exact."""
    cells, half, parts, outside = _draw_blocks(rng)
    workspace = Workspace.from_array(
        np.kron(cells, np.ones((parts, parts), dtype=np.bool_)), 1.0 / parts
    )
    space = cspace.build(workspace, Robot.rectangle(*(2.0 * half)), outside=outside)
    return _compare(space, _grow_boxes(cells, half, outside), rng)


def draw_columns(rng: Rng) -> list[Outcome]:
    """Draw a box among columns from floor to ceiling; lengths are exact."""
    cells, half, parts, _ = _draw_blocks(rng)
    occupied = np.kron(cells, np.ones((parts, parts), dtype=np.bool_))
    workspace = Workspace.from_array(np.repeat(occupied[..., None], 2 * parts, axis=2), 1.0 / parts)
    space = cspace.build(workspace, Robot.box((*(2.0 * half), HEIGHT)), outside="blocked")
    return _compare(space, _grow_boxes(cells, half, "blocked"), rng)


def draw_yaws(rng: Rng) -> list[Outcome]:
    """Draw a rectangle that rotates; the path is that of a disc around it."""
    cells, half, parts, outside = _draw_blocks(rng)
    workspace = Workspace.from_array(
        np.kron(cells, np.ones((parts, parts), dtype=np.bool_)), 1.0 / parts
    )
    space = cspace.build(
        workspace, Robot.rectangle(*half), rotations=int(rng.integers(4, 9)), outside=outside
    )
    radius = 0.51 * math.hypot(
        *half
    )  # the buffer's circle of 8 corners a quarter contains a circle of 0.5025
    grown = [
        shapely.box(*corner, *(corner + 1.0)).buffer(radius, quad_segs=8)
        for corner in np.argwhere(cells)
    ]
    return _compare(
        space, shapely.union_all([*grown, *_frame(cells, np.full(2, radius), outside)]), rng
    )


WORLDS: dict[str, Callable[[Rng], list[Outcome]]] = {
    "plane": draw_plane,
    "columns in space": draw_columns,
    "plane with rotations": draw_yaws,
}
"""Functions that draw a world and compare a few pairs of points, by kind of world."""


def _draw_blocks(rng: Rng) -> tuple[Bools, Floats, int, str]:
    """Draw blocks of side 1, half the sides of a rectangle, grid cells along a block, and the state
    outside."""
    cells = rng.random(rng.integers(3, 8, 2)) < rng.uniform(0.1, 0.4)
    return (
        cells,
        rng.uniform(0.05, 0.6, 2),
        int(rng.integers(4, 10)),
        str(rng.choice(["blocked", "free"])),
    )


def _grow_boxes(cells: Bools, half: Floats, outside: str) -> shapely.Geometry:
    """Return the reference points at which a rectangle meets a block."""
    grown = [shapely.box(*(corner - half), *(corner + 1.0 + half)) for corner in np.argwhere(cells)]
    return shapely.union_all([*grown, *_frame(cells, half, outside)])


def _frame(cells: Bools, half: Floats, outside: str) -> list[shapely.Geometry]:
    """Return the reference points at which a rectangle reaches out of the workspace, unless it may."""
    if outside == "free":
        return []
    return [
        shapely.box(-9, -9, 99, 99)
        - shapely.box(*half, *np.maximum(np.array(cells.shape) - half, half))
    ]


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
