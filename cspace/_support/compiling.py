"""Compile functions with numba, and keep their machine code on disk."""

from __future__ import annotations

import hashlib
import logging
import os
import re
import shutil
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

import numba
from numba.core import event

from cspace.errors import InputError

F = TypeVar("F", bound=Callable[..., Any])

LOGGER: Final = logging.getLogger("cspace.compiling")
"""Logger of a long wait for the compiler; it gets at most one line per process."""

LONG_WAIT: Final = (
    "cspace: compiling for this machine, for up to half a minute, %s; "
    "logging.getLogger('cspace.compiling').disabled = True hides this line"
)
"""Text about a long wait for the compiler; ``%s`` says how often to expect it."""

LONG_WAIT_SECONDS: Final = 2.0
"""Seconds of compiling after which :data:`LONG_WAIT` is logged."""

KEPT_SECONDS: Final = 7 * 24 * 3600.0
"""Seconds after its last use for which compiled code of other versions is kept."""

FILES_WITHOUT_KERNELS: Final = (
    "cspace/__init__.py",  # the version
    "cspace/_support/compiling.py",
    "cspace/_support/arrays.py",
    "cspace/_bodies/__init__.py",
    "cspace/_grid.py",
    "cspace/_rotations/base.py",
)
"""Files without kernels on which compiled code depends. The last four have constants that are
compiled into kernels."""

_KERNELS: Final = re.compile(rb"^@(kernel|internal|inlined|allocating)\b", re.MULTILINE)

_CONFIG: Final[Any] = numba.config
_CONFIG_LOCK: Final = threading.Lock()


def kernel(function: F) -> F:
    """Compile a function that allocates no arrays, at its first call.

    The GIL is released while the function runs. Division by zero gives infinity or NaN.
    """
    # Numba would count references to each array of a record at each call, which takes up to eight
    # times as long as the work.
    return _compile(function, _nrt=False)


def internal(function: F) -> F:
    """Compile a function that only kernels call, otherwise like :func:`kernel`.

    A call from Python crashes. Omitting the wrapper for Python saves a quarter of the time to
    compile.
    """
    return _compile(function, _nrt=False, no_cpython_wrapper=True)


def inlined(function: F) -> F:
    """Compile a short function that only kernels call into its callers.

    A call would take as long as the function itself.
    """
    return _compile(function, _nrt=False, no_cpython_wrapper=True, forceinline=True)


def allocating(function: F) -> F:
    """Compile a function that allocates arrays, otherwise like :func:`kernel`."""
    return _compile(function, _nrt=True)  # numba takes options that are not given from the caller


def _compile(function: F, **options: Any) -> F:
    """Compile a function with numba at its first call, and cache its code in our folder.

    Raises InputError if numba's compiler is disabled.
    """
    if _CONFIG.DISABLE_JIT:
        raise InputError(
            "NUMBA_DISABLE_JIT",
            "is set",
            "proofs rely on the arithmetic of compiled code",
            "unset it, or set it to 0",
        )
    folder = cache_folder()
    options |= {"nogil": True, "error_model": "numpy", "cache": folder is not None}
    options["no_cfunc_wrapper"] = True  # C functions are not used, and take a tenth of the time
    # Numba reads these settings when a function is decorated. A locator that the user has set would
    # keep code in folders that are not checked.
    settings = {"CACHE_DIR": str(folder), "CACHE_LOCATOR_CLASSES": ""}
    with _CONFIG_LOCK:
        user_settings = {name: getattr(_CONFIG, name, "") for name in settings}
        vars(_CONFIG).update(settings)
        try:
            return numba.njit(**options)(function)  # type: ignore[no-any-return]
        finally:
            vars(_CONFIG).update(user_settings)


@cache
def cache_folder() -> Path | None:
    """Return the folder of compiled code, or None if no folder is safe.

    Each version of cspace, numba and Python has its own folder.
    """
    if not hasattr(os, "geteuid"):  # Windows does not tell who may write to a folder
        return None
    # Code depends on the versions of numba and Python, and on the sources of the kernels.
    name = f"numba-{numba.__version__}-{sys.implementation.cache_tag}-{_digest_sources()}"
    places = [_CONFIG.CACHE_DIR, os.environ.get("XDG_CACHE_HOME"), "~/.cache"]
    with suppress(FileNotFoundError):  # no folder for temporary files
        places.append(f"{tempfile.gettempdir()}/cache-{os.geteuid()}")
    for place in filter(None, places):
        with suppress(OSError, RuntimeError):  # RuntimeError without a home folder
            folder = Path(place).expanduser().absolute() / "cspace" / name
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
            if is_private(folder):
                (folder / "lock").touch()  # the time of the last use
                _remove_unused(folder.parent)
                return folder
    return None


