"""Triangle surfaces from OBJ and PLY files.

Unambiguous polygons are cut into triangles. trimesh reads the elements of binary PLY (Turk, 1994);
this module parses its header, for meshes and point clouds.
"""

# OBJ and polygons of four or more corners are read here because trimesh 5.2 and meshio move or lose
# their faces.

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from cspace._files.access import (
    ContentError,
    check_file,
    decoding,
    is_count,
    iterate_header_lines,
    parse_numbers,
    read_bytes,
)
from cspace._files.crs import refuse_degrees
from cspace._support.arrays import Bools, Floats, Ints, StrPath, Surface
from cspace.errors import GeometryError

MAX_BEND: Final = 1e-4
"""Maximum distance of a flat polygon's corners from its plane, relative to its size."""

FILE_ROUNDING: Final = 1e-6
"""Additional tolerance relative to the largest coordinate, because files keep seven digits."""


MAX_FANS: Final = 100
"""Maximum number of corners tried as the centre of a fan; trying all takes quadratic time."""


_SKIPPED_STATEMENTS: Final = frozenset(
    b"vt vn vp g o s mg usemtl mtllib usemap maplib bevel c_interp d_interp lod "
    b"shadow_obj trace_obj deg bmat step "
    b"cstype parm trim hole scrv sp end con ctech stech curv2".split()
)
"""OBJ statements that describe no surface."""

_SURFACE_STATEMENTS: Final = frozenset(b"surf curv fo bsp bzp cdc cdp res call csh".split())
"""OBJ statements for surfaces other than polygons, of former versions, or in other files."""


def transform_surface(surface: Surface, transform: Floats) -> Surface:
    """Apply an affine transform (4, 4) to a surface.

    A mirror image gets its faces reversed, so that they face as before.
    """
    if (transform == np.eye(4)).all():
        return surface
    points, faces = surface
    linear = transform[:3, :3]
    offset = transform[:3, 3]
    moved = points @ linear.T + offset
    if np.linalg.det(linear) < 0.0:
        faces = faces[:, ::-1]
    return moved, faces


def surface_bytes(points: int, faces: int) -> int:
    """Return the number of bytes of a placed surface.

    A small file can place one surface any number of times.
    """
    # Three numbers of 8 bytes for each point and face, and the objects around them.
    return 24 * (points + faces) + 1000


