"""States of a map, for kernels and for Python."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Ints, States, frozen
from cspace.errors import InputError
from cspace.limits import MAX_MEMORY_FRACTION, bytes_text, free_bytes
from cspace.rotations import CompiledRotations


class Map(NamedTuple):
    """States over rotation cells and grid cells, for kernels.

    The arrays are views of the map's own arrays, so workspace updates are visible here.

    Attributes
    ----------
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
        FREE, MIXED or BLOCKED; read-only, in C order. Kernels read only its shape.
    cells : ndarray of uint8, shape (slices * nx * ny,) or (slices * nx * ny * nz,)
        The same states in a row.
    rotations : NamedTuple
        Rotation cells and their slices; kernels call its methods only.
    lower, upper : tuple of float, length d
        Corners of the grid, metres.
    spacing : float
        Side of a cell, metres.
    exterior : ndarray of int64, shape (slices, 2 d + 1)
        States outside the grid: :attr:`cspace.map.exterior.Exterior.table`.
    """

    states: States
    cells: States
    rotations: CompiledRotations
    lower: tuple[float, ...]
    spacing: float
    upper: tuple[float, ...]
    exterior: Ints

    @property
    def slice_of(self) -> Ints:
        """Slice of each rotation cell, shape (rotations,)."""
        return np.asarray(self.rotations.slice_of)


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
