"""Outputs that are either complete or not there: written under a temporary name beside the target, then renamed."""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from cspace.errors import FileError
from cspace.io.input import not_a_name


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
    target = _named(path)
    try:
        _check(target, overwrite, folder)
        temporary = _beside(target)
        try:
            yield temporary
            _check(target, overwrite, folder)
            _move(temporary, target)
        finally:
            _remove(temporary)
    except FileError:
        raise
    except OSError as error:
        raise FileError(
            str(target),
            f"cannot be written: {error.strerror or error}",
            "an output needs a writable folder with free space",
            "free some or choose another folder",
        ) from error


def _named(path: str | os.PathLike[str]) -> Path:
    """The file that ``path`` means, links followed."""
    try:
        return Path(os.path.realpath(path))
    except (TypeError, ValueError) as error:
        raise not_a_name(path) from error


def check_output(target: Path, overwrite: bool) -> None:
    """Refuse, before any work, a file or folder that may not be written; whether it is of our kind is seen later.

    Raises FileError if its folder is missing or may not be written, or it exists and may not be replaced.
    """
    parent = target.parent
    if not parent.is_dir():
        fault = f"cannot be written: {parent} is not a folder", "outputs go to an existing folder", "create it first"
    elif not os.access(parent, os.W_OK | os.X_OK):
        denied = f"cannot be written: no permission to write in {parent}"
        fault = denied, "an output needs a writable folder", "change its permissions or choose another"
    elif target.exists() and not overwrite:
        fault = "exists", "an existing output is kept unless told otherwise", "pass overwrite=True"
    else:
        return
    raise FileError(str(target), *fault)


def _check(target: Path, overwrite: bool, folder: Callable[[Path], bool] | None) -> None:
    """Raise FileError where ``target`` may not be written."""
    check_output(target, overwrite)
    if not target.exists():
        return
    if folder is None and not target.is_file():
        fault = "is not a plain file", "a file replaces only a file", "choose another name"
    elif folder is not None and not target.is_dir():
        fault = "is not a folder", "a folder replaces only a folder", "choose another name"
    elif folder is not None and any(target.iterdir()) and not folder(target):
        mend = "choose another name, or remove the folder yourself"
        fault = "holds more than an earlier output", "only an earlier output is replaced", mend
    else:
        return
    raise FileError(str(target), *fault)


def _beside(target: Path) -> Path:
    """A fresh name in the folder of ``target``: only within one folder is a rename sure to be atomic."""
    return target.with_name(f".cspace-{uuid.uuid4().hex[:12]}{target.suffix}")


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