def join_surfaces(parts: Sequence[Surface]) -> Surface:
    """Join surfaces into one, empty without parts."""
    vertices = [np.empty((0, 3))]
    faces = [np.empty((0, 3), dtype=np.int64)]
    count = 0  # of vertices before a part; its faces count from its own first vertex
    for points, triangles in parts:
        vertices.append(points)
        faces.append(triangles + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(faces)


def triangulate(vertices: Floats, corners: Ints, sizes: Ints) -> Ints:
    """Cut polygons, given by vertex indices one after another, into triangles.

    Return shape (sum of (`sizes` - 2), 3). Each polygon becomes a fan around one of its corners,
    preferably the first. A polygon that is not flat is refused, because each way to cut it gives
    another surface. So is a polygon that no fan around one of its first :data:`MAX_FANS` corners
    covers exactly.

    Raises ContentError if a polygon has fewer than three corners, names a missing vertex, is not
    flat, crosses itself, or is so bent that no fan covers it.
    """
    if len(sizes) and int(sizes.min()) < 3:
        raise ContentError(f"has a face with {int(sizes.min())} corners; a face needs three")
    if int(sizes.sum()) != len(corners):
        raise ContentError(f"names {len(corners)} corners in faces with {int(sizes.sum())}")
    wrong = corners[(corners < 0) | (corners >= len(vertices))]
    if len(wrong):
        raise ContentError(
            f"has a face that names vertex {wrong[0]}, counted from 0, of {len(vertices)}"
        )
    # All polygons of one size are cut at once.
    firsts = np.cumsum(sizes) - sizes
    faces = [np.empty((0, 3), dtype=np.int64)]
    for size in np.unique(sizes):
        places = firsts[sizes == size, None] + np.arange(size)
        polygons = corners[places]
        if size > 4:
            _check_repeats(polygons)
        if size > 3:
            polygons = _cut_fans(vertices, polygons)
        faces.append(polygons)
    return np.concatenate(faces)


def _check_repeats(polygons: Ints) -> None:
    """Refuse polygons, shape (P, n), that repeat few vertices.

    Otherwise two bytes of text could become a triangle. A polygon with holes names the ends of its
    bridges twice, so at least half of its corners are distinct.
    """
    # Sorted, a vertex is new where the number changes.
    steps = np.diff(np.sort(polygons, axis=1), axis=1)
    distinct = 1 + np.count_nonzero(steps, axis=1)
    if (2 * distinct < polygons.shape[1]).any():
        polygon = polygons[np.argmin(distinct)]
        raise _make_face_error(polygon, f"repeat only {distinct.min()} vertices")


def _cut_fans(vertices: Floats, polygons: Ints) -> Ints:
    """Cut polygons (P, n), n > 3, into fans of triangles."""
    # Judge the shape of each polygon in the scale of its coordinates, up to their rounding.
    points = _scale_polygons(vertices[polygons])
    sizes = np.asarray(np.linalg.norm(points, axis=2).max(axis=1))
    slacks = np.asarray(FILE_ROUNDING + MAX_BEND * sizes)
    normals, flat = _fit_planes(points, sizes, slacks)
    if not flat.all():
        problem = "do not lie in one plane, or enclose no area there"
        raise _make_face_error(polygons[np.argmin(flat)], problem)
    apexes = _find_apexes(points, normals, slacks * sizes)
    if (apexes < 0).any():
        problem = (
            "enclose a shape that bends or crosses itself; none of the tried corners sees it whole"
        )
        raise _make_face_error(polygons[np.argmin(apexes)], problem)
    # Name the corners of each polygon from its apex on. Triangle k of the fan has the apex and the
    # corners k + 1 and k + 2.
    count = polygons.shape[1]
    order = (apexes[:, None] + np.arange(count)) % count
    from_apex = np.take_along_axis(polygons, order, axis=1)
    apex_corners = np.repeat(from_apex[:, :1], count - 2, axis=1)
    fans = np.stack([apex_corners, from_apex[:, 1:-1], from_apex[:, 2:]], axis=2)
    return np.asarray(fans.reshape(-1, 3))


def _scale_polygons(points: Floats) -> Floats:
    """Scale polygons (P, n, 3) by their largest coordinates, and center them.

    A polygon that is not finite becomes zeros; a later check refuses it by name.
    """
    finite = np.isfinite(points).all(axis=(1, 2), keepdims=True)
    points = np.where(finite, points, 0.0)
    largest = np.abs(points).max(axis=(1, 2), keepdims=True)
    points = points / np.where(largest > 0.0, largest, 1.0)
    return np.asarray(points - points.mean(axis=1, keepdims=True))


def _find_apexes(points: Floats, normals: Floats, area_slacks: Floats) -> Ints:
    """Return the corner of each polygon whose fan covers it, or -1.

    `points` has shape (P, n, 3), `normals` (P, 3) and `area_slacks` (P,).
    """
    apexes = np.full(len(points), -1, dtype=np.int64)
    for apex in range(min(points.shape[1], MAX_FANS)):
        rest = np.flatnonzero(apexes < 0)
        if not len(rest):
            break
        # Spokes lead from the apex to the other corners, in order.
        spokes = points[rest] - points[rest, apex : apex + 1]
        spokes = np.roll(spokes, -apex, axis=1)[:, 1:]
        crosses = np.cross(spokes[:, :-1], spokes[:, 1:])
        doubled_areas = np.einsum("pij,pj->pi", crosses, normals[rest])
        # A fan covers a polygon if no triangle faces backwards.
        covers = (doubled_areas >= -area_slacks[rest, None]).all(axis=1)
        apexes[rest[covers]] = apex
    return apexes


def _fit_planes(points: Floats, sizes: Floats, slacks: Floats) -> tuple[Floats, Bools]:
    """Return unit normals of polygons, and a mask of flat ones.

    `points` has shape (P, n, 3). A polygon without area counts as flat if it lies on a line; its
    normal is zero.
    """
    doubled_areas = np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1)
    lengths = np.linalg.norm(doubled_areas, axis=1)
    thin = lengths <= slacks * sizes
    normals = doubled_areas / np.where(lengths > 0.0, lengths, 1.0)[:, None]
    heights = np.abs(np.einsum("pij,pj->pi", points, normals))
    flat = heights.max(axis=1) <= slacks
    # A thin polygon is measured across the line that fits its corners best.
    if thin.any():
        _, _, axes = np.linalg.svd(points[thin], full_matrices=False)
        across = axes[:, 1:].transpose(0, 2, 1)  # the axes but the longest
        distances = np.abs(points[thin] @ across).max(axis=(1, 2))
        flat[thin] = distances <= slacks[thin]
        normals[thin] = 0.0
    return normals, flat


