"""PLY, in text and in binary: vertices and faces."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.io.surfaces.parts import Floats, Integers, Surface, damaged, unread
from cspace.io.surfaces.polygons import triangulated

_NAMES: Final = {
    "char": "i1",
    "uchar": "u1",
    "short": "i2",
    "ushort": "u2",
    "int": "i4",
    "uint": "u4",
    "float": "f4",
    "double": "f8",
}
_SIZED: Final = {f"{kind}{8 * size}": f"{kind[0]}{size}" for kind in ("int", "uint", "float") for size in (1, 2, 4, 8)}
_TYPES: Final = {name: code for name, code in (_NAMES | _SIZED).items() if code not in ("f1", "f2")}

_ORDERS: Final = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_CORNERS: Final = ("vertex_indices", "vertex_index")

Columns = dict[str, tuple[NDArray[np.generic], Integers | None]]
"""Values of each property of an element, and for a list how many each has."""


@dataclass
class _Element:
    name: str
    count: int
    properties: dict[str, tuple[str, str | None]] = field(default_factory=dict)
    """Type of each property's values, and of a list's count."""

    @property
    def lists(self) -> list[str]:
        return [name for name, (_, count) in self.properties.items() if count]


def read_ply(file: Path) -> Surface:
    """Triangles of a PLY file; edges, normals, colours and texture coordinates are left.

    Raises
    ------
    FileError
        If the file is truncated, or holds more or other than its header says.
    GeometryError
        If there are lists besides faces, such as strips of triangles, or a polygon can be cut in several ways.
    """
    data = file.read_bytes()
    elements, order, start = _header(data, file)
    for element in elements:
        if element.count and element.lists and element.name not in ("vertex", "face"):
            raise unread(file, f"an element {element.name!r} of lists ({', '.join(element.lists)})")
    source = _Binary(data, start, order, file) if order else _Text(data[start:], file)
    tables = {element.name: source.read(element) for element in elements}
    source.end()
    vertices = _vertices(tables, file)
    faces = next((element for element in elements if element.name == "face" and element.count), None)
    if faces is None:
        return vertices, np.empty((0, 3), dtype=np.int64)
    names = [name for name in _CORNERS if name in faces.lists]
    if len(names) != 1:
        raise damaged(file, f"has faces with lists {faces.lists or 'none'}; one is named {' or '.join(_CORNERS)}")
    corners, sizes = tables["face"][names[0]]
    if sizes is None or (corners.dtype.kind == "f" and (np.modf(corners)[0] != 0.0).any()):
        raise damaged(file, "has faces whose vertex numbers are not whole")
    return vertices, triangulated(vertices, corners.astype(np.int64), sizes, file)


def _vertices(tables: dict[str, Columns], file: Path) -> Floats:
    columns = tables.get("vertex", {})
    if any(axis not in columns or columns[axis][1] is not None for axis in "xyz"):
        raise damaged(file, "has no element vertex with x, y and z")
    return np.stack([columns[axis][0].astype(np.float64) for axis in "xyz"], axis=1)


def _header(data: bytes, file: Path) -> tuple[list[_Element], str, int]:
    """Elements, byte order (none for text), and where the data begin."""
    end = re.search(rb"[\r\n]end_header[ \t]*(\r\n|\r|\n)", data)
    if not re.match(rb"ply[ \t]*[\r\n]", data) or not end:
        raise damaged(file, "has no whole PLY header, from ply to end_header")
    elements: list[_Element] = []
    order: str | None = None
    for line in data[: end.start()].decode("latin-1").splitlines()[1:]:
        words = line.split()
        match words:
            case [] | ["comment" | "obj_info", *_]:
                continue
            case ["format", name, "1.0"] if name in _ORDERS:
                order = _ORDERS[name]
            case ["element", name, count] if count.isdigit() and name not in [e.name for e in elements]:
                elements.append(_Element(name, int(count)))
            case ["property", kind, name] if kind in _TYPES and elements and name not in elements[-1].properties:
                elements[-1].properties[name] = (_TYPES[kind], None)
            case ["property", "list", many, kind, name] if (
                many in _TYPES and kind in _TYPES and elements and name not in elements[-1].properties
            ):
                elements[-1].properties[name] = (_TYPES[kind], _TYPES[many])
            case _:
                raise damaged(file, f"has a line {line[:60]!r} in its header, which is none of PLY")
    if order is None:
        raise damaged(file, f"does not name its format, one of {', '.join(_ORDERS)}, in its header")
    return elements, order, end.end()


class _Text:
    """Numbers in text, element after element."""

    def __init__(self, data: bytes, file: Path) -> None:
        words = data.split()
        self.values = np.array(words, dtype=np.bytes_).astype(np.float64) if words else np.empty(0)
        self.at = 0
        self.file = file

    def read(self, element: _Element) -> Columns:
        """The next element's properties."""
        counted = [bool(count) for _, count in element.properties.values()]
        names = list(element.properties)
        if not any(counted):
            table = self._take(element.count * len(names), element).reshape(element.count, len(names))
            return {name: (table[:, i], None) for i, name in enumerate(names)}
        if element.count > len(self.values) - self.at:
            raise _cut_short(self.file, element)
        firsts = np.empty((len(names), element.count), dtype=np.int64)
        sizes = np.ones((len(names), element.count), dtype=np.int64)
        values, at = self.values, self.at
        for row in range(element.count):
            for i, listed in enumerate(counted):
                if at >= len(values):
                    raise _cut_short(self.file, element)
                if listed:
                    sizes[i, row] = values[at]
                    at += 1
                firsts[i, row] = at
                at += max(0, int(sizes[i, row]))
        if at > len(values) or (sizes < 0).any():
            raise _cut_short(self.file, element)
        self.at = at
        return {
            name: (values[_spread(firsts[i], sizes[i])], sizes[i] if counted[i] else None)
            for i, name in enumerate(names)
        }

    def end(self) -> None:
        """Refuse what is left over."""
        if self.at < len(self.values):
            raise damaged(self.file, f"holds {len(self.values) - self.at} numbers more than its header says")

    def _take(self, count: int, element: _Element) -> Floats:
        if self.at + count > len(self.values):
            raise _cut_short(self.file, element)
        self.at += count
        return self.values[self.at - count : self.at]


