"""Compile functions with numba, cache their code on disk, and announce each compilation."""

from __future__ import annotations

import hashlib
import inspect
import logging
import os
import re
import stat
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from types import FunctionType
from typing import Any, Final, TypeVar, cast

F = TypeVar("F", bound=Callable[..., Any])

LOGGER: Final = logging.getLogger("cspace.compiling")
"""Logger of the first compilation in each module, at INFO; programs that show progress add a handler."""

LONG_WAIT_SECONDS: Final = 2.0
"""Seconds of compiling after which a program that shows no progress gets a line on stderr."""

LONG_WAIT: Final = (
    "cspace: compiling for this machine, which happens once and may take half a minute; "
    "logging.getLogger('cspace.compiling').disabled = True hides this line"
)
"""That line."""

_IMPORT: Final = re.compile(r"^\s*from ((?:cspace|planners)\b[\w.]*) import (\([^)]*\)|.*)$", re.MULTILINE)
"""Import of our modules. The cache key of a function covers all modules that its own imports in this way."""

_OPTIONS: Final[Any] = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
"""Numba's options for every compiled function; numba types ``min``, ``range`` and such once for each set of options."""

_UNREGISTERED: Final[list[FunctionType]] = []
"""Functions decorated by :func:`compilable` that numba does not know yet."""

_METHODS: Final[set[str]] = set()
"""Names of registered methods; numba compiles the method of the record's own class."""

_IMPLEMENTED_BY: Final[dict[str, set[str]]] = {}
"""Modules of the implementations, for each module with a function given to :func:`dispatch_on_type`."""


class _Clock:
    """A clock, in seconds, that stops while functions are compiled and cached.

    Time limits are measured with this clock. Compilations may nest, but only within one thread.
    """

    # Nested stops, start of the outermost, seconds stopped so far: one tuple, which other threads read at one moment.
    _state = 0, 0.0, 0.0

    def __call__(self) -> float:
        """Return the time, excluding stops."""
        depth, since, stopped = self._state
        return (since if depth else time.perf_counter()) - stopped

    def stop(self) -> None:
        """Stop the clock; stops may nest."""
        depth, since, stopped = self._state
        self._state = depth + 1, since if depth else time.perf_counter(), stopped

    @property
    def stopped(self) -> float:
        """Seconds for which the clock has stopped so far."""
        return time.perf_counter() - self()

    def resume(self) -> None:
        """End a stop; the clock runs again after the outermost."""
        depth, since, stopped = self._state
        self._state = depth - 1, since, stopped if depth > 1 else stopped + time.perf_counter() - since


clock: Final = _Clock()


# ---- decorators ------------------------------------------------------------------------------------------------------


def jit(function: F, **options: Any) -> F:
    """Compile a function with numba at its first call.

    The GIL is released while it runs. The code is cached beside the module, in the user's cache folder, or in
    ``NUMBA_CACHE_DIR``: in the first folder that the user may write to and nobody else may, because cached code is
    executed. Without such a folder each run compiles anew. Division by zero gives infinity or NaN, and 0 for integers.
    The function must not call itself by way of another function, because numba's cache cannot restore that. Options are
    passed to ``numba.njit``.
    """
    from numba import njit

    _announce_compiling()
    _register_compilable()
    compiled = njit(**{**_OPTIONS, "_nrt": True, **options})(function)  # set, or it would be that of the caller
    with suppress(RuntimeError):  # numba found no folder that it may write to
        compiled._cache = _cache_class()(function)
    return cast(F, compiled)


def kernel(function: F) -> F:
    """Compile a function that allocates no arrays.

    Numba then omits reference counting, which costs 30 ns for each array argument of a call from Python, and in inner
    loops as much as the work.
    """
    return jit(function, _nrt=False)


def always_inline(function: F) -> F:
    """Compile a small kernel into each compiled function that calls it."""
    return jit(function, _nrt=False, forceinline=True)


def compilable(plain: F) -> F:
    """Register plain functions for use in compiled code.

    Decorate a function or a record class, whose methods are registered. The decorated object stays plain Python, and
    its module imports no numba. Methods of one name take the same number of arguments in every class, and no record has
    a field of that name.
    """
    members = [plain] if isinstance(plain, FunctionType) else list(vars(plain).values())
    _UNREGISTERED.extend(each for each in members if inspect.isfunction(each) and each.__name__[0] != "_")
    if _announce_compiling.cache_info().currsize:  # numba is imported
        _register_compilable()
    return plain