def _make_face_error(polygon: Ints, what: str) -> ContentError:
    """Return the error for a face without clear triangles."""
    # Largest number of vertices that the error for a face names.
    max_named_vertices = 8
    names = ", ".join(map(str, polygon[:max_named_vertices].tolist()))
    ellipsis = ", ..." if len(polygon) > max_named_vertices else ""
    place = f"(vertices {names}{ellipsis}, counted from 0)"
    problem = f"has a face of {len(polygon)} corners {place} that {what}"
    rule = "more than three corners must lie flat, and one of them must see the whole face"
    return ContentError(problem, rule, kind=GeometryError)


def cover_lines(corners: Ints, sizes: Ints) -> Ints:
    """Return the corners of triangles without area along lines, shape (3 n,).

    ``sizes`` has the number of corners of each line.
    """
    owners = np.repeat(np.arange(len(sizes)), sizes)
    (begins,) = np.nonzero(owners[1:] == owners[:-1])
    return corners[np.stack([begins, begins + 1, begins + 1], axis=1)].ravel()


def unsupported_part(what: str) -> ContentError:
    """Make the error for a file's unsupported part."""
    problem = f"has {what}, which is not read"
    return ContentError(problem, "it would be lost", kind=GeometryError)


def read_obj(file: Path) -> Surface:
    """Read triangles of all objects of an OBJ.

    Lines and points are triangles without area: an outer cell covers them, and no inside changes.

    Raises FileError if a line is malformed or names a missing vertex. Raises GeometryError if the
    file has free-form surfaces, refers to other files, or has a polygon whose triangles are
    ambiguous.
    """
    # Words of each vertex and of all corners; for each face, its number of corners and the number
    # of vertices before it.
    points: list[list[bytes]] = []
    corners: list[bytes] = []
    sizes: list[int] = []
    vertices_before: list[int] = []
    for line in _read_lines(file):
        tokens = line.split()
        if not tokens:
            continue
        name = tokens[0]
        if name not in (b"v", b"f"):
            name = name.lower()  # of other statements, capitals vary
        if name == b"f":
            corners += tokens[1:]
            sizes.append(len(tokens) - 1)
            vertices_before.append(len(points))
        elif name in (b"l", b"p"):
            ends = tokens[2:] if name == b"l" else tokens[1:]
            for first, last in zip(tokens[1:], ends, strict=False):
                corners += [first, last, last]
                sizes.append(3)
                vertices_before.append(len(points))
        elif name == b"v":
            points.append(tokens[1:])
        elif name in _SURFACE_STATEMENTS:
            raise unsupported_part(f"a statement {name.decode()!r}")
        elif name not in _SKIPPED_STATEMENTS:
            text = line[:60].decode("latin-1")
            raise ContentError(f"has a line {text!r}, which is not a statement of OBJ")
    vertices = _parse_vertices(points)
    counts = np.array(sizes, dtype=np.int64)
    before = np.repeat(np.array(vertices_before, dtype=np.int64), counts)
    return vertices, triangulate(vertices, _parse_indices(corners, before), counts)


def _read_lines(file: Path) -> list[bytes]:
    """Return lines without comments; refuse continued ones."""
    data = read_bytes(file, "mesh", memory=20.0).removeprefix(b"\xef\xbb\xbf")
    if b"\0" in data:
        raise ContentError("is not text")
    lines = data.splitlines()
    if b"#" in data:
        lines = [line.partition(b"#")[0] for line in lines]
    if b"\\" in data and any(line.rstrip().endswith(b"\\") for line in lines):
        raise ContentError("has a line that ends with a backslash", "it would be split")
    return lines


