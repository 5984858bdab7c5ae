"""Compile functions with numba, and keep their machine code on disk.

Numba compiles a function into each of its callers, and optimises it there again. So choose:

- :func:`kernel` for functions that Python calls, and :func:`allocating` if they allocate arrays;
- :func:`internal` for functions that only kernels call;
- :func:`inlined` for those that take a few nanoseconds, less than a call;
"""

from __future__ import annotations

import gc
import hashlib
import itertools
import logging
import os
import pickle
import platform
import re
import shutil
import stat
import struct
import tempfile
import threading
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final, TypeVar

import numba
from numba.core import event
from numba.core.bytecode import FunctionIdentity
from numba.core.caching import NullCache
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.compiler_lock import global_compiler_lock
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature

from cspace._support import shipped
from cspace._support.digests import (
    UnknownValueError,
    check_values,
    digest_function,
    digest_value,
)
from cspace._support.interrupts import hold_interrupts
from cspace.errors import InputError

F = TypeVar("F", bound=Callable[..., Any])

LOGGER: Final = logging.getLogger("cspace.compiling")
"""Logger of long waits, and of code that is not kept; it gets each line once per process."""

LONG_WAIT: Final = (
    "cspace: compiling for this machine, for up to half a minute, %s; "
    "logging.getLogger('cspace.compiling').disabled = True hides this line"
)
"""Text about a long wait for the compiler; ``%s`` says how often to expect it."""

LONG_WAIT_SECONDS: Final = 2.0
"""Seconds of compiling after which :data:`LONG_WAIT` is logged."""

LONG_TURN: Final = (
    "cspace: waiting for process %s, which compiles %s; if it is stopped, continue or end it; "
    "after %g s this process compiles without it"
)
"""Text about a wait for another process: its number, a function, and seconds."""

TURN_SECONDS: Final = (5.0, 60.0)
"""Seconds after which :data:`LONG_TURN` is logged, and after which the wait ends."""

NOT_KEPT: Final = "cspace: code is not kept in %s (%s); it is compiled in each process"
"""Text about code that a folder does not keep, e.g. because the disk is full."""

CHECKSUM_BYTES: Final = 32
"""Bytes of a checksum at the start of a file of compiled code."""

UNUSED_SECONDS: Final = 7 * 24 * 3600.0
"""Seconds after its last use for which compiled code of other versions is kept."""

_CONFIG: Final[Any] = numba.config
_CLOCK_LOCK: Final = threading.Lock()


def kernel(function: F) -> F:
    """Compile a function that allocates no arrays, at its first call.

    The GIL is released while the function runs. Division by zero gives infinity or NaN.
    """
    # Numba would count references to each array of a record at each call, which takes up to eight
    # times as long as the work.
    return _compile(function, _nrt=False)


def internal(function: F) -> F:
    """Compile a kernel that only kernels call.

    A call from Python crashes. Without machine code of its own, it compiles in half the time.
    """
    return _compile(function, _nrt=False, no_cpython_wrapper=True, pipeline_class=_PartCompiler)


def inlined(function: F) -> F:
    """Compile a short function that only kernels call into its callers.

    A call would take as long as the function itself.
    """
    return _compile(
        function,
        _nrt=False,
        no_cpython_wrapper=True,
        forceinline=True,
        pipeline_class=_PartCompiler,
    )


def allocating(function: F) -> F:
    """Compile a kernel that allocates arrays."""
    return _compile(function, _nrt=True)  # numba takes options that are not given from the caller


def _compile(function: F, **options: Any) -> F:
    """Compile a function at its first call; cache its code.

    Raises InputError if numba's compiler is disabled.
    """
    if _CONFIG.DISABLE_JIT:
        raise InputError(
            "NUMBA_DISABLE_JIT",
            "is set",
            "proofs rely on the arithmetic of compiled code",
        )
    options |= {"nogil": True, "error_model": "numpy"}
    options["no_cfunc_wrapper"] = True  # C functions are not used, and take a tenth of the time
    compiled = numba.njit(**options)(function)
    compiled._cache = _KeptCode(compiled)
    _compile_in_turn(compiled, f"{function.__module__}.{function.__name__}")
    return compiled  # type: ignore[no-any-return]


