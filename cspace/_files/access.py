"""Reading of files of bounded size, and atomic writing of outputs.

Errors name the file. An output is complete or absent: it is written under a temporary name beside
the target, then renamed.
"""

from __future__ import annotations

import errno
import io
import itertools
import os
import shutil
import uuid
from collections.abc import Callable, Collection, Container, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path, PurePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace._support.arrays import Floats, StrPath
from cspace._support.check import suggest_name
from cspace._support.kinds import BRING_YOUR_FILE, make_kind_error
from cspace._support.limits import SizeLimit, check_bytes
from cspace.errors import CspaceError, FileError, InputError

TEMPORARY_NAME: Final = r"\.cspace-[0-9a-f]{12}(\..*)?"
"""Pattern of the names of outputs that are incomplete or being replaced."""

BROUGHT: Final = (
    ".3ds .3mf .blend .dcm .dxf .e57 .fbx .fgb .gml .gpkg .ifc .iges .igs .kml .las .laz .mha .nc "
    ".nii .nrrd .off .mjcf .pts .sdf .shp .step .stp .svg .tsdf .usd .usda .usdz .x3d .xacro .xml "
    ".xyzrgb"
)
"""Suffixes of formats that the page "Bring your file" names."""

_MALFORMED: Final = "it is malformed or truncated"
"""Rule of a file's content if no other is known."""


def check_file(
    path: StrPath, kind: str, memory: float = 1.0, limit: SizeLimit = "max_bytes"
) -> Path:
    """Return `path` as a Path, if a readable plain file is there.

    `kind` names the expected file in messages, such as "ROS map". Reading takes `memory` bytes per
    byte of the file. `limit` is the limit of :mod:`cspace._support.limits` for its size.

    Raises InputError if `path` is not a file name. Raises FileError if the file is missing, is not
    a plain file, is larger than the limits allow, or is a git-lfs pointer, which git-lfs
    leaves in place of a large file.
    """
    # It must be a plain file, then not a pointer to one, then not too large.
    file, what = inspect_path(path, kind)
    if what != "file":
        problem = f"is {what}" if what else "does not exist"
        rule = f"{_with_article(kind)} must be a plain file"
        hint = suggest_file(file)
        raise FileError(str(file), problem, rule, hint)
    # First bytes of a git-lfs pointer file.
    lfs_pointer_start = b"version https://git-lfs.github.com/spec/v1"
    with _name_file_in_errors(file, kind), file.open("rb") as stream:
        size = file.stat().st_size
        start = stream.read(len(lfs_pointer_start))
    # Maximum size, in bytes, of a git-lfs pointer file, by its specification.
    if start == lfs_pointer_start and size <= 1024:
        rule = f"the {kind} itself has not been fetched"
        raise FileError(str(file), "is a git-lfs pointer", rule)
    check_bytes(file, size, memory=memory, limit=limit)
    return file


def inspect_path(path: StrPath, kind: str) -> tuple[Path, str]:
    """Return a path and the type of file there.

    The type is "file", "a folder", "a device, a pipe or a socket", or "" if nothing is there.

    Raises InputError if `path` is not a file name. Raises FileError if the system denies access.
    """
    file = check_name(path)
    with _name_file_in_errors(file, kind):
        if file.is_file():
            return file, "file"
        if file.is_dir():
            return file, "a folder"
        if file.exists():
            return file, "a device, a pipe or a socket"
    return file, ""


@contextmanager
def _name_file_in_errors(file: Path, kind: str) -> Iterator[None]:
    """Turn an error of the system into one that names the file."""
    try:
        yield
    except OSError as error:
        problem = f"cannot be read: {error.strerror or error}"
        rule = f"{_with_article(kind)} must be readable"
        raise FileError(str(file), problem, rule) from error