def _parse_vertices(points: list[list[bytes]]) -> Floats:
    """Parse x, y and z of each vertex.

    A fourth number is a weight, which must be 1; six or more numbers include a colour.
    """
    # Three or four numbers are a position; a colour adds three.
    for count in set(map(len, points)) & {0, 1, 2, 5}:
        raise ContentError(f"has a vertex with {count} numbers; a vertex has x, y and z")
    if any(float(point[3]) != 1.0 for point in points if len(point) == 4):
        raise unsupported_part("vertices with weights other than 1")
    words = list(itertools.chain.from_iterable(point[:3] for point in points))
    try:
        return parse_numbers(words, float).reshape(-1, 3)
    except ValueError as error:
        rule = "x, y and z must be numbers, with decimal points"
        raise ContentError(f"has a vertex that is none ({error!s:.80})", rule) from error


def _parse_indices(corners: list[bytes], before: Ints) -> Ints:
    """Convert vertex numbers to indices from 0.

    Files count from 1, or backwards from the last vertex if negative. `before` is the number of
    vertices before each corner.
    """
    words = [corner.partition(b"/")[0] for corner in corners]
    try:
        numbers = parse_numbers(words, int)
    except ValueError as error:
        raise ContentError(
            f"has a corner of a face that is not a whole number ({error!s:.80})"
        ) from error
    if (numbers == 0).any():
        raise ContentError("has a face that names vertex 0; vertices count from 1")
    return np.where(numbers > 0, numbers - 1, before + numbers)


PLY_KIND: Final = "PLY file"

_PLY_FORMATS: Final = ("ascii", "binary_little_endian", "binary_big_endian")
_CORNER_LISTS: Final = ("vertex_indices", "vertex_index")
_NO_FACES: Final = np.empty(0, dtype=np.int64)


