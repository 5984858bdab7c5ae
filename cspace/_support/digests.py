"""Digests of all that numba compiles a function from.

They describe the code and the values of this process, because files may have changed since they
were imported.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Set
from contextlib import suppress
from enum import Enum
from functools import cache
from types import CodeType, FunctionType, ModuleType
from typing import Any, Final
from weakref import WeakKeyDictionary

import numpy as np
from numba.core import types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic

VERSIONED: Final = {"builtins", "cmath", "heapq", "math", "operator", "llvmlite", "numba", "numpy"}
"""Packages whose functions and classes are described by their names.

Folders of compiled code name the versions. Users' modules hide others, e.g. ``profile``."""

PLAIN: Final = (type(None), type(...), bool, int, float, complex, str, bytes)
"""Types of values that are described by their representation."""


class UnknownValueError(Exception):
    """A function reads a value that no digest describes, or one that has changed."""


def digest_value(value: object) -> str:
    """Return a digest of a value's representation, of 128 bits."""
    return hashlib.sha256(repr(value).encode()).hexdigest()[:32]


def digest_function(function: Any, *values: object) -> str:
    """Return a digest of a compiled function, of all that it takes in, and of more values.

    Raises UnknownValueError if the function, or one that it calls, reads a value that is neither
    code nor a constant.
    """
    more = _Description(values)
    functions = _list_functions([function, *more.functions])
    described = [more, *map(_describe_function, functions)]
    if changed := [each for each in functions if not _describe_function(each).text]:
        raise UnknownValueError(f"{changed[0].__name__} reads a value that has changed")
    return digest_value([(each.text, *map(functions.index, each.functions)) for each in described])


def check_values(function: Any) -> None:
    """Raise UnknownValueError if a value that a function takes in has changed since its digest.

    The function, or one that it calls, may be compiled with either value.
    """
    for each in _list_functions([function]):
        described = _describe_function(each)
        if described.text != _Description.of_function(each).text:
            described.text = ""
    digest_function(function)


def _list_functions(functions: list[Any]) -> list[Any]:
    """Append all that compiled functions call."""
    for each in functions:  # the list grows meanwhile
        callees = _describe_function(each).functions
        functions += [callee for callee in callees if callee not in functions]
    return functions


def _describe_function(function: Any) -> _Description:
    """Describe a function as it is when it, or a function that calls it, is first compiled."""
    if function not in _descriptions:
        _descriptions[function] = _Description.of_function(function)
    return _descriptions[function]


_descriptions: Final = WeakKeyDictionary[Any, "_Description"]()


class _Description:
    """A digest of values, and the compiled functions among them."""

    def __init__(self, values: object, names: Set[str] = frozenset()) -> None:
        """Describe values that code with some names reads."""
        self.names = names
        self.functions = list[Any]()
        self.modules = set[str]()
        self.text = digest_value(self._describe(values))

    @classmethod
    def of_function(cls, function: Any) -> _Description:
        """Describe the code of a function, its options, and the values that it reads."""
        is_intrinsic = isinstance(function, _Intrinsic)
        python = function._defn if is_intrinsic else function.py_func
        code, names = _describe_code(python.__code__)
        cells = [cell.cell_contents for cell in python.__closure__ or ()]
        read = {name: value for name, value in python.__globals__.items() if name in names}
        options = {} if is_intrinsic else {**function.targetoptions, "locals": function.locals}
        extender = python if is_intrinsic else function._compiler.pipeline_class
        extension = _describe_extension(extender.__module__)
        place = python.__module__, python.__qualname__, python.__defaults__, python.__kwdefaults__
        return cls((code, *place, cells, read, options, extension), names)

    def _describe(self, value: Any) -> object:
        """Return nested tuples of texts, in which compiled functions are numbers."""
        kind = type(value)
        if kind in PLAIN:
            return kind.__name__, repr(value)
        return kind.__module__, kind.__name__, tuple(map(self._describe, self._take_apart(value)))

    def _take_apart(self, value: Any) -> tuple[Any, ...]:
        """Return the parts of a value on which the code of functions that read it depends."""
        kind = type(value)
        match value:
            case Enum():
                return kind, value.name
            case list() | tuple():
                return (*value, *getattr(value, "_fields", ()))
            case set() | frozenset():
                return tuple(sorted(value, key=repr))
            case dict():
                return tuple(sorted(value.items(), key=lambda item: repr(item[0])))
            case Dispatcher() | _Intrinsic():
                if value not in self.functions:
                    self.functions.append(value)
                return (self.functions.index(value),)
            case np.ndarray() | np.generic():
                return value.dtype, value.shape, value.strides, value.tobytes()
            case np.dtype():
                return repr(value), value.alignment
            case types.Omitted():
                return (value.value,)
            case types.Type():
                return _describe_extension(kind.__module__), value.key
        name = str(getattr(value, "__qualname__", None) or getattr(value, "__name__", ""))
        home = str(getattr(value, "__module__", None) or name)
        if name and _is_versioned(home):
            return home, name
        if isinstance(value, ModuleType):
            read = {} if home in self.modules else _read_attributes(value, self.names)
            self.modules.add(home)
            return home, read
        if isinstance(value, type) and issubclass(value, tuple | Enum | BaseException):
            fields = getattr(value, "_fields", ()), getattr(value, "_field_defaults", {})
            members = getattr(value, "__members__", {})
            return home, name, fields, [(key, each.value) for key, each in members.items()]
        raise UnknownValueError(f"a function reads {value!r:.100}")


def _read_attributes(module: ModuleType, names: Set[str]) -> dict[str, Any]:
    """Return the attributes of a module that have some names."""
    found = {}
    for name in names:
        with suppress(Exception):  # a name of something else may be that of a lazy submodule
            found[name] = getattr(module, name)
    return found


def _is_versioned(module: str) -> bool:
    """Return True for a module of a package that is described by its version."""
    return module.partition(".")[0] in VERSIONED


@cache
def _describe_extension(module: str) -> tuple[str, ...]:
    """Describe the code of all functions of a module that extends the compiler."""
    if _is_versioned(module):
        return ()
    values = [each for each in vars(sys.modules[module]).values() if hasattr(each, "__module__")]
    own = [each for each in values if each.__module__ == module]
    for each in own:
        if isinstance(each, type):
            own += vars(each).values()
    return tuple(_describe_code(each.__code__)[0] for each in own if isinstance(each, FunctionType))


@cache
def _describe_code(code: CodeType) -> tuple[str, frozenset[str]]:
    """Return a digest of code without the values that it reads, and the names of these."""
    inner = [_describe_code(each) for each in code.co_consts if isinstance(each, CodeType)]
    constants = [repr(each) for each in code.co_consts if not isinstance(each, CodeType)]
    sizes = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, code.co_flags
    names = code.co_names, code.co_varnames, code.co_freevars, code.co_cellvars
    constants += [digest for digest, _ in inner]
    digest = digest_value((code.co_code, code.co_exceptiontable, constants, sizes, names))
    return digest, frozenset(code.co_names).union(*(each for _, each in inner))
