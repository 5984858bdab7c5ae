"""Work in threads: compiled loops release the GIL, and share nothing that they write."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

LEAST = 50_000
"""Elements below which a second thread costs more than it saves."""

_here = threading.local()  # whether this thread is one of several already


def cores() -> int:
    """Number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_chunks(work: Callable[[int, int], int], size: int, least: int = LEAST) -> int:
    """Call ``work(start, stop)`` over chunks of ``range(size)``, in threads where that pays.

    Each call gives the index, from ``start``, of the first bad element of its chunk, or -1; so does this, of all. A
    chunk of fewer than ``least`` is not worth a thread. What the work itself would do in chunks, it does alone.
    """
    threads = 1 if getattr(_here, "shared", False) else min(cores(), max(1, size // least))
    if threads == 1:
        return work(0, size)
    bounds = [size * k // threads for k in range(threads + 1)]
    with ThreadPoolExecutor(threads, initializer=_share) as pool:
        bad = list(pool.map(work, bounds[:-1], bounds[1:]))
    return next((start + index for start, index in zip(bounds, bad, strict=False) if index >= 0), -1)


def in_threads(
    work: Callable[[Item], Result],
    items: Sequence[Item],
    threads: int,
    progress: Callable[[int], None] | None = None,
) -> list[Result]:
    """Results for all items; a failure or Ctrl-C stops those that have not begun.

    What the work itself would do in chunks, it does alone.
    """
    threads = min(threads, len(items))
    if threads == 1:
        return _gather(map(work, items), progress)
    with ThreadPoolExecutor(threads, initializer=_share) as pool:
        try:
            return _gather(pool.map(work, items), progress)
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


def _share() -> None:
    _here.shared = True


def _gather(done: Iterable[Result], progress: Callable[[int], None] | None) -> list[Result]:
    results = []
    for number, result in enumerate(done, start=1):
        results.append(result)
        if progress is not None:
            progress(number)
    return results
