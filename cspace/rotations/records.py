"""Records and overloads in compiled code, for kernels that take a map as a record."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial
from types import FunctionType
from typing import Any, Final, TypeVar, cast

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, overload_method, register_jitable

from cspace.compiling import allocating, kernel

F = TypeVar("F", bound=Callable[..., Any])

_OPTIONS: Final[Any] = {"nogil": True, "error_model": "numpy"}
"""Numba's options of registered functions, those of :func:`cspace.compiling.kernel`."""

_METHODS: Final[set[str]] = set()
"""Names of registered methods; numba compiles the method of the record's own class."""

always_inline: Final = kernel


def jit(function: F, **options: Any) -> F:
    """Compile a function that may allocate arrays, unless ``_nrt`` is False."""
    return allocating(function) if options.get("_nrt", True) else kernel(function)


def compilable(plain: F) -> F:
    """Register plain functions for use in compiled code.

    Decorate a function or a record class, whose methods are registered. The decorated object stays plain Python.
    Methods of one name take the same number of arguments in every class, and no record has a field of that name.
    """
    members = [plain] if isinstance(plain, FunctionType) else list(vars(plain).values())
    for function in members:
        if inspect.isfunction(function) and function.__name__[0] != "_":
            _register(function)
    return plain


def _register(function: FunctionType) -> None:
    """Register a function, or the method of a record."""
    name = function.__name__
    if "." not in function.__qualname__:
        register_jitable(**_OPTIONS, _nrt=False)(function)
    elif name not in _METHODS:
        _METHODS.add(name)

        def choose(record: Any, *others: Any) -> Any:
            return getattr(record.instance_class, name, None)

        choose.__signature__ = inspect.signature(function)  # type: ignore[attr-defined]
        options: Any = {"jit_options": _OPTIONS, "strict": False}
        overload_method(types.BaseNamedTuple, name, **options)(choose)


def dispatch_on_type(function: Callable[..., Any], implementations: dict[type, Callable[..., Any]]) -> None:
    """Choose an implementation by type, in compiled code.

    The type of the first argument decides. Types are record classes or ``numpy.ndarray``; ``object`` stands for all
    others. Only the chosen implementation is compiled.
    """
    options: Any = {**_OPTIONS, "_nrt": False}

    @overload(function, jit_options=options, strict=False)
    def choose(first: Any, *others: Any) -> Any:
        kind = np.ndarray if isinstance(first, types.Array) else getattr(first, "instance_class", object)
        return implementations.get(kind)


def bind_kernel(kernel: Any, fixed: tuple[Any, ...], *others: Any) -> Callable[..., Any]:
    """Bind a kernel to its first arguments.

    Calls skip numba's dispatch, so that all other arguments must have the types of ``others``.
    """
    argument_types = tuple(map(numba.typeof, (*fixed, *others)))
    kernel.compile(argument_types)
    return partial(kernel.get_overload(argument_types), *fixed)


def _emit_load(context: Any, octets: Any, index: Any) -> Any:
    """Load the word that begins at a byte of an array.

    The word may be unaligned; seven more bytes must follow.
    """

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        pointer = builder.bitcast(builder.gep(data, [arguments[1]]), ir.IntType(64).as_pointer())
        return builder.load(pointer, align=1)

    return cast(Any, types.uint64(octets, types.int64)), generate


load_word: Any = intrinsic(_emit_load)
