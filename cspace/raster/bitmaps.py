"""Outlines and faces of sets of cells, boxes with the same union, and bitmaps turned onto an upright grid.

Cells are set in a boolean array; ``spacing`` is their side and ``lower``, shape (d,), the lower corner of the first
one, metres. Whatever lies outside the array is not set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.grid import SLACK, Grid
from cspace.limits import check_cells
from cspace.raster.segments import outline_cells

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from cspace.files.ros import MapInfo


def ring_segments(polygon: Polygon) -> Floats:
    """Segments ``(x0, y0, x1, y1)`` of all rings of a polygon, shape (E, 4)."""
    rings = [polygon.exterior, *polygon.interiors]
    return np.concatenate([point_segments(np.asarray(ring.coords)[:, :2]) for ring in rings])


def point_segments(points: Floats) -> Floats:
    """Segments between consecutive points, shape (n - 1, 4); one point gives one segment of length zero."""
    if len(points) == 1:
        points = np.repeat(points, 2, axis=0)
    return np.hstack([points[:-1], points[1:]])


def boundary_segments(occupied: Bools, spacing: float, lower: ArrayLike) -> Floats:
    """Segments between the occupied cells of a plane grid and all else, ``x0, y0, x1, y1``, shape (E, 4), metres.

    Unit edges that follow one another are merged, so that the count grows with the corners of the outline and not with
    its length. Every piece of the outline is in exactly one segment, which is what even-odd parity needs; where two
    cells touch only in a corner, both pass through it. All coordinates come from ``lower + spacing * index``, so
    segments that meet share the corner to the last bit. Each has the occupied cells on its left hand; first come the
    upright segments, then the level ones.
    """
    cells = occupied.view(np.uint8) != 0  # a boolean array may hold other bytes than 0 and 1
    x, start, stop, step = _runs(cells.view(np.int8))
    # The cells lie on the left of an upright segment that runs down where occupied cells begin, and up where they end.
    upright = np.column_stack((x, np.where(step > 0, stop, start), x, np.where(step > 0, start, stop)))
    y, start, stop, step = _runs(cells.T.view(np.int8))
    level = np.column_stack((np.where(step > 0, start, stop), y, np.where(step > 0, stop, start), y))
    return np.asarray(np.tile(lower, 2) + spacing * np.concatenate((upright, level)))


def _runs(cells: NDArray[np.int8]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Runs of equal steps across the lattice lines of the first axis: line, start, stop (both along it) and step."""
    lines, length = len(cells) + 1, cells.shape[1]
    steps = np.zeros((lines, length + 2), dtype=np.int8)
    steps[:-1, 1:-1] = cells
    steps[1:, 1:-1] -= cells
    change = steps[:, 1:] != steps[:, :-1]
    line, start = np.nonzero(change & (steps[:, 1:] != 0))
    # Starts and stops pair up: both lists are in reading order, and every run ends before the padding of its line.
    stop = np.nonzero(change & (steps[:, :-1] != 0))[1]
    return line, start, stop, steps[line, start + 1]


def boundary_triangles(cells: Bools, spacing: float, lower: Any) -> Floats:
    """Triangles of the border of the union of closed cells, shape (n, 3, 3).

    Sides that lie in one plane are merged to rectangles.
    """
    triangles = [np.empty((0, 3, 3))]
    for axis in range(3):
        columns = np.moveaxis(cells, axis, 0)
        sides = np.zeros((columns.shape[0] + 1, *columns.shape[1:]), dtype=np.bool_)
        sides[:-1] = columns
        sides[1:] ^= columns
        triangles.append(rectangle_triangles(sides, axis, spacing, lower))
    return np.concatenate(triangles)


def rectangle_triangles(sides: Bools, axis: int, spacing: float, lower: Any) -> Floats:
    """Triangles of the squares ``sides[k, i, j]`` that lie in the lattice plane k across an axis, shape (n, 3, 3)."""
    low, high = merge_into_rectangles(sides)
    first, second = low.copy(), low.copy()
    first[:, 1], second[:, 2] = high[:, 1], high[:, 2]
    corners = np.stack([low, first, high, second], axis=1)
    order = np.argsort([axis, *(other for other in range(3) if other != axis)])
    points = np.asarray(lower, dtype=np.float64) + spacing * corners[..., order]
    return np.asarray(points[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3))


