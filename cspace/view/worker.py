"""Work that is done in threads of its own, so that a page never waits for it."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Worker:
    """Does some work at each request; once for all requests that come while it is busy.

    ``fail`` is given what the work raises; the next time it is done again.
    """

    def __init__(self, work: Callable[[], None], fail: Callable[[Exception], None]) -> None:
        self._work, self._fail = work, fail
        self._changed = threading.Condition()
        self._requested, self._busy, self._open = False, False, True
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def request(self) -> None:
        """Have the work done, once what is under way is done."""
        with self._changed:
            self._requested = True
            self._changed.notify_all()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait until all that was requested is done; gives whether it is."""
        with self._changed:
            return self._changed.wait_for(lambda: not (self._requested or self._busy), seconds)

    def close(self) -> None:
        """Do nothing more, once what is under way is done."""
        with self._changed:
            self._open = self._requested = False
            self._changed.notify_all()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._busy = False
                self._changed.notify_all()
                self._changed.wait_for(lambda: self._requested or not self._open)
                if not self._open:
                    return
                self._requested, self._busy = False, True
            try:
                self._work()
            except Exception as error:  # whatever it is, the page goes on
                if self._open:
                    self._fail(error)
