"""Inputs: a file that is there and can be read, or an error that names it."""

from __future__ import annotations

import os
from pathlib import Path

from cspace.errors import FileError, InputError


def existing(path: str | os.PathLike[str], kind: str) -> Path:
    """``path`` as a :class:`~pathlib.Path` to a file that exists.

    Parameters
    ----------
    path : path-like
    kind : str
        What the file should be, for the message: "ROS map".

    Raises
    ------
    InputError
        If ``path`` is not a file name.
    FileError
        If nothing is there, or a folder.
    """
    try:
        file = Path(path)
        there, folder = file.exists(), file.is_dir()
    except (TypeError, ValueError) as error:
        raise InputError(f"path is {path!r}; it must be a file name; pass a string or a pathlib.Path") from error
    except OSError as error:
        raise unreadable(path, kind, error) from error
    if not there:
        raise FileError(f"{file} does not exist; {_one(kind)} is read from a file; check the name and the folder")
    if folder:
        raise FileError(f"{file} is a folder; {_one(kind)} is read from a file; pass the file inside it")
    return file


def _one(kind: str) -> str:
    """A kind of file with its article."""
    return f"{'an' if kind[:1].lower() in 'aeio' else 'a'} {kind}"


def unreadable(path: str | os.PathLike[str], kind: str, error: OSError) -> FileError:
    """The error for a file that the system refuses to read."""
    reason = error.strerror or error
    return FileError(
        f"{os.fspath(path)} cannot be read: {reason}; {_one(kind)} must be readable; check its permissions"
    )


def read_text(path: str | os.PathLike[str], kind: str) -> str:
    """Text of a file in UTF-8, line ends turned into ``\\n``.

    Raises
    ------
    InputError
        If ``path`` is not a file name.
    FileError
        If the file is missing, cannot be read, or is not text.
    """
    file = existing(path, kind)
    try:
        return file.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileError(
            f"{file} is not text: byte {error.start} is not UTF-8; {_one(kind)} is a text file; pass the right file"
        ) from error
    except OSError as error:
        raise unreadable(file, kind, error) from error
