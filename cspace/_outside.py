"""The outer door: functions of wings that the core calls, mostly as methods of its classes.

The stub beside this module lists them. A class takes one as a method by ``name = _outside.name``,
and the wing is imported when somebody asks for it. No other call of the core leads to a wing.
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
from cspace.errors import MissingPackageError

HOMES: Final = {
    node.names[0].name: f"cspace.{node.module}"
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom)
}
"""Modules of the functions."""


class WingFunction:
    """A function of a wing, as a method of the class that takes it."""

    def __init__(self, name: str) -> None:
        """Remember the function's name, and import nothing yet."""
        self._name = name

    def __get__(self, instance: object | None, owner: type) -> Callable[..., Any]:
        """Return the function, bound to an object of the class."""
        function = _load(self._name)
        return function if instance is None else MethodType(function, instance)

    def __call__(self, *values: Any, **options: Any) -> Any:
        """Call the function."""
        return _load(self._name)(*values, **options)


@cache
def _load(name: str) -> Callable[..., Any]:
    """Import a function, and let it check names and truth values of its options.

    Raises MissingPackageError if its wing is missing.
    """
    home = HOMES[name]
    try:
        module = import_in_turn(import_module, home)
    except ModuleNotFoundError as error:
        if error.name is None or not home.startswith(error.name):
            raise  # another package is missing
        problem = "is missing"
        rule = f"{name} is a function of this part of cspace"
        raise MissingPackageError(error.name, problem, rule) from error
    return names_options(getattr(module, name))


def __getattr__(name: str) -> WingFunction:
    """Return a function of a wing, which is imported when it is needed."""
    if name not in HOMES:
        raise AttributeError(f"no wing has a function {name}")
    return WingFunction(name)
