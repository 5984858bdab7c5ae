"""Files: what is there and of a size that can be read is read, or an error names it; outputs are written.

An output is either complete or not there: it is written under a temporary name beside the target, then renamed.
"""

from __future__ import annotations

import io
import os
import shutil
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Any, Final, TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Floats, Ints
from cspace.errors import CspaceError, FileError, InputError
from cspace.limits import check_bytes

_LONGEST_HEADER: Final = 2**16
"""Bytes in which a text header before binary data must end."""

_LONGEST_NUMBER: Final = 64
"""Bytes of a number that are read many at a time."""

_ASIDE: Final = ".cspace-"
"""Beginning of the names of outputs that are not complete, or are being replaced."""

_MAX_READS: Final = 1000
"""Times that an output is read at most, if each time another process replaces it."""

_PAUSE: Final = 0.002
"""Seconds between two of these."""

Result = TypeVar("Result")

_POINTER: Final = b"version https://git-lfs.github.com/spec/v1"
"""First bytes of a pointer of git-lfs."""

_MAX_POINTER_BYTES: Final = 1024
"""Largest size of a pointer of git-lfs, bytes, by its specification."""

_SHOWN: Final = 60
"""Characters of a wrong line that a message quotes."""


def existing(path: str | os.PathLike[str], kind: str, memory: float = 1.0) -> Path:
    """``path`` as a :class:`~pathlib.Path` to a file that is there and not too large.

    ``kind`` says in messages what it should be, such as "ROS map"; each of its bytes takes ``memory`` bytes when read.

    Raises InputError if ``path`` is not a file name, and FileError if nothing is there, or no plain file, or one that
    is too large (:mod:`cspace.limits`), or a pointer of git-lfs.
    """
    file, what = look_up(path, kind)
    if not what:
        raise FileError(str(file), "does not exist", f"{_one(kind)} is to be read", "check the name and the folder")
    if what != "file":
        raise FileError(str(file), f"is {what}", f"{_one(kind)} is read from a plain file", "pass the file itself")
    try:
        size = file.stat().st_size
    except OSError as error:  # it was removed just now
        raise unreadable(path, kind, error) from error
    if size <= _MAX_POINTER_BYTES:
        _refuse_pointer(file, kind)
    check_bytes(file, size, memory=memory)
    return file


def _refuse_pointer(file: Path, kind: str) -> None:
    """Refuse a pointer that git-lfs leaves in place of a large file."""
    try:
        with file.open("rb") as stream:
            is_pointer = stream.read(len(_POINTER)) == _POINTER
    except OSError as error:
        raise unreadable(file, kind, error) from error
    if is_pointer:
        rule = f"the {kind} itself has not been fetched"
        raise FileError(str(file), "is a pointer of git-lfs", rule, "run git lfs pull in its repository")


def look_up(path: str | os.PathLike[str], kind: str) -> tuple[Path, str]:
    """A path, and what is there: "file", "a folder", "a device, a pipe or a socket", or nothing, the empty text.

    Raises InputError if ``path`` is not a file name, and FileError if the system refuses to look there.
    """
    try:
        file = Path(path)
        if file.is_file():
            return file, "file"
        return file, "a folder" if file.is_dir() else "a device, a pipe or a socket" if file.exists() else ""
    except (TypeError, ValueError) as error:
        raise not_a_name(path) from error
    except OSError as error:
        raise unreadable(path, kind, error) from error


def not_a_name(path: object) -> InputError:
    """The error for something that cannot be a file's name."""
    return InputError("path", f"is {path!r}", "it must be a file name", "pass a string or a pathlib.Path", value=path)


def unreadable(path: str | os.PathLike[str], kind: str, error: OSError) -> FileError:
    """The error for a file that the system refuses to read."""
    problem, rule = f"cannot be read: {error.strerror or error}", f"{_one(kind)} must be readable"
    return FileError(os.fspath(path), problem, rule, "check its permissions")


