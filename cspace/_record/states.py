"""Functions on arrays of states."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace._support.arrays import BLOCKED, Ints, States, frozen


def count_states(states: States) -> Ints:
    """Count each slice's FREE, MIXED and BLOCKED cells, shape (slices, 3)."""
    return np.array([np.bincount(cells.ravel(), minlength=BLOCKED + 1) for cells in states])


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous read-only view of an array."""
    return frozen(np.ascontiguousarray(array).view())
