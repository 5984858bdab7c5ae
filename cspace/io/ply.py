"""PLY (Turk, 1994), for meshes and for clouds of points."""

from __future__ import annotations

import os
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import FileError, GeometryError
from cspace.io.input import damaged, decoding, existing, header_lines, is_count, numbers, read_bytes

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Polygons = tuple[Floats, Integers, Integers]
"""Vertices, shape (V, 3); the vertices of the polygons, one polygon after the other; corners of each polygon."""

_KIND: Final = "PLY file"
_MARKS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
"""NumPy's mark of the order of bytes, by format."""

_TYPES: Final = {
    **dict.fromkeys(("char", "int8"), "i1"),
    **dict.fromkeys(("uchar", "uint8"), "u1"),
    **dict.fromkeys(("short", "int16"), "i2"),
    **dict.fromkeys(("ushort", "uint16"), "u2"),
    **dict.fromkeys(("int", "int32"), "i4"),
    **dict.fromkeys(("uint", "uint32"), "u4"),
    **dict.fromkeys(("float", "float32"), "f4"),
    **dict.fromkeys(("double", "float64"), "f8"),
}
_CORNERS: Final = ("vertex_indices", "vertex_index")
_NONE: Final = np.empty(0, dtype=np.int64)

Property = tuple[str, str, str]
"""Name and type; and, of a list, the type of its length, else nothing."""


class PlyHeader(NamedTuple):
    """What the header of a PLY file tells.

    Attributes
    ----------
    mark : str
        That of NumPy for the order of bytes; empty for a text.
    elements : dict of str to (int, list of Property)
        How many there are of each element and what they consist of, in the order of the file.
    end : int
        Byte at which the elements begin.
    """

    mark: str
    elements: dict[str, tuple[int, list[Property]]]
    end: int

    @property
    def faces(self) -> int:
        """Number of faces."""
        return self.elements.get("face", (0, []))[0]

    def at(self, element: str, *names: str) -> list[int]:
        """Where the properties with some names stand in an element."""
        return [n for name in names for n, found in enumerate(self.elements[element][1]) if found[0] == name]


def read_ply_header(path: str | os.PathLike[str]) -> PlyHeader:
    """The header of a PLY file.

    Raises
    ------
    FileError
        If the file is missing, or has no whole header with vertices.
    GeometryError
        If it has surfaces of another kind than faces, such as strips of triangles, which would be lost.
    """
    file = existing(path, _KIND)
    with decoding(file, _KIND), file.open("rb") as stream:
        return _header(stream.read(2**16), str(file))


def read_ply(path: str | os.PathLike[str]) -> Polygons:
    """Vertices and faces of a PLY file.

    Raises
    ------
    FileError
        If the file is missing, malformed or truncated, holds more or fewer elements than it declares, or is binary and
        has faces of different numbers of corners.
    GeometryError
        If it has surfaces of another kind.
    """
    content, file = read_bytes(path, _KIND, memory=8.0), os.fspath(path)
    header = _header(content, file)
    if len(header.at("vertex", *"xyz")) != 3:
        raise damaged(file, "has vertices without x, y and z")
    if header.faces and [bool(header.elements["face"][1][n][2]) for n in header.at("face", *_CORNERS)] != [True]:
        raise damaged(file, f"has faces without one list named {' or '.join(_CORNERS)}")
    with decoding(file, _KIND):
        return (_binary if header.mark else _text)(content[header.end :], header, file)


def _text(body: bytes, header: PlyHeader, file: str) -> Polygons:
    """Each line held to the properties of its element."""
    rows = [words for line in body.splitlines() if (words := line.split())]
    declared = sum(count for count, _ in header.elements.values())
    if len(rows) != declared:
        raise damaged(file, f"declares {declared} elements and has {len(rows)} lines of them")
    named = header.at("face", *_CORNERS) if header.faces else []
    points: list[bytes] = []
    corners: list[bytes] = []
    sizes: list[int] = []
    first = 0
    for element, (count, properties) in header.elements.items():
        for words in rows[first : first + count]:
            at = 0
            for n, (_, _, length) in enumerate(properties):
                size = int(words[at]) if length and at < len(words) else 0
                if element == "face" and n in named:
                    sizes.append(size)
                    corners += words[at + 1 : at + 1 + size]
                at += 1 + size
            if at != len(words):
                raise damaged(file, f"has a {element} of {len(words)} words, and declares {at}")
        if element == "vertex":
            xyz = header.at("vertex", *"xyz")
            points = [words[n] for words in rows[first : first + count] for n in xyz]
        first += count
    return numbers(points, np.float64).reshape(-1, 3), numbers(corners, np.int64), np.array(sizes, dtype=np.int64)


