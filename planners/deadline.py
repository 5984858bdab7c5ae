"""Deadlines that OMPL keeps.

OMPL checks its termination condition between two steps of a planner, and a single step, or the simplification of a
path, may check thousands of edges. After the deadline these are all refused without a look-up, so that whatever runs
ends soon and keeps the best path that it has; where even that is not enough, an exception ends it.
"""

from __future__ import annotations

import math
import os
import threading
from collections.abc import Callable, Sequence
from functools import partial
from operator import itemgetter
from types import TracebackType
from typing import Any, Final, Protocol

from cspace.compiling import clock

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

    A thread waits for the time, one for all deadlines, so that no callback has to look at the clock.

    Parameters
    ----------
    seconds : float
    refusing : sequence of Callbacks
        Those that answer no after the deadline.
    raising : sequence of Callbacks
        Those that raise :class:`OutOfTime` from :data:`GRACE` later on.
    """

    def __init__(self, seconds: float, refusing: Sequence[Callbacks], raising: Sequence[Callbacks] = ()) -> None:
        self._end = clock() + seconds
        self._refusing, self._raising = refusing, raising

    @property
    def left(self) -> float:
        """Seconds that are left, zero or above."""
        return max(0.0, self._end - clock())

    def __enter__(self) -> Deadline:
        _watch.add(self._end, self, partial(_answer, self._refusing, _refuse))
        if self._raising:
            _watch.add(self._end + GRACE, self, partial(_answer, self._raising, _raise))
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        _watch.forget(self)
        _answer((*self._refusing, *self._raising), None)


class _Watch:
    """A thread that calls functions at their times; it is started at the first one, and wakes up only where it must."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._calls: list[tuple[float, object, Callable[[], None]]] = []
        self._thread: threading.Thread | None = None
        self._wakes = math.inf

    def add(self, at: float, owner: object, call: Callable[[], None]) -> None:
        """Call a function at a time, by :data:`cspace.compiling.clock`, unless its owner is forgotten before."""
        with self._changed:
            self._calls.append((at, owner, call))
            if self._thread is None or not self._thread.is_alive():
                self._thread = threading.Thread(target=self._run, name="planners deadlines", daemon=True)
                self._thread.start()
            elif at < self._wakes:
                self._changed.notify()

    def forget(self, owner: object) -> None:
        """Call nothing of an owner any more; what is under way is waited for."""
        with self._changed:
            self._calls = [each for each in self._calls if each[1] is not owner]

    def _run(self) -> None:
        with self._changed:
            while True:
                self._call_due()
                self._wakes = min((at for at, _, _ in self._calls), default=math.inf)
                self._changed.wait(None if self._wakes == math.inf else self._wakes - clock())

    def _call_due(self) -> None:
        # In a function of its own, so that the thread holds on to no callback while it waits.
        now = clock()
        due = sorted((each for each in self._calls if each[0] <= now), key=itemgetter(0))
        self._calls = [each for each in self._calls if each[0] > now]
        for _, _, call in due:
            call()


_watch = _Watch()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_watch.__init__)  # type: ignore[misc]  # a forked process has no such thread


def _answer(callbacks: Sequence[Callbacks], answer: Callable[..., Any] | None) -> None:
    for each in callbacks:
        each.answer_with(answer)


def _refuse(*asked: Any) -> bool:
    return False


def _raise(*asked: Any) -> bool:
    raise OutOfTime