def _digest_sources() -> str:
    """Return a digest of the source files on which compiled code depends."""
    root = Path(__file__).parents[2]  # the folder of both packages
    digest = hashlib.sha256()
    for package in ("cspace", "planners"):
        for file in sorted((root / package).rglob("*.py")):
            source = file.read_bytes()
            name = file.relative_to(root).as_posix()
            if name in FILES_WITHOUT_KERNELS or _KERNELS.search(source):
                digest.update(source)
    return digest.hexdigest()[:16]  # 64 bits distinguish all versions on a machine


def is_private(folder: Path) -> bool:
    """Return True if no other user can replace the files in a folder.

    Compiled code in it is executed, so others must not write it.
    """
    folder = folder.resolve()
    status = folder.stat()
    is_own = status.st_uid == os.geteuid()
    is_open = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if is_open or not is_own:
        return False
    for parent in folder.parents:
        mode = parent.stat().st_mode
        # Only owners can replace their entries in a sticky folder, such as /tmp.
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return False
    return True


def _remove_unused(parent: Path) -> None:
    """Remove the compiled code of versions that no process has used for a week."""
    for lock in parent.glob("*/lock"):
        with suppress(OSError):
            if time.time() - lock.stat().st_mtime > KEPT_SECONDS:
                shutil.rmtree(lock.parent)


class _Clock(event.Listener):
    """A clock for time limits: CPU time of the process without compilations.

    CPU time does not depend on the load of the machine by other programs.
    """

    # Number of nested compilations, start of the outermost one, and seconds that all earlier ones
    # took. They are one tuple, so that threads read values of one moment.
    _stops = 0, 0.0, 0.0
    _has_warned = False

    def __call__(self) -> float:
        """Return the CPU time of the process without compilations, seconds."""
        depth, since, seconds = self._stops
        return (since if depth else time.process_time()) - seconds

    def on_start(self, event: Any) -> None:
        """Stop the clock, and log a long wait once."""
        depth, since, seconds = self._stops
        self._stops = depth + 1, since if depth else time.process_time(), seconds
        module = event.data["dispatcher"].py_func.__module__
        has_waited = time.process_time() - self() > LONG_WAIT_SECONDS
        if has_waited and not self._has_warned and module.startswith(("cspace.", "planners.")):
            self._has_warned = True
            how_often = "once" if cache_folder() else "at each start, as no cache is safe"
            LOGGER.warning(LONG_WAIT, how_often)

    def on_end(self, event: Any) -> None:
        """Restart the clock after the outermost compilation."""
        depth, since, seconds = self._stops
        if depth == 1:
            seconds += time.process_time() - since
        self._stops = depth - 1, since, seconds


class _SaveLock(event.Listener):
    """A lock between processes, held while numba saves code.

    Numba saves an index and a file of code, so two processes that save at once could mix their
    files. It saves after a compilation ends, and before its own lock is released.
    """

    def __init__(self, file: Path) -> None:
        """Open the file that processes lock."""
        self._file = os.open(file, os.O_RDWR)

    def on_start(self, event: Any) -> None:
        """Do nothing, because the lock is needed only for saving."""

    def on_end(self, event: Any) -> None:
        """Acquire the lock when a compilation ends, and release it with numba's lock."""
        import fcntl  # imported here, because Windows lacks it, and has no folder to lock

        action = fcntl.LOCK_EX if event.kind == "numba:compile" else fcntl.LOCK_UN
        with suppress(OSError):  # some file systems have no locks; saving goes on without
            fcntl.flock(self._file, action)


clock: Final = _Clock()
event.register("numba:compile", clock)  # type: ignore[no-untyped-call]
if (_folder := cache_folder()) is not None:
    _save_lock = _SaveLock(_folder / "lock")
    for _kind in ("numba:compile", "numba:compiler_lock"):
        event.register(_kind, _save_lock)  # type: ignore[no-untyped-call]