def suggest_file(path: Path, otherwise: str = "", suffixes: Container[str] | None = None) -> str:
    """Return a hint about a wrong file name.

    If the file is missing, it names a similar file beside it, of these suffixes. `otherwise` is the
    hint if the file exists, or there is none.
    """
    try:
        if path.exists():
            return otherwise
        visible = (file for file in path.parent.iterdir() if not file.name.startswith("."))
        # Maximum number of names in a folder that are compared with a misspelt one.
        names = [
            file.name
            for file in itertools.islice(visible, 10_000)
            if suffixes is None or file.suffix.lower() in suffixes
        ]
    except (OSError, ValueError):
        return otherwise
    return suggest_name(path.name, names) or otherwise


def check_name(path: StrPath) -> Path:
    """Return a file name as a Path.

    Raises InputError if it is not one.
    """
    with suppress(TypeError, UnicodeError):
        if b"\0" not in os.fsencode(path):
            return Path(os.fsdecode(path))
    raise make_kind_error(path, "path", "it must be a file name")


class ContentError(Exception):
    """An error in the content of a file, without its name.

    :func:`decoding` raises it again with the name. `kind` is the type of that error; the other
    parameters are those of :class:`cspace.errors.CspaceError`.
    """

    def __init__(
        self,
        problem: str,
        rule: str = _MALFORMED,
        hint: str = "",
        *,
        kind: type[CspaceError] = FileError,
    ) -> None:
        """Keep the parts of the message."""
        super().__init__(problem)
        self.parts = problem, rule, hint
        self.kind = kind


@contextmanager
def decoding(path: StrPath, kind: str, rule: str = _MALFORMED) -> Iterator[None]:
    """Turn any exception of a decoder into an error naming the file.

    `rule` is that of exceptions other than :class:`ContentError`.
    """
    try:
        yield
    except (CspaceError, MemoryError, UserWarning):  # callers may turn our warnings into errors
        raise
    except ContentError as error:
        raise error.kind(os.fspath(path), *error.parts) from error
    except Exception as error:
        reason = f"{type(error).__name__}: {' '.join(str(error).split()):.200}"
        problem = f"cannot be read as {_with_article(kind)} ({reason})"
        raise FileError(os.fspath(path), problem, rule) from error


def check_suffix(
    path: StrPath,
    known: Collection[str],
    rule: str,
    argument: str = "path",
    *,
    is_output: bool = False,
) -> str:
    """Return a file name's suffix, in lower case.

    Messages suggest a similar file, unless the file is an output.

    Raises InputError if `path` is not a file name, or its suffix is not in `known`.
    """
    file = check_name(path)
    suffix = file.suffix.lower()
    if suffix not in known:
        rule = f"{rule}; known are {', '.join(filter(None, known))}"
        page = BRING_YOUR_FILE if suffix in BROUGHT.split() else ""
        hint = "" if is_output else suggest_file(file, page, known)
        raise InputError(argument, f"is {file}, with suffix {suffix!r}", rule, hint)
    return suffix


def read_bytes(
    path: StrPath, kind: str, memory: float = 1.0, limit: SizeLimit = "max_bytes"
) -> bytes:
    """Return the content of a file; parameters as for :func:`check_file`.

    Raises InputError or FileError as :func:`check_file`, and FileError if the system refuses to
    read the file.
    """
    file = check_file(path, kind, memory, limit)
    with _name_file_in_errors(file, kind):
        return file.read_bytes()


def read_member(folder: StrPath, name: str, kind: str) -> bytes | None:
    """Read a file that another of its folder names.

    Returns None if the file is missing.

    Raises FileError if the name leads out of the folder, or as :func:`check_file`.
    """
    relative = PurePath(name)
    if relative.drive or relative.root or ".." in relative.parts:
        rule = "files outside the folder are never read"
        raise FileError(os.fspath(folder), f"names a file {name!r}", rule)
    file, what = inspect_path(Path(folder, relative), kind)
    if not what and not file.is_symlink():  # a broken link is an error, not a missing file
        return None
    return read_bytes(file, kind)


def read_text(path: StrPath, kind: str, memory: float = 4.0, limit: SizeLimit = "max_bytes") -> str:
    """Return the text of a UTF-8 file.

    Every line end becomes a newline; parameters as for :func:`check_file`.

    Raises InputError or FileError as :func:`read_bytes`, and FileError if the file is not UTF-8.
    """
    content = read_bytes(path, kind, memory, limit)
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        problem = f"is not text: byte {error.start} is not UTF-8"
        rule = f"{_with_article(kind)} is a text file"
        raise FileError(os.fspath(path), problem, rule) from error
    return text.replace("\r\n", "\n").replace("\r", "\n")