class PlyHeader(NamedTuple):
    """The header of a PLY file.

    Attributes
    ----------
    is_text : bool
    counts : dict of str to int
        Number of each element, in the order of the file.
    properties : dict of str to list of (str, bool)
        Name of each property of an element, and whether it is a list.
    end : int
        Position of the first byte of the elements.
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


def read_ply_header(path: StrPath) -> PlyHeader:
    """Read the header of a PLY file.

    Raises FileError if the file is missing, or has no whole header with vertices. Raises
    GeometryError if it has surfaces other than faces, such as triangle strips, because they would
    be lost.
    """
    file = check_file(path, PLY_KIND)
    with decoding(file, PLY_KIND), file.open("rb") as stream:
        # Number of bytes of a PLY file in which its header is looked for.
        return _parse_ply_header(stream.read(2**16))


def read_ply(path: StrPath) -> tuple[Floats, Ints, Ints]:
    """Read the vertices and polygons of a PLY file.

    Returns the vertices, shape (V, 3), the corners of all polygons, and the number of corners of
    each.

    Raises FileError if the file is missing. Raises ContentError if it is malformed or truncated,
    holds another number of elements than declared, is binary with polygons of unequal size, or has
    surfaces of another kind.
    """
    # trimesh reads binary files, whose sizes are compared with the header afterwards.
    content = read_bytes(path, PLY_KIND, memory=8.0)
    header = _parse_ply_header(content)
    columns = [name for name, _ in header.properties["vertex"]]
    if not {"x", "y", "z"} <= set(columns):
        refuse_degrees(columns)
        problem = f"has vertices with {', '.join(columns)}"
        raise ContentError(problem, "they need x, y and z, in metres")
    lists = [name for name, is_list in header.properties.get("face", []) if is_list]
    names = [name for name in lists if name in _CORNER_LISTS]
    if header.faces and len(names) != 1:
        rule = f"the corners of faces are one list named {' or '.join(_CORNER_LISTS)}"
        raise ContentError(f"has faces with {names or lists}", rule)
    if header.is_text:
        return _read_ply_text(content[header.end :], header)
    if not header.vertices:
        return np.empty((0, 3)), _NO_FACES, _NO_FACES
    from trimesh.exchange.ply import load_ply

    with decoding(path, f"{PLY_KIND} with faces of equally many corners"):
        loaded: Any = load_ply(io.BytesIO(content), skip_materials=True)
        elements = loaded["metadata"]["_ply_raw"]
        rows = elements["vertex"]["data"]
        vertices = np.column_stack([rows[axis].reshape(-1) for axis in "xyz"])
        corners = sizes = _NO_FACES
        if header.faces:
            corners, sizes = _read_corners(elements["face"]["data"], names[0], lists)
    if len(vertices) != header.vertices or len(sizes) != header.faces:
        declared = f"{header.vertices} vertices and {header.faces} faces"
        raise ContentError(f"declares {declared} but has {len(vertices)} and {len(sizes)}")
    return vertices.astype(np.float64), corners, sizes


def _read_ply_text(text: bytes, header: PlyHeader) -> tuple[Floats, Ints, Ints]:
    """Read the vertices and polygons of a text file; return as :func:`read_ply`.

    trimesh counts blank lines as elements, skips excess lines and words, and applies the first
    list's length to all.
    """
    rows = [line.split() for line in text.splitlines() if line.strip()]
    declared = sum(header.counts.values())
    if len(rows) != declared:
        raise ContentError(f"declares {declared} elements but has {len(rows)} lines of them")
    elements = np.repeat(list(header.counts), list(header.counts.values())).tolist()
    names = [name for name, _ in header.properties["vertex"]]
    columns = [names.index(axis) for axis in "xyz"]
    points: list[bytes] = []
    corners: list[bytes] = []
    sizes: list[int] = []
    try:
        for element, tokens in zip(elements, rows, strict=True):
            # A property is one word; a list is its length and so many words more.
            end = 0
            for name, is_list in header.properties[element]:
                length = int(tokens[end]) if is_list else 0
                start = end + 1
                end = start + length
                if element == "face" and is_list and name in _CORNER_LISTS:
                    sizes.append(length)
                    corners += tokens[start:end]
            if end != len(tokens):
                raise ContentError(f"has a {element} of {len(tokens)} words but declares {end}")
            if element == "vertex":
                points += [tokens[column] for column in columns]
        vertices = parse_numbers(points, float).reshape(-1, 3)
        return vertices, parse_numbers(corners, int), np.array(sizes, dtype=np.int64)
    except (IndexError, ValueError, OverflowError) as error:
        raise ContentError(f"has elements that are not as declared ({error})") from error


_PLY_ELEMENTS: Final = ("vertex", "face", "range_grid", "camera", "material", "user")
"""Elements of PLY that are read, or that occupy nothing."""


def _parse_ply_header(content: bytes) -> PlyHeader:
    """Parse the header of a PLY file."""
    # Each element is followed by its properties, so ``name`` is the last element.
    lines = iterate_header_lines(content)
    first, _ = next(lines, ("", 0))
    if first.split() != ["ply"]:
        raise _make_ply_header_error()
    counts: dict[str, int] = {}
    properties: dict[str, list[tuple[str, bool]]] = {}
    form = ""
    name = ""
    for line, after in lines:
        match line.split():
            case ["format", form, _]:
                pass
            case ["element", name, count] if is_count(count) and name not in counts:
                counts[name] = int(count)
                properties[name] = []
            case ["property", "list", _, _, label] if name:
                properties[name].append((label, True))
            case ["property", kind, label] if name and kind != "list":
                properties[name].append((label, False))
            case ["end_header"] if "vertex" in counts and form in _PLY_FORMATS:
                _check_ply_elements(counts)
                return PlyHeader(form == "ascii", counts, properties, after)
            case ["comment" | "obj_info", *_] | []:
                pass
            case _:
                raise _make_ply_header_error()
    raise _make_ply_header_error()


def _check_ply_elements(counts: dict[str, int]) -> None:
    """Refuse elements that may be obstacles, other than faces and points."""
    for element, count in counts.items():
        if count and element == "edge":
            raise unsupported_part("edges beside its faces or points")
        if count and element not in _PLY_ELEMENTS:
            raise unsupported_part(f"elements {element}, which may be surfaces")


def _make_ply_header_error() -> ContentError:
    """Return the error for a header that is not one of PLY."""
    rule = "it must go from 'ply' and 'format' to 'end_header', with 'element vertex' once"
    return ContentError("has no whole PLY header", rule)


def _read_corners(data: Any, name: str, lists: list[str]) -> tuple[Ints, Ints]:
    """Return corners and sizes of a binary PLY's faces.

    Refuses faces of different sizes, because trimesh applies the size of the first face to all.
    """
    # trimesh gives a list as two fields: "f0" has the lengths, and "f1" the values.
    for list_name in lists:
        lengths = data[list_name]["f0"]
        if (lengths != lengths[0]).any():
            problem = "has faces of different numbers of corners"
            rule = "those of a binary file must have equally many"
            raise ContentError(problem, rule)
    corners = np.asarray(data[name]["f1"], dtype=np.int64).reshape(-1)
    return corners, data[name]["f0"].astype(np.int64).reshape(-1)
