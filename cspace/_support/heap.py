"""A binary heap for searches in kernels."""

from __future__ import annotations

from typing import Protocol

from cspace._support.arrays import Floats, Ints
from cspace._support.compiling import internal, kernel


class Heap(Protocol):
    """A record with a binary heap of numbers by their keys, which kernels change.

    Attributes
    ----------
    keys, queue : ndarray of float64 and int64, shape (n,)
        Keys, the lowest one first, and the number of each.
    length : ndarray of int64, shape (1,)
        Number of entries of the heap.
    """

    @property
    def keys(self) -> Floats: ...
    @property
    def queue(self) -> Ints: ...
    @property
    def length(self) -> Ints: ...


@kernel
def push(heap: Heap, key: float, number: int) -> None:
    """Add a number to a binary heap in a record, with smaller keys first."""
    keys = heap.keys
    queue = heap.queue
    position = heap.length[0]
    heap.length[0] += 1
    # Entries with larger keys move down, from the last place towards the root.
    while position > 0:
        parent = (position - 1) // 2
        if keys[parent] <= key:
            break
        keys[position] = keys[parent]
        queue[position] = queue[parent]
        position = parent
    keys[position] = key
    queue[position] = number


@internal
def pop_first(heap: Heap) -> None:
    """Remove the number of the lowest key from a binary heap in a record."""
    keys = heap.keys
    queue = heap.queue
    heap.length[0] -= 1
    count = heap.length[0]
    # The last entry sinks from the root.
    key = keys[count]
    number = queue[count]
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
    queue[position] = number