class _Binary:
    """Records of bytes, element after element."""

    def __init__(self, data: bytes, start: int, order: str, file: Path) -> None:
        self.data = data
        self.at = start
        self.order = order
        self.file = file

    def read(self, element: _Element) -> Columns:
        """The next element's properties."""
        if not element.properties:
            return {}
        sizes = self._first_sizes(element)
        dtype = np.dtype(
            [
                (f"{name}{part}", f"{self.order}{kind}", shape)
                for name, (value, count) in element.properties.items()
                for part, kind, shape in ([(" count", count, ())] if count else [])
                + [("", value, (sizes[name],) if count else ())]
            ]
        )
        fits = self.at + element.count * dtype.itemsize <= len(self.data)
        if fits:
            table = np.frombuffer(self.data, dtype=dtype, count=element.count, offset=self.at)
            if all((table[f"{name} count"] == sizes[name]).all() for name in element.lists):
                self.at += element.count * dtype.itemsize
                return {
                    name: (table[name].reshape(-1), np.full(element.count, sizes[name]) if count else None)
                    for name, (_, count) in element.properties.items()
                }
        if not element.lists:
            raise _cut_short(self.file, element)
        return self._row_by_row(element)

    def end(self) -> None:
        """Refuse what is left over."""
        if self.data[self.at :].strip():
            raise damaged(self.file, f"holds {len(self.data) - self.at} bytes more than its header says")

    def _first_sizes(self, element: _Element) -> dict[str, int]:
        """How long the lists of the first row are."""
        sizes, at = {}, self.at
        for name, (value, count) in element.properties.items():
            many = 1
            if count and element.count:
                many = sizes[name] = self._size(at, count, element)
                at += np.dtype(count).itemsize
            elif count:
                sizes[name] = 0
            at += many * np.dtype(value).itemsize
        return sizes

    def _size(self, at: int, kind: str, element: _Element) -> int:
        raw = self.data[at : at + np.dtype(kind).itemsize]
        if len(raw) < np.dtype(kind).itemsize or kind[0] == "f":
            raise _cut_short(self.file, element)
        size = int.from_bytes(raw, "big" if self.order == ">" else "little", signed=kind[0] == "i")
        if not 0 <= size <= len(self.data):
            raise _cut_short(self.file, element)
        return size

    def _row_by_row(self, element: _Element) -> Columns:
        """Properties where lists are of several lengths."""
        firsts: dict[str, list[int]] = {name: [] for name in element.properties}
        sizes: dict[str, list[int]] = {name: [] for name in element.properties}
        widths = {name: np.dtype(value).itemsize for name, (value, _) in element.properties.items()}
        at = self.at
        for _ in range(element.count):
            for name, (_, count) in element.properties.items():
                many = 1
                if count:
                    many = self._size(at, count, element)
                    at += np.dtype(count).itemsize
                firsts[name].append(at)
                sizes[name].append(many)
                at += many * widths[name]
        if at > len(self.data):
            raise _cut_short(self.file, element)
        raw = np.frombuffer(self.data, dtype=np.uint8)
        self.at = at
        found: Columns = {}
        for name, (value, count) in element.properties.items():
            lengths = np.array(sizes[name], dtype=np.int64)
            where = _spread(np.array(firsts[name], dtype=np.int64), lengths * widths[name])
            found[name] = (raw[where].view(f"{self.order}{value}"), lengths if count else None)
        return found


def _spread(firsts: Integers, sizes: Integers) -> Integers:
    """Numbers of runs that begin at ``firsts`` and are ``sizes`` long, one run after another."""
    ends = np.cumsum(sizes)
    return np.asarray(np.arange(int(sizes.sum())) + np.repeat(firsts - (ends - sizes), sizes))


def _cut_short(file: Path, element: _Element) -> Exception:
    return damaged(file, f"declares {element.count} of {element.name} and holds fewer")
