"""The outer door: functions of wings that are methods of the core's classes.

The stub beside this module lists them. A class takes one by ``name = _outside.name``, and the wing
is imported when somebody asks for the method.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MethodType
from typing import Any, Final

from cspace._support import import_in_turn
from cspace._support.check import names_options

HOMES: Final = {
    node.names[0].name: f"cspace.{node.module}"
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom)
}
"""Modules of the functions."""


class WingMethod:
    """A method that is a function of a wing."""

    def __init__(self, name: str) -> None:
        """Remember the function's name, and import nothing yet."""
        self._name = name

    def __get__(self, instance: object | None, owner: type) -> Callable[..., Any]:
        """Return the function, bound to the object that is asked for it."""
        function = _load(self._name)
        return function if instance is None else MethodType(function, instance)


@cache
def _load(name: str) -> Callable[..., Any]:
    """Import a function, and let it check names and truth values of its options."""
    return names_options(getattr(import_in_turn(import_module, HOMES[name]), name))


def __getattr__(name: str) -> WingMethod:
    """Return a method of any class."""
    if name not in HOMES:
        raise AttributeError(f"no wing has a method {name}")
    return WingMethod(name)
