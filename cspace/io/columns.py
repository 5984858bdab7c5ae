"""Columns of numbers in a text, read quickly, with the line named where one is wrong."""

from __future__ import annotations

import io
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError

_SHOWN: Final = 60
"""Characters of a wrong line that a message quotes."""


def read_columns(text: str, file: str, first: int = 1) -> NDArray[np.float64]:
    """Numbers of a text, one row for each line that holds some.

    A text that is cut within its last number cannot be told from a whole one, with or without a line end there.

    Parameters
    ----------
    text : str
        Columns are separated by commas where the first row has one, else by blanks. ``#`` begins a comment.
    file : str
        For messages.
    first : int
        Number of the text's first line, for messages.

    Returns
    -------
    ndarray of float64, shape (n, columns)
        Shape (0, 0) for a text without numbers.

    Raises
    ------
    FileError
        If a line holds something else than numbers, or has more or fewer than the first one; the message names it.
    """
    row = next((content for line in text.split("\n") if (content := _content(line))), "")
    if not row:
        return np.zeros((0, 0))
    separator = "," if "," in row else None
    try:
        return np.loadtxt(io.StringIO(text), dtype=np.float64, comments="#", delimiter=separator, ndmin=2)
    except ValueError as error:
        raise _fault(text, file, first, separator, len(row.split(separator)), error) from error


def _content(line: str) -> str:
    """A line without its comment."""
    return line.partition("#")[0].strip()


def _fault(text: str, file: str, first: int, separator: str | None, columns: int, error: ValueError) -> FileError:
    """The error for the first line that is wrong."""
    for number, line in enumerate(text.split("\n"), start=first):
        parts = _content(line).split(separator) if _content(line) else []
        rule = f"{columns} columns, like the first row"
        try:
            if len(list(map(float, parts))) in (0, columns):
                continue
        except ValueError:
            rule = "numbers alone; a heading needs a '#' before it"
        found = f"line {number} is {line.strip()[:_SHOWN]!r}"
        return FileError(file, found, f"it must hold {rule}", "mend the line, or fetch a truncated file again")
    return FileError(file, f"cannot be read: {error}", "it must hold columns of numbers", "mend that line")
