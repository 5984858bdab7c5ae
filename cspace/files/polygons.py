"""Surfaces of triangles: placed, joined, and cut from polygons where there is one way to do so; OBJ, OFF and PLY.

OBJ and OFF are texts of vertices and polygons. The elements of PLY (Turk, 1994) are read by trimesh; its header is read
here, for meshes and for clouds of points.
"""

# OBJ, OFF and polygons of four or more corners are read here because trimesh 5.2 and meshio move or lose their faces.

from __future__ import annotations

import io
import os
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from cspace.arrays import Bools, Floats, Ints, Surface
from cspace.errors import GeometryError
from cspace.files.access import Fault, decoding, existing, header_lines, is_count, numbers_of, read_bytes

FLAT: Final = 1e-4
"""How far the corners of a flat polygon may be out of its plane, as a part of its size."""

ROUNDED: Final = 1e-6
"""What the corners may be out besides, as a part of the largest coordinate: files keep seven digits."""


TRIED: Final = 500
"""Most corners of a polygon that are tried as the centre of its fan: to try all takes the square of their number."""

MIN_WORK: Final = 2**26
WORK_PER_CORNER: Final = 16
"""Corners that may be visited in all fans tried for a file: `WORK_PER_CORNER` times its corners, at least `MIN_WORK`.
Visiting a million takes 0.1 s."""


_LEFT: Final = frozenset(
    b"vt vn vp g o s mg l p usemtl mtllib usemap maplib bevel c_interp d_interp lod shadow_obj trace_obj deg bmat step "
    b"cstype parm trim hole scrv sp end con ctech stech curv2".split()
)
"""Statements that say nothing of a surface of their own."""

_SURFACES: Final = frozenset(b"surf curv fo bsp bzp cdc cdp res call csh".split())
"""Statements of surfaces that are no polygons, of former versions, or in other files."""


def placed(surface: Surface, transform: Floats) -> Surface:
    """A surface moved by an affine transform, shape (4, 4); a mirror image is turned, so that it faces as before."""
    points, faces = surface
    if (transform == np.eye(4)).all():
        return surface
    mirror = np.linalg.det(transform[:3, :3]) < 0.0
    return points @ transform[:3, :3].T + transform[:3, 3], faces[:, ::-1] if mirror else faces


def unfolded(points: int, faces: int) -> int:
    """Bytes that a surface takes wherever it is placed; files name one, and so few bytes may unfold into any number."""
    return 24 * (points + faces) + 1000


def joined(parts: Sequence[Surface]) -> Surface:
    """Surfaces as one."""
    firsts = np.cumsum([0, *(len(points) for points, _ in parts)])
    vertices = np.concatenate([np.empty((0, 3)), *(points for points, _ in parts)])
    faces = [faces + first for (_, faces), first in zip(parts, firsts[:-1], strict=True)]
    return vertices, np.concatenate([np.empty((0, 3), dtype=np.int64), *faces])


def triangulated(vertices: Floats, corners: Ints, sizes: Ints) -> Ints:
    """Triangles of polygons, shape (sum of (sizes - 2), 3), whose corners are vertex numbers, polygon after polygon.

    Each polygon becomes a fan around one of its corners, the first one if that does. A polygon that is not flat has no
    surface of its own: each way to cut it gives another. It is refused, and so is one that no fan around one of its
    first :data:`TRIED` corners covers exactly.

    Raises Fault if a polygon has fewer than three corners, or names a vertex that there is not. Or if one is not flat,
    or crosses itself or is so bent that no fan covers it.
    """
    if len(sizes) and int(sizes.min()) < 3:
        raise Fault(f"has a face with {int(sizes.min())} corners; a face has three or more")
    if int(sizes.sum()) != len(corners):
        raise Fault(f"has faces with {int(sizes.sum())} corners, and names {len(corners)}")
    wrong = corners[(corners < 0) | (corners >= len(vertices))]
    if len(wrong):
        raise Fault(f"has a face that names vertex {wrong[0]}, counted from 0, of {len(vertices)}")
    firsts = np.cumsum(sizes) - sizes
    faces = [np.empty((0, 3), dtype=np.int64)]
    work = max(MIN_WORK, WORK_PER_CORNER * len(corners))
    for size in np.unique(sizes):
        polygons = corners[firsts[sizes == size, None] + np.arange(size)]
        if size > 4:
            _check_repeats(polygons)
        if size > 3:
            polygons, work = _fans(vertices, polygons, work)
        faces.append(polygons)
    return np.concatenate(faces)


def _check_repeats(polygons: Ints) -> None:
    """Refuse polygons, shape (P, n), that name few vertices again and again: two bytes of text become a triangle.

    A polygon around holes names the ends of the bridges to them twice, so that half of its corners are distinct.
    """
    ascending = np.sort(polygons, axis=1)
    distinct = 1 + np.count_nonzero(ascending[:, 1:] != ascending[:, :-1], axis=1)
    if (2 * distinct < polygons.shape[1]).any():
        raise _refused(polygons[np.argmin(distinct)], f"name {distinct.min()} vertices again and again")