def _compile_in_turn(compiled: Any, name: str) -> None:
    """Let one process at a time compile or load a function, while the clock stops.

    Others wait for it and load its code, which they would otherwise compile again.
    """
    compile_ = compiled.compile

    def compile_in_turn(signature: Any) -> Any:
        """Compile a signature, or load its code."""
        with global_compiler_lock, clock.stopped(), _turn(name), hold_interrupts():
            return compile_(signature)  # threads take turns, too

    compiled.compile = compile_in_turn


class _KeptCode(NullCache):
    """Machine code of a function on disk, a file for each signature and processor.

    The name of a file has a digest of all from which the code was compiled. A file begins with a
    checksum of its name and of the rest.
    """

    def __init__(self, function: Any) -> None:
        """Keep the code of a compiled function."""
        self.function = function

    def load_overload(self, signature: Any, context: Any) -> Any:
        """Load the code of a signature, or return None."""
        context.refresh()
        target = context.codegen().magic_tuple()
        with _without_disk():
            name = self._name_code(signature)
            data = _read(cache_folder(), name, target)
            if data is None and not shipped.find_code_misfit():
                folder = shipped.FOLDER / shipped.name_code()
                data = _read(folder, name, (target[0], *shipped.TARGET))
            if data is not None:
                return CompileResult._rebuild(context, *pickle.loads(data))  # type: ignore[no-untyped-call]
            # Code of several processes meets in one, and functions of one name, e.g. closures, are
            # told apart by numbers. Numba counts from 1 in each process.
            FunctionIdentity._unique_ids = itertools.count(int(name[-16:], 16))
        return None

    def save_overload(self, signature: Any, result: Any) -> None:
        """Save the code of a signature, if possible."""
        folder = cache_folder()
        if folder is None or result.library.has_dynamic_globals:  # such as addresses
            return
        with _without_disk():
            check_values(self.function)
            data = dumps(result._reduce())  # type: ignore[no-untyped-call]
            _write(folder, self._name_code(signature), result.codegen.magic_tuple(), data)

    def _name_code(self, signature: Any) -> str:
        """Name the code of a signature, for any processor."""
        types = normalize_signature(signature)  # type: ignore[no-untyped-call]
        function = self.function.py_func
        name = re.sub(r"[^\w.]", "", f"{function.__module__}.{function.__qualname__}")
        return f"{name[:100]}-{digest_function(self.function, types)}"


def _find_file(folder: Path, name: str, target: tuple[str, ...]) -> Path:
    """Return the file of code for a processor."""
    return folder / f"{name}-{digest_value(target)}.nbc"


def _read(folder: Path | None, name: str, target: tuple[str, ...]) -> bytes | None:
    """Read code for a processor; return None without a file, or if it is damaged."""
    file = folder and _find_file(folder, name, target)
    if file is None or not file.exists():
        return None
    content = file.read_bytes()
    checksum, data = content[:CHECKSUM_BYTES], content[CHECKSUM_BYTES:]
    if checksum != _sum_up(file, data):
        return None
    with suppress(OSError):  # code that comes with the package may belong to another user
        file.touch()  # the time of the last use
    return data


def _write(folder: Path, name: str, target: tuple[str, ...], data: bytes) -> None:
    """Write code for a processor, and remove the function's code that is unused for a week."""
    file = _find_file(folder, name, target)
    part = file.with_suffix(f".{os.getpid()}")
    try:
        part.write_bytes(_sum_up(file, data) + data)
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)
    function, *_ = name.split("-")
    for other in folder.glob(f"{function}-*"):
        if _is_unused(other):
            other.unlink(missing_ok=True)


def _sum_up(file: Path, data: bytes) -> bytes:
    """Return the checksum of a file's name and data."""
    return hashlib.sha256(file.name.encode() + data).digest()


@contextmanager
def _without_disk() -> Iterator[None]:
    """Go on without the disk where it is full, or cannot be read, and without what is not kept."""
    try:
        yield
    except (OSError, UnknownValueError) as error:
        _warn_once(NOT_KEPT, cache_folder(), getattr(error, "strerror", None) or error)


@contextmanager
def _turn(name: str) -> Iterator[None]:
    """Wait for this process's turn at a function, a byte of the lock file."""
    place = 1, zlib.crc32(name.encode())
    file = _open_lock_file()
    if file is None or place in _own_turns:
        yield
        return
    import fcntl  # imported here, because Windows lacks it, and has no folder to lock

    with suppress(OSError):  # some file systems have no locks; processes go on without
        _take_turn(file, place, name)
    _own_turns.add(place)
    try:
        yield
    finally:
        _own_turns.remove(place)
        with suppress(OSError):
            fcntl.lockf(file, fcntl.LOCK_UN, *place)


