"""Attributes of a map that are computed at the first access and follow its changes."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Any, ClassVar, Generic, ParamSpec, Protocol, Self, TypeVar, overload
from weakref import ReferenceType, ref

T = TypeVar("T")
P = ParamSpec("P")


class Refreshable(Protocol[P]):
    """A cached part of a map that follows its changes."""

    def refresh(self, *args: P.args, **kwargs: P.kwargs) -> None:
        """Become what would be made from the map now; to renew twice after one change does no harm."""


class Lock:
    """A lock for the parts of one map, which one thread may take several times; a copy gets a lock of its own.

    A process is forked when no other thread holds one: the child has none of those threads, so that it would wait for
    them forever, and find parts half made.
    """

    _all: ClassVar[set[ReferenceType[Lock]]] = set()
    _held: ClassVar = threading.local()

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._all.add(ref(self, self._all.discard))

    @classmethod
    def _hold(cls) -> None:
        cls._held.locks = [lock for each in tuple(cls._all) if (lock := each()) is not None]
        for lock in cls._held.locks:
            lock.__enter__()

    @classmethod
    def _let_go(cls) -> None:
        for lock in cls._held.__dict__.pop("locks"):
            lock.__exit__(None, None, None)

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()

    def __reduce__(self) -> tuple[type[Lock], tuple[()]]:
        return Lock, ()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(before=Lock._hold, after_in_parent=Lock._let_go, after_in_child=Lock._let_go)


class Locked(Protocol):
    """An object whose parts share one lock."""

    _lock: Lock


class lazy(Generic[T]):  # noqa: N801 - used as a decorator
    """Turn a method into an attribute that is computed at the first access and cached.

    One thread computes the part, however many ask for it, and the others wait. All parts of an object share the lock
    ``_lock`` of the object. An update holds the lock while it changes the object. Copies and pickles of the object must
    leave its ``__dict__``, where parts are cached, behind.
    """

    def __init__(self, make: Callable[[Any], T]) -> None:
        self._make, self._name = make, make.__name__
        self.__doc__ = make.__doc__

    @overload
    def __get__(self, owner: None, kind: type | None = None) -> Self: ...
    @overload
    def __get__(self, owner: Locked, kind: type | None = None) -> T: ...
    def __get__(self, owner: Locked | None, kind: type | None = None) -> Self | T:
        if owner is None:
            return self
        # Python finds a cached part in __dict__ before it comes here.
        parts = vars(owner)
        with owner._lock:
            if self._name not in parts:
                parts[self._name] = self._make(owner)
            part: T = parts[self._name]
            return part

    def cached(self, owner: Locked) -> T | None:
        """Return the part, or None if it is not cached."""
        part: T | None = vars(owner).get(self._name)
        return part

    def refresh(self: lazy[Refreshable[P]], owner: Locked, *args: P.args, **kwargs: P.kwargs) -> None:
        """Call ``refresh`` of the part with the arguments, if it is cached."""
        with owner._lock:
            part = self.cached(owner)
            if part is not None:
                part.refresh(*args, **kwargs)

    def drop(self, owner: Locked) -> None:
        """Forget the part, after waiting for a thread that computes it; the next access computes it again."""
        with owner._lock:
            vars(owner).pop(self._name, None)
