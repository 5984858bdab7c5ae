"""Deadlines that OMPL keeps.

OMPL asks between two steps of a planner whether to go on, and a single step, or the simplification of a path, may ask
for thousands of edges. After the deadline those are no longer answered by the map but by a plain no, so that whatever
runs is soon through and keeps the best path that it has; and where even that is not enough, by an exception.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Final, Protocol

GRACE: Final = 0.1
"""Seconds after a deadline from which on callbacks raise."""


class OutOfTime(Exception):  # noqa: N818 - it ends a search, and is no error
    """Raised through OMPL, and caught where OMPL was called."""


class Callbacks(Protocol):
    """What OMPL calls: a checker, a validator or an objective."""

    def answer_with(self, answer: Callable[..., Any] | None) -> None:
        """Answer by a function from now on, or as before where there is none."""


class Deadline:
    """A context in which OMPL's callbacks end their work after some seconds; on leaving, they are as before.

    A thread of its own waits for the time, so that no callback has to look at the clock.

    Parameters
    ----------
    seconds : float
    refusing : sequence of Callbacks
        Those that answer no after the deadline.
    raising : sequence of Callbacks
        Those that raise :class:`OutOfTime` from :data:`GRACE` later on.
    """

    def __init__(self, seconds: float, refusing: Sequence[Callbacks], raising: Sequence[Callbacks] = ()) -> None:
        self._end = time.perf_counter() + seconds
        self._refusing, self._raising = refusing, raising
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._wait, name="planners deadline", daemon=True)

    @property
    def left(self) -> float:
        """Seconds that are left, zero or above."""
        return max(0.0, self._end - time.perf_counter())

    def __enter__(self) -> Deadline:
        self._watch.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._over.set()
        self._watch.join()
        _answer((*self._refusing, *self._raising), None)

    def _wait(self) -> None:
        if not self._over.wait(min(self.left, threading.TIMEOUT_MAX)):
            _answer(self._refusing, _refuse)
            if not self._over.wait(GRACE):
                _answer(self._raising, _raise)


def _answer(callbacks: Sequence[Callbacks], answer: Callable[..., Any] | None) -> None:
    for each in callbacks:
        each.answer_with(answer)


def _refuse(*asked: Any) -> bool:
    return False


def _raise(*asked: Any) -> bool:
    raise OutOfTime
