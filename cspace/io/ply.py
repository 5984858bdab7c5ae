"""Headers of PLY files: which elements there are, and how many."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Final

from cspace.errors import FileError, GeometryError
from cspace.io.input import existing, unreadable

KIND: Final = "PLY file"

_NO_SURFACES: Final = ("vertex", "face", "range_grid")
"""Elements that may have lists: what is read, and the raster of a range scan, which numbers its vertices."""

_DIGITS: Final = 18
"""At most so many of a count; more is no count of anything."""


@dataclass(frozen=True, slots=True)
class PlyHeader:
    """What the header of a PLY file tells.

    Attributes
    ----------
    vertices, faces : int
        How many.
    """

    vertices: int
    faces: int


def read_ply_header(path: str | os.PathLike[str]) -> PlyHeader:
    """The header of a PLY file.

    Raises
    ------
    FileError
        If the file is missing, or has no whole header with vertices.
    GeometryError
        If it has surfaces of another kind than faces, such as strips of triangles, which would be lost.
    """
    file = existing(path, KIND)
    counts: dict[str, int] = {}
    lists: set[str] = set()
    name, complete = "", False
    try:
        with file.open("rb") as stream:
            if stream.readline().strip() == b"ply":
                for line in stream:
                    words = line.decode("latin-1").split()
                    if words[:1] == ["element"] and len(words) == 3 and _is_count(words[2]):
                        name = words[1]
                        counts[name] = int(words[2])
                    elif words[:2] == ["property", "list"]:
                        lists.add(name)
                    complete = words == ["end_header"]
                    if complete:
                        break
    except OSError as error:
        raise unreadable(file, KIND, error) from error
    if not complete or "vertex" not in counts:
        raise FileError(
            f"{file} has no whole PLY header; it goes from 'ply' to 'end_header' and tells 'element vertex'; the file "
            "is truncated or of another format"
        )
    strange = [name for name in lists.difference(_NO_SURFACES) if counts.get(name)]
    if strange:
        raise GeometryError(
            f"{file} has elements {', '.join(sorted(strange))}, which may be surfaces; they would be lost, since only "
            "'face' is read; write it with faces, e.g. by MeshLab"
        )
    return PlyHeader(counts["vertex"], counts.get("face", 0))


def _is_count(word: str) -> bool:
    return word.isascii() and word.isdecimal() and len(word) <= _DIGITS