class Fault(Exception):  # noqa: N818 - it becomes an error in decoding
    """What is wrong with the content of a file, said without its name, which :func:`decoding` adds.

    The parts are those of :class:`cspace.errors.CspaceError`, and ``kind`` is the type of the error.
    """

    def __init__(
        self,
        problem: str,
        rule: str = "it is malformed or truncated",
        hint: str = "copy it or write it again",
        *,
        kind: type[CspaceError] = FileError,
        value: object = None,
    ) -> None:
        super().__init__(problem)
        self.parts, self.kind, self.value = (problem, rule, hint), kind, value


@contextmanager
def decoding(path: str | os.PathLike[str], kind: str, *advice: str) -> Iterator[None]:
    """Turn whatever damage makes the decoders in a block raise into one error for the file.

    ``advice`` are the rule and the mend of an error that is no :class:`Fault`; by default those of one.
    """
    try:
        yield
    except (CspaceError, MemoryError, UserWarning):  # a warning of ours may be an error to its caller
        raise
    except Fault as problem:
        raise problem.kind(os.fspath(path), *problem.parts, value=problem.value) from problem
    except PermissionError as error:
        raise unreadable(path, kind, error) from error
    except Exception as error:
        reason = f"{type(error).__name__}: {' '.join(str(error).split()):.200}"
        raise FileError(os.fspath(path), *Fault(f"cannot be read as {_one(kind)} ({reason})", *advice).parts) from error


def suffix_of(path: str | os.PathLike[str], known: Iterable[str], rule: str, argument: str = "path") -> str:
    """The suffix of a file's name, in small letters.

    Raises InputError if ``path`` is no name of a file, or ends otherwise than in one of those that are known.
    """
    try:
        file = Path(path)
    except TypeError as error:
        raise not_a_name(path) from error
    suffix = file.suffix.lower()
    if suffix not in known:
        hint = f"use one of {', '.join(filter(None, known))}"
        raise InputError(argument, f"is {file}, which ends in {suffix!r}", rule, hint, value=path)
    return suffix


def read_bytes(path: str | os.PathLike[str], kind: str, memory: float = 1.0) -> bytes:
    """Content of a file; ``memory`` as for :func:`existing`.

    Raises InputError or FileError as :func:`existing`, and if the system refuses to read it.
    """
    file = existing(path, kind, memory)
    try:
        return file.read_bytes()
    except OSError as error:
        raise unreadable(file, kind, error) from error


def read_part(folder: str | os.PathLike[str], name: str, kind: str) -> bytes | None:
    """Read a file of a folder by the name that other files of the folder give it; None if it is missing.

    Raises FileError if the name leads out of the folder, or as :func:`existing`.
    """
    part = PurePath(name)
    if part.drive or part.root or ".." in part.parts:
        rule, hint = "a folder is read without any file outside of it", "do not trust it; fetch it again"
        raise FileError(os.fspath(folder), f"names a file {name!r}", rule, hint)
    file = Path(folder, part)
    try:
        return read_bytes(file, kind)
    except FileError:
        if os.path.lexists(file):
            raise
        return None


def read_text(path: str | os.PathLike[str], kind: str, memory: float = 4.0) -> str:
    """Text of a file in UTF-8, line ends turned into ``\\n``; ``memory`` as for :func:`existing`.

    Raises InputError or FileError as :func:`read_bytes`, and if the file is not text.
    """
    content = read_bytes(path, kind, memory)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem, rule = f"is not text: byte {error.start} is not UTF-8", f"{_one(kind)} is a text file"
        raise FileError(os.fspath(path), problem, rule, "pass the right file") from error
    return text.replace("\r\n", "\n").replace("\r", "\n") if "\r" in text else text


