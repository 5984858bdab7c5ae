"""Outlines, faces and boxes of sets of cells, and images rotated onto an axis-aligned grid.

Sets of cells are boolean arrays; ``spacing`` is the side of a cell and ``lower``, shape (d,), the
lower corner of the first cell, in metres. Cells outside the array are not in the set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.grid import SLACK, Grid
from cspace.limits import check_cells
from cspace.raster.segments import outline_cells
from cspace.support.arrays import Bools, Floats, Ints

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from cspace.files.ros import MapInfo


def ring_segments(polygon: Polygon) -> Floats:
    """Return the segments of all rings of a polygon.

    Each is ``(x0, y0, x1, y1)``; shape (E, 4).
    """
    rings = [polygon.exterior, *polygon.interiors]
    return np.concatenate([point_segments(np.asarray(ring.coords)[:, :2]) for ring in rings])


def point_segments(points: Floats) -> Floats:
    """Return the segments between consecutive points, shape (n - 1, 4).

    A single point gives one segment of length zero.
    """
    if len(points) == 1:
        points = np.repeat(points, 2, axis=0)
    return np.hstack([points[:-1], points[1:]])


def boundary_segments(occupied: Bools, spacing: float, lower: ArrayLike) -> Floats:
    """Return the boundary segments of a set of plane cells.

    Returns ``(x0, y0, x1, y1)``, shape (E, 4), metres. Collinear unit edges are merged, so that the
    count grows with the corners of the outline and not with its length. Each piece of the outline
    is in exactly one segment, as even-odd parity requires; if two cells touch only in a corner,
    both segments pass through it. All coordinates are ``lower + spacing * index``, so segments that
    meet share the corner to the last bit. The occupied cells lie on the left of each segment.
    Vertical segments come first, then horizontal ones.
    """
    cells = occupied.view(np.uint8) != 0  # a boolean array may contain bytes other than 0 and 1
    x, start, stop, step = _find_edge_runs(cells.view(np.int8))
    # For the cells to lie on the left, a vertical segment runs down where occupied cells start and
    # up where they stop.
    begin, end = np.where(step > 0, (stop, start), (start, stop))
    upright = np.column_stack((x, begin, x, end))
    y, start, stop, step = _find_edge_runs(cells.T.view(np.int8))
    begin, end = np.where(step > 0, (start, stop), (stop, start))
    level = np.column_stack((begin, y, end, y))
    return np.asarray(np.tile(lower, 2) + spacing * np.concatenate((upright, level)))


def _find_edge_runs(cells: NDArray[np.int8]) -> tuple[NDArray[Any], ...]:
    """Find runs of equal steps across lattice lines.

    The lattice lines divide the first axis. Returns line, start, stop (both along the line) and
    step of each run.
    """
    lines = len(cells) + 1
    length = cells.shape[1]
    steps = np.zeros((lines, length + 2), dtype=np.int8)
    steps[:-1, 1:-1] = cells
    steps[1:, 1:-1] -= cells
    changes = steps[:, 1:] != steps[:, :-1]
    line, start = np.nonzero(changes & (steps[:, 1:] != 0))
    # Starts and stops pair up because both lists are in reading order and each run stops before
    # its line's padding.
    stop = np.nonzero(changes & (steps[:, :-1] != 0))[1]
    return line, start, stop, steps[line, start + 1]


def boundary_triangles(cells: Bools, spacing: float, lower: Any) -> Floats:
    """Triangulate the boundary of a union of closed cells.

    Returns shape (n, 3, 3). Coplanar faces are merged into rectangles, so neighbours may share only
    part of an edge.
    """
    triangles = [np.empty((0, 3, 3))]
    for axis in range(3):
        columns = np.moveaxis(cells, axis, 0)
        faces = np.zeros((columns.shape[0] + 1, *columns.shape[1:]), dtype=np.bool_)
        faces[:-1] = columns
        faces[1:] ^= columns
        triangles.append(rectangle_triangles(faces, axis, spacing, lower))
    return np.concatenate(triangles)


def rectangle_triangles(squares: Bools, axis: int, spacing: float, lower: Any) -> Floats:
    """Triangulate lattice squares across an axis.

    ``squares[k, i, j]`` lies in the lattice plane k. Returns shape (n, 3, 3).
    """
    low, high = merge_into_rectangles(squares)
    first = np.column_stack([low[:, 0], high[:, 1], low[:, 2]])
    second = np.column_stack([low[:, :2], high[:, 2]])
    corners = np.stack([low, first, high, second], axis=1)
    order = np.argsort([axis, *(other for other in range(3) if other != axis)])
    points = np.asarray(lower, dtype=np.float64) + spacing * corners[..., order]
    return np.asarray(points[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3, 3))


def boundary_mesh(cells: Bools, spacing: float, lower: Any) -> tuple[Floats, Ints, Ints]:
    """Triangulate the boundary of closed cells without T-junctions.

    Returns
    -------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
    windings : ndarray of int64, shape (F,)
        1 if the face points outward, -1 otherwise.
    """
    corners = tuple(n + 1 for n in cells.shape)
    quads = []
    windings = []
    for axis in range(3):
        first, second = (int(np.prod(corners[other + 1 :])) for other in range(3) if other != axis)
        gap = np.int8(0)
        steps = np.asarray(np.diff(cells.view(np.int8), axis=axis, prepend=gap, append=gap))
        squares_at = np.nonzero(steps)
        start = np.ravel_multi_index(squares_at, corners)
        quads.append(start[:, None] + np.array([0, first, first + second, second]))
        windings.append(np.repeat((1 if axis == 1 else -1) * steps[squares_at], 2))
    points, numbers = np.unique(np.concatenate(quads), return_inverse=True)
    faces = numbers.reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    indices = np.stack(np.unravel_index(points, corners), axis=1)
    vertices = np.asarray(lower, dtype=np.float64) + spacing * indices
    return vertices, faces, np.concatenate(windings).astype(np.int64)


def cover_with_boxes(cells: Bools, spacing: float, lower: Any) -> tuple[Floats, Floats]:
    """Partition a union of closed cells into boxes.

    Runs are merged along two axes. Returns the lower and upper corners, shape (n, d) each, metres.
    """
    corner = np.asarray(lower, dtype=np.float64)
    low, high = merge_into_rectangles(cells.reshape((-1, *cells.shape[-2:])))
    high[:, 0] += 1
    first = 3 - cells.ndim
    return corner + spacing * low[:, first:], corner + spacing * high[:, first:]


def merge_into_rectangles(squares: Bools) -> tuple[Ints, Ints]:
    """Cover the set entries of each layer with disjoint rectangles.

    Equal runs in consecutive rows are merged. Returns the lower and upper lattice corners ``(layer,
    row, column)``, shape (n, 3) each.
    """
    edges = np.zeros((*squares.shape[:2], squares.shape[2] + 1), dtype=np.bool_)
    edges[..., :-1] = squares
    edges[..., 1:] ^= squares
    layer, row, column = np.nonzero(edges)
    runs = np.stack([layer[::2], column[::2], column[1::2], row[::2]], axis=1)
    runs = runs[np.lexsort(runs.T[::-1])]
    is_new = np.ones(len(runs), dtype=np.bool_)
    is_new[1:] = (np.diff(runs, axis=0) != (0, 0, 0, 1)).any(axis=1)
    starts = np.flatnonzero(is_new)
    ends = np.append(starts[1:], len(runs))[: len(starts)] - 1
    layer, low, high, row = runs[starts].T
    stop = runs[ends, 3] + 1
    return np.stack([layer, row, low], axis=1), np.stack([layer, stop, high], axis=1)


def boxes_within_cells(
    cells: Bools,
    lows: Sequence[Floats],
    size: float,
    cell_size: float,
) -> Bools:
    """Return a mask of the boxes inside a union of closed cells.

    A box may overlap any cell whose interval, grown by ``SLACK``, contains part of the box along
    every axis; the box lies in the union if all these cells are set. So faces shared by set cells
    count as inside, and the boundary of the union does not.

    Parameters
    ----------
    cells : ndarray of bool
    lows : sequence of ndarray of float64, shape (m,)
        Lower ends of the boxes along each axis, from the lower boundary of cell 0.
    size, cell_size : float
        Sides of the boxes, zero for points, and of the cells; as ``lows`` in lattice steps.
    """
    for axis, start in enumerate(lows):
        count = cells.shape[axis]
        # ceil - 1 and floor take both cells at a shared face; SLACK also if a face is merely near.
        first = np.clip(np.ceil((start - SLACK) / cell_size) - 1.0, -1, count).astype(np.int64)
        last = np.clip(np.floor((start + size + SLACK) / cell_size), -1, count).astype(np.int64)
        within = (first >= 0) & (last < count)
        first, last = np.where(within, (first, last), 0)
        columns = np.moveaxis(cells, axis, -1)
        covered = columns[..., first] & within
        for step in range(1, int((last - first).max(initial=0)) + 1):
            covered &= columns[..., np.minimum(first + step, last)]
        cells = np.moveaxis(covered, -1, axis)
    return np.ascontiguousarray(cells)


QUARTER_TURNS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""


def align_image(
    info: MapInfo,
    free: Bools,
    occupied: Bools,
    unknown: str,
) -> tuple[Grid, Bools, Bools, Bools]:
    """Rasterise an image with a yaw onto an axis-aligned grid.

    Images rotated by a whole number of quarter turns stay exact. By any other yaw, the cells become
    squares rotated about the origin's corner; they are rasterised onto a grid of the same spacing
    that covers them. A cell is unknown if its center lies in an unknown cell or outside the image.

    Returns
    -------
    grid : Grid
    outer, inner, unknown : ndarray of bool
        Cells that meet obstacles, cells that lie in obstacles, and unknown cells.

    Raises
    ------
    InputError
        If the grid lies too far from the origin.
    FileError
        If it has more cells than are read, or than fit into memory.
    """
    unknown_cells = free | occupied
    np.logical_not(unknown_cells, out=unknown_cells)
    solid = np.logical_not(free, out=free) if unknown == "occupied" else occupied
    quarters = _count_quarter_turns(info.yaw, solid.shape)
    if quarters is None:
        return _rotate_image(info, solid, unknown_cells, exterior_solid=unknown == "occupied")
    lower, _ = _rotated_bounds(info, solid.shape, *QUARTER_TURNS[quarters])
    cells = np.rot90(solid, quarters)
    grid = Grid(lower, info.resolution, cells.shape)
    return grid, cells, cells, np.rot90(unknown_cells, quarters)


def _count_quarter_turns(yaw: float, shape: tuple[int, ...]) -> int | None:
    """Return how many quarter turns, 0 to 3, a yaw is.

    Returns None if ``yaw`` is no multiple of pi / 2 up to rounding.
    """
    # Larger multiples of pi / 2 have a rounding error above the tolerance.
    if abs(yaw) > 4.0 * math.pi:
        return None
    quarters = round(yaw / (math.pi / 2))
    error = abs(yaw - quarters * (math.pi / 2))
    return quarters % 4 if error * math.hypot(*shape) <= SLACK / 64 else None


def _place_points(info: MapInfo, points: ArrayLike, cos: float, sin: float) -> Floats:
    """Return points of the image, in cells, as points of the map, in metres."""
    rotated = np.asarray(points) @ np.array([(cos, sin), (-sin, cos)])
    return np.asarray(info.origin + info.resolution * rotated)


def _rotated_bounds(
    info: MapInfo,
    shape: tuple[int, ...],
    cos: float,
    sin: float,
) -> tuple[Floats, Floats]:
    """Return the bounding box of the rotated image, in metres."""
    nx, ny = shape
    corners = _place_points(info, [(0, 0), (nx, 0), (nx, ny), (0, ny)], cos, sin)
    return corners.min(axis=0), corners.max(axis=0)


def _rotate_image(
    info: MapInfo,
    solid: Bools,
    unknown: Bools,
    exterior_solid: bool,
) -> tuple[Grid, Bools, Bools, Bools]:
    """Rasterise an image rotated by its yaw onto an axis-aligned grid.

    ``exterior_solid`` says whether the area around the image is solid.
    """
    cos = math.cos(info.yaw)
    sin = math.sin(info.yaw)
    lower, upper = _rotated_bounds(info, solid.shape, cos, sin)
    # The grid is wider than the bounding box by more than the rounding of the corners.
    counts = np.ceil((upper - lower) / info.resolution + 2.0 * SLACK)
    center = 0.5 * (lower + upper)
    shape = tuple(int(n) for n in counts)
    check_cells(info.source, shape, memory=8.0)
    grid = Grid(center - 0.5 * info.resolution * counts, info.resolution, shape)
    # Outline the set that is bounded by the image, so that the area around it needs no outline.
    bounded = ~solid if exterior_solid else solid
    points = boundary_segments(bounded, 1.0, (0.0, 0.0)).reshape(-1, 2)
    segments = _place_points(info, points, cos, sin).reshape(-1, 4)
    outer, inner = outline_cells([(segments, True)] if len(segments) else [], grid)
    if exterior_solid:
        outer, inner = ~inner, ~outer
    return grid, outer, inner, _sample_image(info, unknown, grid)


def _sample_image(info: MapInfo, cells: Bools, grid: Grid) -> Bools:
    """Sample a mask of the rotated image at cell centers.

    Centers outside the image give True.
    """
    cos = math.cos(info.yaw)
    sin = math.sin(info.yaw)
    x, y = (grid.centers(axis) - info.origin[axis] for axis in range(2))
    sampled = np.ones(grid.shape, dtype=np.bool_)
    # Column by column, because the positions of all cells would take 32 bytes each.
    for column, along in enumerate(x):
        positions = np.stack([cos * along + sin * y, cos * y - sin * along], axis=-1)
        cell = np.floor(positions / info.resolution).astype(np.int64)
        within = ((cell >= 0) & (cell < cells.shape)).all(axis=-1)
        sampled[column, within] = cells[tuple(cell[within].T)]
    return sampled
