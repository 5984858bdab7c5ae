"""Grid: the only place where metres and cell indices meet."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints, frozen, in_c_order
from cspace.errors import InputError

SLACK: Final = 2.0**-26
"""Rounding allowance in cells. Outer rasters grow by it and inner rasters shrink by it, and the rounding of every
look-up stays below it, so that no answer depends on how a floating-point number was rounded."""

MAX_COORDINATE: Final = 2.0**22
"""Largest coordinate in cells, measured from the origin, for which :data:`SLACK` covers the rounding."""

MAX_COUNT: Final = 2**53
"""Largest whole number that is taken as a count: floats hold all of them up to here."""

FLOATS: Final = "pass floats, in metres or radians; of a scipy Rotation, those of as_quat()"


def real_numbers(values: ArrayLike, name: str) -> NDArray[Any]:
    """Return values as an array of real numbers that float64 can hold; it keeps whole numbers and booleans.

    Raises InputError if a value is not a real number.
    """
    unmasked(values, name)
    try:
        array = np.asarray(values)
        if values is None or array.dtype.kind in "US":
            raise TypeError("texts and None are no numbers")
        if array.dtype.kind not in "fiubc":
            array = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(name, f"is {values!r}", "it must be numeric", FLOATS, value=values) from error
    except OverflowError as error:
        raise InputError(
            name, "holds a whole number", "it is larger than a float can be", FLOATS, value=values
        ) from error
    if array.dtype.kind == "c":
        raise InputError(
            name, "has complex values", "it must be real", "pass the real parts, e.g. array.real", value=values
        )
    return array


def finite(values: ArrayLike, name: str) -> Floats:
    """``values`` as a float64 array.

    Raises InputError if a value is not a real number, is NaN or is infinite.
    """
    array = np.asarray(real_numbers(values, name), dtype=np.float64)
    usable = np.isfinite(array)
    if not usable.all():
        index = tuple(int(i) for i in np.argwhere(~usable)[0])
        where = f"{name}[{', '.join(map(str, index))}]" if index else name
        raise InputError(
            where,
            f"is {array[index]}",
            "NaN and infinities are refused",
            "drop or replace such values first",
            value=float(array[index]),
        )
    return array


def unmasked(values: Any, name: str) -> None:
    """Refuse masked entries: what a mask hides is neither free nor occupied.

    Raises InputError if ``values`` is a masked array with masked entries.
    """
    if isinstance(values, np.ma.MaskedArray) and np.ma.getmaskarray(values).any():
        raise InputError(
            name,
            f"has {int(np.ma.getmaskarray(values).sum())} masked entries",
            "each must have a value",
            "fill them first, e.g. array.filled(True) for occupied cells",
            value=values,
        )


def positive(value: Any, name: str, unit: str = "metres") -> float:
    """``value`` as a float above zero.

    Raises InputError if it is not one number, not finite, or not above zero.
    """
    array = finite(value, name)
    if array.ndim or array <= 0.0:
        mend = f"pass it in {unit}" + ", e.g. 0.05" * (unit == "metres")
        raise InputError(name, f"is {value!r}", "it must be one number above zero", mend, value=value)
    if not 1e-100 < array < 1e100:
        raise InputError(
            name, f"is {value!r}", "it must lie between 1e-100 and 1e100", f"check its units ({unit})", value=value
        )
    return float(array)


def not_negative(value: Any, name: str, mend: str = "pass it in metres") -> float:
    """``value`` as a float, zero or above.

    Raises InputError if it is not one number, not finite, or negative.
    """
    array = finite(value, name)
    if array.ndim or array < 0.0:
        raise InputError(name, f"is {value!r}", "it must be one number, zero or above", mend, value=value)
    return float(array)


def whole(value: Any, name: str, least: int = 0, most: int | None = None, mend: str = "pass e.g. 100") -> int:
    """Return a whole number from ``least`` to ``most``, or to :data:`MAX_COUNT` by default.

    Raises InputError if the value is not one.
    """
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    if number is not None and number > MAX_COUNT and most is None:
        most = MAX_COUNT
    if number is None or number < least or (most is not None and number > most):
        span = f"from {least} to {most}" if most is not None else ("above zero" if least == 1 else f"from {least} on")
        raise InputError(name, f"is {value!r}", f"it must be a whole number {span}", mend, value=value)
    return number


def check_word(value: Any, name: str, choices: Sequence[Any], mend: str = "pass one of them") -> None:
    """Refuse what is none of a few words, or numbers.

    Raises InputError if it is none, or of another type.
    """
    if isinstance(value, bool) or not isinstance(value, str | int) or value not in choices:
        *most, last = map(repr, choices)
        raise InputError(name, f"is {value!r}", f"it must be {', '.join(most)} or {last}", mend, value=value)


def points_of(values: ArrayLike, name: str, dim: int) -> Floats:
    """``values`` as float64 numbers, shape (..., dim).

    Raises InputError if the last axis is not ``dim`` long, or a value is not finite.
    """
    array = finite(values, name)
    if array.ndim == 0 or array.shape[-1] != dim:
        rule, mend = f"its last axis must be {dim} long, one entry for each coordinate", "pass one of them or a batch"
        raise InputError(name, f"has shape {array.shape}", rule, mend, value=values)
    return array


def check_bounds(bounds: ArrayLike, dim: int = 2) -> Floats:
    """The lower and upper corner of a map, shape (2, dim), given so, or as ``xmin, ymin, (zmin,) xmax, ymax(, zmax)``.

    Raises InputError if there are not as many numbers, or an upper one is not above its lower one.
    """
    box = finite(bounds, "bounds")
    names = [f"{axis}{end}" for end in ("min", "max") for axis in "xyz"[:dim]]
    mend = f"pass ({', '.join(names)}) in metres"
    if box.shape not in ((2 * dim,), (2, dim)):
        rule = f"it must hold {('four', 'six')[dim - 2]} numbers"
        raise InputError("bounds", f"is {bounds!r}", rule, f"{mend}, or the lower and the upper corner", value=bounds)
    corners = box.reshape(2, dim)
    if (corners[1] <= corners[0]).any():
        rule = f"{', '.join(names[dim:])} must be above {', '.join(names[:dim])}"
        raise InputError("bounds", f"is {box.tolist()}", rule, mend, value=bounds)
    return corners


def check_dims(array: Any, name: str) -> None:
    """Refuse an array whose dimensions have names, as those of xarray do, other than x, y (and z) in this order."""
    dims = getattr(array, "dims", None)
    if dims is not None and tuple(dims) != ("x", "y", "z")[: len(dims)]:
        rule = "they must be named x, y (and z), in this order"
        mend = 'rename or transpose it, e.g. array.transpose("x", "y")'
        raise InputError(name, f"has the dimensions {tuple(dims)}", rule, mend, value=array)


def check_cells(values: ArrayLike, name: str) -> Bools:
    """Return a read-only boolean array of two or three axes: a copy, unless the array itself can be kept."""
    check_dims(values, name)
    unmasked(values, name)
    try:
        array = np.asarray(values)
    except ValueError as error:
        raise InputError(
            name, f"is ragged: {error}", "its rows must have one length", "pad or cut them", value=values
        ) from error
    if array.ndim not in (2, 3) or array.size == 0:
        raise InputError(
            name,
            f"has shape {array.shape}",
            "it must have two or three axes and at least one cell",
            "pass an array indexed [x, y] or [x, y, z]",
            value=values,
        )
    if array.dtype.kind == "f":
        finite(array, name)
    if array.dtype.kind not in "biu":
        raise InputError(
            name,
            f"has dtype {array.dtype}",
            "cells are occupied or not, so that it must be boolean",
            "compare it with a threshold first, e.g. array > 0.5",
            value=values,
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
                value=array[index].item(),
            )
    # A boolean array may hold other bytes than 0 and 1, which a comparison of bytes makes 1.
    stored = array.view(np.uint8) if array.dtype.kind == "b" else array
    ours = values is array and array.base is None and not array.flags.writeable and array.flags.c_contiguous
    if ours and array.dtype.kind == "b" and stored.max() <= 1:
        return array
    return frozen(in_c_order(stored != 0))


def check_reach(far: float, name: str, origin: str, mend: str) -> None:
    """Refuse what reaches so many cells from an origin that rounding could reach the certificate's slack.

    Raises InputError if ``far`` is above :data:`MAX_COORDINATE`.
    """
    if not far <= MAX_COORDINATE:
        rule = f"at most {MAX_COORDINATE:.0f} keep the answers proven against rounding"
        raise InputError(name, f"reaches {far:.3g} cells from {origin}", rule, mend, value=far)


@dataclass(frozen=True, slots=True)
class Grid:
    """A box of closed cubic cells; cell ``i`` is ``lower + spacing * (i + [0, 1]^d)``.

    Arrays over the grid are indexed in the order of the coordinates, ``[x, y]`` or ``[x, y, z]``.

    Parameters
    ----------
    lower : sequence of float, length d
        Lower corner of cell 0, in metres; d is 2 or 3.
    spacing : float
        Side of a cell, in metres.
    shape : sequence of int, length d
        Number of cells along each axis.
    axes : sequence of str, length d, optional
        What the coordinates are called; by default x, y and, in space, z.
    units : sequence of str, length d, optional
        Their unit, "m" by default; the joints of an arm may have "rad".

    Raises
    ------
    InputError
        If a value is not finite, the spacing or a count is not above zero, or the lengths differ; or if the grid lies
        so far from the origin (over 2^22 cells) that floating-point rounding could reach the certificate's slack.

    Examples
    --------
    >>> import cspace
    >>> grid = cspace.Grid((0.0, 0.0), 0.5, (10, 8))
    >>> grid.cell_of((1.2, 3.9))
    array([2, 7])
    >>> grid.center_of((2, 7))
    array([1.25, 3.75])
    """

    lower: tuple[float, ...]
    spacing: float
    shape: tuple[int, ...]
    axes: tuple[str, ...]
    units: tuple[str, ...]

    def __init__(
        self,
        lower: ArrayLike,
        spacing: float,
        shape: Sequence[int],
        axes: Sequence[str] | None = None,
        units: Sequence[str] | None = None,
    ) -> None:
        corner = finite(lower, "lower")
        if corner.ndim != 1 or len(corner) not in (2, 3):
            raise InputError(
                "lower", f"is {lower!r}", "it must hold 2 or 3 coordinates", "pass e.g. (0.0, 0.0)", value=lower
            )
        side = positive(spacing, "spacing")
        counts = np.asarray(shape)
        if counts.shape != corner.shape or counts.dtype.kind not in "iu" or (counts <= 0).any():
            raise InputError(
                "shape",
                f"is {tuple(np.atleast_1d(counts).tolist())}",
                f"it must hold {len(corner)} whole numbers above zero, one for each coordinate of lower",
                "pass the number of cells along each axis",
                value=shape,
            )
        reach = float(np.max(np.maximum(np.abs(corner), np.abs(corner + side * counts))) / side)
        check_reach(reach, "grid", "the origin", "use a larger spacing, or move the frame's origin nearer to the map")
        object.__setattr__(self, "lower", tuple(corner.tolist()))
        object.__setattr__(self, "spacing", side)
        object.__setattr__(self, "shape", tuple(int(n) for n in counts))
        object.__setattr__(self, "axes", tuple("xyz"[: self.dim] if axes is None else axes))
        object.__setattr__(self, "units", ("m",) * self.dim if units is None else tuple(units))
        for name, texts in (("axes", self.axes), ("units", self.units)):
            if len(texts) != self.dim or (name == "axes" and len(set(texts)) < self.dim):
                rule = f"there must be {self.dim}, each another one"
                raise InputError(name, f"are {', '.join(texts)}", rule, "leave them out", value=texts)

    @property
    def dim(self) -> int:
        """Number of axes, 2 or 3."""
        return len(self.shape)

    @property
    def unit(self) -> str:
        """The unit of the side of a cell."""
        return " or ".join(dict.fromkeys(self.units))

    @property
    def measure_unit(self) -> str:
        """The unit of a cell's area or volume: "m2", "rad3", or e.g. "rad m"."""
        powers = [(unit, self.units.count(unit)) for unit in sorted(set(self.units), reverse=True)]
        return " ".join(f"{unit}{power}" if power > 1 else unit for unit, power in powers)

    @property
    def labels(self) -> tuple[str, ...]:
        """What stands at the axes of a picture: names and units."""
        return tuple(f"{axis} ({unit})" for axis, unit in zip(self.axes, self.units, strict=True))

    @property
    def size(self) -> int:
        """Number of cells."""
        return math.prod(self.shape)

    @property
    def upper(self) -> tuple[float, ...]:
        """Upper corner, in metres."""
        return tuple(low + self.spacing * n for low, n in zip(self.lower, self.shape, strict=True))

    def coordinates(self, points: ArrayLike, name: str = "points") -> Floats:
        """Points as an array of float64, shape (..., d), metres.

        Raises
        ------
        InputError
            If the last axis is not d long, or a value is not finite.
        """
        return points_of(points, name, self.dim)

    def contains(self, points: ArrayLike) -> Bools:
        """Whether points lie in the closed box of the grid.

        Parameters
        ----------
        points : array-like, shape (..., d)

        Returns
        -------
        ndarray of bool, shape (...)
        """
        array = self.coordinates(points)
        inside = (array >= self.lower) & (array <= self.upper)
        return np.asarray(inside.all(axis=-1))

    def cell_of(self, points: ArrayLike) -> Ints:
        """Cells that hold points; outside the grid, the cell that an endless grid would have there.

        A point on a border belongs to the cell above it, except on the grid's own upper border, which belongs to the
        last cell: cell ``i`` owns ``lower + spacing * (i + [0, 1))``, the last one its upper border too.

        Parameters
        ----------
        points : array-like, shape (..., d)

        Returns
        -------
        ndarray of int64, shape (..., d)
        """
        array = self.coordinates(points)
        cells = np.floor((array - self.lower) / self.spacing)
        cells -= (cells == self.shape) & (array <= self.upper)
        # Beyond 2^62 cells an int64 would wrap around; far outside is far outside.
        return np.minimum(np.maximum(cells, -(2.0**62)), 2.0**62).astype(np.int64)

    def center_of(self, cells: ArrayLike) -> Floats:
        """Middle points of cells.

        Parameters
        ----------
        cells : array-like of int, shape (..., d)

        Returns
        -------
        ndarray of float64, shape (..., d)
            Metres.
        """
        return np.asarray(self.lower + self.spacing * (real_numbers(cells, "cells") + 0.5))

    def centers(self, axis: int) -> Floats:
        """Coordinates of the cells' middle points along one axis, in metres, shape (shape[axis],)."""
        return np.asarray(self.lower[axis] + self.spacing * (np.arange(self.shape[axis]) + 0.5))


def check_point(value: ArrayLike, name: str = "center", dim: int = 2) -> Floats:
    """The coordinates of one point, shape (dim,).

    Raises InputError if there are not as many numbers, or one is not finite.
    """
    point = finite(value, name)
    if point.shape != (dim,):
        raise InputError(
            name,
            f"has shape {point.shape}",
            f"it must be {dim} numbers in metres",
            f"pass e.g. {(0.5,) * dim}",
            value=value,
        )
    return point.copy()
