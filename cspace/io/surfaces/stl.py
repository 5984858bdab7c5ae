"""STL, in binary and in text."""

from __future__ import annotations

import re
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from cspace.io.surfaces.parts import Floats, Surface, damaged

_RECORD: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD: Final = 84

_POINT: Final = ("vertex", ".", ".", ".")
_FACET: Final = ("facet", "normal", ".", ".", ".", "outer", "loop", *3 * _POINT, "endloop", "endfacet")
"""Words of a triangle in text, numbers as points."""

_NUMBERS: Final = [i for i, word in enumerate(_FACET) if word == "." and i > _FACET.index("vertex")]
_LONGEST: Final = 64
"""Letters of a word, at most; numbers are shorter."""


def read_stl(file: Path) -> Surface:
    """Triangles of an STL file, three vertices of their own each.

    Raises
    ------
    FileError
        If the file is truncated, or is neither of the two forms.
    """
    data = file.read_bytes()
    count = int.from_bytes(data[_HEAD - 4 : _HEAD], "little")
    binary = len(data) >= _HEAD and len(data) == _HEAD + _RECORD.itemsize * count
    if not binary and data.lstrip()[:5].lower() == b"solid":
        corners = _text(data, file)
    elif not binary:
        raise _wrong_size(file, len(data), count)
    else:
        corners = np.frombuffer(data, dtype=_RECORD, offset=_HEAD)["corners"].astype(np.float64)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def _wrong_size(file: Path, size: int, count: int) -> Exception:
    if size < _HEAD:
        return damaged(file, f"has {size} bytes; the head of a binary STL file has {_HEAD}")
    held = (size - _HEAD) / _RECORD.itemsize
    return damaged(
        file, f"declares {count} triangles and has bytes for {held:g}; a binary STL file has as many as it says"
    )


def _text(data: bytes, file: Path) -> Floats:
    """Corners of the triangles of an STL file in text, all its solids together, shape (F, 3, 3)."""
    text = data.lower().replace(b"\r", b"\n")
    ends = list(re.finditer(rb"^[ \t]*(end)?solid\b[^\n]*", text, re.MULTILINE))
    kinds = [bool(end[1]) for end in ends]
    if not kinds or kinds != [False, True] * (len(kinds) // 2) or text[ends[-1].end() :].strip(b" \t\n\0"):
        raise damaged(file, "does not go from solid to endsolid, as an STL file in text does")
    if any(b"endfacet" in end[0] for end in ends):
        raise damaged(file, "has facets on a line of solid or endsolid; they need lines of their own")
    inside = [text[first.end() : last.start()] for first, last in pairwise(ends)]
    words = b" ".join(inside).split()
    if len(words) % len(_FACET) or max(map(len, words), default=0) > _LONGEST:
        raise damaged(file, f"has {len(words)} words between solid and endsolid; a facet has {len(_FACET)}")
    table = np.array(words, dtype=np.bytes_).reshape(-1, len(_FACET))
    for i, word in enumerate(_FACET):
        wrong = table[:, i] != word.encode() if word != "." else np.zeros(len(table), dtype=np.bool_)
        if wrong.any():
            facet = int(np.argmax(wrong))
            raise damaged(file, f"has {table[facet, i].decode('latin-1')!r} in facet {facet}, where {word!r} must be")
    return table[:, _NUMBERS].astype(np.float64).reshape(-1, 3, 3)