def _binary(body: bytes, header: PlyHeader, file: str) -> Polygons:
    """All lists of an element being as long as those of the first, so that they are read at once."""
    tables: dict[str, NDArray[np.void]] = {}
    at = 0
    for element, (count, properties) in header.elements.items():
        fields: list[tuple[str, str] | tuple[str, str, int]] = []
        for n, (_, kind, length) in enumerate(properties):
            if length:
                begin = at + np.dtype(fields).itemsize
                size = int(np.frombuffer(body, header.mark + length, 1, begin)[0]) if count else 0
                fields.append((f"size {n}", header.mark + length))
                fields.append((f"{n}", header.mark + kind, (size,)))  # type: ignore[arg-type]
            else:
                fields.append((f"{n}", header.mark + kind))
        record = np.dtype(fields)
        if at + count * record.itemsize > len(body):
            raise damaged(file, f"has too few bytes for {count} of {element}, if they have equally many corners")
        tables[element] = np.frombuffer(body, record, count, at) if count else np.empty(0, record)
        for name in (name for name in record.names or () if name.startswith("size")):
            if (tables[element][name] != tables[element][name][:1]).any():
                raise damaged(
                    file, "has faces of different numbers of corners; write it as text, or with triangles alone"
                )
        at += count * record.itemsize
    if at != len(body):
        raise damaged(file, f"has {len(body) - at} bytes too many for elements of equally many corners")
    points = np.stack([tables["vertex"][f"{n}"].astype(np.float64) for n in header.at("vertex", *"xyz")], axis=1)
    if not header.faces:
        return points, _NONE, _NONE
    corners = tables["face"][f"{header.at('face', *_CORNERS)[0]}"]
    return points, corners.astype(np.int64).reshape(-1), np.full(len(corners), corners.shape[1])


def _header(content: bytes, file: str) -> PlyHeader:
    elements: dict[str, tuple[int, list[Property]]] = {}
    form, name = "", ""
    for number, (line, after) in enumerate(header_lines(content)):
        words = line.split()
        if number == 0 and words != ["ply"]:
            break
        if words[:1] == ["format"] and len(words) == 3:
            form = words[1]
        elif words[:1] == ["element"] and len(words) == 3 and is_count(words[2]) and words[1] not in elements:
            name = words[1]
            elements[name] = int(words[2]), []
        elif words[:1] == ["property"] and name and len(words) == 3 and words[1] in _TYPES:
            elements[name][1].append((words[2], _TYPES[words[1]], ""))
        elif words[:2] == ["property", "list"] and name and len(words) == 5 and {*words[2:4]} <= _TYPES.keys():
            elements[name][1].append((words[4], _TYPES[words[3]], _TYPES[words[2]]))
        elif words == ["end_header"] and "vertex" in elements and form in _MARKS:
            foreign = {name: kinds for name, (count, kinds) in elements.items() if count} | {
                "face": [],
                "range_grid": [],
            }
            strange = [name for name, kinds in foreign.items() if any(length for _, _, length in kinds)]
            if strange:
                raise GeometryError(
                    file,
                    f"has elements {', '.join(strange)} with lists, which may be surfaces",
                    "they would be lost, since only 'face' is read",
                    "write it with faces, e.g. by MeshLab",
                )
            return PlyHeader(_MARKS[form], elements, after)
        elif number and words[:1] not in (["comment"], ["obj_info"], []):
            break
    raise FileError(
        file,
        "has no whole PLY header",
        "it goes from 'ply' and 'format' to 'end_header' and tells 'element vertex' once",
        "the file is truncated or of another format, fetch it again",
    )
