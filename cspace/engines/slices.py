"""Slices of a map: robot rasters correlated with the cells of the workspace.

A raster has the cells that the robot covers at one rotation; a slice of the map belongs to it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.engines import ENGINES, Engine, choose_engine
from cspace.limits import RASTER_CELL_BYTES, SLICE_BYTES
from cspace.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.support.arrays import Bools
from cspace.support.threads import cores, in_threads
from cspace.support.words import Method

SAMPLED_ROTATIONS = 32
"""Approximate number of rotations at which the size of the robot's rasters is estimated."""

MIN_CELLS_FOR_THREADS = 50_000
"""Cells of the robot's bounding box, summed over all slices, below which one thread is faster."""

RasterPair = tuple[Raster, Raster]
"""Outer and inner raster of a robot at one rotation."""


def slice_rasters(
    robot: Robot,
    spacing: float,
    margin: float,
    rotations: Rotations,
) -> list[RasterPair]:
    """Rasterize the robot for each slice.

    Returns outer and inner raster; ``spacing`` and ``margin`` are in metres. Rasters are made from
    the rotated geometry, unless a slice is the image of an earlier slice by quarter turns or
    mirrors. Then the raster is an image too.
    """
    if rotations.preserve(robot.shape):
        return [robot.rasters(spacing, margin)]
    rotation_cells = rotations.make_shape_cells(robot.dim)
    slice_of = rotations.assign_slices(robot.shape)
    first_cells = np.unique(slice_of, return_index=True)[1]
    # Each slice comes from the smallest of its images; the transposed matrix maps it back.
    images = rotations.find_images(robot.shape)
    image_slices = np.array([slice_of[image_cells[first_cells]] for _, image_cells in images])
    sources = image_slices.min(axis=0).tolist()
    matrices = [images[image][0].T for image in image_slices.argmin(axis=0).tolist()]
    originals = [number for number, source in enumerate(sources) if source == number]
    cells = float(np.prod(np.ptp(robot.shape.outer.bounds, axis=0) / spacing + 1.0))
    threads = cores() if len(originals) * cells > MIN_CELLS_FOR_THREADS else 1
    made = in_threads(
        lambda number: robot.rasters(spacing, margin, rotation_cells[first_cells[number]]),
        originals,
        threads,
    )
    rasters = dict(zip(originals, made, strict=True))
    for number, (source, matrix) in enumerate(zip(sources, matrices, strict=True)):
        if number not in rasters:
            outer, inner = rasters[source]
            rasters[number] = outer.rotate(matrix), inner.rotate(matrix)
    return [rasters[number] for number in range(len(sources))]


def raster_bytes(
    robot: Robot,
    spacing: float,
    margin: float,
    rotations: Rotations,
    slices: int,
) -> float:
    """Estimate the memory for the rasters of all slices.

    The estimate uses the robot's bounds at some rotations; ``slices`` is the number of slices.
    """
    if slices == 1:
        return 0.0
    centers = rotations.centers[:: max(1, len(rotations) // SAMPLED_ROTATIONS)]
    matrices = rotations.make_matrices(centers, robot.dim)
    corners = np.array(list(itertools.product(*zip(*robot.shape.outer.bounds, strict=True))))
    sides = np.ptp(corners @ matrices.swapaxes(1, 2), axis=1) + 2.0 * margin
    cells = float(np.prod(sides / spacing + 2.0, axis=1).mean())
    # A slice has an outer and an inner raster.
    return slices * (SLICE_BYTES + RASTER_CELL_BYTES[robot.dim] * 2.0 * cells)


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
    ) -> None:
        """Fill all slices.

        ``outer`` has the cells that touch an obstacle, ``inner`` the cells inside one. ``state``,
        shape (slices, ...), receives the states, and ``overlaps``, if any, the overlap counts.
        Slices smaller than the workspace get its first cells.
        """
        collides = state.view(np.bool_)
        counts = collides if overlaps is None else overlaps
        self._collide(outer, groups[0], list(counts), share=(0, len(groups)))
        if overlaps is not None:
            np.not_equal(overlaps, 0, out=collides)
        if len(groups) > 1:
            self._collide(inner, groups[1], list(state), share=(1, 2), add=True)

    def _collide(
        self,
        occupied: Bools,
        rasters: Sequence[Raster],
        out: Sequence[NDArray[Any]],
        share: tuple[int, int],
        add: bool = False,
    ) -> None:
        """Run one correlation.

        ``share`` is its index and the number of correlations, for the progress.
        """
        index, count = share

        def advance(done: int, total: int) -> None:
            if self.progress is not None:
                step = STEPS_PER_CORRELATION * done // total
                self.progress(
                    STEPS_PER_CORRELATION * index + step,
                    STEPS_PER_CORRELATION * count,
                )

        self.engine.collide(
            occupied,
            rasters,
            out,
            outside=self.outside == "blocked",
            add=add,
            workers=self.workers,
            progress=advance,
        )
        advance(1, 1)  # even if there was nothing to do
