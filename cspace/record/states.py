"""Arrays of states."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, free_bytes
from cspace.support.arrays import Ints, States, frozen


def count_states(states: States) -> Ints:
    """Count the states of each slice, shape (slices, 3)."""
    return np.array([np.bincount(part.reshape(-1), minlength=3) for part in states])


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    """Return a contiguous read-only view of an array."""
    return frozen(np.ascontiguousarray(array).view())


def check_bytes(states: int) -> None:
    """Raise InputError if bytes for states exceed the memory."""
    free = free_bytes()
    if states > MAX_MEMORY_FRACTION * free:
        raise InputError(
            "the state of every cell",
            f"takes {bytes_text(states)}, a byte for each",
            f"at most {bytes_text(MAX_MEMORY_FRACTION * free)} of memory may be used",
            "read one rotation at a time, with states_at",
            value=states,
        )