def read_columns(text: str, first: int = 1) -> Floats:
    """Numbers of a text, shape (n, columns), a row for each line that holds some; (0, 0) where there are none.

    Columns are separated by commas where the first row has one, else by blanks; ``#`` begins a comment, and ``first``
    is the number of the first line. A text that is cut within its last number cannot be told from a whole one.

    Raises Fault if a line holds something else than numbers, or has more or fewer than the first one; the message
    names it.
    """
    row = next((content for line in text.split("\n") if (content := _content(line))), "")
    if not row:
        return np.zeros((0, 0))
    separator = "," if "," in row else None
    try:
        return np.loadtxt(io.StringIO(text), dtype=np.float64, comments="#", delimiter=separator, ndmin=2)
    except ValueError as error:
        raise _fault(text, first, separator, len(row.split(separator)), error) from error


def _content(line: str) -> str:
    """A line without its comment."""
    return line.partition("#")[0].strip()


def _fault(text: str, first: int, separator: str | None, columns: int, error: ValueError) -> Fault:
    """What is wrong with the first line that is."""
    for number, line in enumerate(text.split("\n"), start=first):
        parts = _content(line).split(separator) if _content(line) else []
        rule = f"{columns} columns, like the first row"
        try:
            if len(list(map(float, parts))) in (0, columns):
                continue
        except ValueError:
            rule = "numbers alone; a heading needs a '#' before it"
        problem = f"line {number} is {line.strip()[:_SHOWN]!r}"
        return Fault(problem, f"it must hold {rule}", "mend the line, or fetch a truncated file again")
    return Fault(f"cannot be read: {error}", "it must hold columns of numbers", "mend that line")


def header_lines(content: bytes) -> Iterator[tuple[str, int]]:
    """Lines at the beginning of a file, each with the place after it, as far as a header may reach."""
    at = 0
    while 0 <= at < min(len(content), _LONGEST_HEADER):
        end = content.find(b"\n", at, at + _LONGEST_HEADER)
        after = len(content) if end < 0 else end + 1
        yield content[at : after if end < 0 else end].decode("latin-1"), after
        at = after


@overload
def numbers_of(tokens: Sequence[bytes], kind: type[int]) -> Ints: ...
@overload
def numbers_of(tokens: Sequence[bytes], kind: type[float]) -> Floats: ...
def numbers_of(tokens: Sequence[bytes], kind: type[int] | type[float]) -> NDArray[Any]:
    """Tokens as numbers, shape (n,).

    Raises ValueError or OverflowError if one is none, or beyond 64 bits.
    """
    if max(map(len, tokens), default=0) > _LONGEST_NUMBER:  # a table of texts is as wide as its longest one
        return np.array(list(map(kind, tokens)), dtype=np.dtype(kind))
    return np.array(tokens, dtype=np.bytes_).astype(kind) if tokens else np.empty(0, kind)


UNKNOWNS: Final = ("occupied", "free")
"""What unknown cells of a map can count as."""


def is_count(word: str) -> bool:
    """Whether a word is a whole number without a sign, of at most 18 digits: more is no count of anything."""
    return word.isascii() and word.isdecimal() and len(word) <= 18


def _one(kind: str) -> str:
    """A kind of file with its article."""
    return f"{'an' if kind[:1].lower() in 'aeio' else 'a'} {kind}"


@contextmanager
def replacing(
    path: str | os.PathLike[str], overwrite: bool = False, *, folder: Callable[[Path], bool] | None = None
) -> Iterator[Path]:
    """Hand out a temporary name to write to; give it the real name once the block has ended well.

    The name is in the same folder and has the same suffix; a link is followed. Any exception in the block, Ctrl-C
    included, removes what was written and leaves the target as it was. Targets are checked before the block runs, so
    that long work is not lost to a name that could never be used: FileError, as where writing fails. Several outputs
    that belong together are nested, the one that refers to the others outermost::

        with replacing("map.yaml") as yaml, replacing("map.pgm") as pgm:
            ...

    With ``overwrite`` a folder is replaced only by a folder and a file only by a file. ``folder`` is given where the
    output is a folder: it tells of an existing, non-empty one whether it is an earlier output, so that nothing else
    is ever removed.
    """
    try:
        target = Path(os.path.realpath(path))
    except (TypeError, ValueError) as error:
        raise not_a_name(path) from error
    try:
        _check_target(target, overwrite, folder)
        temporary = _beside(target)
        try:
            yield temporary
            _check_target(target, overwrite, folder)
            _move(temporary, target)
        finally:
            _remove(temporary)
    except FileError:
        raise
    except OSError as error:
        rule, hint = "an output needs a writable folder with free space", "free some or choose another folder"
        raise FileError(str(target), f"cannot be written: {error.strerror or error}", rule, hint) from error


