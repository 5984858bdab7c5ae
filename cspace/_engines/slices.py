"""Slices of a map: robot rasters correlated with the cells of the workspace.

A raster has the cells that the robot covers at one rotation; a slice of the map belongs to it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cspace._engines import ENGINES, choose_engine, put_layers_first
from cspace._grid import check_reach
from cspace._raster import MAX_RASTER_CELLS, Raster
from cspace._robot import Robot
from cspace._rotations import NO_ROTATION, RotationCell, Rotations
from cspace._shapes.layers import Heights, LayeredShape
from cspace._support.arrays import Bools, States
from cspace._support.limits import RASTER_CELL_BYTES, SLICE_BYTES, map_bytes
from cspace._support.threads import count_cores, map_in_threads
from cspace._support.words import Method

RasterPair = tuple[Raster, Raster]
"""Outer and inner raster of a robot at one rotation."""

MAX_KEPT_CELLS: Final = 2**22
"""Number of cells up to which the last rasters of a robot are kept for its next map."""

_last_rasters: Final = WeakKeyDictionary[Robot, tuple[object, list[RasterPair]]]()


def slice_rasters(
    robot: Robot,
    spacing: float,
    margin: float,
    rotations: Rotations,
    heights: Heights | None = None,
) -> list[RasterPair]:
    """Rasterize the robot for each slice, or return the rasters of its last map if they fit.

    Returns the outer and inner raster of each slice; ``spacing`` and ``margin`` are in metres.
    With ``heights``, the robot drives on a floor, and offsets are (x, y, layer of the scene).
    """
    asked = spacing, margin, rotations, heights
    known, rasters = _last_rasters.get(robot, (None, []))
    if known != asked:
        rasters = _make_rasters(robot, *asked)
        if sum(outer.cells.size for outer, _ in rasters) <= MAX_KEPT_CELLS:
            _last_rasters[robot] = asked, rasters
    return list(rasters)


def _make_rasters(
    robot: Robot, spacing: float, margin: float, rotations: Rotations, heights: Heights | None
) -> list[RasterPair]:
    """Rasterize the robot for each slice.

    Rasters are made from the rotated geometry, unless a slice is the image of an earlier slice by
    quarter turns or mirrors. Then the raster is an image too.
    """
    if heights is not None:
        robot = Robot(robot.name, LayeredShape(robot.shape, heights, spacing))
    slice_cells = list_slice_cells(robot, rotations)
    if len(slice_cells) == 1:
        return [rasterize(robot, spacing, margin, slice_cells[0])]
    slice_of = rotations._assign_slices(robot.shape)
    _, first_cells = np.unique(slice_of, return_index=True)
    # The source of a slice is the smallest of its images; the transposed matrix maps it back.
    images = rotations._find_images(robot.shape)
    image_slices = np.array([slice_of[image_cells[first_cells]] for _, image_cells in images])
    sources = image_slices.min(axis=0).tolist()
    image_of_source = image_slices.argmin(axis=0).tolist()
    # Rasterize the slices that are their own source.
    originals = [number for number, source in enumerate(sources) if source == number]
    sides = np.ptp(robot.shape.outer.bounds, axis=0) / spacing
    cells = float(np.prod(sides + 1.0))
    # Cells of the robot's bounding box, summed over all slices, below which one thread is faster.
    threads = count_cores() if len(originals) * cells > 50_000 else 1
    original_rasters = map_in_threads(
        lambda number: rasterize(robot, spacing, margin, slice_cells[number]),
        originals,
        threads,
    )
    rasters = dict(zip(originals, original_rasters, strict=True))
    for number, source in enumerate(sources):
        if number not in rasters:
            outer, inner = rasters[source]
            matrix, _ = images[image_of_source[number]]
            rasters[number] = outer.rotate(matrix.T), inner.rotate(matrix.T)
    return [rasters[number] for number in range(len(sources))]


def rasterize(robot: Robot, spacing: float, margin: float, rotation: RotationCell) -> RasterPair:
    """Rasterize the robot at one rotation cell.

    Returns the outer and inner raster, as ``Shape.rasters`` does; metres.

    Raises InputError if the robot is too large or too far from its reference point for the spacing.
    """
    span = robot.shape.span
    if rotation.matrix is not None:
        # A rotation may move a corner of the robot's box, which is farther from the origin than a
        # side, onto an axis.
        span *= math.sqrt(robot.dim)
    check_reach((span + margin) / spacing, "robot", "its reference point")
    return robot.shape.rasters(spacing, margin, rotation)


def list_slice_cells(robot: Robot, rotations: Rotations) -> list[RotationCell]:
    """Return the rotation cell of each slice, as shapes take it."""
    if rotations._preserves(robot.shape):
        return [NO_ROTATION]
    cells = rotations._make_shape_cells(robot.dim)
    _, first_cells = np.unique(rotations._assign_slices(robot.shape), return_index=True)
    return [cells[number] for number in first_cells]


def estimate_bytes(
    shape: Sequence[int],
    spacing: float,
    robot: Robot,
    rotations: Rotations,
    margin: float,
    slices: int,
    counts: bool = False,
) -> float:
    """Estimate the memory to build a map on a grid of a shape, in bytes."""
    rasters = estimate_raster_bytes(robot, spacing, margin, rotations, slices)
    return map_bytes(shape, slices, counts) + rasters


def estimate_raster_bytes(
    robot: Robot,
    spacing: float,
    margin: float,
    rotations: Rotations,
    slices: int,
) -> float:
    """Estimate the memory for the rasters of all slices, in bytes.

    The estimate uses the robot's bounds at some rotations; ``slices`` is the number of slices.
    """
    # Approximate number of rotations at which the size of the robot's rasters is estimated.
    stride = max(1, len(rotations) // 32)
    matrices = rotations.make_matrices(rotations.centers[::stride], robot.dim)
    low, high = robot.shape.outer.bounds
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    rotated_corners = corners @ matrices.swapaxes(1, 2)
    sides = np.ptp(rotated_corners, axis=1) + 2.0 * margin
    # A larger raster is refused as such.
    cells = min(float(np.prod(sides / spacing + 2.0, axis=1).mean()), MAX_RASTER_CELLS)
    raster_bytes_of_slice = 2.0 * cells * RASTER_CELL_BYTES[robot.dim]  # outer and inner
    return slices * (SLICE_BYTES + raster_bytes_of_slice)


Progress = Callable[[int, int], None]
"""Function that is called with the finished steps and all steps."""

RasterGroups = Sequence[Sequence[Raster]]
"""Outer rasters of all slices and, if BLOCKED is to be proven, inner rasters of all slices."""


def group_rasters(pairs: Sequence[RasterPair], inner: bool) -> RasterGroups:
    """Separate pairs of rasters into outer and inner rasters.

    Inner rasters are left out unless ``inner`` is True.
    """
    outer_rasters, inner_rasters = map(list, zip(*pairs, strict=True))
    return [outer_rasters, inner_rasters] if inner else [outer_rasters]


def fill_states(
    method: Method,
    outside: str,
    cells: tuple[Bools, Bools],
    groups: RasterGroups,
    states: States,
    overlaps: NDArray[np.int32] | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
) -> None:
    """Correlate the cells of a workspace with the rasters of all slices.

    Parameters
    ----------
    method : {"auto", "fft", "direct"}
        The engine, or "auto" for the faster one.
    outside : str
        State of space outside the cells: "blocked" or "free".
    cells : tuple of ndarray of bool
        Cells that touch an obstacle, and cells inside one.
    groups : sequence of sequence of Raster
    states : ndarray of uint8, shape (slices, ...)
        Receives the states. Slices smaller than the workspace get its first cells. Slices of a
        robot on a floor are plane, and the cells and rasters are in space.
    overlaps : ndarray of int32, the shape of states, optional
        Receives the overlap counts.
    workers : int, optional
        Threads.
    progress : callable, optional
    """
    if states.ndim == cells[0].ndim:
        # On a floor, states are those of one layer.
        outer, inner = cells
        layers = put_layers_first(outer)
        cells = layers, layers if inner is outer else put_layers_first(inner)
        groups = [[raster.layers_first for raster in rasters] for rasters in groups]
        states = states[:, np.newaxis]
        overlaps = None if overlaps is None else overlaps[:, np.newaxis]
    if method == "auto":
        method = choose_engine(groups[0], counts=overlaps is not None)
    # The outer rasters write 0 or 1 (FREE or MIXED); the inner rasters add 1 where they hit.
    hits = states.view(np.bool_)
    outer_output = hits if overlaps is None else overlaps
    outputs = [outer_output, states]
    for index, rasters in enumerate(groups):
        advance = progress and partial(_report_progress, progress, index, len(groups))
        ENGINES[method].write_overlaps(
            cells[index],
            rasters,
            list(outputs[index]),
            outside=outside == "blocked",
            add=index == 1,
            workers=workers,
            progress=advance,
        )
        if advance is not None:
            advance(1, 1)  # even if there was nothing to do
        if overlaps is not None and index == 0:
            np.not_equal(overlaps, 0, out=hits)


def _report_progress(progress: Progress, index: int, count: int, done: int, total: int) -> None:
    """Report the progress of one of ``count`` correlations as that of all."""
    # Number of progress steps of one correlation.
    steps_per_correlation = 1000
    steps_before = steps_per_correlation * index
    steps = steps_per_correlation * done // total
    progress(steps_before + steps, steps_per_correlation * count)
