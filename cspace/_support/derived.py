"""Attributes that a map computes at first access, and drops when its cells change."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any, Generic, Protocol, Self, TypeVar, overload

Part = TypeVar("Part")


class Locked(Protocol):
    """An object whose parts share one lock."""

    lock: AbstractContextManager[Any]


class lazy(Generic[Part]):  # noqa: N801 - used as a decorator
    """Turn a method into an attribute, computed at first access.

    One thread computes the part and any others wait: all parts of an object share its lock
    ``lock``, which an update holds while it changes the object. Copies and pickles of the object
    must omit its ``__dict__``, where parts are kept.
    """

    def __init__(self, make: Callable[[Any], Part]) -> None:
        """Store the method, and copy its name and docstring."""
        self._make = make
        self._name = make.__name__
        self.__doc__ = make.__doc__

    @overload
    def __get__(self, owner: None, kind: type | None = None) -> Self: ...
    @overload
    def __get__(self, owner: Locked, kind: type | None = None) -> Part: ...
    def __get__(self, owner: Locked | None, kind: type | None = None) -> Self | Part:
        """Return the attribute, computed at first access; on a class, the descriptor."""
        if owner is None:
            return self
        # Python looks in __dict__ before it calls __get__, so a computed part is accessed without
        # this method.
        parts = vars(owner)
        with owner.lock:
            if self._name not in parts:
                parts[self._name] = self._make(owner)
            part: Part = parts[self._name]
            return part


class derived(lazy[Part]):  # noqa: N801 - used as a decorator
    """Turn a method into an attribute that depends on the cells of a map."""

    @staticmethod
    def drop(owner: Locked) -> None:
        """Discard derived attributes, to compute them anew."""
        with owner.lock:
            for name in list(vars(owner)):
                # A subclass inherits the descriptors of its parents.
                if isinstance(getattr(type(owner), name, None), derived):
                    del vars(owner)[name]
