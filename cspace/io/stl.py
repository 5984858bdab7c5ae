"""STL, binary and in text: the triangles of all its solids, three vertices of their own each."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import numpy as np

from cspace.io.input import damaged, numbers, read_bytes
from cspace.io.polygons import Floats, Surface

_RECORD: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_HEAD: Final = 84
"""Bytes before the triangles of a binary file; the last four tell their number."""

_SOLIDS: Final = re.compile(rb"^[ \t]*(end)?solid\b[^\n]*", re.MULTILINE)
_FACET: Final = b"facet normal 0 0 0 outer loop vertex 0 0 0 vertex 0 0 0 vertex 0 0 0 endloop endfacet".split()
"""The words of a facet, with zeros where numbers stand."""


def read_stl(file: Path) -> Surface:
    """Triangles of an STL file; their normals follow from their corners, and are not read.

    Raises
    ------
    FileError
        If a binary file has bytes for other triangles than it declares, or a text is no row of whole solids.
    """
    data = read_bytes(file, "mesh", memory=12.0)
    declared = int.from_bytes(data[_HEAD - 4 : _HEAD], "little")
    if len(data) == _HEAD + _RECORD.itemsize * declared:
        corners = np.frombuffer(data, _RECORD, declared, _HEAD)["corners"].astype(np.float64).reshape(-1, 3)
    elif data.lstrip()[:5].lower() == b"solid":
        corners = _of_text(data, file)
    else:
        held = max(0.0, (len(data) - _HEAD) / _RECORD.itemsize)
        raise damaged(file, f"declares {declared} triangles and has bytes for {held:g}, as a binary STL file")
    return corners, np.arange(len(corners)).reshape(-1, 3)


def _of_text(data: bytes, file: Path) -> Floats:
    """Corners of the triangles, shape (3 F, 3)."""
    text = data.lower().replace(b"\r", b"\n")
    lines = list(_SOLIDS.finditer(text))
    kinds = [bool(line[1]) for line in lines]
    if not kinds or kinds != [False, True] * (len(kinds) // 2) or text[lines[-1].end() :].strip(b" \t\n\0"):
        raise damaged(file, "does not go from solid to endsolid, as an STL file in text does")
    if any(b"endfacet" in line[0] for line in lines):
        raise damaged(file, "has facets on a line of solid or endsolid; they need lines of their own")
    words = _SOLIDS.sub(b"", text[: lines[-1].end()]).split()
    columns = [words[place :: len(_FACET)] for place in range(len(_FACET))]
    keywords = [(column, word) for column, word in zip(columns, _FACET, strict=True) if word != b"0"]
    if len(words) % len(_FACET) or any(column.count(word) < len(column) for column, word in keywords):
        raise damaged(file, "has something else than whole facets between solid and endsolid")
    corners = [columns[place] for place, word in enumerate(_FACET) if word == b"0"][3:]
    return np.stack([numbers(column, np.float64) for column in corners], axis=1).reshape(-1, 3)
