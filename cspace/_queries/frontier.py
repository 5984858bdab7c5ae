"""The nodes that a search has reached, and its queue."""

from __future__ import annotations

import mmap
from contextlib import suppress
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace._support.arrays import Bools, Floats, Ints
from cspace._support.compiling import internal, kernel
from cspace._support.deadlines import Effort, is_over

DONE: Final = 0
GOES_ON: Final = 1
"""Results of kernels that expand nodes: they ended, or the next call goes on."""


class Progress(NamedTuple):
    """State of a search, which kernels change.

    Attributes
    ----------
    cost : ndarray of float32, shape (cells,)
        Cost of the best chain found to each reached cell, in cells.
    previous : ndarray of int32, or int64 for 2^31 cells and more, shape (cells,)
        The cell before each reached cell of its best chain, plus 1; 0 for cells not reached, so
        that a large map takes memory only where the search leads.
    closed : ndarray of bool, shape (cells,)
        True for cells that were expanded.
    keys, queue : ndarray of float64 and int64, shape (n,)
        Binary heap of cells by their expected cost.
    length : ndarray of int64, shape (1,)
        Number of entries of the heap.
    """

    cost: NDArray[np.float32]
    previous: NDArray[np.signedinteger[Any]]
    closed: Bools
    keys: Floats
    queue: Ints
    length: Ints


def check_deadline(until: Effort) -> None:
    """Raise TimeoutError from ``until`` on, or if the caller ended the search."""
    if is_over(until):
        raise TimeoutError


def make_progress(count: int, queue_length: int) -> Progress:
    """Make an empty search over ``count`` nodes."""
    kind = np.int32 if count < 2**31 else np.int64
    return Progress(
        cost=sparse_zeros(count, np.float32),
        previous=sparse_zeros(count, kind),
        closed=sparse_zeros(count, np.bool_),
        keys=np.empty(queue_length),
        queue=np.empty(queue_length, dtype=np.int64),
        length=np.zeros(1, dtype=np.int64),
    )


def sparse_zeros(count: int, kind: type[np.generic]) -> NDArray[Any]:
    """Return zeros, shape (count,); a large array takes memory only when touched.

    Small arrays use the memory of earlier arrays, because the first touch of each new page takes
    time. Large arrays of numpy come in pages of megabytes, and a search touches few bytes of each.
    """
    size = count * np.dtype(kind).itemsize
    # Largest size in bytes of an array that is cleared at once, in about a millisecond.
    if size <= 2**24:
        return np.zeros(count, dtype=kind)
    memory = mmap.mmap(-1, size)
    if hasattr(mmap, "MADV_NOHUGEPAGE"):
        with suppress(OSError):  # a system without large pages
            memory.madvise(mmap.MADV_NOHUGEPAGE)
    return np.frombuffer(memory, dtype=kind)


def double(array: NDArray[Any]) -> NDArray[Any]:
    """Double an array with zeros along its first axis."""
    return np.concatenate([array, np.zeros_like(array)])


@kernel
def push(progress: Progress, key: float, cell: int) -> None:
    """Add a cell to the binary heap, with smaller keys first."""
    keys = progress.keys
    queue = progress.queue
    position = progress.length[0]
    progress.length[0] += 1
    # Entries with larger keys move down, from the last place towards the root.
    while position > 0:
        parent = (position - 1) // 2
        if keys[parent] <= key:
            break
        keys[position] = keys[parent]
        queue[position] = queue[parent]
        position = parent
    keys[position] = key
    queue[position] = cell


@internal
def pop_first(progress: Progress) -> None:
    """Remove the heap's cell of the lowest key."""
    keys = progress.keys
    queue = progress.queue
    progress.length[0] -= 1
    count = progress.length[0]
    # The last entry sinks from the root.
    key = keys[count]
    cell = queue[count]
    position = 0
    child = 1
    while child < count:
        if child + 1 < count and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[position] = keys[child]
        queue[position] = queue[child]
        position = child
        child = 2 * position + 1
    keys[position] = key
    queue[position] = cell
