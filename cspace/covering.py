"""The grid that covers obstacles, and the check of arrays of cells."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Bools, Floats, frozen
from cspace.errors import InputError
from cspace.grid import SLACK, Grid, finite, unmasked
from cspace.memory import Planned, check_memory

_SLIVER: Final = 1e-9
"""Part of a cell that the upper bound may be off by rounding; far below the slack of an outer raster, so that an
obstacle in that sliver still marks the last cell."""

_NOUGHT: Final = SLACK / 2**14
"""Part of a cell below which a bound counts as zero."""

_SMALL: Final = 1.0 - 2.0**-20
"""Part of a cell below which all obstacles together are smaller than one, whatever the rounding."""

_SMALL_WITHIN: Final = 0.25
"""The same, where the map has bounds."""


def check_bounds(bounds: ArrayLike, dim: int = 2) -> Floats:
    """The corners ``xmin, ymin, (zmin,) xmax, ymax(, zmax)`` of a map, shape (2, dim).

    Raises InputError if there are not as many numbers, or an upper one is not above its lower one.
    """
    box = finite(bounds, "bounds")
    names = [f"{axis}{end}" for end in ("min", "max") for axis in "xyz"[:dim]]
    if box.shape != (2 * dim,):
        raise InputError(
            "bounds",
            f"is {bounds!r}",
            f"it must hold {('four', 'six')[dim - 2]} numbers",
            f"pass ({', '.join(names)}) in metres",
        )
    if (box[dim:] <= box[:dim]).any():
        raise InputError(
            "bounds",
            f"is {tuple(box.tolist())}",
            f"{', '.join(names[dim:])} must be above {', '.join(names[:dim])}",
            f"pass ({', '.join(names)}) in metres",
        )
    return box.reshape(2, dim)


def covering_shape(corners: Floats, spacing: float) -> list[int]:
    """Cells along each axis of the grid that begins at the lower of two corners and reaches the upper one."""
    with np.errstate(over="ignore"):
        counts = np.maximum(1.0, np.ceil((corners[1] - corners[0]) / spacing - _SLIVER))
    return [int(min(n, 2.0**62)) for n in counts]


def covering_grid(corners: Floats, spacing: float, bytes_a_cell: int) -> Grid:
    """The grid that begins at the lower of two corners, shape (2, dim), and reaches the upper one.

    Raises InputError if a workspace of so many cells does not fit into memory.
    """
    # What no raster can distinguish from zero is zero: shapely goes wrong on numbers below 1e-308.
    corners = np.where(np.abs(corners) < _NOUGHT * spacing, 0.0, corners)
    shape = covering_shape(corners, spacing)
    check_memory(bytes_a_cell * float(np.prod(shape, dtype=float)), "the map", Planned(shape, spacing, *corners))
    return Grid(corners[0], spacing, shape)


def warn_of_units(corners: Floats, spacing: float, what: str, bounded: bool) -> None:
    """Warn of obstacles that are smaller than a cell: they are hardly in metres.

    Within bounds, which are in metres, something a little smaller than a cell may well be meant; there it is warned of
    from a quarter of a cell down. ``corners``, shape (2, d), are those of their box; nothing is said of a single point.
    ``what`` says in the message what they are: "mesh".
    """
    sides = corners[1] - corners[0]
    if 0.0 < sides.max() < (_SMALL_WITHIN if bounded else _SMALL) * spacing:
        size = " m x ".join(f"{side:g}" for side in sides)
        warnings.warn(
            f"the {what} is {size} m large and fits into one cell of {spacing:g} m; its units are probably wrong "
            "(metres are needed): scale it, or use a smaller spacing",
            stacklevel=4,
        )


def warn_of_nothing(outer: Bools, grid: Grid, corners: Floats) -> None:
    """Warn where no obstacle, of a box, shape (2, d), metres, lies in the bounds of a map: no ``outer`` cell is set."""
    if not outer.any():
        warnings.warn(
            f"the obstacles reach from {in_metres(corners[0])} to {in_metres(corners[1])} and none lies within the "
            f"bounds, {in_metres(grid.lower)} to {in_metres(grid.upper)}; the map has no obstacle at all: check the "
            "bounds, and the units (metres)",
            stacklevel=4,
        )


def in_metres(point: Iterable[float]) -> str:
    """A point for people, as ``(x, y, z) m``."""
    return f"({', '.join(f'{x:g}' for x in point)}) m"


def check_dims(array: Any, name: str) -> None:
    """Refuse an array whose dimensions have names, as those of xarray do, other than x, y (and z) in this order."""
    dims = getattr(array, "dims", None)
    if dims is not None and tuple(dims) != ("x", "y", "z")[: len(dims)]:
        rule = "they must be named x, y (and z), in this order"
        mend = 'rename or transpose it, e.g. array.transpose("x", "y")'
        raise InputError(name, f"has the dimensions {tuple(dims)}", rule, mend)


def check_cells(values: ArrayLike, name: str) -> Bools:
    """A read-only copy of a boolean array of two or three axes."""
    check_dims(values, name)
    unmasked(values, name)
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(name, f"is ragged: {error}", "its rows must have one length", "pad or cut them") from error
    if array.ndim not in (2, 3) or array.size == 0:
        raise InputError(
            name,
            f"has shape {array.shape}",
            "it must have two or three axes and at least one cell",
            "pass an array indexed [x, y] or [x, y, z]",
        )
    if array.dtype.kind == "f":
        finite(array, name)
    if array.dtype.kind not in "biu":
        raise InputError(
            name,
            f"has dtype {array.dtype}",
            "cells are occupied or not, so that it must be boolean",
            "compare it with a threshold first, e.g. array > 0.5",
        )
    if array.dtype.kind != "b":
        wrong = np.argwhere((array != 0) & (array != 1))
        if len(wrong):
            index = tuple(wrong[0].tolist())
            raise InputError(
                f"{name}[{', '.join(map(str, index))}]",
                f"is {array[index]}",
                "whole numbers must be 0 or 1",
                "compare with a threshold first, e.g. array >= 50",
            )
    # A boolean array may hold other bytes than 0 and 1; a comparison does not.
    return frozen(np.array(array != 0, order="C"))
