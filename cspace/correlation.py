"""The engine at work: overlaps of obstacle cells with the rasters of slices, as the states of a map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools
from cspace.engines import ENGINES, Engine, choose
from cspace.engines.slices import Pair
from cspace.raster import Raster

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
