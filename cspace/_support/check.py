"""Validators of arguments: each returns the checked value, or raises InputError."""

from __future__ import annotations

import difflib
import operator
from collections.abc import Collection, Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._support.arrays import Bools, Floats, Ints, frozen
from cspace.errors import InputError

MAX_COUNT: Final = 2**53
"""Largest count. Floats represent all whole numbers up to it exactly."""

UNKNOWN_CELL: Final = -1
"""Value of unknown cells in occupancy grids of ROS."""


def check_real(values: ArrayLike, name: str) -> NDArray[Any]:
    """Return values as an array of real numbers.

    Integers and booleans keep their type; other types become float64. Raises InputError if a value
    is not a real number, or is too large for float64.
    """
    check_unmasked(values, name)
    # Refuse None and texts, because numpy would turn None into NaN and parse texts as numbers.
    # Arrays of objects, such as fractions, are converted if they hold numbers.
    try:
        array = np.asarray(values)
        if values is None or array.dtype.kind in "US":
            raise TypeError("texts and None are no numbers")
        if array.dtype.kind not in "fiubc":
            array = np.asarray(array, dtype=np.float64)
    except (TypeError, ValueError) as error:
        hint = "pass numbers, in metres or radians"
        if isinstance(values, str | bytes):
            hint = "write the number without quotes"
        elif hasattr(values, "as_quat"):
            hint = "pass the Rotation's as_quat()"
        raise InputError(name, f"is {values!r}", "it must be numeric", hint) from error
    except OverflowError as error:
        problem = "has too large an integer"
        raise InputError(name, problem, "it must fit a float", "pass a float") from error
    if array.dtype.kind == "c":
        raise InputError(name, "has complex values", "it must be real", "pass array.real")
    return array


def check_finite(values: ArrayLike, name: str) -> Floats:
    """Return values as a float64 array.

    Raises InputError if a value is not a real number, is NaN or is infinite.
    """
    array = np.asarray(check_real(values, name), dtype=np.float64)
    is_finite = np.isfinite(array)
    if not is_finite.all():
        entry, value = _first_wrong_entry(array, name, ~is_finite)
        raise InputError(
            entry,
            f"is {value}",
            "it must be finite",
            "drop or replace such values first",
        )
    return array


def _first_wrong_entry(array: NDArray[Any], name: str, wrong: Bools) -> tuple[str, Any]:
    """Return the name and the value of the first wrong entry.

    A name is, for example, ``points[2, 0]``.

    ``wrong`` is a mask with at least one entry set.
    """
    index = tuple(np.argwhere(wrong)[0].tolist())
    entry = f"{name}[{', '.join(map(str, index))}]" if index else name
    return entry, array[index].item()


def check_unmasked(values: Any, name: str) -> None:
    """Raise InputError for masked entries, because they are neither free nor occupied."""
    if not isinstance(values, np.ma.MaskedArray):
        return
    count = int(np.ma.getmaskarray(values).sum())
    if count:
        problem = f"has {count} masked entries"
        hint = "fill them first, e.g. array.filled(True) for occupied cells"
        raise InputError(name, problem, "each must have a value", hint)


def check_positive(value: Any, name: str, unit: str = "metres") -> float:
    """Return a positive number as a float.

    Raises InputError if it is not one number, not finite, not above zero, or outside [1e-100,
    1e100].
    """
    array = check_finite(value, name)
    problem = f"is {value!r}"
    if array.ndim or array <= 0.0:
        example = ", e.g. 0.05" if unit == "metres" else ""
        rule = "it must be one number above zero"
        raise InputError(name, problem, rule, f"pass it in {unit}{example}")
    # Squares and cubes of numbers in this range do not overflow or underflow float64.
    if not 1e-100 < array < 1e100:
        rule = "it must be in [1e-100, 1e100]"
        raise InputError(name, problem, rule, f"check its unit ({unit})")
    return float(array)


def check_not_negative(value: Any, name: str, hint: str = "pass it in metres") -> float:
    """Return a number that is zero or above as a float.

    Raises InputError if it is not one number, not finite, or negative.
    """
    array = check_finite(value, name)
    if array.ndim or array < 0.0:
        raise InputError(name, f"is {value!r}", "it must be one number, zero or above", hint)
    return float(array)


def check_count(
    value: Any, name: str, minimum: int = 0, maximum: int | None = None, hint: str = "pass e.g. 100"
) -> int:
    """Return a whole number from ``minimum`` to ``maximum`` as an int.

    The default maximum is :data:`MAX_COUNT`.

    Raises InputError if the value is no such number.
    """
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:
        number = None
    highest = MAX_COUNT if maximum is None else maximum
    if number is not None and minimum <= number <= highest:
        return number
    # Messages name the default maximum only if the number exceeds it.
    if maximum is not None or (number is not None and number > highest):
        span = f"from {minimum} to {highest}"
    elif minimum == 1:
        span = "above zero"
    else:
        span = f"from {minimum} on"
    raise InputError(name, f"is {value!r}", f"it must be a whole number {span}", hint)


