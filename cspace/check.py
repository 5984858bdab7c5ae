"""Validators of arguments: each returns the checked value, or raises InputError."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints, frozen, in_c_order
from cspace.errors import InputError

MAX_COUNT: Final = 2**53
"""Largest whole number that is taken as a count: floats hold all of them up to here."""

_FLOATS: Final = "pass floats, in metres or radians; of a scipy Rotation, those of as_quat()"


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
        raise InputError(name, f"is {values!r}", "it must be numeric", _FLOATS, value=values) from error
    except OverflowError as error:
        rule = "it is larger than a float can be"
        raise InputError(name, "holds a whole number", rule, _FLOATS, value=values) from error
    if array.dtype.kind == "c":
        hint = "pass the real parts, e.g. array.real"
        raise InputError(name, "has complex values", "it must be real", hint, value=values)
    return array


def finite(values: ArrayLike, name: str) -> Floats:
    """Return values as a float64 array.

    Raises InputError if a value is not a real number, is NaN or is infinite.
    """
    array = np.asarray(real_numbers(values, name), dtype=np.float64)
    usable = np.isfinite(array)
    if not usable.all():
        entry, value = _entry(array, name, ~usable)
        hint = "drop or replace such values first"
        raise InputError(entry, f"is {value}", "NaN and infinities are refused", hint, value=value)
    return array


def _entry(array: NDArray[Any], name: str, wrong: Bools) -> tuple[str, Any]:
    """Return the name of the first wrong entry, such as ``points[2, 0]``, and its value."""
    index = tuple(np.argwhere(wrong)[0].tolist())
    return f"{name}[{', '.join(map(str, index))}]" if index else name, array[index].item()


def unmasked(values: Any, name: str) -> None:
    """Refuse masked entries: what a mask hides is neither free nor occupied.

    Raises InputError if ``values`` is a masked array with masked entries.
    """
    if isinstance(values, np.ma.MaskedArray) and (count := int(np.ma.getmaskarray(values).sum())):
        hint = "fill them first, e.g. array.filled(True) for occupied cells"
        raise InputError(name, f"has {count} masked entries", "each must have a value", hint, value=values)


def positive(value: Any, name: str, unit: str = "metres") -> float:
    """Return one number above zero.

    Raises InputError if it is not one number, not finite, or not above zero.
    """
    array = finite(value, name)
    if array.ndim or array <= 0.0:
        hint = f"pass it in {unit}" + ", e.g. 0.05" * (unit == "metres")
        raise InputError(name, f"is {value!r}", "it must be one number above zero", hint, value=value)
    if not 1e-100 < array < 1e100:
        rule = "it must lie between 1e-100 and 1e100"
        raise InputError(name, f"is {value!r}", rule, f"check its units ({unit})", value=value)
    return float(array)


def not_negative(value: Any, name: str, hint: str = "pass it in metres") -> float:
    """Return one number, zero or above.

    Raises InputError if it is not one number, not finite, or negative.
    """
    array = finite(value, name)
    if array.ndim or array < 0.0:
        raise InputError(name, f"is {value!r}", "it must be one number, zero or above", hint, value=value)
    return float(array)


def whole(value: Any, name: str, least: int = 0, most: int | None = None, hint: str = "pass e.g. 100") -> int:
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
        raise InputError(name, f"is {value!r}", f"it must be a whole number {span}", hint, value=value)
    return number


def check_word(value: Any, name: str, choices: Sequence[Any], hint: str = "pass one of them") -> None:
    """Refuse a value that is not among a few words or numbers.

    Raises InputError if it is not, or of another type.
    """
    if isinstance(value, bool) or not isinstance(value, str | int) or value not in choices:
        *most, last = map(repr, choices)
        raise InputError(name, f"is {value!r}", f"it must be {', '.join(most)} or {last}", hint, value=value)


def check_flag(value: bool, name: str) -> None:
    """Refuse a value that is neither True nor False.

    Raises InputError if it is not one of them.
    """
    if not isinstance(value, bool | np.bool_):
        raise InputError(name, f"is {value!r}", "it must be True or False", "pass one of them", value=value)


def check_rng(rng: object) -> np.random.Generator:
    """Return `rng`, or a freshly seeded generator if it is None.

    Raises InputError if it is anything else.
    """
    if rng is None:
        return np.random.default_rng()
    if not isinstance(rng, np.random.Generator):
        rule = "it must be a numpy.random.Generator, or None for a fresh one"
        raise InputError("rng", f"is {rng!r}", rule, "pass numpy.random.default_rng(0)", value=rng)
    return rng


def check_rows(values: ArrayLike, name: str, length: int) -> NDArray[Any]:
    """Return real numbers, shape (..., length), of any type that float64 can hold, perhaps with NaN or infinities.

    Raises InputError if a value is not a real number, or the last axis has another length.
    """
    array = real_numbers(values, name)
    if array.ndim == 0 or array.shape[-1] != length:
        rule, hint = f"its last axis must be {length} long, one entry for each coordinate", "pass one or a batch"
        raise InputError(name, f"has shape {array.shape}", rule, hint, value=values)
    return array


def check_points(values: ArrayLike, name: str, dim: int) -> Floats:
    """Return finite float64 numbers, shape (..., dim).

    Raises InputError if the last axis has another length, or a value is not finite.
    """
    return finite(check_rows(values, name, dim), name)


def check_point(value: ArrayLike, name: str = "center", dim: int = 2) -> Floats:
    """Return a copy of the coordinates of one point, shape (dim,).

    Raises InputError if there are not as many numbers, or one is not finite.
    """
    point = finite(value, name)
    if point.shape != (dim,):
        rule, hint = f"it must be {dim} numbers in metres", f"pass e.g. {(0.5,) * dim}"
        raise InputError(name, f"has shape {point.shape}", rule, hint, value=value)
    return point.copy()


def check_bounds(bounds: ArrayLike, dim: int = 2) -> Floats:
    """Return the lower and the upper corner of a map, shape (2, dim).

    They are given so, or as ``xmin, ymin, (zmin,) xmax, ymax(, zmax)``.

    Raises InputError if there are not as many numbers, or an upper one is not above its lower one.
    """
    box = finite(bounds, "bounds")
    names = [f"{axis}{end}" for end in ("min", "max") for axis in "xyz"[:dim]]
    hint = f"pass ({', '.join(names)}) in metres"
    if box.shape not in ((2 * dim,), (2, dim)):
        rule = f"it must hold {('four', 'six')[dim - 2]} numbers"
        raise InputError("bounds", f"is {bounds!r}", rule, f"{hint}, or the lower and the upper corner", value=bounds)
    corners = box.reshape(2, dim)
    if (corners[1] <= corners[0]).any():
        rule = f"{', '.join(names[dim:])} must be above {', '.join(names[:dim])}"
        raise InputError("bounds", f"is {box.tolist()}", rule, hint, value=bounds)
    return corners


def check_pairs(edges: ArrayLike, vertices: Floats) -> Ints:
    """Return edges as pairs of indices of vertices, shape (m, 2).

    Raises InputError if they are none.
    """
    unmasked(edges, "edges")
    try:
        pairs = np.asarray(edges)
    except ValueError as error:
        hint = "pass indices of shape (m, 2)"
        raise InputError("edges", f"is {edges!r}", "it must be pairs of vertices", hint, value=edges) from error
    pairs = pairs.astype(np.int64).reshape(0, 2) if pairs.size == 0 else pairs
    if pairs.dtype.kind not in "iu" or pairs.ndim != 2 or pairs.shape[1] != 2 or vertices.ndim != 2:
        problem = f"has shape {pairs.shape} and type {pairs.dtype}, for vertices of shape {vertices.shape}"
        rule = "each edge must be two whole numbers, and vertices a list of configurations"
        raise InputError("edges", problem, rule, "pass shapes (m, 2) and (n, size)", value=edges)
    wrong = (pairs < 0) | (pairs >= len(vertices))
    if wrong.any():
        number = int(np.argwhere(wrong)[0, 0])
        pair = tuple(pairs[number].tolist())
        rule = f"there are {len(vertices)} vertices, counted from 0"
        hint = f"pass indices from 0 to {len(vertices) - 1}"
        raise InputError("edge", f"number {number} is {pair}", rule, hint, value=pair)
    return pairs.astype(np.int64, copy=False)


def check_dims(array: Any, name: str) -> None:
    """Refuse an array whose named dimensions, as in xarray, are not x, y (and z) in this order.

    Raises InputError if they are not.
    """
    dims = getattr(array, "dims", None)
    if dims is not None and tuple(dims) != ("x", "y", "z")[: len(dims)]:
        rule, hint = "they must be x, y (and z), in this order", 'rename or transpose it, e.g. transpose("x", "y")'
        raise InputError(name, f"has the dimensions {tuple(dims)}", rule, hint, value=array)


def check_cells(values: ArrayLike, name: str) -> Bools:
    """Return a read-only boolean array of two or three axes: a copy, unless the array itself can be kept.

    Raises InputError if it has other axes, no cells, or values other than 0 and 1.
    """
    check_dims(values, name)
    unmasked(values, name)
    try:
        array = np.asarray(values)
    except ValueError as error:
        rule = "its rows must have one length"
        raise InputError(name, f"is ragged: {error}", rule, "pad or cut them", value=values) from error
    if array.ndim not in (2, 3) or array.size == 0:
        rule, hint = "it must have two or three axes and at least one cell", "pass an array indexed [x, y] or [x, y, z]"
        raise InputError(name, f"has shape {array.shape}", rule, hint, value=values)
    if array.dtype.kind == "f":
        finite(array, name)
    if array.dtype.kind not in "biu":
        rule, hint = "cells must be boolean: occupied or not", "compare with a threshold first, e.g. array > 0.5"
        raise InputError(name, f"has dtype {array.dtype}", rule, hint, value=values)
    if array.dtype.kind != "b" and (wrong := (array != 0) & (array != 1)).any():
        entry, value = _entry(array, name, wrong)
        hint = "compare with a threshold first, e.g. array >= 50"
        raise InputError(entry, f"is {value}", "whole numbers must be 0 or 1", hint, value=value)
    # A boolean array may hold other bytes than 0 and 1, which a comparison of bytes makes 1.
    stored = array.view(np.uint8) if array.dtype.kind == "b" else array
    is_ours = values is array and array.base is None and not array.flags.writeable and array.flags.c_contiguous
    if is_ours and array.dtype.kind == "b" and stored.max() <= 1:
        return array
    return frozen(in_c_order(stored != 0))
