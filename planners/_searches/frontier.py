"""The nodes that a search has reached, and its queue."""

from __future__ import annotations

import mmap
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.inside import Bools, Effort, Floats, Ints, is_over


class Progress(NamedTuple):
    """State of a search, which kernels change.

    Attributes
    ----------
    cost : ndarray of float32, shape (cells,)
        Cost of the best chain found to each reached cell, in cells.
    previous : ndarray of int32, or int64 for 2^31 cells and more, shape (cells,)
        The cell before each reached cell of its best chain, plus 1; 0 for cells not reached, so
        that a large map takes memory only for reached cells.
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
    """Raise TimeoutError after ``until``, or if the caller ended the search."""
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
    """Return zeros, shape (count,), in memory that is allocated when touched.

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