def check_output(target: Path, overwrite: bool) -> None:
    """Refuse, before any work, a file or folder that may not be written; whether it is of our kind is seen later.

    Raises FileError if its folder is missing or may not be written, or it exists and may not be replaced.
    """
    parent = target.parent
    if not parent.is_dir():
        problem = f"cannot be written: {parent} is not a folder", "outputs go to an existing folder", "create it first"
    elif not os.access(parent, os.W_OK | os.X_OK):
        denied = f"cannot be written: no permission to write in {parent}"
        problem = denied, "an output needs a writable folder", "change its permissions or choose another"
    elif target.exists() and not overwrite:
        problem = "exists", "an existing output is kept unless told otherwise", "pass overwrite=True"
    else:
        return
    raise FileError(str(target), *problem)


def _check_target(target: Path, overwrite: bool, folder: Callable[[Path], bool] | None) -> None:
    """Raise FileError where ``target`` may not be written."""
    check_output(target, overwrite)
    if not target.exists():
        return
    if folder is None and not target.is_file():
        problem = "is not a plain file", "a file replaces only a file", "choose another name"
    elif folder is not None and not target.is_dir():
        problem = "is not a folder", "a folder replaces only a folder", "choose another name"
    elif folder is not None and any(target.iterdir()) and not folder(target):
        hint = "choose another name, or remove the folder yourself"
        problem = "holds more than an earlier output", "only an earlier output is replaced", hint
    else:
        return
    raise FileError(str(target), *problem)


def retry_if_replaced(path: str | os.PathLike[str], read: Callable[[], Result]) -> Result:
    """Read an output; read it again if another process replaced it meanwhile.

    A folder that :func:`replacing` writes is missing for an instant, between the two renames, and a reader may find
    some files of the old folder and some of the new one.

    Raises what `read` raises if the output stays as it is.
    """
    for _ in range(_MAX_READS - 1):
        before = _moment(path)
        try:
            return read()
        except FileError:
            is_between = before is None and any(Path(os.path.realpath(path)).parent.glob(f"{_ASIDE}*"))
            if _moment(path) == before and not is_between:
                raise
            time.sleep(_PAUSE)
    return read()


def _moment(path: str | os.PathLike[str]) -> tuple[int, int, int] | None:
    """Return what differs between a file or folder and the one that replaces it; None if nothing is there."""
    try:
        status = Path(path).stat()
    except (OSError, TypeError, ValueError):
        return None
    return status.st_ino, status.st_mtime_ns, status.st_ctime_ns


def _beside(target: Path) -> Path:
    """A fresh name in the folder of ``target``: only within one folder is a rename sure to be atomic."""
    return target.with_name(f"{_ASIDE}{uuid.uuid4().hex[:12]}{target.suffix}")


def _move(temporary: Path, target: Path) -> None:
    """Rename ``temporary`` to ``target``; an old folder is kept aside until the new one is in its place."""
    if not target.is_dir():
        temporary.replace(target)
        return
    aside = _beside(target)
    try:
        target.rename(aside)
        temporary.rename(target)
    except BaseException:
        if aside.exists() and not target.exists():
            aside.rename(target)
        _remove(aside)
        raise
    _remove(aside)


def _remove(path: Path) -> None:
    """Remove a file or folder of ours, where it is there."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
