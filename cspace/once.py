"""Values that are made at the first call and kept, by one thread, until they are dropped."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, Final, TypeVar

T = TypeVar("T")

_MISSING: Final = object()


class Once:
    """A store of values by name, each made once however many threads ask for it.

    Attributes
    ----------
    lock : threading.RLock
        Held while a value is made. Who holds it may change what values are made from.
    """

    def __init__(self) -> None:
        self._made: dict[str, Any] = {}
        self.lock = threading.RLock()

    def __call__(self, key: str, make: Callable[[], T]) -> T:
        """What ``make`` gave when it was first asked for under this key."""
        value: Any = self._made.get(key, _MISSING)
        if value is _MISSING:
            with self.lock:
                value = self._made.get(key, _MISSING)
                if value is _MISSING:
                    value = self._made[key] = make()
        found: T = value
        return found

    def made(self, key: str) -> Any:
        """The value under a key, or None where it was not asked for yet."""
        return self._made.get(key)

    def put(self, key: str, value: Any) -> None:
        """Keep another value under a key from now on."""
        with self.lock:
            self._made[key] = value

    def drop(self, *keys: str) -> None:
        """Forget values; they are made again when they are next asked for. A value that is being made is waited for."""
        with self.lock:
            for key in keys:
                self._made.pop(key, None)
