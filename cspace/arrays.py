"""Types of arrays, by what they hold, and arrays that are not to be written."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
States = NDArray[np.uint8]
Words = NDArray[np.uint64]

Numbers = tuple[float, ...]
"""A configuration, or what compiled code makes of one."""

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]

Surface = tuple[Floats, Ints]
"""Triangles: vertices, shape (V, 3), metres, and the numbers of their corners among these, shape (F, 3)."""


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array, not to be written."""
    array.setflags(write=False)
    return array
