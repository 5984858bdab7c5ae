"""Outlines, faces and boxes of sets of cells, and images rotated onto an axis-aligned grid.

Sets of cells are boolean arrays; ``spacing`` is the side of a cell and ``lower``, shape (d,), the
lower corner of the first cell, in metres. Cells outside the array are not in the set.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._grid import SLACK, Grid
from cspace._support.arrays import Bools, Floats, Ints, frozen
from cspace._support.limits import check_cells

if TYPE_CHECKING:
    from shapely.geometry import Polygon

    from cspace._files.ros_maps import MapInfo


_QUAD_TRIANGLES: Final = (0, 1, 2, 0, 2, 3)
"""Corners of a quadrilateral that form its two triangles."""


def ring_segments(polygon: Polygon) -> Floats:
    """Return the segments of all rings of a polygon.

    A segment is ``(x0, y0, x1, y1)``; the result has shape (E, 4).
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
    """Return boundary segments of plane cells.

    Returns ``(x0, y0, x1, y1)``, shape (E, 4), metres. Collinear unit edges are merged, so that the
    count grows with the corners of the outline and not with its length. Each piece of the outline
    is in exactly one segment, as even-odd parity requires; if two cells touch only in a corner,
    both segments pass through it. All coordinates are ``lower + spacing * index``, so segments that
    meet share the corner to the last bit. The occupied cells lie on the left of each segment.
    Vertical segments come first, then horizontal ones.
    """
    # A boolean array may contain bytes other than 0 and 1.
    cells = (occupied.view(np.uint8) != 0).view(np.int8)
    # For the cells to lie on the left, a vertical segment runs down where occupied cells start and
    # up where they stop.
    edges = _find_edge_runs(cells)
    begin = np.where(edges.step > 0, edges.stop, edges.start)
    end = np.where(edges.step > 0, edges.start, edges.stop)
    vertical = np.column_stack((edges.line, begin, edges.line, end))
    edges = _find_edge_runs(cells.T)
    begin = np.where(edges.step > 0, edges.start, edges.stop)
    end = np.where(edges.step > 0, edges.stop, edges.start)
    horizontal = np.column_stack((begin, edges.line, end, edges.line))
    indices = np.concatenate((vertical, horizontal))
    return np.asarray(np.tile(lower, 2) + spacing * indices)


class _EdgeRuns(NamedTuple):
    """Runs of cell edges on lattice lines, each array of shape (n,).

    A run covers the edges from ``start`` to ``stop`` along the line. ``step`` is 1 if the occupied
    cells lie after the line, -1 if before.
    """

    line: Ints
    start: Ints
    stop: Ints
    step: NDArray[np.int8]


def _find_edge_runs(cells: NDArray[np.int8]) -> _EdgeRuns:
    """Find runs of equal edges on lines across the first axis."""
    lines = len(cells) + 1
    length = cells.shape[1]
    # A step is the difference of the cells after and before a line, 1 or -1 at an edge. One column
    # of padding on both sides begins and ends the runs.
    steps = np.zeros((lines, length + 2), dtype=np.int8)
    steps[:-1, 1:-1] = cells
    steps[1:, 1:-1] -= cells
    # Along a line, a run starts or stops where the step changes.
    before = steps[:, :-1]
    after = steps[:, 1:]
    changes = before != after
    line, start = np.nonzero(changes & (after != 0))
    # Starts and stops pair up because both lists are in reading order and each run stops before
    # its line's padding.
    _, stop = np.nonzero(changes & (before != 0))
    return _EdgeRuns(line, start, stop, after[line, start])


def boundary_triangles(cells: Bools, spacing: float, lower: Any) -> Floats:
    """Triangulate the boundary of a union of closed cells.

    Returns shape (n, 3, 3). Coplanar faces are merged into rectangles, so neighbours may share only
    part of an edge.
    """
    triangles = []
    for axis in range(3):
        layers = np.moveaxis(cells, axis, 0)
        # A face separates two layers if exactly one of its two cells is set.
        faces = np.zeros((layers.shape[0] + 1, *layers.shape[1:]), dtype=np.bool_)
        faces[:-1] = layers
        faces[1:] ^= layers
        triangles.append(rectangle_triangles(faces, axis, spacing, lower))
    return np.concatenate(triangles)