def read_columns(text: str, first: int = 1) -> Floats:
    """Parse lines of numbers into an array of shape (n, columns).

    Without numbers the shape is (0, 0). Semicolons or commas separate columns if the first row has
    one, blanks otherwise; ``#`` starts a comment. `first` is the number of the first line, for
    messages. A text truncated within its last number cannot be detected.

    Raises ContentError, naming the line, if a line holds anything but numbers or its length differs
    from the first row's.
    """
    contents = map(_strip_comment, text.split("\n"))
    first_row = next(filter(None, contents), "")
    if not first_row:
        return np.zeros((0, 0))
    separator = next((mark for mark in ";," if mark in first_row), None)
    try:
        return np.loadtxt(
            io.StringIO(text), dtype=np.float64, comments="#", delimiter=separator, ndmin=2
        )
    except ValueError as error:
        columns = len(first_row.split(separator))
        raise _make_line_error(text, first, separator, columns) from error


def _strip_comment(line: str) -> str:
    """Return a line without its comment."""
    return line.partition("#")[0].strip()


def _make_line_error(text: str, first: int, separator: str | None, columns: int) -> ContentError:
    """Return the error for the first line that is no numbers."""
    for number, line in enumerate(text.split("\n"), start=first):
        content = _strip_comment(line)
        words = content.split(separator) if content else []
        rule = f"it must hold {columns} columns, like the first row"
        try:
            values = [float(word) for word in words]
            if len(values) in (0, columns):
                continue
        except ValueError:
            rule = "it must hold only numbers, with decimal points"
        # Maximum number of characters of a wrong line that a message quotes.
        problem = f"line {number} is {line.strip()[:60]!r}"
        return ContentError(problem, rule)
    return ContentError("cannot be read", "it must hold columns of numbers")


def iterate_header_lines(content: bytes) -> Iterator[tuple[str, int]]:
    """Yield each line of a header, and the position after it.

    A header lies within the first 64 KiB.
    """
    start = 0
    # Maximum size, in bytes, of a text header before binary data.
    max_header_bytes = 2**16
    while start < min(len(content), max_header_bytes):
        end = content.find(b"\n", start, start + max_header_bytes)
        if end < 0:  # the last line has no end
            end = len(content)
        following = min(end + 1, len(content))
        yield content[start:end].decode("latin-1"), following
        start = following


def parse_numbers(tokens: Sequence[bytes], kind: type[int] | type[float]) -> NDArray[Any]:
    """Parse tokens as numbers, shape (n,).

    Raises ValueError if a token is not a number, and OverflowError if it needs more than 64 bits.
    """
    if not tokens:
        return np.empty(0, kind)
    # An array of texts is as wide as its longest entry, so one long token would multiply the
    # memory.
    # Maximum length, in bytes, of a number that is parsed in a batch.
    if max(map(len, tokens)) > 64:
        return np.array([kind(token) for token in tokens], dtype=np.dtype(kind))
    return np.array(tokens, dtype=np.bytes_).astype(kind)


UNKNOWNS: Final = ("occupied", "free")
"""What unknown cells of a map can count as."""


def is_count(word: str) -> bool:
    """Return True for a decimal number of at most 18 digits.

    Such numbers fit into 64 bits; a sign is not allowed.
    """
    return word.isascii() and word.isdecimal() and len(word) <= 18


def _with_article(kind: str) -> str:
    """Return the kind of a file with its article."""
    # No kind begins with a vowel u; SRDF is spelt.
    article = "an" if kind[:1].lower() in "aeio" or kind.startswith("SRDF") else "a"
    return f"{article} {kind}"