def check_word(
    value: Any, name: str, choices: Sequence[Any], hint: str = "pass one of them"
) -> None:
    """Raise InputError unless a value is one of a few words or whole numbers."""
    if isinstance(value, bool) or not isinstance(value, str | int) or value not in choices:
        *others, last = map(repr, choices)
        rule = f"it must be {', '.join(others)} or {last}"
        raise InputError(name, f"is {value!r}", rule, hint)


def check_known(value: object, name: str, known: Collection[str], verb: str = "is") -> str:
    """Return a known name; raise InputError, with the most similar name, otherwise."""
    if isinstance(value, str) and value in known:
        return value
    similar = difflib.get_close_matches(str(value), known, n=1)
    rule = f"there are {', '.join(known)}"
    hint = "name one of these"
    if not known:
        rule = "there is none"
        hint = "leave it out"
    elif similar:
        hint = f"did you mean {similar[0]!r}?"
    raise InputError(name, f"{verb} {value!r}", rule, hint)


def check_names(values: Iterable[str], name: str) -> list[str]:
    """Return names as a list; a string is one name.

    Raises InputError if the values are not iterable.
    """
    if isinstance(values, str):
        return [values]
    try:
        return list(values)
    except TypeError as error:
        problem = f"is {values!r}"
        rule = "it must be a list of names"
        raise InputError(name, problem, rule, "pass a list of strings") from error


def check_text(value: object, name: str, example: str) -> str:
    """Return a string that is not empty; raise InputError, with an example, otherwise."""
    if not isinstance(value, str) or not value:
        rule = "it must be a non-empty string"
        raise InputError(name, f"is {value!r}", rule, f"pass e.g. {example!r}")
    return value


def check_flag(value: object, name: str) -> None:
    """Raise InputError for a value that is neither True nor False."""
    if not isinstance(value, bool | np.bool_):
        raise InputError(name, f"is {value!r}", "it must be True or False", "pass one of them")


def check_rng(rng: object) -> np.random.Generator:
    """Return `rng`, or a freshly seeded generator if it is None.

    Raises InputError if it is anything else.
    """
    if rng is None:
        return np.random.default_rng()
    if not isinstance(rng, np.random.Generator):
        rule = "it must be a numpy.random.Generator or None"
        raise InputError("rng", f"is {rng!r}", rule, "pass numpy.random.default_rng(0)")
    return rng


def check_rows(values: ArrayLike, name: str, length: int) -> NDArray[Any]:
    """Return real numbers of any type as an array, shape (..., length).

    They may be NaN or infinite. Raises InputError if a value is not a real number, or the last axis
    has another length.
    """
    array = check_real(values, name)
    if array.ndim == 0 or array.shape[-1] != length:
        rule = f"its last axis must be {length} long, one entry for each coordinate"
        raise InputError(name, f"has shape {array.shape}", rule, "pass one or a batch")
    return array


def check_points(values: ArrayLike, name: str, dim: int) -> Floats:
    """Return finite points as float64, shape (..., dim).

    Raises InputError if the last axis has another length, or a value is not finite.
    """
    return check_finite(check_rows(values, name, dim), name)


def check_point(value: ArrayLike, name: str = "center", dim: int = 2) -> Floats:
    """Return a copy of the coordinates of one point, shape (dim,).

    Raises InputError if the shape differs, or a value is not finite.
    """
    point = check_finite(value, name)
    if point.shape != (dim,):
        rule = f"it must be {dim} numbers in metres"
        hint = f"pass e.g. {(0.5,) * dim}"
        raise InputError(name, f"has shape {point.shape}", rule, hint)
    return point.copy()


def check_bounds(bounds: ArrayLike, dim: int = 2) -> Floats:
    """Return the lower and the upper corner of a map, shape (2, dim).

    ``bounds`` has that shape, or is ``xmin, ymin, (zmin,) xmax, ymax(, zmax)``. Raises InputError
    if it has another shape, or an upper value is not above the lower value.
    """
    box = check_finite(bounds, "bounds")
    names = [f"{axis}{end}" for end in ("min", "max") for axis in "xyz"[:dim]]
    hint = f"pass ({', '.join(names)}) in metres"
    if box.shape not in ((2 * dim,), (2, dim)):
        rule = f"it must have {'four' if dim == 2 else 'six'} numbers"
        hint = f"{hint}, or the lower and the upper corner"
        raise InputError("bounds", f"is {bounds!r}", rule, hint)
    corners = box.reshape(2, dim)
    lower, upper = corners
    if (upper <= lower).any():
        rule = f"{', '.join(names[dim:])} must be above {', '.join(names[:dim])}"
        raise InputError("bounds", f"is {box.tolist()}", rule, hint)
    return corners