def rectangle_triangles(squares: Bools, axis: int, spacing: float, lower: Any) -> Floats:
    """Triangulate lattice squares across an axis.

    Set entries of ``squares[k, i, j]`` are squares in the lattice plane k. Returns shape (n, 3, 3).
    """
    # Corners of rectangles are (layer, row, column).
    low, high = merge_into_rectangles(squares)
    layer, low_row, low_column = low.T
    _, high_row, high_column = high.T
    lower_right = np.column_stack([layer, high_row, low_column])
    upper_left = np.column_stack([layer, low_row, high_column])
    corners = np.stack([low, lower_right, high, upper_left], axis=1)
    # The lattice planes, rows and columns become the three axes of space.
    indices = np.insert(corners[..., 1:], axis, corners[..., 0], axis=-1)
    points = np.asarray(lower, dtype=np.float64) + spacing * indices
    return np.asarray(points[:, _QUAD_TRIANGLES].reshape(-1, 3, 3))


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
    lattice_shape = tuple(n + 1 for n in cells.shape)
    # Step between the flat indices of neighbouring lattice points, along each axis.
    strides = np.array([lattice_shape[1] * lattice_shape[2], lattice_shape[2], 1])
    quads = []
    windings = []
    for axis in range(3):
        # A square at lattice point p has the corners p, p + first, p + first + second, p + second.
        first, second = np.delete(strides, axis)
        gap = np.int8(0)
        steps = np.asarray(np.diff(cells.view(np.int8), axis=axis, prepend=gap, append=gap))
        squares = np.nonzero(steps)
        start = np.ravel_multi_index(squares, lattice_shape)
        quads.append(start[:, None] + np.array([0, first, first + second, second]))
        # The normal of these corners points along the axis (for y, against it). Where cells start,
        # outward is against the axis.
        orientation = 1 if axis == 1 else -1
        windings.append(np.repeat(orientation * steps[squares], 2))
    points, numbers = np.unique(np.concatenate(quads), return_inverse=True)
    faces = numbers.reshape(-1, 4)[:, _QUAD_TRIANGLES].reshape(-1, 3)
    indices = np.stack(np.unravel_index(points, lattice_shape), axis=1)
    vertices = np.asarray(lower, dtype=np.float64) + spacing * indices
    return vertices, faces, np.concatenate(windings).astype(np.int64)


def cover_with_boxes(cells: Bools, spacing: float, lower: Any) -> tuple[Floats, Floats]:
    """Partition a union of closed cells into boxes.

    Cells are merged along the last two axes. Returns the lower and upper corners of the boxes,
    shape (n, d) each, metres.
    """
    corner = np.asarray(lower, dtype=np.float64)
    layers = cells if cells.ndim == 3 else cells[None]
    low, high = merge_into_rectangles(layers)
    high[:, 0] += 1  # a box is one layer thick
    # In the plane, drop the layer.
    axes = slice(3 - cells.ndim, 3)
    return corner + spacing * low[:, axes], corner + spacing * high[:, axes]


def merge_into_rectangles(squares: Bools) -> tuple[Ints, Ints]:
    """Cover each layer's set entries with disjoint rectangles.

    Equal runs in consecutive rows are merged. Returns the lower and upper lattice corners ``(layer,
    row, column)``, shape (n, 3) each.
    """
    layers, rows, columns = squares.shape
    is_edge = np.zeros((layers, rows, columns + 1), dtype=np.bool_)
    is_edge[..., :-1] = squares
    is_edge[..., 1:] ^= squares
    layer, row, column = np.nonzero(is_edge)
    # Edges alternate: a run starts at each even one, and stops at the odd one after it.
    layer = layer[::2]
    row = row[::2]
    start = column[::2]
    stop = column[1::2]
    # Sort the runs so that equal ones in consecutive rows follow each other.
    order = np.lexsort((row, stop, start, layer))
    runs = np.stack([layer, start, stop, row], axis=1)[order]
    begins_rectangle = np.ones(len(runs), dtype=np.bool_)
    # A run continues a rectangle if it differs from the run before by the next row alone.
    begins_rectangle[1:] = (np.diff(runs, axis=0) != (0, 0, 0, 1)).any(axis=1)
    ends_rectangle = np.ones(len(runs), dtype=np.bool_)
    ends_rectangle[:-1] = begins_rectangle[1:]
    layer, low, high, first_row = runs[begins_rectangle].T
    stop_row = runs[ends_rectangle, 3] + 1
    return np.stack([layer, first_row, low], axis=1), np.stack([layer, stop_row, high], axis=1)


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
        # -1 and count stand for cells outside.
        first = np.clip(np.ceil((start - SLACK) / cell_size) - 1.0, -1, count).astype(np.int64)
        last = np.clip(np.floor((start + size + SLACK) / cell_size), -1, count).astype(np.int64)
        within = (first >= 0) & (last < count)
        first, last = np.where(within, (first, last), 0)
        columns = np.moveaxis(cells, axis, -1)
        is_covered = columns[..., first] & within
        most_steps = int((last - first).max(initial=0))
        for step in range(1, most_steps + 1):
            is_covered &= columns[..., np.minimum(first + step, last)]
        cells = np.moveaxis(is_covered, -1, axis)
    return np.ascontiguousarray(cells)