def _register_compilable() -> None:
    """Register with numba what :func:`compilable` decorated since the last call."""
    from numba import types
    from numba.extending import overload_method, register_jitable

    for function in _UNREGISTERED:
        name = function.__name__
        if "." not in function.__qualname__:
            register_jitable(**_OPTIONS, _nrt=False)(function)
        elif name not in _METHODS:
            _METHODS.add(name)

            def choose(record: Any, *others: Any, name: str = name) -> Any:
                return getattr(record.instance_class, name, None)

            choose.__signature__ = inspect.signature(function)  # type: ignore[attr-defined]
            options: Any = {"jit_options": _OPTIONS, "strict": False}
            overload_method(types.BaseNamedTuple, name, **options)(choose)
    _UNREGISTERED.clear()


def dispatch_on_type(function: Callable[..., Any], implementations: dict[type, Callable[..., Any]]) -> None:
    """Choose an implementation by type, in compiled code.

    The type of the first argument decides. Types are record classes or ``numpy.ndarray``; ``object`` stands for all
    others. Only the chosen implementation is compiled.
    """
    import numpy as np
    from numba import types
    from numba.extending import overload

    _IMPLEMENTED_BY.setdefault(function.__module__, set()).update(each.__module__ for each in implementations.values())

    options: Any = {**_OPTIONS, "_nrt": False}

    @overload(function, jit_options=options, strict=False)
    def choose(first: Any, *others: Any) -> Any:
        kind = np.ndarray if isinstance(first, types.Array) else getattr(first, "instance_class", object)
        return implementations.get(kind)


def bind_kernel(kernel: Any, fixed: tuple[Any, ...], *others: Any) -> Callable[..., Any]:
    """Bind a kernel to its first arguments.

    Calls skip numba's dispatch, so that all other arguments must have the types of ``others``.
    """
    import numba

    types = tuple(map(numba.typeof, (*fixed, *others)))
    kernel.compile(types)
    return partial(kernel.get_overload(types), *fixed)


# ---- the cache -------------------------------------------------------------------------------------------------------


@cache
def _cache_class() -> Any:
    """Return numba's function cache, stamped with all sources of a function.

    Numba stamps it with the function's own file alone, so it would use a stale callee after the callee's file changed.
    """
    from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
    from numba.core.runtime.nrt import rtsys

    class OwnFolder:
        def ensure_cache_path(self) -> None:
            super().ensure_cache_path()  # type: ignore[misc]
            if not is_private(Path(self.get_cache_path())):  # type: ignore[attr-defined]
                raise PermissionError

    class Folders(CompileResultCacheImpl):
        _locator_classes = [  # noqa: RUF012
            cast(type[object], type(each.__name__, (OwnFolder, each), {}))
            for each in CompileResultCacheImpl._locator_classes
        ]

    class CheckedFile(IndexDataCacheFile):
        """Cached code, stored with its key.

        Otherwise two processes that save at once might exchange the files of their code.
        """

        def load(self, key: Any) -> Any:
            with suppress(Exception):  # a damaged file counts as absent
                saved_key, code = super().load(key)  # type: ignore[no-untyped-call]
                return code if saved_key == (self._source_stamp, key) else None

        def save(self, key: Any, code: Any) -> None:
            with suppress(OSError):  # a full disk, or a folder that has gone
                super().save(key, ((self._source_stamp, key), code))  # type: ignore[no-untyped-call]

        def _load_index(self) -> Any:
            with suppress(Exception):
                return super()._load_index()  # type: ignore[no-untyped-call]
            return {}

    class SourceCache(FunctionCache):
        _impl_class = Folders

        def __init__(self, function: Callable[..., Any]) -> None:
            super().__init__(function)  # type: ignore[no-untyped-call]
            stamp = digest_sources({function.__module__})
            self._cache_file = CheckedFile(self._cache_path, self._impl.filename_base, stamp)  # type: ignore[no-untyped-call]

        def _index_key(self, signature: Any, codegen: Any) -> Any:
            # Methods of records are compiled into the function, from modules that it need not import.
            records = digest_sources(_record_modules(signature))
            return (*super()._index_key(signature, codegen), records)  # type: ignore[no-untyped-call]

        def load_overload(self, signature: Any, target: Any) -> Any:
            # Numba would first import everything that it can compile, which takes longer than loading the cache.
            rtsys.initialize(target)
            return self._load_overload(signature, target)  # type: ignore[no-untyped-call]

        def save_overload(self, signature: Any, compiled: Any) -> None:
            clock.stop()
            try:
                super().save_overload(signature, compiled)  # type: ignore[no-untyped-call]
            finally:
                clock.resume()

    return SourceCache


