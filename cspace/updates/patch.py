"""Patch: the new occupancy of a box of workspace cells, checked."""

from __future__ import annotations

import operator
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.covering import check_cells
from cspace.errors import InputError
from cspace.grid import Grid


@dataclass(frozen=True, slots=True)
class Patch:
    """What a box of workspace cells holds from now on.

    Attributes
    ----------
    lower : tuple of int
        Its first cell.
    outer, inner : ndarray of bool
        Its cells that meet an obstacle, and those that lie in obstacles; the same object where both are the same.
    """

    lower: tuple[int, ...]
    outer: NDArray[np.bool_]
    inner: NDArray[np.bool_]

    @classmethod
    def of(cls, grid: Grid, cells: ArrayLike, lower: Any, inner: ArrayLike | None) -> Patch:
        """Check what was passed to an update of a map on a grid; the arrays are copied.

        Raises
        ------
        InputError
            If the cells or their place are not as :meth:`cspace.CSpace.update` states.
        """
        outer = _cells(cells, "cells")
        first = _first(lower, grid.dim)
        if outer.ndim != grid.dim:
            raise InputError(
                f"cells has {outer.ndim} axes on a grid of {grid.dim}; both must have as many; pass one entry for "
                "each cell of a box, indexed in the order of the coordinates"
            )
        for low, count, size in zip(first, outer.shape, grid.shape, strict=True):
            if low < 0 or low + count > size:
                raise InputError(
                    f"cells has shape {outer.shape} and lower is {first} on a grid of {grid.shape} cells; the box must "
                    "lie in the grid; cut off what lies beyond it"
                )
        if inner is None:
            return cls(first, outer, outer)
        within = _cells(inner, "inner")
        if within.shape != outer.shape:
            raise InputError(
                f"inner has shape {within.shape} and cells {outer.shape}; both must be the same; pass one entry for "
                "each cell of the box"
            )
        if (within > outer).any():
            lost = tuple(np.argwhere(within & ~outer)[0].tolist())
            raise InputError(
                f"entry {lost} is in inner and not in cells; a cell that lies in an obstacle also meets it; add it to "
                "cells"
            )
        return cls(first, outer, within)


def _cells(values: ArrayLike, name: str) -> NDArray[np.bool_]:
    """A copy in one piece, of zeros and ones, that may be written."""
    if type(values) is np.ndarray and values.dtype == np.bool_ and values.size and values.ndim in (2, 3):
        return np.not_equal(values, 0, order="C")  # a boolean array may hold other bytes than 0 and 1
    return np.array(check_cells(values, name))


def _first(lower: Any, dim: int) -> tuple[int, ...]:
    values = lower.tolist() if isinstance(lower, np.ndarray) else lower
    try:
        first = tuple(operator.index(value) for value in values) if isinstance(values, Iterable) else ()
    except TypeError:
        first = ()
    if len(first) != dim:
        raise InputError(
            f"lower is {lower!r}; it must hold {dim} whole numbers, the index of the box's first cell; from metres, "
            "ask space.grid.cell_of"
        )
    return first
