"""Backends of a map, which store cells and run kernels."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol, TypeVar

from cspace.map.batches import Kernel, Query, in_threaded_chunks
from cspace.map.derived import Lock
from cspace.map.periodic import Periodic
from cspace.map.storage import Map
from cspace.threads import MIN_ITEMS_PER_THREAD

Result = TypeVar("Result")


class Backend(Protocol):
    """Cells of a map, over which compiled kernels run."""

    def query(self, kernel: Kernel, *arguments: Any, passed: object = None, least: int = MIN_ITEMS_PER_THREAD) -> Query:
        """Return a query that runs a kernel over the rows of a batch.

        The kernel is called as ``kernel(map_, *arguments, *rows, out)`` with the record of the map. ``passed`` is its
        result for a row if all cells it reads are FREE. Each thread gets at least ``least`` rows.
        """

    def at_one_moment(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` on a consistent state of the map."""


@dataclass(frozen=True, slots=True)
class MemoryBackend:
    """Cells in memory, in bytes or in two bits.

    Attributes
    ----------
    map_ : Map
        Record of the map, with periodic axes unrolled; it follows updates.
    periodic : Periodic
        Periodic axes.
    lock : Lock
        Held by an update while it changes cells.
    """

    map_: Map
    periodic: Periodic
    lock: Lock

    def query(self, kernel: Kernel, *arguments: Any, passed: object = None, least: int = MIN_ITEMS_PER_THREAD) -> Query:
        """Return a query; see :meth:`Backend.query`."""
        run = partial(kernel, self.map_, *arguments)
        return in_threaded_chunks(self.periodic.wrap_rows(run) if self.periodic else run, least)

    def at_one_moment(self, work: Callable[[], Result]) -> Result:
        """Run ``work`` under the lock; see :meth:`Backend.at_one_moment`."""
        with self.lock:
            return work()
