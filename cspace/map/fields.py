"""The overlap field that a map may carry: an array for the overlap, and one for its derivative along each axis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import finite
from cspace.states import FIELDS


def checked_fields(
    fields: Mapping[str, NDArray[np.float64]], dim: int, shape: tuple[int, ...]
) -> dict[str, NDArray[np.float64]]:
    """The arrays of an overlap field, in the order of :data:`cspace.states.FIELDS`, not to be written.

    Raises
    ------
    InputError
        If one is missing or there are others, or one has another shape or type, or holds what is not finite.
    """
    names, mend = FIELDS[: 1 + dim], "use OverlapField.of, or CSpace.with_overlap_field"
    if set(fields) != set(names):
        rule = f"of a map of {dim} axes they must be {', '.join(names)}"
        raise InputError("fields", f"are {', '.join(fields) or 'none'}", rule, mend)
    for name in names:
        array = fields[name]
        if array.shape != shape or array.dtype != np.float64:
            rule = f"it must have the map's shape {shape} and type float64"
            raise InputError(name, f"has shape {array.shape} and type {array.dtype}", rule, mend)
        finite(array, name)
    return {name: read_only(fields[name]) for name in names}


def writable(array: NDArray[Any]) -> NDArray[Any]:
    """The array in one piece, and to be written; a copy only where it is not."""
    array = np.ascontiguousarray(array)
    return array if array.flags.writeable else array.copy()


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The array in one piece, and not to be written."""
    array = np.ascontiguousarray(array)
    array.setflags(write=False)
    return array
