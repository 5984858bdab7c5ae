"""Threads for compiled loops, which release the GIL and write to separate memory."""

from __future__ import annotations

import itertools
import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

MIN_ITEMS_PER_THREAD = 50_000
"""Number of items below which a second thread costs more than it saves."""

_local = threading.local()  # has the attribute is_worker in threads that are started here


def count_cores() -> int:
    """Return the number of cores for this process."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_in_chunks(
    work: Callable[[int, int], int], size: int, min_items: int = MIN_ITEMS_PER_THREAD
) -> int:
    """Call ``work(start, stop)`` for chunks in threads.

    The chunks cover ``range(size)``, one for each thread, and have at least ``min_items``. Each
    call returns the index, relative to ``start``, of the first bad item of its chunk, or a negative
    number. Returns the index of the first bad item of the range, or the largest of these numbers.
    Nested calls run serially.
    """
    if size < 2 * min_items:  # for one thread, at once, because most queries are small
        return work(0, size)
    threads = min(count_cores(), size // min_items)
    bounds = [size * k // threads for k in range(threads + 1)]
    chunks = list(itertools.pairwise(bounds))
    indices = map_in_threads(lambda chunk: work(*chunk), chunks, threads)
    for (start, _), index in zip(chunks, indices, strict=True):
        if index >= 0:
            return start + index
    return max(indices)


def map_in_threads(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    threads: int,
    progress: Callable[[int], None] | None = None,
) -> list[Result]:
    """Return ``[work(item) for item in items]``, computed in threads.

    ``progress`` is called with the number of items done. An exception or Ctrl-C cancels the items
    that have not begun. Nested calls run serially.
    """
    threads = min(threads, len(items))
    if threads <= 1 or getattr(_local, "is_worker", False):
        return _gather(map(work, items), progress)
    with ThreadPoolExecutor(threads, initializer=_mark_worker) as pool:
        try:
            try:
                results = pool.map(work, items)
            except RuntimeError:  # Python ends, and starts no more threads
                pool.shutdown(cancel_futures=True)
                results = map(work, items)
            return _gather(results, progress)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _mark_worker() -> None:
    """Mark this thread as a worker, in which nested calls run serially."""
    _local.is_worker = True


def _gather(results: Iterable[Result], progress: Callable[[int], None] | None) -> list[Result]:
    """Return results as a list, and report their number to ``progress``."""
    gathered = []
    for count, result in enumerate(results, start=1):
        gathered.append(result)
        if progress is not None:
            progress(count)
    return gathered
