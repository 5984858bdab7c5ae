"""Ends of searches: a reading of the clock, or the caller's word."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from cspace._support.compiling import clock


class _Stop:
    """The caller's function, called now and then until it returns True."""

    def __init__(self, function: Callable[[], bool]) -> None:
        self._function = function
        self._next_call = 0.0
        self._is_set = False

    def __call__(self) -> bool:
        """Return True if the function has returned True."""
        now = time.monotonic()
        if not self._is_set and now >= self._next_call:
            self._is_set = bool(self._function())
            # Least time between two calls of the caller's function, which may take longer than an
            # edge.
            self._next_call = now + 0.005
        return self._is_set


_stop: ContextVar[_Stop | None] = ContextVar("stop", default=None)


@contextmanager
def stopping(function: Callable[[], bool] | None) -> Iterator[None]:
    """End this thread's searches once a function returns True."""
    token = _stop.set(None if function is None else _Stop(function))
    try:
        yield
    finally:
        _stop.reset(token)


def is_stopped() -> bool:
    """Return True if the caller has ended the search."""
    stop = _stop.get()
    return stop is not None and stop()


def is_over(until: float) -> bool:
    """Return True after a reading of the clock or the caller's stop."""
    return clock() >= until or is_stopped()