_own_turns: Final = set[tuple[int, int]]()
_idle_processes: Final = set[int]()
_warnings: Final = set[str]()


def _take_turn(file: int, place: tuple[int, int], name: str) -> None:
    """Wait for a byte of the lock file, unless another process keeps it for long."""
    import fcntl

    began = time.monotonic()
    seconds_until_named, seconds_until_left = TURN_SECONDS
    while True:
        try:
            fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB, *place)
            return
        except (BlockingIOError, PermissionError):  # systems differ
            process = _find_process(file, place)
        waited = time.monotonic() - began
        # It keeps the functions, too, for which it compiles this one.
        if waited > seconds_until_left or process in _idle_processes:
            _idle_processes.add(process)
            return
        if waited > seconds_until_named:
            _warn_once(LONG_TURN, process, name, seconds_until_left)
        time.sleep(0.02)


def _find_process(file: int, place: tuple[int, int]) -> int:
    """Return the number of the process that has locked a byte; 0 if none has any more."""
    import fcntl

    length, start = place
    kind = fcntl.F_WRLCK, os.SEEK_SET
    # macOS orders the fields of ``struct flock`` differently.
    is_mac = platform.system() == "Darwin"
    layout = "qqihh" if is_mac else "hhqqi"
    fields = (start, length, 0, *kind) if is_mac else (*kind, start, length, 0)
    answer = fcntl.fcntl(file, fcntl.F_GETLK, struct.pack(layout, *fields))
    return int(struct.unpack(layout, answer)[2 if is_mac else 4])


def _warn_once(message: str, *values: object) -> None:
    """Log a message, once per process."""
    if message not in _warnings:
        _warnings.add(message)
        LOGGER.warning(message, *values)


@cache
def _open_lock_file() -> int | None:
    """Open the lock file; return its descriptor, or None without a cache that can be written."""
    folder = cache_folder()
    with suppress(OSError):
        return None if folder is None else os.open(folder / "lock", os.O_RDWR)
    return None


class _Part(JITCodeLibrary):
    """Code of a function that only kernels call.

    It is optimised and made machine code as a part of each kernel. Numba would do so here too, for
    nobody.
    """

    def _optimize_final_module(self) -> None:
        """Do nothing, because kernels optimise their parts."""

    def _finalize_final_module(self) -> None:
        """Do without machine code."""
        self._finalize_dynamic_globals()  # type: ignore[no-untyped-call]
        self._finalized = True

    @property
    def codegen(self) -> _Part:
        """The receiver of the environment of machine code."""
        return self

    def set_env(self, name: str, environment: object) -> None:
        """Do nothing, because there is no machine code."""

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """Return the code for the cache."""
        return self.serialize_using_bitcode()  # type: ignore[no-any-return,no-untyped-call]


class _PartCompiler(Compiler):
    """Compiler of functions that only kernels call."""

    def define_pipelines(self) -> Any:
        """Return numba's pipelines, with another container of the code."""
        state = self.state
        name = state.func_id.func_qualname
        state.library = _Part(state.targetctx.codegen(), name)  # type: ignore[no-untyped-call]
        return super().define_pipelines()  # type: ignore[no-untyped-call]


@cache
def cache_folder() -> Path | None:
    """Return the folder of compiled code, or None.

    Each version of Python, numba, llvmlite and numpy has its own folder.
    """
    if not hasattr(os, "geteuid"):  # Windows does not tell who may write to a folder
        return None
    places = [_CONFIG.CACHE_DIR, os.environ.get("XDG_CACHE_HOME"), "~/.cache"]
    with suppress(FileNotFoundError):  # no folder for temporary files
        places.append(f"{tempfile.gettempdir()}/cache-{os.geteuid()}")
    for place in filter(None, places):
        with suppress(OSError, RuntimeError):  # RuntimeError without a home folder
            folder = Path(place).expanduser().absolute() / "cspace" / shipped.name_code()
            folder.parent.mkdir(parents=True, exist_ok=True)
            folder.mkdir(mode=0o700, exist_ok=True)
            if is_private(folder):
                (folder / "lock").touch()  # the time of the last use
                _remove_unused(folder.parent)
                return folder
    return None