def _fans(vertices: Floats, polygons: Ints, work: int) -> tuple[Ints, int]:
    """Cut polygons of equally many corners, shape (P, n), n > 3, into triangles; return these and the work left.

    At most `work` corners are visited.
    """
    points = vertices[polygons]
    # A value that is not finite is refused later, by name.
    points = np.where(np.isfinite(points).all(axis=(1, 2), keepdims=True), points, 0.0)
    largest = np.abs(points).max(axis=(1, 2), keepdims=True)
    points = points / np.where(largest > 0.0, largest, 1.0)
    points -= points.mean(axis=1, keepdims=True)
    size = np.asarray(np.linalg.norm(points, axis=2).max(axis=1))
    slack = np.asarray(ROUNDED + FLAT * size)
    normal, flat = _planes(points, size, slack)
    if not flat.all():
        raise _refused(polygons[np.argmin(flat)], "do not lie in one plane, or go around no area there")
    count = polygons.shape[1]
    apex = np.full(len(polygons), -1, dtype=np.int64)
    for first in range(min(count, TRIED)):
        left = np.flatnonzero(apex < 0)
        work -= len(left) * count
        if not len(left) or work < 0:
            break
        spokes = np.roll(points[left] - points[left, first : first + 1], -first, axis=1)[:, 1:]
        areas = np.einsum("pij,pj->pi", np.cross(spokes[:, :-1], spokes[:, 1:]), normal[left])
        apex[left[(areas >= -(slack * size)[left, None]).all(axis=1)]] = first
    if (apex < 0).any():
        raise _refused(
            polygons[np.argmin(apex)],
            "go around a shape that bends or crosses itself; none of the corners that were tried sees it whole",
        )
    order = (apex[:, None] + np.arange(count)) % count
    turned = polygons[np.arange(len(polygons))[:, None], order]
    fans = np.stack([np.broadcast_to(turned[:, :1], (len(turned), count - 2)), turned[:, 1:-1], turned[:, 2:]], axis=2)
    return np.asarray(fans.reshape(-1, 3)), work


def _planes(points: Floats, size: Floats, slack: Floats) -> tuple[Floats, Bools]:
    """Unit normals of polygons around their centres, and which are flat; those without an area need lie on a line."""
    total = np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1)
    length = np.linalg.norm(total, axis=1)
    thin = length <= slack * size
    normal = total / np.where(length > 0.0, length, 1.0)[:, None]
    flat = np.abs(np.einsum("pij,pj->pi", points, normal)).max(axis=1) <= slack
    if thin.any():
        _, _, axes = np.linalg.svd(points[thin], full_matrices=False)
        off = np.abs(points[thin] @ axes[:, 1:].transpose(0, 2, 1)).max(axis=(1, 2))
        flat[thin] = off <= slack[thin]
        normal[thin] = 0.0
    return normal, flat


def _refused(polygon: Ints, what: str) -> Fault:
    shown = ", ".join(map(str, polygon[:8].tolist())) + (", ..." if len(polygon) > 8 else "")
    problem = f"has a face of {len(polygon)} corners (vertices {shown}, counted from 0) that {what}"
    rule = "more than three corners must lie flat, and one of them must see the whole face"
    return Fault(problem, rule, "triangulate the faces where the file is written", kind=GeometryError)


def unread(what: str, hint: str = "export it as plain triangles, e.g. as STL") -> Fault:
    """What is wrong with a file of which a part is not read, and so would be lost."""
    return Fault(f"has {what}, which is not read", "it would be lost", hint, kind=GeometryError)


def read_obj(file: Path) -> Surface:
    """Triangles of an OBJ file, all its objects together; lines and points are left.

    Raises FileError if a line cannot be understood, or names a vertex that there is not, and GeometryError if there are
    free-form surfaces or other files, or a polygon can be cut in several ways.
    """
    points: list[list[bytes]] = []
    corners: list[bytes] = []
    sizes: list[int] = []
    before: list[int] = []
    for line in _statements(file):
        tokens = line.split()
        if not tokens:
            continue
        name = tokens[0]
        if name not in (b"v", b"f"):
            name = name.lower()
        if name == b"f":
            corners += tokens[1:]
            sizes.append(len(tokens) - 1)
            before.append(len(points))
        elif name == b"v":
            points.append(tokens[1:])
        elif name in _SURFACES:
            raise unread(f"a statement {name.decode()!r}")
        elif name not in _LEFT:
            raise Fault(f"has a line {line[:60].decode('latin-1')!r}, which is no statement of OBJ")
    vertices = _vertices(points)
    counts = np.array(sizes, dtype=np.int64)
    numbers = _numbers(corners, np.repeat(np.array(before, dtype=np.int64), counts))
    return vertices, triangulated(vertices, numbers, counts)