def boundary_mesh(cells: Bools, spacing: float, lower: Any) -> tuple[Floats, Ints, Ints]:
    """The sides of closed cells that lie on the border of their union, as triangles that share edges whole.

    Gives their corners, shape (V, 3), metres, the triangles, shape (F, 3), and for each of these 1 where it faces
    outward, and -1 elsewhere, shape (F,).
    """
    corners = tuple(n + 1 for n in cells.shape)
    quads, turns = [], []
    for axis in range(3):
        first, second = (int(np.prod(corners[other + 1 :])) for other in range(3) if other != axis)
        padded = np.pad(cells.view(np.int8), [(1, 1) if other == axis else (0, 0) for other in range(3)])
        change = np.asarray(np.diff(padded, axis=axis))
        where = np.nonzero(change)
        start = np.ravel_multi_index(where, corners)
        quads.append(start[:, None] + np.array([0, first, first + second, second]))
        turns.append(np.repeat((1 if axis == 1 else -1) * change[where], 2))
    squares = np.concatenate(quads)
    used = np.zeros(int(np.prod(corners)), dtype=np.bool_)
    used[squares] = True
    points = np.flatnonzero(used)
    faces = np.searchsorted(points, squares)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    vertices = np.asarray(lower, dtype=np.float64) + spacing * np.stack(np.unravel_index(points, corners), axis=1)
    return vertices, faces, np.concatenate(turns).astype(np.int64)


def cover_with_boxes(cells: Bools, spacing: float, lower: Any) -> tuple[Floats, Floats]:
    """Boxes whose union is that of closed cells, as few as runs along two axes leave: corners, shape (n, d), metres."""
    corner = np.asarray(lower, dtype=np.float64)
    low, high = merge_into_rectangles(cells.reshape((-1, *cells.shape[-2:])))
    high[:, 0] += 1
    first = 3 - cells.ndim
    return corner + spacing * low[:, first:], corner + spacing * high[:, first:]


def merge_into_rectangles(sides: Bools) -> tuple[Ints, Ints]:
    """Rectangles that cover the set entries of each layer: lattice corners ``(layer, row, column)``, lower and upper.

    Runs along a row, and rows with the same run that follow one another taken together.
    """
    edges = np.zeros((*sides.shape[:2], sides.shape[2] + 1), dtype=np.bool_)
    edges[..., :-1] = sides
    edges[..., 1:] ^= sides
    layer, row, place = np.nonzero(edges)
    layer, row, start, stop = layer[::2], row[::2], place[::2], place[1::2]
    order = np.lexsort((row, stop, start, layer))
    layer, row, start, stop = layer[order], row[order], start[order], stop[order]
    fresh = np.ones(len(row), dtype=np.bool_)
    fresh[1:] = (np.diff(layer) != 0) | (np.diff(start) != 0) | (np.diff(stop) != 0) | (np.diff(row) != 1)
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(row))[: len(first)] - 1
    return (
        np.stack([layer[first], row[first], start[first]], axis=1),
        np.stack([layer[first], row[last] + 1, stop[first]], axis=1),
    )


def boxes_within_cells(cells: Bools, starts: Sequence[Floats], length: float, side: float) -> Bools:
    """Which boxes of a lattice lie wholly in the union of closed cells.

    A box may lie in any cell whose interval, grown by ``SLACK``, holds part of it along every axis; it is in the union
    where all these are set. So the common borders of set cells count as within, and the border of the union does not.

    Along each axis, ``starts`` are the lower ends of the boxes, shape (m,), from the lower border of cell 0. ``length``
    and ``side`` are those of the boxes, zero for points, and of the cells; all in steps of the lattice.
    """
    for axis, start in enumerate(starts):
        count = cells.shape[axis]
        # Rounding up less one, and down, takes both neighbours of a border; SLACK, both neighbours of one that is near.
        first = np.clip(np.ceil((start - SLACK) / side) - 1.0, -1, count).astype(np.int64)
        last = np.clip(np.floor((start + length + SLACK) / side), -1, count).astype(np.int64)
        within = (first >= 0) & (last < count)
        first, last = np.where(within, first, 0), np.where(within, last, 0)
        held = np.take(cells, first, axis=axis)
        for step in range(1, int((last - first).max(initial=0)) + 1):
            held &= np.take(cells, np.minimum(first + step, last), axis=axis)
        cells = np.asarray(held & within.reshape(tuple(-1 if a == axis else 1 for a in range(cells.ndim))))
    return cells


QUARTERS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""


