"""PLY (Turk, 1994): the header, read once for meshes and for clouds of points, and the elements, read by trimesh."""

from __future__ import annotations

import io
import os
import warnings
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cspace.arrays import Floats, Ints
from cspace.errors import GeometryError
from cspace.files.access import Fault, decoding, existing, header_lines, is_count, numbers_of, read_bytes

KIND: Final = "PLY file"

_FORMATS: Final = ("ascii", "binary_little_endian", "binary_big_endian")
_CORNERS: Final = ("vertex_indices", "vertex_index")
_NO_FACES: Final = (np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64))

_MEMORY: Final = 8.0
"""Bytes that each byte of a file takes while it is read."""


@dataclass(frozen=True, slots=True)
class PlyHeader:
    """The header of a PLY file.

    Attributes
    ----------
    is_text : bool
    counts : dict of str to int
        How many there are of each element, in the order of the file.
    properties : dict of str to list of (str, bool)
        Name of each property of an element, and whether it is a list.
    end : int
        Byte at which the elements begin.
    """

    is_text: bool
    counts: dict[str, int]
    properties: dict[str, list[tuple[str, bool]]]
    end: int

    @property
    def vertices(self) -> int:
        """Number of vertices."""
        return self.counts["vertex"]

    @property
    def faces(self) -> int:
        """Number of faces."""
        return self.counts.get("face", 0)


def read_ply_header(path: str | os.PathLike[str]) -> PlyHeader:
    """The header of a PLY file.

    Raises FileError if the file is missing, or has no whole header with vertices, and GeometryError if it has surfaces
    of another kind than faces, such as strips of triangles, which would be lost.
    """
    file = existing(path, KIND)
    with decoding(file, KIND), file.open("rb") as stream:
        return _header(stream.read(2**16))


def read_ply(path: str | os.PathLike[str]) -> tuple[Floats, Ints, Ints]:
    """Vertices, shape (V, 3), of a PLY file, the corners of its polygons, one after the other, and how many each has.

    Raises FileError if the file is missing, and Fault if it is malformed or truncated, holds more or fewer elements
    than it declares, is binary and has faces of different numbers of corners, or has surfaces of another kind.
    """
    from trimesh.exchange.ply import load_ply

    content = read_bytes(path, KIND, memory=_MEMORY)
    header = _header(content)
    faces: tuple[Ints, Ints] | None = None
    if header.is_text:
        content, faces = _counted(content, header)
    if not {"x", "y", "z"} <= {name for name, _ in header.properties["vertex"]}:
        raise Fault("has vertices without x, y and z")
    names = [name for name, is_list in header.properties.get("face", []) if is_list and name in _CORNERS]
    if header.faces and len(names) != 1:
        raise Fault(f"has faces without one list named {' or '.join(_CORNERS)}")
    if not header.vertices:
        return np.empty((0, 3)), *_NO_FACES
    with decoding(path, f"{KIND} with faces of equally many corners"), warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what numpy says of text that is no number
        loaded: Any = load_ply(io.BytesIO(content), skip_materials=True)
        elements = loaded["metadata"]["_ply_raw"]
        vertices = np.column_stack([np.asarray(elements["vertex"]["data"][axis]).reshape(-1) for axis in "xyz"])
        if faces is None:
            faces = _corners(elements["face"]["data"], names[0], header) if header.faces else _NO_FACES
    if len(vertices) != header.vertices or len(faces[1]) != header.faces:
        counts = f"{len(vertices)} and {len(faces[1])} were read"
        raise Fault(f"declares {header.vertices} vertices and {header.faces} faces, and {counts}")
    return vertices.astype(np.float64), *faces


def _counted(content: bytes, header: PlyHeader) -> tuple[bytes, tuple[Ints, Ints]]:
    """A text without its blank lines, each of the others held to the properties of its element; and the faces.

    trimesh takes blank lines for elements, passes over lines and words too many, and tells the length of all lists by
    the first one.
    """
    rows = [tokens for line in content[header.end :].splitlines() if (tokens := line.split())]
    if len(rows) != sum(header.counts.values()):
        raise Fault(f"declares {sum(header.counts.values())} elements and has {len(rows)} lines of them")
    corners: list[bytes] = []
    sizes: list[int] = []
    first = 0
    try:
        for element, count in header.counts.items():
            properties = header.properties[element]
            lists = any(is_list for _, is_list in properties)
            for tokens in rows[first : first + count]:
                at = 0 if lists else len(properties)
                for name, is_list in properties if lists else ():
                    if is_list and name in _CORNERS and element == "face":
                        sizes.append(int(tokens[at]))
                        corners += tokens[at + 1 : at + 1 + sizes[-1]]
                    at += 1 + int(tokens[at]) if is_list else 1
                if at != len(tokens):
                    raise Fault(f"has a {element} of {len(tokens)} words, and declares {at}")
            first += count
        faces = numbers_of(corners, int), np.array(sizes, dtype=np.int64)
    except (IndexError, ValueError, OverflowError) as error:
        raise Fault(f"has elements that are not as declared ({error})") from error
    return content[: header.end] + b"\n".join(map(b" ".join, rows)), faces


def _header(content: bytes) -> PlyHeader:
    counts: dict[str, int] = {}
    properties: dict[str, list[tuple[str, bool]]] = {}
    form, name = "", ""
    for number, (line, after) in enumerate(header_lines(content)):
        tokens = line.split()
        if number == 0 and tokens != ["ply"]:
            break
        if tokens[:1] == ["format"] and len(tokens) == 3:
            form = tokens[1]
        elif tokens[:1] == ["element"] and len(tokens) == 3 and is_count(tokens[2]) and tokens[1] not in counts:
            name = tokens[1]
            counts[name], properties[name] = int(tokens[2]), []
        elif tokens[:1] == ["property"] and name and len(tokens) == (5 if tokens[1:2] == ["list"] else 3):
            properties[name].append((tokens[-1], len(tokens) == 5))
        elif tokens == ["end_header"] and "vertex" in counts and form in _FORMATS:
            known = ("face", "range_grid")
            strange = [e for e in counts if e not in known and counts[e] and any(listed for _, listed in properties[e])]
            if strange:
                raise Fault(
                    f"has elements {', '.join(strange)} with lists, which may be surfaces",
                    "they would be lost, since only 'face' is read",
                    "write it with faces, e.g. by MeshLab",
                    kind=GeometryError,
                )
            return PlyHeader(form == "ascii", counts, properties, after)
        elif number and tokens[:1] not in (["comment"], ["obj_info"], []):
            break
    raise Fault(
        "has no whole PLY header",
        "it goes from 'ply' and 'format' to 'end_header' and tells 'element vertex' once",
        "the file is truncated or of another format, fetch it again",
    )


def _corners(data: Any, name: str, header: PlyHeader) -> tuple[Ints, Ints]:
    """The faces of a binary file, all of equally many corners: trimesh takes the length of the first one for all."""
    counts, corners = data[name]["f0"], data[name]["f1"]
    size = corners.shape[1] if corners.ndim == 2 else 1
    lists = [data[other]["f0"] for other, is_list in header.properties["face"] if is_list]
    if any((lengths != lengths[0]).any() for lengths in lists):
        raise Fault("has faces of different numbers of corners; write it as text, or with triangles alone")
    return np.asarray(corners, dtype=np.int64).reshape(-1), np.full(len(counts), size)
