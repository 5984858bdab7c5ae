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
"""Logger of one line a process about a long wait for the compiler."""

LONG_WAIT: Final = (
    "cspace: compiling for this machine, for up to half a minute, %s; "
    "logging.getLogger('cspace.compiling').disabled = True hides this line"
)
"""The line; ``%s`` is how often to expect the wait."""

LONG_WAIT_SECONDS: Final = 2.0
"""Seconds of compiling after which the line is logged."""

KEPT_SECONDS: Final = 7 * 24 * 3600.0
"""Seconds for which the code of another version is kept after its last use."""

FILES_WITHOUT_KERNELS: Final = (
    "cspace/__init__.py",  # the version
    "cspace/_support/compiling.py",
    "cspace/_support/arrays.py",
    "cspace/_bodies/__init__.py",
    "cspace/_grid.py",
    "cspace/_rotations/base.py",
)
"""Files that kernels depend on; the last four have constants that are compiled into kernels."""

_KERNELS: Final = re.compile(rb"^@(kernel|internal|inlined|allocating)\b", re.MULTILINE)

_CONFIG: Final[Any] = numba.config
_CONFIG_LOCK: Final = threading.Lock()


def kernel(function: F) -> F:
    """Compile a function that allocates no arrays, at its first call.

    The GIL is released while it runs. Division by zero gives infinity or NaN.
    """
    # Numba would count references to each array of a record at each call, which takes up to eight
    # times as long as the work.
    return _compile(function, _nrt=False)


def internal(function: F) -> F:
    """Like :func:`kernel`, for functions that only kernels call; a call from Python crashes.

    Without a wrapper for Python, they compile in three quarters of the time.
    """
    return _compile(function, _nrt=False, no_cpython_wrapper=True)


def inlined(function: F) -> F:
    """Compile a short internal function into its callers, where a call would take as long."""
    return _compile(function, _nrt=False, no_cpython_wrapper=True, forceinline=True)


def allocating(function: F) -> F:
    """Compile a function that allocates arrays; else like :func:`kernel`."""
    return _compile(function, _nrt=True)  # numba takes options that are not given from the caller


def _compile(function: F, **options: Any) -> F:
    """Compile a function with numba, and cache its code in our folder.

    Raises InputError if numba is told not to compile.
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
    # A locator of the user would keep code in folders that are not checked.
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
    """Return the folder of this version's code, or None if no folder is safe to use."""
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
    """Return a digest of all that is compiled into kernels."""
    root = Path(__file__).parents[2]  # the folder of both packages
    digest = hashlib.sha256()
    for package in ("cspace", "planners"):
        for file in sorted((root / package).rglob("*.py")):
            source = file.read_bytes()
            name = file.relative_to(root).as_posix()
            if name in FILES_WITHOUT_KERNELS or _KERNELS.search(source):
                digest.update(source)
    return digest.hexdigest()[:16]  # 64 bits tell the sources of one machine apart


def is_private(folder: Path) -> bool:
    """Return True if no other user can replace a folder's files, which are executed."""
    folder = folder.resolve()
    status = folder.stat()
    is_own = status.st_uid == os.geteuid()
    is_open = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    if is_open or not is_own:
        return False
    for parent in folder.parents:
        mode = parent.stat().st_mode
        # Entries of a sticky folder, such as /tmp, are replaced by their owners only.
        if mode & stat.S_IWOTH and not mode & stat.S_ISVTX:
            return False
    return True


def _remove_unused(parent: Path) -> None:
    """Remove the code of versions that no process has used for a week."""
    for lock in parent.glob("*/lock"):
        with suppress(OSError):
            if time.time() - lock.stat().st_mtime > KEPT_SECONDS:
                shutil.rmtree(lock.parent)


class _Clock(event.Listener):
    """A clock of the process's CPU time that stops while functions are compiled, for time limits.

    Other programs on the machine do not make it run faster than the work goes on.
    """

    # Number of nested compilations, start of the outermost one, and seconds that all earlier ones
    # took. Threads read it at once.
    _stops = 0, 0.0, 0.0
    _is_told = False

    def __call__(self) -> float:
        """Return the CPU time in seconds without compilations."""
        depth, since, seconds = self._stops
        return (since if depth else time.process_time()) - seconds

    def on_start(self, event: Any) -> None:
        """Stop the clock, and tell the user once if it has stood for long."""
        depth, since, seconds = self._stops
        self._stops = depth + 1, since if depth else time.process_time(), seconds
        module = event.data["dispatcher"].py_func.__module__
        has_waited = time.process_time() - self() > LONG_WAIT_SECONDS
        if has_waited and not self._is_told and module.startswith(("cspace.", "planners.")):
            self._is_told = True
            how_often = "once" if cache_folder() else "at each start, as no cache is safe"
            LOGGER.warning(LONG_WAIT, how_often)

    def on_end(self, event: Any) -> None:
        """Let the clock go on after the outermost compilation."""
        depth, since, seconds = self._stops
        if depth == 1:
            seconds += time.process_time() - since
        self._stops = depth - 1, since, seconds


class _SaveLock(event.Listener):
    """A lock between processes, held while numba saves code.

    Numba saves an index and a file, so that two processes at once could exchange their files.
    It does so after a compilation ends and before its own lock is released.
    """

    def __init__(self, file: Path) -> None:
        """Open the file that processes lock."""
        self._file = os.open(file, os.O_RDWR)

    def on_start(self, event: Any) -> None:
        """Do nothing."""

    def on_end(self, event: Any) -> None:
        """Take the lock when a compilation ends, and leave it with numba's lock."""
        import fcntl  # Windows has none, and no folder

        action = fcntl.LOCK_EX if event.kind == "numba:compile" else fcntl.LOCK_UN
        with suppress(OSError):  # a file system without locks
            fcntl.flock(self._file, action)


clock: Final = _Clock()
event.register("numba:compile", clock)  # type: ignore[no-untyped-call]
if (_folder := cache_folder()) is not None:
    _save_lock = _SaveLock(_folder / "lock")
    for _kind in ("numba:compile", "numba:compiler_lock"):
        event.register(_kind, _save_lock)  # type: ignore[no-untyped-call]