def _statements(file: Path) -> list[bytes]:
    """Lines without comments, those that are continued joined."""
    data = read_bytes(file, "mesh", memory=20.0).removeprefix(b"\xef\xbb\xbf")
    if b"\0" in data:
        raise Fault("is not text")
    if b"\\" in data:
        data = re.sub(rb"#[^\r\n]*", b"", data)
        lost = re.search(rb"\\[ \t]*(?:\r\n|\r|\n)[ \t]*(?:v[tnp]?|f)[ \t][^\r\n]*", data, re.IGNORECASE)
        if lost:
            line = lost[0].split(maxsplit=1)[-1][:60].decode("latin-1")
            problem = f"has a backslash at the end of the line before {line!r}, which would make that part of another"
            raise Fault(problem, "a backslash continues a line", "remove it")
        data = re.sub(rb"\\[ \t]*(?:\r\n|\r|\n)", b" ", data)
    return [line.partition(b"#")[0] for line in data.splitlines()] if b"#" in data else data.splitlines()


def _vertices(points: list[list[bytes]]) -> Floats:
    """x, y and z; a fourth number is a weight, which must be 1, and six or more are a colour besides."""
    widths = set(map(len, points))
    if widths & {0, 1, 2, 5}:
        raise Fault(f"has a vertex with {min(widths & {0, 1, 2, 5})} numbers; a vertex has x, y and z")
    weights = [point[3] for point in points if len(point) == 4] if 4 in widths else []
    if any(float(weight) != 1.0 for weight in weights):
        raise unread("vertices with weights other than 1")
    return numbers_of([word for point in points for word in point[:3]], float).reshape(-1, 3)


def _numbers(corners: list[bytes], before: Ints) -> Ints:
    """Vertex numbers, counted from 0: in the file from 1, or, where negative, back from the last one before."""
    try:
        numbers = numbers_of([corner.partition(b"/")[0] for corner in corners], int)
    except ValueError as error:
        raise Fault(f"has a corner of a face that is no whole number ({error!s:.80})") from error
    if (numbers == 0).any():
        raise Fault("has a face that names vertex 0; they are numbered from 1")
    return np.where(numbers > 0, numbers - 1, before + numbers)


def read_off(file: Path) -> Surface:
    """Triangles of an OFF file; normals, colours and texture coordinates are left.

    Raises FileError if the file is truncated, or its lines are not as many as it says, and GeometryError if it is
    binary, its vertices have other than three coordinates, or a polygon can be cut in several ways.
    """
    text = re.sub(rb"#[^\r\n]*", b"", read_bytes(file, "mesh", memory=20.0))
    head = re.match(rb"\s*((?:ST)?C?N?)(4?n?)OFF\b([ \t]+BINARY)?", text)
    if not head:
        raise Fault("does not begin with OFF")
    if head[2] or head[3]:
        what = "binary data" if head[3] else "vertices of another number of coordinates than three"
        raise unread(f"{what} ({head[0].decode().strip()})")
    rows = [tokens for line in text[head.end() :].splitlines() if (tokens := line.split())]
    if not rows or len(rows[0]) not in (2, 3):
        raise Fault("does not tell the numbers of vertices and faces after OFF")
    count, polygons = int(rows[0][0]), int(rows[0][1])
    if len(rows) != 1 + count + polygons:
        raise Fault(f"declares {count} vertices and {polygons} faces, and has {len(rows) - 1} lines of them")
    points, faces = rows[1 : count + 1], rows[count + 1 :]
    if points and (min(map(len, points)) < 3 or len(set(map(len, points))) > 1):
        raise Fault("has lines of vertices that are not alike; each has x, y and z, and as many words as others")
    sizes = numbers_of([row[0] for row in faces], int)
    if any(len(row) <= size for row, size in zip(faces, sizes.tolist(), strict=True)):
        raise Fault("has a face with fewer corners than it says")
    corners = [word for row, size in zip(faces, sizes.tolist(), strict=True) for word in row[1 : size + 1]]
    vertices = numbers_of([word for row in points for word in row[:3]], float).reshape(-1, 3)
    return vertices, triangulated(vertices, numbers_of(corners, int), sizes)


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
    rule = "it goes from 'ply' and 'format' to 'end_header' and tells 'element vertex' once"
    raise Fault("has no whole PLY header", rule, "the file is truncated or of another format, fetch it again")


def _corners(data: Any, name: str, header: PlyHeader) -> tuple[Ints, Ints]:
    """The faces of a binary file, all of equally many corners: trimesh takes the length of the first one for all."""
    counts, corners = data[name]["f0"], data[name]["f1"]
    size = corners.shape[1] if corners.ndim == 2 else 1
    lists = [data[other]["f0"] for other, is_list in header.properties["face"] if is_list]
    if any((lengths != lengths[0]).any() for lengths in lists):
        raise Fault("has faces of different numbers of corners; write it as text, or with triangles alone")
    return np.asarray(corners, dtype=np.int64).reshape(-1), np.full(len(counts), size)