def align_image(info: MapInfo, free: Bools, occupied: Bools, unknown: str) -> tuple[Grid, Bools, Bools, Bools]:
    """Return the upright grid of an image, its cells that meet and that lie in obstacles, and the unknown ones.

    What is neither free nor occupied is unknown, and counts as ``unknown`` says: "occupied" or "free". ``free`` and
    ``occupied`` may be overwritten.

    An image that is turned by a whole number of quarter turns stays exact. By any other ``yaw`` its cells become
    squares turned about the origin's corner; they are rasterised onto an upright grid of the same spacing that covers
    them. A cell of it is unknown if its middle lies in an unknown cell or beyond the image.

    Raises InputError if no grid can lie there, and FileError if it has more cells than are read, or than fit into
    memory.
    """
    unsure = free | occupied
    np.logical_not(unsure, out=unsure)
    solid = np.logical_not(free, out=free) if unknown == "occupied" else occupied
    turns = _quarter_turns(info.yaw, solid.shape)
    if turns is None:
        return _turned(info, solid, unsure, solid_around=unknown == "occupied")
    lower, _ = _extent(info, solid.shape, *QUARTERS[turns])
    cells = np.rot90(solid, turns)
    return Grid(lower, info.resolution, cells.shape), cells, cells, np.rot90(unsure, turns)


def _quarter_turns(yaw: float, shape: tuple[int, ...]) -> int | None:
    """Number of quarter turns, 0 to 3, where ``yaw`` is a multiple of them up to rounding; else None."""
    if abs(yaw) > 4.0 * math.pi:  # so far out, multiples of pi / 2 are off by more than the yaw that is asked for
        return None
    turns = round(yaw / (math.pi / 2))
    error = abs(yaw - turns * (math.pi / 2))
    return turns % 4 if error * math.hypot(*shape) <= SLACK / 64 else None


def _extent(info: MapInfo, shape: tuple[int, ...], cos: float, sin: float) -> tuple[Floats, Floats]:
    """Lower and upper corner of the box around the turned map, in metres."""
    corners = np.array([(0, 0), (shape[0], 0), shape, (0, shape[1])]) @ np.array([(cos, sin), (-sin, cos)])
    return (
        np.asarray(info.origin + info.resolution * corners.min(axis=0)),
        np.asarray(info.origin + info.resolution * corners.max(axis=0)),
    )


def _turned(info: MapInfo, solid: Bools, unknown: Bools, solid_around: bool) -> tuple[Grid, Bools, Bools, Bools]:
    """The map turned by its yaw, on an upright grid; ``solid_around``: whether the ground around it is solid."""
    cos, sin = math.cos(info.yaw), math.sin(info.yaw)
    lower, upper = _extent(info, solid.shape, cos, sin)
    # The corners are rounded, so that the grid is wider than their box by more than that.
    counts = np.ceil((upper - lower) / info.resolution + 2.0 * SLACK)
    middle = 0.5 * (lower + upper)
    shape = tuple(int(n) for n in counts)
    check_cells(info.source, shape, memory=8.0)
    grid = Grid(middle - 0.5 * info.resolution * counts, info.resolution, shape)
    # The border of whichever set lies within the turned map: the ground around it then needs no border of its own.
    bounded = ~solid if solid_around else solid
    segments = boundary_segments(bounded, 1.0, (0.0, 0.0)).reshape(-1, 2)
    turned = info.origin + info.resolution * (segments @ np.array([(cos, sin), (-sin, cos)]))
    outer, inner = outline_cells([(turned.reshape(-1, 4), True)] if len(segments) else [], grid)
    if solid_around:
        outer, inner = ~inner, ~outer
    return grid, outer, inner, _sampled(info, unknown, grid)


def _sampled(info: MapInfo, cells: Bools, grid: Grid) -> Bools:
    """Cells of a grid whose middle lies in a given cell of the turned map, or beyond it."""
    cos, sin = math.cos(info.yaw), math.sin(info.yaw)
    x, y = (grid.centers(axis) - info.origin[axis] for axis in range(2))
    sampled = np.ones(grid.shape, dtype=np.bool_)
    for column, along in enumerate(x):  # a column at a time: places of all cells would take 32 bytes each
        places = np.stack([cos * along + sin * y, cos * y - sin * along], axis=-1) / info.resolution
        cell = np.floor(places).astype(np.int64)
        within = ((cell >= 0) & (cell < cells.shape)).all(axis=-1)
        sampled[column, within] = cells[tuple(cell[within].T)]
    return sampled
