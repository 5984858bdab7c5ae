"""Compiled functions: how they are made, kept between runs, and how a person hears that one is being compiled."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import cache, partial
from typing import Any, Final, TypeVar, overload

F = TypeVar("F", bound=Callable[..., Any])

LOGGER: Final = logging.getLogger("cspace.compiling")
"""Says at INFO, once for each module of compiled functions, that one of it is being compiled.

A program that shows progress adds a handler of its own; this module is quick to import."""


@overload
def jit(function: F, /, **options: Any) -> F: ...
@overload
def jit(function: None = None, /, **options: Any) -> Callable[[F], F]: ...
def jit(function: F | None = None, /, **options: Any) -> Any:
    """A function compiled by numba at its first call, which lets other threads run meanwhile.

    What was compiled is kept on disk, beside the module or in the user's cache folder, or where ``NUMBA_CACHE_DIR``
    says. Where none of them may be written, it is compiled again in each run.

    Parameters
    ----------
    **options
        Those of ``numba.njit``, of which ``cache`` and ``nogil`` are True if left out.

    Examples
    --------
    >>> @jit
    ... def twice(value: float) -> float:
    ...     return 2.0 * value
    >>> @jit(error_model="numpy")
    ... def ratio(first: float, second: float) -> float:
    ...     return first / second
    """
    if function is None:
        return lambda decorated: jit(decorated, **options)
    from numba import njit

    _announce_compiling()
    options = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, **options}
    try:
        return njit(**options)(function)
    except RuntimeError:  # numba found no folder that it may write to
        return njit(**{**options, "cache": False})(function)


@overload
def reader(function: F, /) -> F: ...
@overload
def reader(**options: Any) -> Callable[[F], F]: ...
def reader(function: F | None = None, /, **options: Any) -> Any:
    """:func:`jit` for what only reads and writes the arrays that it is given, and makes none.

    Numba then counts no references, which from Python takes 30 ns an array, and in inner loops as long as the work.
    """
    return jit(function, _nrt=False, **options)


def entry(kernel: Any, fixed: tuple[Any, ...], floats: int) -> Callable[..., Any]:
    """A kernel with its first arguments given and some floats to come, without numba's dispatch on every call."""
    import numba

    types = (*map(numba.typeof, fixed), *[numba.float64] * floats)
    kernel.compile(types)
    return partial(kernel.get_overload(types), *fixed)


@cache
def _announce_compiling() -> None:
    """Have numba tell when it compiles; what it reads from its cache does not count."""
    from numba.core import event

    class Announcer(event.Listener):
        def __init__(self) -> None:
            self.announced: set[str] = set()

        def on_start(self, event: Any) -> None:
            module = str(event.data["dispatcher"].py_func.__module__)
            if module.startswith(("cspace.", "planners.")) and module not in self.announced:
                self.announced.add(module)
                LOGGER.info("compiling %s, once per machine", module)

        def on_end(self, event: Any) -> None:
            pass

    event.register("numba:compile", Announcer())  # type: ignore[no-untyped-call]
