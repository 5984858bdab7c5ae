"""Attributes computed at first access and refreshed later."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, ClassVar, Generic, ParamSpec, Protocol, Self, TypeVar, overload
from weakref import ReferenceType, ref

Part = TypeVar("Part")
P = ParamSpec("P")


class Refreshable(Protocol[P]):
    """A cached part that follows changes of its map."""

    def refresh(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Update to the current map; a repeated call changes nothing."""


class Lock:
    """Reentrant lock for the parts of one map.

    A copy gets a new lock. A process forks only while no other thread holds a lock. The child has no other threads, so
    it would wait forever, or find parts half made.
    """

    _all: ClassVar[set[ReferenceType[Lock]]] = set()
    _held: ClassVar = threading.local()

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._all.add(ref(self, self._all.discard))

    @classmethod
    def _acquire_all(cls) -> None:
        """Acquire all locks, before a fork."""
        cls._held.locks = [lock for each in tuple(cls._all) if (lock := each()) is not None]
        for lock in cls._held.locks:
            lock.__enter__()

    @classmethod
    def _release_all(cls) -> None:
        """Release all locks, after a fork."""
        for lock in cls._held.__dict__.pop("locks"):
            lock.__exit__(None, None, None)

    def __enter__(self) -> None:
        """Acquire the lock."""
        self._lock.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release the lock."""
        self._lock.release()

    def __reduce__(self) -> tuple[type[Lock], tuple[()]]:
        """Pickle as a new lock."""
        return Lock, ()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=Lock._acquire_all, after_in_parent=Lock._release_all, after_in_child=Lock._release_all)


class Locked(Protocol):
    """An object whose parts share one lock."""

    _lock: Lock


class lazy(Generic[Part]):  # noqa: N801 - used as a decorator
    """Turn a method into an attribute, computed at first access.

    One thread computes the part and any others wait. All parts of an object share its lock ``_lock``. An update holds
    the lock while it changes the object. Copies and pickles of the object must omit its ``__dict__``, where parts are
    cached.
    """

    def __init__(self, make: Callable[[Any], Part]) -> None:
        self._make, self._name = make, make.__name__
        self.__doc__ = make.__doc__

    @overload
    def __get__(self, owner: None, kind: type | None = None) -> Self: ...
    @overload
    def __get__(self, owner: Locked, kind: type | None = None) -> Part: ...
    def __get__(self, owner: Locked | None, kind: type | None = None) -> Self | Part:
        """Return the cached part, computed at first access."""
        if owner is None:
            return self
        # Python looks in __dict__ before it calls __get__, so cached parts cost nothing.
        parts = vars(owner)
        with owner._lock:
            if self._name not in parts:
                parts[self._name] = self._make(owner)
            part: Part = parts[self._name]
            return part

    def cached(self, owner: Locked) -> Part | None:
        """Return the value cached in ``owner``, or None."""
        part: Part | None = vars(owner).get(self._name)
        return part

    def refresh(self: lazy[Refreshable[P]], owner: Locked, *args: P.args, **kwargs: P.kwargs) -> None:
        """Refresh the value cached in ``owner``, if any, with the arguments."""
        with owner._lock:
            part = self.cached(owner)
            if part is not None:
                part.refresh(*args, **kwargs)

    def drop(self, owner: Locked) -> None:
        """Discard the value cached in ``owner``; the next access computes it.

        If another thread is computing the value, wait for it first.
        """
        with owner._lock:
            vars(owner).pop(self._name, None)
