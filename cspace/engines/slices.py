"""Slices of a map: robot rasters correlated with the cells of the workspace.

A raster has the cells that the robot covers at one rotation; a slice of the map belongs to it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats
from cspace.engines import ENGINES, Engine, choose_engine
from cspace.limits import RASTER_CELL_BYTES, SLICE_BYTES
from cspace.raster import Raster
from cspace.robot import Robot
from cspace.rotations import RotationCell, Rotations
from cspace.threads import cores, in_threads
from cspace.words import Method

SAMPLED_ROTATIONS = 32
"""Approximate number of rotations at which the size of the robot's rasters is estimated."""

MIN_CELLS_FOR_THREADS = 50_000
"""Cells of the robot's bounding box, summed over all slices, below which threads cost more time than they save."""

RasterPair = tuple[Raster, Raster]
"""Outer and inner raster of a robot at one rotation."""

RasterTask = Callable[[], list[tuple[int, RasterPair]]]
"""Function that rasterizes the robot for some slices; it returns their indices and rasters."""


def slice_rasters(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[RasterPair]:
    """Rasterize the robot for each slice.

    Returns outer and inner raster; ``spacing`` and ``margin`` are in metres.
    """
    tasks = raster_tasks(robot, spacing, margin, rotations)
    cells = float(np.prod(np.ptp(robot.shape.outer.bounds, axis=0) / spacing + 1.0))
    threads = cores() if len(tasks) * cells > MIN_CELLS_FOR_THREADS else 1
    rasters = dict(itertools.chain.from_iterable(in_threads(lambda task: task(), tasks, threads)))
    return [rasters[number] for number in range(len(rasters))]


def raster_bytes(robot: Robot, spacing: float, margin: float, rotations: Rotations, slices: int) -> float:
    """Estimate the memory for the rasters of all slices.

    The estimate uses the robot's bounds at some rotations; ``slices`` is the number of slices.
    """
    if slices == 1:
        return 0.0
    centers = rotations.centers[:: max(1, len(rotations) // SAMPLED_ROTATIONS)]
    matrices = rotations._rotation_matrices(np.hstack([np.zeros((len(centers), robot.dim)), centers]))
    sides = np.ptp(_box_corners(robot) @ matrices.swapaxes(1, 2), axis=1) + 2.0 * margin
    cells = 2.0 * float(np.prod(sides / spacing + 2.0, axis=1).mean())  # outer and inner raster
    return slices * (SLICE_BYTES + RASTER_CELL_BYTES[robot.dim] * cells)


def narrower_rotations(robot: Robot, rotations: Rotations, distance: float) -> Iterator[tuple[str, Rotations]]:
    """Yield ever more rotation cells, with their argument for messages.

    In the last ones, the first for which that is true, no corner of the robot's bounding box moves
    by more than ``distance``, metres.
    """
    if rotations._preserve(robot.shape):
        return
    corners = _box_corners(robot)
    while True:
        widest = RotationCell(None, float(rotations.covering_angles.max()), rotations._about_z)
        narrower = rotations._doubled()
        if narrower is None or float(widest.displacement(corners).max()) <= distance:
            return
        _, rotations = narrower
        yield narrower


def _box_corners(robot: Robot) -> Floats:
    """Return the corners of the robot's bounding box, shape (2^d, d)."""
    return np.array(list(itertools.product(*zip(*robot.shape.outer.bounds, strict=True))))


def raster_tasks(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[RasterTask]:
    """Return tasks that together rasterize the robot for all slices.

    Rasters are made from the rotated geometry, unless a slice is the image of another slice by quarter turns or
    mirrors. Then the raster is an image too, made in the same task as that slice.
    """
    if rotations._preserve(robot.shape):
        return [lambda: [(0, robot.rasters(spacing, margin))]]
    slice_of = rotations._slices_for(robot.shape)
    first_cells, cells = np.unique(slice_of, return_index=True)[1], rotations._shape_cells(robot.dim)
    # Each slice comes from the smallest of its images; the transposed matrix maps it back.
    images = rotations._images(robot.shape)
    image_slices = np.array([slice_of[image_cells[first_cells]] for _, image_cells in images])
    image_indices, sources, slices = image_slices.argmin(axis=0), image_slices.min(axis=0), np.arange(len(first_cells))
    images_of: dict[int, list[int]] = {}
    for index in np.flatnonzero(sources < slices).tolist():
        images_of.setdefault(int(sources[index]), []).append(index)

    def rasterise(index: int) -> list[tuple[int, RasterPair]]:
        rasters = [(index, robot.rasters(spacing, margin, cells[first_cells[index]]))]
        for index_known, (outer, inner) in rasters:  # grows during the loop
            for image in images_of.get(index_known, ()):
                matrix = images[image_indices[image]][0].T
                rasters.append((image, (outer.rotate(matrix), inner.rotate(matrix))))
        return rasters

    return [partial(rasterise, index) for index in np.flatnonzero(sources == slices).tolist()]


Progress = Callable[[int, int], None]
"""Function that is called with the finished steps and all steps."""

RasterGroups = Sequence[Sequence[Raster]]
"""Outer rasters of all slices and, if BLOCKED is to be proven, inner rasters of all slices."""

STEPS_PER_CORRELATION: Final = 1000
"""Number of progress steps of one correlation."""


def group_rasters(pairs: Sequence[RasterPair], inner: bool) -> RasterGroups:
    """Split pairs of rasters into outer and inner rasters.

    Inner rasters are left out unless ``inner`` is True.
    """
    return [list(group) for group in zip(*pairs, strict=True)][: 2 if inner else 1]


@dataclass(frozen=True, slots=True)
class Correlation:
    """Settings and engine of the correlations of one build.

    Attributes
    ----------
    engine : Engine
    outside : str
        State outside the cells passed to :meth:`fill`: "blocked" or "free".
    workers : int or None
        Threads.
    progress : callable or None
    """

    engine: Engine
    outside: str
    workers: int | None
    progress: Progress | None = None

    @classmethod
    def create(
        cls,
        method: Method,
        groups: RasterGroups,
        outside: str,
        workers: int | None,
        progress: Progress | None = None,
        counts: bool = False,
    ) -> Correlation:
        """Create the settings of a build.

        ``method`` is the name of an engine, or "auto" for the faster engine.
        """
        engine = ENGINES[choose_engine(groups[0], counts=counts) if method == "auto" else method]
        return cls(engine, outside, workers, progress)

    def fill(
        self,
        outer: Bools,
        inner: Bools,
        groups: RasterGroups,
        state: NDArray[np.uint8],
        overlaps: NDArray[np.int32] | None,
    ) -> str:
        """Fill all slices; return the arithmetic used.

        ``outer`` has the cells that touch an obstacle, ``inner`` the cells inside one; they are the same array if
        equal. ``state``, shape (slices, ...), receives the states, and ``overlaps``, if any, the overlap counts. Slices
        smaller than the workspace get its first cells.
        """
        outers, inners = groups[0], [raster for group in groups[1:] for raster in group]
        collides = state.view(np.bool_)
        if inners and overlaps is None and len(outers) == 1 and inner is outer:
            # One slice and one workspace bitmap: correlate both rasters in one pass over the bitmap.
            inside = np.empty(state[0].shape, dtype=np.bool_)
            precision = self._collide(outer, [*outers, *inners], [collides[0], inside], (0, 1))
            state[0] += inside
            return precision
        counts = collides if overlaps is None else overlaps
        precision = self._collide(outer, outers, list(counts), (0, len(groups)))
        if overlaps is not None:
            np.not_equal(overlaps, 0, out=collides)
        if inners:
            added = self._collide(inner, inners, list(state), (1, 2), add=True)
            precision = max(precision, added)
        return precision

    def _collide(
        self,
        occupied: Bools,
        rasters: Sequence[Raster],
        out: Sequence[NDArray[Any]],
        part: tuple[int, int],
        add: bool = False,
    ) -> str:
        """Run one correlation, reporting its progress.

        ``part``, (index, count), is its share of the progress. Returns the arithmetic used.
        """
        (index, count), progress = part, self.progress

        def advance(done: int, total: int) -> None:
            if progress is not None:
                step = STEPS_PER_CORRELATION * index + STEPS_PER_CORRELATION * done // total
                progress(step, STEPS_PER_CORRELATION * count)

        precision = self.engine.collide(
            occupied, rasters, out, outside=self.outside == "blocked", add=add, workers=self.workers, progress=advance
        )
        advance(1, 1)  # even if there was nothing to do
        return precision