def check_pairs(edges: ArrayLike, vertices: Floats) -> Ints:
    """Return edges as pairs of vertex indices, shape (m, 2).

    Raises InputError if they have another shape, or an index is not that of a vertex.
    """
    pairs = check_real(edges, "edges")
    # numpy makes an empty list an array of floats, shape (0,).
    if pairs.size == 0:
        pairs = np.empty((0, 2), dtype=np.int64)
    if pairs.dtype.kind not in "iu" or pairs.ndim != 2 or pairs.shape[1] != 2 or vertices.ndim != 2:
        problem = (
            f"has shape {pairs.shape} and type {pairs.dtype}, for vertices of shape "
            f"{vertices.shape}"
        )
        rule = "each edge must be two whole numbers, and vertices a list of configurations"
        raise InputError("edges", problem, rule, "pass shapes (m, 2) and (n, size)")
    wrong = (pairs < 0) | (pairs >= len(vertices))
    if wrong.any():
        row = int(wrong.any(axis=1).argmax())  # the first one
        pair = tuple(pairs[row].tolist())
        rule = f"there are {len(vertices)} vertices, counted from 0"
        hint = f"pass indices from 0 to {len(vertices) - 1}"
        raise InputError("edge", f"number {row} is {pair}", rule, hint)
    return pairs.astype(np.int64, copy=False)


def check_dims(array: Any, name: str) -> None:
    """Raise InputError unless named dimensions of an array are x, y (and z).

    Dimensions are named as in xarray or zarr. They must be in this order, and have no coordinates,
    which :func:`cspace._files.rasters.place_raster` evaluates and removes.
    """
    metadata = getattr(array, "metadata", None)
    dims = getattr(array, "dims", None) or getattr(metadata, "dimension_names", None) or ()
    if dims and None not in dims and tuple(dims) != ("x", "y", "z")[: len(dims)]:
        rule = "they must be x, y (and z), in this order"
        hint = "project, rename or transpose it, and reverse y if its first row is the top"
        raise InputError(name, f"has the dimensions {tuple(dims)}", rule, hint)
    if set(dims) & set(getattr(array, "coords", ())):
        hint = "pass its values, with ascending x and y"
        raise InputError(name, "has coordinates", "they have no effect here", hint)


def check_cells(values: ArrayLike, name: str) -> Bools:
    """Return a read-only boolean array of two or three axes.

    It is a copy, unless the array itself can be used. Raises InputError if it has other axes, no
    cells, or values other than 0 and 1.
    """
    check_dims(values, name)
    check_unmasked(values, name)
    try:
        array = np.asarray(values)
    except ValueError as error:
        problem = f"is ragged: {error}"
        rule = "its rows must have one length"
        raise InputError(name, problem, rule, "pad or cut them") from error
    if array.ndim not in (2, 3) or array.size == 0:
        rule = "it must have two or three axes and at least one cell"
        hint = "pass an array indexed [x, y] or [x, y, z]"
        raise InputError(name, f"has shape {array.shape}", rule, hint)
    if array.dtype.kind == "f":
        check_finite(array, name)
    if array.dtype.kind not in "biu":
        problem = f"has dtype {array.dtype}"
        hint = "compare with a threshold first, e.g. array > 0.5"
        raise InputError(name, problem, "cells must be boolean", hint)
    is_boolean = array.dtype.kind == "b"
    if not is_boolean:
        _check_zeros_and_ones(array, name)
    # A boolean array may contain bytes other than 0 and 1; comparing bytes with 0 normalises them.
    stored_values = array.view(np.uint8) if is_boolean else array
    # An array that is read-only and no view cannot be changed, so it needs no copy.
    is_constant = array.base is None and not array.flags.writeable and array.flags.c_contiguous
    if is_constant and is_boolean and stored_values.max() <= 1:
        return array
    return frozen(np.ascontiguousarray(stored_values != 0))


def _check_zeros_and_ones(array: NDArray[Any], name: str) -> None:
    """Raise InputError for numbers other than 0 and 1."""
    wrong = (array != 0) & (array != 1)
    if not wrong.any():
        return
    entry, value = _first_wrong_entry(array, name, wrong)
    # Occupancy grids of ROS get a message of their own.
    problem = f"is {value}"
    rule = "whole numbers must be 0 or 1"
    hint = "compare with a threshold first, e.g. array >= 50"
    if (array == UNKNOWN_CELL).any():
        problem = f"{problem}, and some cells are {UNKNOWN_CELL}, as unknown cells of ROS"
        rule = f"{rule}, and unknown cells may hide obstacles"
        hint = (
            "use Workspace.from_occupancy_grid, where unknown cells are occupied unless you pass "
            "unknown='free'"
        )
    raise InputError(entry, problem, rule, hint)
