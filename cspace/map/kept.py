"""Kept parts: what look-ups need beyond the map itself, made at the first call and brought up to date after changes."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import ClassVar, Generic, Protocol, TypeVar
from weakref import ReferenceType, ref

import numpy as np
from numpy.typing import NDArray

from cspace.placed import Scene
from cspace.workspace import Workspace

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Change:
    """What an update of the workspace did to a map.

    Boxes hold the first and the last cell along x, y and z, six numbers; in the plane x is 0, and y and z stand for the
    two axes. A box is empty where a first number is beyond the last.

    Attributes
    ----------
    workspace : Workspace
        As it is now.
    scene : Scene or None
        What its cells come from, where obstacles were placed.
    cells : ndarray of int64, shape (6,)
        The box around the workspace cells that differ.
    states : ndarray of int64, shape (slices, 6)
        Of each slice, the box around the states that differ.
    changed : int
        Number of states that differ, over all rotation cells.
    """

    workspace: Workspace
    scene: Scene | None
    cells: Ints
    states: Ints
    changed: int


class Part(Protocol):
    """What is derived from a map and follows its changes."""

    def renew(self, change: Change) -> None:
        """Be what would be made from the map now. To be told twice of one change does no harm."""


T = TypeVar("T")
P = TypeVar("P", bound=Part)


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

    Parameters
    ----------
    lock : Lock
        Shared by all parts of a map, and held while one is made. An update holds it while it changes the map.
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

    def renew(self: Kept[P], change: Change) -> None:
        """Have the part follow a change of the map, if it was made."""
        with self._lock:
            if self._part is not None:
                self._part.renew(change)

    def drop(self) -> None:
        """Forget the part; it is made again when it is next asked for. One that is being made is waited for."""
        with self._lock:
            self._part = None
