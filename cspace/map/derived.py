"""What look-ups derive from a map: made at the first call, and brought up to date when the map changes."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from types import TracebackType
from typing import ClassVar, Generic, ParamSpec, Protocol, TypeVar
from weakref import ReferenceType, ref

T = TypeVar("T")
P = ParamSpec("P")


class Part(Protocol[P]):
    """What is derived from a map and follows its changes."""

    def renew(self, *args: P.args, **kwargs: P.kwargs) -> None:
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


class Derived(Generic[T]):
    """A part that one thread makes at the first call, however many call.

    Pickles and copies leave the part out; their first call makes it again. All parts of a map share one lock, which is
    held while a part is made, and by an update while it changes the map.
    """

    __slots__ = ("_lock", "_part")

    def __init__(self, lock: Lock) -> None:
        self._lock = lock
        self._part: T | None = None

    def __reduce__(self) -> tuple[type[Derived[T]], tuple[Lock]]:
        return Derived, (self._lock,)

    def get(self, make: Callable[[], T]) -> T:
        """The part; what ``make`` gives if there is none yet. It must not be None."""
        part = self._part
        if part is None:
            with self._lock:
                part = self._part
                if part is None:
                    part = self._part = make()
        return part

    @property
    def made(self) -> T | None:
        """The part, or None where there is none yet."""
        return self._part

    def renew(self: Derived[Part[P]], *args: P.args, **kwargs: P.kwargs) -> None:
        """Renew the part, if it was made, with the arguments of its own ``renew``."""
        with self._lock:
            if self._part is not None:
                self._part.renew(*args, **kwargs)

    def drop(self) -> None:
        """Forget the part, after waiting for one that is being made; the next call makes it again."""
        with self._lock:
            self._part = None
