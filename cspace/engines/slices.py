"""Slices of a map: the robot's rasters for each rotation, and their correlation with the workspace's cells."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools
from cspace.engines import ENGINES, Engine, choose
from cspace.limits import RASTER_CELL_BYTES, SLICE_BYTES
from cspace.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.threads import cores, in_threads

SAMPLED_ROTATIONS = 32
"""Rotations, about, at which the size of a robot's rasters is estimated."""

CELLS_A_THREAD = 50_000
"""Cells of the robot's box, over all slices, below which a second thread costs more than it saves."""

Pair = tuple[Raster, Raster]
Rasters = Callable[[], list[tuple[int, Pair]]]
"""Makes the outer and the inner raster of some slices, with their numbers."""


def slice_rasters(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[Pair]:
    """Outer and inner raster of the robot for each slice."""
    parts = raster_parts(robot, spacing, margin, rotations)
    cells = float(np.prod(np.ptp(robot.shape.outer.bounds, axis=0) / spacing + 1.0))
    threads = cores() if len(parts) * cells > CELLS_A_THREAD else 1
    made = dict(itertools.chain.from_iterable(in_threads(lambda part: part(), parts, threads)))
    return [made[number] for number in range(len(made))]


def raster_bytes(robot: Robot, spacing: float, margin: float, rotations: Rotations, slices: int) -> float:
    """Estimate the memory for the rasters of so many slices, from the robot's bounds at some rotations, in bytes."""
    if slices == 1:
        return 0.0
    centers = rotations.centers[:: max(1, rotations.count // SAMPLED_ROTATIONS)]
    matrices = rotations.matrices(np.hstack([np.zeros((len(centers), robot.dim)), centers]))
    corners = np.array(list(itertools.product(*zip(*robot.shape.outer.bounds, strict=True))))
    sides = np.ptp(corners @ matrices.swapaxes(1, 2), axis=1) + 2.0 * margin
    cells = 2.0 * float(np.prod(sides / spacing + 2.0, axis=1).mean())  # of the outer and the inner raster
    return slices * (SLICE_BYTES + RASTER_CELL_BYTES[robot.dim] * cells)


def raster_parts(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[Rasters]:
    """What makes the rasters of the robot for all slices.

    Each is rasterised afresh from the turned geometry, but for those that are another one turned by quarters or
    mirrored, which come in the same part as that.
    """
    if rotations.preserve(robot.shape):
        return [lambda: [(0, robot.rasters(spacing, margin))]]
    slice_of = rotations.slices_for(robot.shape)
    first, turns = np.unique(slice_of, return_index=True)[1], rotations.turns(robot.dim)
    # Of the slices that each one becomes, the least, and what makes it so; the way back is the transposed matrix.
    images = rotations.images(robot.shape)
    becomes = np.array([slice_of[cells[first]] for _, cells in images])
    made_by, source, own = becomes.argmin(axis=0), becomes.min(axis=0), np.arange(len(first))
    alike: dict[int, list[int]] = {}
    for number in np.flatnonzero(source < own).tolist():
        alike.setdefault(int(source[number]), []).append(number)

    def make(number: int) -> list[tuple[int, Pair]]:
        made = [(number, robot.rasters(spacing, margin, turns[first[number]]))]
        for known, (outer, inner) in made:  # which grows meanwhile
            for other in alike.get(known, ()):
                matrix = images[made_by[other]][0].T
                made.append((other, (outer.rotate(matrix), inner.rotate(matrix))))
        return made

    return [partial(make, number) for number in np.flatnonzero(source == own).tolist()]


Progress = Callable[[int, int], None]
Sides = Sequence[Sequence[Raster]]
"""The outer rasters of slices, and, where BLOCKED is to be proven, the inner ones."""

STEP: Final = 1000
"""Steps of progress that a correlation counts for."""


def sides_of(pairs: Sequence[Pair], inner: bool) -> Sides:
    """The rasters of slices by side."""
    return [list(side) for side in zip(*pairs, strict=True)][: 2 if inner else 1]


@dataclass(frozen=True, slots=True)
class Correlation:
    """An engine at work for one build.

    Attributes
    ----------
    engine : Engine
    outside : str
        What lies outside the cells that :meth:`fill` is given: "blocked" or "free".
    workers : int or None
        Threads.
    progress : callable or None
    """

    engine: Engine
    outside: str
    workers: int | None
    progress: Progress | None = None

    @classmethod
    def by(
        cls,
        method: str,
        sides: Sides,
        outside: str,
        workers: int | None,
        progress: Progress | None = None,
        counts: bool = False,
    ) -> Correlation:
        """By the engine of a name, or, for "auto", by the one to take for these rasters."""
        engine = ENGINES[choose(sides[0], counts=counts) if method == "auto" else method]
        return cls(engine, outside, workers, progress)

    def fill(
        self,
        outer: Bools,
        inner: Bools,
        sides: Sides,
        state: NDArray[np.uint8],
        overlaps: NDArray[np.int32] | None,
    ) -> str:
        """Fill all slices from the outer and, where there are any, the inner rasters; the arithmetic that it took.

        ``outer`` and ``inner`` are the cells that meet an obstacle, and those that lie in one; the same array where
        both are the same. Slices that are smaller are of their first cells.
        """
        outers, inners = sides[0], [raster for side in sides[1:] for raster in side]
        collides = state.view(np.bool_)
        if inners and overlaps is None and len(outers) == 1 and inner is outer:
            # One slice and one workspace bitmap, which is read for both rasters together.
            lies_in = np.empty(state[0].shape, dtype=np.bool_)
            precision = self._collide(outer, [*outers, *inners], [collides[0], lies_in], (0, 1))
            state[0] += lies_in
            return precision
        counts = collides if overlaps is None else overlaps
        precision = self._collide(outer, outers, list(counts), (0, len(sides)))
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
        step: tuple[int, int],
        add: bool = False,
    ) -> str:
        """One step of so many; each counts alike for progress, however many parts it has."""
        (number, steps), progress = step, self.progress

        def advance(done: int, total: int) -> None:
            if progress is not None:
                progress(number * STEP + STEP * done // total, steps * STEP)

        precision = self.engine.collide(
            occupied, rasters, out, outside=self.outside == "blocked", add=add, workers=self.workers, progress=advance
        )
        advance(1, 1)  # also where there was nothing to do
        return precision