def digest_sources(modules: Iterable[str]) -> str:
    """Return a digest of modules and of the modules that they import.

    Only modules of ours count.
    """
    pending, seen = list(modules), set[str]()
    while pending:
        module = pending.pop()
        if module not in seen:
            seen.add(module)
            pending += [*_source(module)[1], *_IMPLEMENTED_BY.get(module, ())]
    sources = "".join(f"{module} {_source(module)[0]}\n" for module in sorted(seen))
    return hashlib.sha256(sources.encode()).hexdigest()


@cache
def _source(module: str) -> tuple[str, frozenset[str]]:
    """Return the digest and the imports of a module's source.

    Only imports of our modules count; modules of other packages have none.
    """
    path = getattr(sys.modules.get(module), "__file__", None) or ""
    if not path:
        parts = Path(__file__).parents[1].joinpath(*module.split("."))
        path = next((str(p) for p in (parts.with_suffix(".py"), parts / "__init__.py") if p.is_file()), "")
    if not path:  # a name within a module, or a function made in an interpreter
        return "", frozenset()
    text = Path(path).read_text(encoding="utf-8")
    names = {home: re.findall(r"\w+", names) for home, names in _IMPORT.findall(text)}
    imported = {*names, *(f"{home}.{name}" for home, listed in names.items() for name in listed)}
    return hashlib.sha256(text.encode()).hexdigest(), frozenset(imported)


def _record_modules(types: Iterable[Any]) -> set[str]:
    """Return the modules of record classes.

    The classes are found among argument types, at any depth.
    """
    pending, modules = list(types), set[str]()
    while pending:
        each = pending.pop()
        if hasattr(each, "instance_class"):
            modules.add(each.instance_class.__module__)
        pending.extend(getattr(each, "types", ()))
    return modules


@cache
def is_private(folder: Path) -> bool:
    """Return True if only the user can have written to a folder.

    The folder must belong to the user. Neither others nor a group other than the user's own may write to it or to a
    folder above it, except to sticky folders such as ``/tmp``. On Windows nothing is checked, because a user's folders
    are closed to others there.
    """
    if sys.platform == "win32":
        return True
    import grp
    import pwd

    private_groups = {0}
    with suppress(KeyError):  # a user or a group without a name
        user = pwd.getpwuid(os.geteuid())
        if grp.getgrgid(user.pw_gid).gr_name == user.pw_name:
            private_groups.add(user.pw_gid)
    folder = folder.resolve()
    for path in (folder, *folder.parents):
        status = path.stat()
        others = stat.S_IWOTH if status.st_gid in private_groups else stat.S_IWOTH | stat.S_IWGRP
        owned = path != folder or status.st_uid == os.geteuid()
        sticky = path != folder and status.st_mode & stat.S_ISVTX
        if not owned or (status.st_mode & others and not sticky):
            LOGGER.info("compiled code is not cached in %s, because others may write to %s", folder, path)
            return False
    return True


@cache
def _announce_compiling() -> None:
    """Log compilations, and stop the clock during them.

    Only the first compilation in each module is logged.
    """
    from numba.core import event

    announced = set[str]()
    begun = clock.stopped

    class Announcer(event.Listener):
        def on_start(self, event: Any) -> None:
            """Announce the first compilation of a module.

            The clock of time limits stops.
            """
            module = str(event.data["dispatcher"].py_func.__module__)
            if module.startswith(("cspace.", "planners.")) and module not in announced:
                announced.add(module)
                LOGGER.info("compiling %s, once per machine", module)
                shows_progress = LOGGER.isEnabledFor(logging.INFO)
                if clock.stopped - begun > LONG_WAIT_SECONDS and not shows_progress and LONG_WAIT not in announced:
                    announced.add(LONG_WAIT)
                    LOGGER.warning(LONG_WAIT)
            clock.stop()

        def on_end(self, event: Any) -> None:
            clock.resume()

    event.register("numba:compile", Announcer())  # type: ignore[no-untyped-call]
