"""Values that are made at the first call and kept, by one thread."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


class Once:
    """A store of values by name, each made once however many threads ask for it."""

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}
        self._lock = threading.RLock()

    def __call__(self, key: str, make: Callable[[], T]) -> T:
        """What ``make`` gave when it was first asked for under this key."""
        if key not in self._made:
            with self._lock:
                if key not in self._made:
                    self._made[key] = make()
        value: T = self._made[key]
        return value
