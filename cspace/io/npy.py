"""Arrays saved by :func:`numpy.save`, whose header is held against the file before anything is read."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError
from cspace.io.input import existing, unreadable

KIND: Final = "NumPy array"

_HEADERS: Final = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}
"""What reads a header, by the version of the format; later ones are for records with names beyond Latin letters."""


def npy_header(path: str | os.PathLike[str]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of an array, without reading it.

    Raises
    ------
    FileError
        As :func:`read_npy`.
    """
    file = existing(path, KIND)
    try:
        with file.open("rb") as stream:
            return _header(file, stream)
    except FileError:
        raise
    except OSError as error:
        raise unreadable(file, KIND, error) from error


def read_npy(path: str | os.PathLike[str]) -> NDArray[Any]:
    """The array of a ``.npy`` file.

    Raises
    ------
    FileError
        If the file is missing, is no such file, is truncated, or holds Python objects.
    """
    file = existing(path, KIND)
    try:
        with file.open("rb") as stream:
            _header(file, stream)
            stream.seek(0)
            array: NDArray[Any] = np.lib.format.read_array(stream, allow_pickle=False)
    except FileError:
        raise
    except OSError as error:
        raise unreadable(file, KIND, error) from error
    except (ValueError, OverflowError, EOFError) as error:  # sizes of no bytes that NumPy cannot hold
        raise _unusable(file, str(error)) from error
    return array


def _header(file: Path, stream: BinaryIO) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """The header at the beginning of a stream, checked."""
    try:
        version = np.lib.format.read_magic(stream)
        shape, _, dtype = _HEADERS[version](stream)
    except (MemoryError, OSError):
        raise
    except Exception as error:  # The header is text in Python's syntax: damaged, it raises whatever that leads to.
        raise _unusable(file, f"{type(error).__name__}: {error}") from error
    if dtype.hasobject:
        raise _unusable(file, f"it holds Python objects ({dtype})")
    if min(shape, default=0) < 0:
        raise _unusable(file, f"its header says shape {shape}")
    start = stream.tell()
    held, told = stream.seek(0, os.SEEK_END) - start, math.prod(shape) * dtype.itemsize
    if held < told:
        raise _unusable(
            file, f"its header says shape {shape} of {dtype}, which is {told} bytes, and {held} follow: it is truncated"
        )
    return shape, dtype


def _unusable(file: Path, reason: str) -> FileError:
    return FileError(
        f"{file} cannot be read: {reason}; it must hold one array, boolean for cells or floating-point for points; "
        "write it with numpy.save"
    )
