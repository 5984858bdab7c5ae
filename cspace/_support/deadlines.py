"""Ends of searches: by their work, by the clock, or by the caller's word.

Searches count their steps. Equal searches do the same work before they end, on any machine and
however busy it is, so they return equal paths unless the clock or the caller ends them.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from typing import Final

from cspace._support.check import check_positive
from cspace._support.compiling import clock
from cspace._support.interrupts import hold_exit

NANOSECONDS: Final = 1e9
"""Nanoseconds in a second."""

PATIENCE: Final = 60.0
"""Time that work may take, relative to that on an idle machine, if no time limit is given."""


@dataclass(frozen=True, slots=True)
class Effort:
    """Work and time: of a search, or up to its end.

    Attributes
    ----------
    work : float
        Nanoseconds that the counted steps take on an idle machine; a whole number, or infinite, so
        that sums are exact.
    seconds : float
        Time by the clock that stops while functions are compiled.
    """

    work: float
    seconds: float

    def __add__(self, other: Effort) -> Effort:
        """Add work and time."""
        return Effort(self.work + other.work, self.seconds + other.seconds)

    def __sub__(self, other: Effort) -> Effort:
        """Subtract work and time."""
        return Effort(self.work - other.work, self.seconds - other.seconds)

    @classmethod
    def from_seconds(cls, work_seconds: float, seconds: float) -> Effort:
        """Return an effort of work in seconds, which is rounded to nanoseconds."""
        if math.isinf(work_seconds):
            return cls(work_seconds, seconds)
        return cls(float(round(NANOSECONDS * work_seconds)), seconds)

    @classmethod
    def within(cls, time_limit: float | None, default: float = math.inf) -> Effort:
        """Return the limit of a search by a caller's seconds; without any, by ``default`` of work.

        Raises InputError if the time limit is not positive.
        """
        if time_limit is None:
            return cls.from_seconds(default, PATIENCE * default)
        seconds = check_positive(time_limit, "time_limit", "seconds")
        # Work that a given time limit admits, relative to that of an idle machine in this time; the
        # clock ends nearly all searches before.
        return cls.from_seconds(2.0 * seconds, seconds)

    @staticmethod
    @contextmanager
    def stopping(function: Callable[[], bool] | None) -> Iterator[None]:
        """End this thread's searches within the block once a function returns True."""
        token = _stop.set(None if function is None else _Stop(function))
        try:
            yield
        finally:
            _stop.reset(token)

    hold_exit = staticmethod(hold_exit)

    def share(self, factor: float) -> Effort:
        """Return a share of both."""
        return Effort.from_seconds(factor * self.work_seconds, factor * self.seconds)

    def at_most(self, other: Effort) -> Effort:
        """Return the smaller work and the smaller time."""
        return Effort(min(self.work, other.work), min(self.seconds, other.seconds))

    @property
    def work_seconds(self) -> float:
        """The work in seconds."""
        return self.work / NANOSECONDS

    @property
    def is_left(self) -> bool:
        """Whether both are positive."""
        return self.work > 0.0 and self.seconds > 0.0

    def seconds_late(self) -> float:
        """Return the seconds of work, or of the clock, since this reading; negative before."""
        return max((_work.done - self.work) / NANOSECONDS, clock() - self.seconds)


NEVER: Final = Effort(math.inf, math.inf)
"""The limit of a search without end."""


class _Work(threading.local):
    """Work of this thread, nanoseconds."""

    done = 0.0


_work: Final = _Work()


def spend(nanoseconds: float) -> None:
    """Count steps of a search, by the whole nanoseconds that they take on an idle machine."""
    _work.done += nanoseconds


def now() -> Effort:
    """Return a reading of this thread's work and of the clock."""
    return Effort(_work.done, clock())


class _Stop:
    """The caller's function, called now and then until it returns True."""

    def __init__(self, function: Callable[[], bool]) -> None:
        self._function = function
        self._next_call = 0.0
        self._is_set = False

    def __call__(self) -> bool:
        """Return True if the function has returned True."""
        moment = time.monotonic()
        if not self._is_set and moment >= self._next_call:
            self._is_set = bool(self._function())
            # Least time between two calls of the caller's function, which may take longer than an
            # edge.
            self._next_call = moment + 0.005
        return self._is_set


_stop: ContextVar[_Stop | None] = ContextVar("stop", default=None)


def is_over(until: Effort) -> bool:
    """Return True at the end of a search, or after the caller's stop.

    Without a limit, that of :data:`NEVER`, it is the caller's stop alone.
    """
    stop = _stop.get()
    return until.seconds_late() >= 0.0 or (stop is not None and stop())
