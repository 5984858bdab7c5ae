"""What a file may take, held against what it declares before it is read: one place for all formats.

A file of a few bytes can declare a map of terabytes. So each reader states here, from the size of the file or from its
header, what it is about to take, and is refused with the figures where that is beyond a limit or does not fit into
memory.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Final, NamedTuple

from cspace.arrays import StrPath
from cspace.errors import FileError
from cspace.memory import bytes_text, cells_of, free_bytes


class Limits(NamedTuple):
    """The most that one file may hold.

    Attributes
    ----------
    max_bytes : int
        Of a file, or of what one unpacks to.
    max_cells : int
        Cells, voxels or pixels of a grid.
    """

    max_bytes: int = 2**32
    max_cells: int = 2**29


_CURRENT: Final = ContextVar("limits", default=Limits())  # noqa: B039 - it cannot be changed

_MOST_OF_MEMORY: Final = 0.9
"""Part of the free memory that a file may be read into."""

_LEAST: Final = 2**18
"""Bytes below which memory is not asked for: that takes longer than to read so few."""


@contextmanager
def raised_limits(*, max_bytes: int | None = None, max_cells: int | None = None) -> Iterator[None]:
    """Other limits for the files that are read within a ``with`` block.

    Parameters
    ----------
    max_bytes, max_cells : int, optional
        The largest file in bytes, and the most cells of a map; unchanged if left out.

    Examples
    --------
    >>> with raised_limits(max_cells=2**33):
    ...     pass  # e.g. workspace = cspace.Workspace.open("city.png", spacing=0.05)
    """
    now = _CURRENT.get()
    most = now.max_bytes if max_bytes is None else max_bytes
    token = _CURRENT.set(Limits(most, now.max_cells if max_cells is None else max_cells))
    try:
        yield
    finally:
        _CURRENT.reset(token)


def check_bytes(path: StrPath, size: int, what: str = "holds", memory: float = 1.0) -> None:
    """Refuse a file of so many bytes, or that ``what`` them, such as "unpacks to", where that is too large.

    Raises FileError if it is over ``max_bytes``, or ``memory`` times as much does not fit into memory.
    """
    most = _CURRENT.get().max_bytes
    if size > most or memory * size >= _LEAST:
        held = f"{what} {bytes_text(size)}"
        _check(path, held, size, "max_bytes", bytes_text(most), size)
        check_memory(path, held, memory * size)


def check_cells(path: StrPath, shape: Sequence[int], memory: float = 1.0) -> None:
    """Refuse a grid, as a file declares it, that is too large.

    Raises FileError if there are more than ``max_cells``, or ``memory`` bytes for each do not fit into memory.
    """
    count = cells_of(shape)
    declared = f"declares {' x '.join(f'{n}' if n < 2**53 else f'{n:.4g}' for n in shape)} cells"
    most = f"{_CURRENT.get().max_cells:.4g}"
    _check(path, f"{declared}, {count:.4g} in all", count, "max_cells", most, tuple(shape))
    check_memory(path, declared, memory * count)


def check_memory(path: StrPath, declared: str, needed: float) -> None:
    """Refuse a file, by a FileError, whose reading takes ``needed`` bytes, where so many are not free."""
    if needed < _LEAST:
        return
    free = free_bytes()
    if needed > _MOST_OF_MEMORY * free:
        fault = f"{declared}, and reading it takes about {bytes_text(needed)}"
        mend = "take a machine with more memory, or a smaller or coarser file"
        raise FileError(os.fspath(path), fault, f"{bytes_text(free)} of memory are free", mend)


def _check(path: StrPath, fault: str, number: int, limit: str, most: str, value: object) -> None:
    if number > getattr(_CURRENT.get(), limit):
        mend = f"raise it with cspace.files.limits.raised_limits({limit}={number}), if the file is meant to be so large"
        raise FileError(os.fspath(path), fault, f"at most {most} are read", mend, value=value)
