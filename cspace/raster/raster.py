"""Raster: a set of lattice offsets, the discrete robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.memory import free_bytes

MAX_CELLS = 2**28

SMALL = 2**22
"""Cells up to which a robot is rasterised without a look at the memory."""

BYTES = 6
"""Memory for each cell of a robot while it is rasterised: several bitmaps."""


@dataclass(frozen=True, slots=True)
class Raster:
    """A finite set of offsets ``m`` in Z^d, held as a bitmap trimmed to its bounding box.

    Attributes
    ----------
    cells : ndarray of bool
        ``cells[i]`` tells whether the offset ``lower + i`` belongs to the set; of shape (0, ...) for the empty set.
    lower : tuple of int
        Offset of ``cells[0, ...]``.
    """

    cells: NDArray[np.bool_]
    lower: tuple[int, ...]

    @classmethod
    def trimmed(cls, cells: NDArray[np.bool_], lower: tuple[int, ...]) -> Raster:
        """The set of the True entries of ``cells``, whose first entry is the offset ``lower``."""
        window = []
        for axis in range(cells.ndim):
            used = np.flatnonzero(cells.any(axis=tuple(a for a in range(cells.ndim) if a != axis)))
            if not len(used):
                return cls(np.zeros((0,) * cells.ndim, dtype=np.bool_), (0,) * cells.ndim)
            window.append(slice(int(used[0]), int(used[-1]) + 1))
        tight = np.ascontiguousarray(cells[tuple(window)])
        tight.setflags(write=False)
        return cls(tight, tuple(low + part.start for low, part in zip(lower, window, strict=True)))

    def quarter_turned(self, turns: int) -> Raster:
        """The set turned by quarter turns about the z axis, ``(x, y)`` to ``(-y, x)`` each: an exact permutation."""
        cells, lower, upper = self.cells, self.lower, self.upper
        for _ in range(turns % 4):
            # Entry [x, y] of the turned bitmap is entry [y, -x] of the bitmap.
            cells = cells.swapaxes(0, 1)[::-1]
            lower, upper = (-upper[1], lower[0], *lower[2:]), (-lower[1], upper[0], *upper[2:])
        return Raster(np.ascontiguousarray(cells), lower if self.cells.size else self.lower)

    @property
    def upper(self) -> tuple[int, ...]:
        """The largest offset along each axis, inclusive."""
        return tuple(low + n - 1 for low, n in zip(self.lower, self.cells.shape, strict=True))

    @property
    def count(self) -> int:
        """Number of offsets in the set."""
        return int(np.count_nonzero(self.cells))


def blank(low: NDArray[np.float64], high: NDArray[np.float64]) -> tuple[NDArray[np.bool_], tuple[int, ...]]:
    """An empty bitmap over the lattice points of a box, with two cells to spare, and the offset of its first entry.

    Raises
    ------
    InputError
        If the box holds more cells than a raster may.
    """
    first = np.floor(low) - 2
    shape = np.ceil(high) + 3 - first
    cells, most = float(np.prod(shape)), MAX_CELLS
    if cells > SMALL:
        most = min(MAX_CELLS, (free_bytes() or BYTES * MAX_CELLS) // BYTES)
    if cells > most:
        across = " x ".join(f"{n:.0f}" for n in shape)
        raise InputError(
            "robot",
            f"is {across} cells large at this spacing",
            f"at most {most} cells are rasterised, with the memory that is free",
            "use a larger spacing, or check the robot's units (metres)",
        )
    return np.zeros(tuple(shape.astype(int)), dtype=np.bool_), tuple(int(n) for n in first)