def describe_code() -> dict[str, object]:
    """Return what ``cspace compile`` tells; raise InputError if compiled code is not kept."""
    folder = cache_folder()
    if folder is None:
        raise InputError("NUMBA_CACHE_DIR", "names no safe folder", "compiled code is kept in one")
    return {
        "folder": str(folder),
        "compiled_functions": len(list(folder.glob("*.nbc"))),
        "code_of_package": shipped.find_code_misfit() or "used",
    }


def is_private(folder: Path) -> bool:
    """Return True if no other user can replace a folder's files.

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
    """Remove compiled code of versions unused for a week."""
    for lock in parent.glob("numba-*/lock"):
        is_ours = re.fullmatch("numba-.+-llvmlite-.+-numpy-.+-[a-z]+-[0-9]+", lock.parent.name)
        with suppress(OSError):
            if is_ours and _is_unused(lock):
                shutil.rmtree(lock.parent)


def _is_unused(file: Path) -> bool:
    """Return True if a file was not used for a week."""
    return time.time() - file.stat().st_mtime > UNUSED_SECONDS


class _Clock(event.Listener):
    """A clock for time limits: the time that passes, without this process's compilations.

    A compilation in one thread holds up the others, so it stops the clock for all of them. So does
    loading code, and waiting for another process that compiles it.
    """

    read = staticmethod(time.monotonic)

    # Number of nested stops, start of the outermost one, and seconds that all earlier ones took.
    # They are one tuple, so that threads read values of one moment.
    _stops = 0, 0.0, 0.0

    # Number of nested compilations, start of the outermost one, and seconds of all earlier ones.
    _compilations = 0, 0.0, 0.0

    def __call__(self) -> float:
        """Return the time without compilations, seconds."""
        depth, since, seconds = self._stops
        return (since if depth else self.read()) - seconds

    @contextmanager
    def stopped(self) -> Iterator[None]:
        """Stop the clock meanwhile."""
        with _CLOCK_LOCK:
            self._stops = _enter(self._stops, self.read())
        try:
            yield
        finally:
            with _CLOCK_LOCK:
                self._stops = _leave(self._stops, self.read())

    def on_start(self, event: Any) -> None:
        """Stop the clock, for functions of others, too; log a long wait."""
        now = self.read()
        with _CLOCK_LOCK:
            self._stops = _enter(self._stops, now)
        self._compilations = _enter(self._compilations, now)
        _, since, seconds = self._compilations
        module = event.data["dispatcher"].py_func.__module__
        is_ours = module.startswith(("cspace.", "planners."))
        if is_ours and now - since + seconds > LONG_WAIT_SECONDS:
            how_often = "once" if cache_folder() else "at each start, as no cache is safe"
            _warn_once(LONG_WAIT, how_often)

    def on_end(self, event: Any) -> None:
        """Restart the clock."""
        now = self.read()
        self._compilations = _leave(self._compilations, now)
        with _CLOCK_LOCK:
            self._stops = _leave(self._stops, now)


def _enter(nested: tuple[int, float, float], now: float) -> tuple[int, float, float]:
    """Begin a span of time, which may lie within another one."""
    depth, since, seconds = nested
    return depth + 1, since if depth else now, seconds


def _leave(nested: tuple[int, float, float], now: float) -> tuple[int, float, float]:
    """End a span of time, and add the outermost one to the seconds."""
    depth, since, seconds = nested
    return depth - 1, since, seconds + (now - since if depth == 1 else 0.0)


class _CollectorPause(event.Listener):
    """A pause of the garbage collector while a function is compiled.

    A compiler makes many objects and keeps most of them, so visiting them would take a tenth of its
    time.
    """

    _depth = 0
    _was_enabled = False

    def on_start(self, event: Any) -> None:
        """Pause at the start of the outermost compilation."""
        if self._depth == 0:
            self._was_enabled = gc.isenabled()
            gc.disable()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """Go on after the outermost compilation."""
        self._depth -= 1
        if self._depth == 0 and self._was_enabled:
            gc.enable()


clock: Final = _Clock()
for _listener in (clock, _CollectorPause()):
    event.register("numba:compile", _listener)  # type: ignore[no-untyped-call]