QUARTER_TURNS: Final = ((1, 0), (0, 1), (-1, 0), (0, -1))
"""Cosine and sine of 0 to 3 quarter turns."""


def align_image(
    info: MapInfo,
    free: Bools,
    occupied: Bools,
    unknown: str,
) -> tuple[Grid, Bools, Bools, Bools]:
    """Rasterise a turned image onto an axis-aligned grid.

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
    exterior_solid = unknown == "occupied"
    solid = np.logical_not(free, out=free) if exterior_solid else occupied
    quarters = _count_quarter_turns(info.yaw, solid.shape)
    if quarters is None:
        return _rotate_image(info, solid, unknown_cells, exterior_solid)
    lower, _ = _rotated_bounds(info, solid.shape, *QUARTER_TURNS[quarters])
    if quarters:
        solid, unknown_cells = (np.rot90(each, quarters).copy() for each in (solid, unknown_cells))
    grid = Grid(lower, info.resolution, solid.shape, frame_id=info.frame_id)
    return grid, frozen(solid), frozen(solid), frozen(unknown_cells)


def _count_quarter_turns(yaw: float, shape: tuple[int, ...]) -> int | None:
    """Express a yaw as a number of quarter turns, 0 to 3.

    Returns None if ``yaw`` is not a multiple of pi / 2 up to rounding. ``shape`` is the number of
    cells of the image along each axis.
    """
    # Beyond two turns, multiples of pi / 2 have a rounding error above the tolerance.
    if abs(yaw) > 4.0 * math.pi:
        return None
    quarters = round(yaw / (math.pi / 2))
    error = abs(yaw - quarters * (math.pi / 2))
    max_displacement = error * math.hypot(*shape)  # cells
    # A small share of the slack, so that the other roundings have the rest.
    return quarters % 4 if max_displacement <= SLACK / 64 else None


def _place_points(info: MapInfo, points: ArrayLike, cos: float, sin: float) -> Floats:
    """Convert points of the image, in cells, to metres of the map."""
    rotated = np.asarray(points) @ np.array([(cos, sin), (-sin, cos)])
    return np.asarray(info.origin + info.resolution * rotated)


def _rotated_bounds(
    info: MapInfo,
    shape: tuple[int, ...],
    cos: float,
    sin: float,
) -> tuple[Floats, Floats]:
    """Return the rotated image's bounding box, metres."""
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
    from cspace._raster.rounded_segments import outline_cells

    cos = math.cos(info.yaw)
    sin = math.sin(info.yaw)
    lower, upper = _rotated_bounds(info, solid.shape, cos, sin)
    # The grid is wider than the bounding box by more than the rounding of the corners.
    counts = np.ceil((upper - lower) / info.resolution + 2.0 * SLACK)
    center = 0.5 * (lower + upper)
    shape = tuple(int(n) for n in counts)
    check_cells(info.source, shape, memory=9.0)
    lower = center - 0.5 * info.resolution * counts
    grid = Grid(lower, info.resolution, shape, frame_id=info.frame_id)
    # Outline the set that is bounded by the image, so that the area around it needs no outline.
    bounded = ~solid if exterior_solid else solid
    points = boundary_segments(bounded, 1.0, (0.0, 0.0)).reshape(-1, 2)
    segments = _place_points(info, points, cos, sin).reshape(-1, 4)
    parts = [(segments, True)] if len(segments) else []
    outer, inner = outline_cells(parts, grid)
    if exterior_solid:
        outer, inner = ~inner, ~outer
    return grid, outer, inner, _sample_image(info, unknown, grid)


def _sample_image(info: MapInfo, cells: Bools, grid: Grid) -> Bools:
    """Sample the rotated image's mask at cell centers.

    Centers outside the image give True.
    """
    cos = math.cos(info.yaw)
    sin = math.sin(info.yaw)
    column_x = grid.centers(0) - info.origin[0]
    y = grid.centers(1) - info.origin[1]
    sampled = np.ones(grid.shape, dtype=np.bool_)
    # Column by column, because the positions of all cells would take 32 bytes each.
    for column, x in enumerate(column_x):
        positions = np.stack([cos * x + sin * y, cos * y - sin * x], axis=-1)
        image_cells = np.floor(positions / info.resolution).astype(np.int64)
        within = ((image_cells >= 0) & (image_cells < cells.shape)).all(axis=-1)
        image_x, image_y = image_cells[within].T
        sampled[column, within] = cells[image_x, image_y]
    return sampled
