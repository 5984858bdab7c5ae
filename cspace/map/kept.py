"""Kept parts: what look-ups need beyond the map itself, made at the first call and brought up to date after changes."""

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
        """Be what would be made from the map now. To be told twice of one change does no harm."""


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


class Kept(Generic[T]):
    """Room for one part, which is made at the first call, by one thread, however many ask for it.

    Pickles and copies have the room without the part, which is made again when it is next asked for.

    The lock is shared by all parts of a map, and held while one is made. An update holds it while it changes the map.
    """

    __slots__ = ("_lock", "_part")

    def __init__(self, lock: Lock) -> None:
        self._lock = lock
        self._part: T | None = None

    def __reduce__(self) -> tuple[type[Kept[T]], tuple[Lock]]:
        return Kept, (self._lock,)

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

    def renew(self: Kept[Part[P]], *args: P.args, **kwargs: P.kwargs) -> None:
        """Have the part, if it was made, follow a change of the map, by what its ``renew`` takes."""
        with self._lock:
            if self._part is not None:
                self._part.renew(*args, **kwargs)

    def drop(self) -> None:
        """Forget the part; it is made again when it is next asked for. One that is being made is waited for."""
        with self._lock:
            self._part = None