@contextmanager
def replacing(
    path: StrPath,
    overwrite: bool = False,
    *,
    folder: Callable[[Path], bool] | None = None,
) -> Iterator[Path]:
    """Yield a temporary name; rename it to `path` if the block succeeds.

    The temporary name has the folder and suffix of the target; a link is followed. Any exception in
    the block, Ctrl-C included, removes the temporary file and leaves the target unchanged. The
    target is checked before the block, so that no long work is lost to an unusable name. Nest
    outputs that belong together; the file that refers to the others goes outermost::

        with replacing("map.yaml") as yaml, replacing("map.pgm") as pgm:
            ...

    With `overwrite`, a folder replaces only a folder and a file only a file. Pass `folder` if the
    output is a folder: it returns True for an existing folder that is an earlier output, so that
    nothing else is ever removed.

    Raises FileError if the target may not be written, or if writing fails.
    """
    target = Path(os.path.realpath(check_name(path)))
    try:
        _check_target(target, overwrite, folder)
        temporary = _make_temporary_name(target)
        try:
            yield temporary
            _move(temporary, target, partial(_check_target, target, overwrite, folder))
        finally:
            _remove(temporary)
    except FileError:
        raise
    except OSError as error:
        problem = f"cannot be written: {error.strerror or error}"
        rule = "outputs need a writable folder and free space"
        raise FileError(str(target), problem, rule) from error


def check_output(target: Path, overwrite: bool) -> None:
    """Refuse an output path that cannot be written.

    Call it before any work; :func:`replacing` checks the kind of the target.

    Raises FileError if the parent folder is missing or read-only, or the target exists and
    `overwrite` is False.
    """
    parent = target.parent
    if not parent.is_dir():
        problem = f"cannot be written: {parent} is not a folder"
        raise FileError(str(target), problem, "outputs go to an existing folder")
    if not os.access(parent, os.W_OK | os.X_OK):
        problem = f"cannot be written: no permission to write in {parent}"
        rule = "outputs need a writable folder"
        raise FileError(str(target), problem, rule)
    if target.exists() and not overwrite:
        raise FileError(
            str(target), "exists", "existing outputs are kept by default", "pass overwrite=True"
        )


def _check_target(target: Path, overwrite: bool, folder: Callable[[Path], bool] | None) -> None:
    """Raise FileError if the output cannot replace `target`."""
    check_output(target, overwrite)
    if not target.exists():
        return
    # A file replaces a file, and a folder replaces an empty folder or an earlier output.
    problem = ""
    if folder is None:
        if not target.is_file():
            problem = "is not a plain file"
    elif not target.is_dir():
        problem = "is not a folder"
    elif any(target.iterdir()) and not folder(target):
        problem = "holds more than an earlier output"
    if problem:
        raise FileError(str(target), problem, "only an earlier output is replaced")


def _make_temporary_name(target: Path) -> Path:
    """Return a fresh name in the folder of `target`.

    A rename is atomic only within one folder.
    """
    return target.with_name(f".cspace-{uuid.uuid4().hex[:12]}{target.suffix}")


def _move(temporary: Path, target: Path, check: Callable[[], None]) -> None:
    """Rename `temporary` to `target`, unless `check` refuses it.

    An old folder is set aside until the new one is in place.
    """
    aside = _make_temporary_name(target)
    try:
        check()
        while True:
            try:
                temporary.rename(target)
                return
            except OSError as error:
                # Other errors than of a folder with entries, which would be replaced.
                if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                    raise
            # Another process may have put its own folder there, or move the old one first.
            check()
            _remove(aside)
            with suppress(FileNotFoundError):
                target.rename(aside)
    except BaseException:
        # Put the old folder back, also after Ctrl-C.
        if aside.exists() and not target.exists():
            aside.rename(target)
        raise
    finally:
        _remove(aside)


def discard(path: Path) -> None:
    """Remove our file or folder, even while another process writes.

    It is renamed first, so the writer fails, and never puts the rest in place.
    """
    aside = _make_temporary_name(path)
    with suppress(FileNotFoundError):  # another process discards it too
        path.rename(aside)
        _remove(aside)


def _remove(path: Path) -> None:
    """Remove our file or folder, if it exists."""
    if path.is_dir():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)
