"""Timing of alternating calls, and memory of a call."""

from __future__ import annotations

import contextlib
import math
import os
import statistics
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Timing:
    """Wall and CPU times of the runs of one call, and the value of the first run.

    If other work slows the machine, CPU times are more reliable.
    """

    value: Any
    seconds: list[float] = field(default_factory=list)
    cpu: list[float] = field(default_factory=list)

    def take(self, call: Callable[[], Any]) -> Any:
        """Run a call, store its times, and return its value."""
        start, cpu = time.perf_counter(), time.process_time()
        value = call()
        self.seconds.append(time.perf_counter() - start)
        self.cpu.append(time.process_time() - cpu)
        return value

    def forget(self) -> None:
        """Drop the times so far."""
        self.seconds.clear()
        self.cpu.clear()

    @property
    def median(self) -> float:
        """Median wall time in seconds."""
        return statistics.median(self.seconds)

    @property
    def median_cpu(self) -> float:
        """Median CPU time in seconds."""
        return statistics.median(self.cpu)

    def per(self, number: float) -> Timing:
        """Return the times per item of a call that handles a number of items."""
        return Timing(
            self.value,
            [taken / number for taken in self.seconds],
            [taken / number for taken in self.cpu],
        )


def once(call: Callable[[], Any]) -> Timing:
    """Time a single run of a slow call."""
    timing = Timing(None)
    timing.value = timing.take(call)
    return timing


def interleave(
    calls: Mapping[str, Callable[[], Any]], runs: int, slow: float = math.inf
) -> dict[str, Timing]:
    """Time calls alternately, so that other work affects all calls equally.

    Parameters
    ----------
    calls : mapping of str to callable
    runs : int
        Timed runs of each call, after an untimed run. Each round begins with another call.
    slow : float
        A call whose first run takes longer, in seconds, is not repeated; that run counts.

    Returns
    -------
    dict of str to Timing
        In the order of ``calls``; ``value`` is from the first run.
    """
    timings = {name: once(call) for name, call in calls.items()}
    names = [name for name in calls if timings[name].seconds[0] <= slow]
    for name in names:
        timings[name].forget()
    for turn in range(runs if names else 0):
        first = turn % len(names)
        for name in names[first:] + names[:first]:
            timings[name].take(calls[name])
    return timings


def memory_rise(call: Callable[[], Any]) -> float | None:
    """Return the peak rise of resident memory in bytes, or None without psutil."""
    try:
        import psutil
    except ImportError:
        return None
    process = psutil.Process()
    before = highest = process.memory_info().rss
    done = threading.Event()

    def watch() -> None:
        nonlocal highest
        while not done.wait(0.001):
            highest = max(highest, process.memory_info().rss)

    watcher = threading.Thread(target=watch)
    watcher.start()
    try:
        result = call()
        highest = max(highest, process.memory_info().rss)
        del result
    finally:
        done.set()
        watcher.join()
    return float(highest - before)


@contextlib.contextmanager
def one_core() -> Iterator[bool]:
    """Keep this thread and its children on one core; yield False if impossible."""
    if not hasattr(os, "sched_setaffinity"):
        yield False
        return
    allowed = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(allowed)})
    try:
        yield True
    finally:
        os.sched_setaffinity(0, allowed)
