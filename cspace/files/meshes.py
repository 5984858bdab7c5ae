"""Meshes from files, and from the objects of trimesh: all triangles that a file holds, or an error that names it.

PLY, GLB and glTF are read by trimesh, with ``process=False``, and counted: a census of the file, made apart from the
reading, must agree with what was read. STL, OBJ, OFF and COLLADA are read here. Of STL the census is the reading.
trimesh moves triangles of OBJ where corners count backwards or are written in more than one way, loses those of lines
that begin with a blank, and lays polygons that bend as fans that stick out of them. COLLADA is read here because
pycollada drops what it does not know and warns on NumPy 2.5.

In glTF, trimesh passes over fans of triangles, fills sparse and compressed accessors with zeros, takes quantised
numbers as they are, leaves out instances, skins and morphs, and loses what hangs below a node with a camera. All of
these are refused here by name; the triangles of the rest are counted, and their bounds compared with the header's.
"""

from __future__ import annotations

import io
import json
import logging
import math
import os
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np

from cspace.arrays import Floats, Ints, Surface
from cspace.check import finite
from cspace.errors import GeometryError, InputError
from cspace.files.access import Fault, decoding, existing, numbers_of, read_bytes, suffix_of
from cspace.files.plain import check_nesting, parse_xml
from cspace.files.polygons import joined, placed, read_obj, read_off, read_ply, triangulated, unfolded, unread
from cspace.limits import check_bytes

_KIND: Final = "mesh"

_LOOKS: Final = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp", "MSFT_texture_")
"""Extensions, by their first letters, that leave the shape as it is."""

_DEEPEST: Final = 256
"""Levels of nodes within each other, at most."""

_TRIANGLES: Final = 4
_MODES: Final = {5: "strips of triangles", 6: "fans of triangles"}
_WIDTHS: Final = {5121: 1, 5123: 2, 5125: 4, 5126: 12}
"""Bytes of a corner's number, and of a position, by the type of its component."""


def load_gltf(file: Path) -> tuple[Any, int]:
    """The scene of a file, as trimesh reads it, and how many triangles it must have.

    Raises FileError if the file or a buffer is missing, truncated or malformed, or another thing was read than is
    declared, and GeometryError if there is something besides triangles, or shapes that depend on an extension, a skin,
    a morph, or on numbers that are quantised, sparse or compressed.
    """
    import trimesh

    data = read_bytes(file, _KIND, memory=4.0)
    is_binary = file.suffix.lower() == ".glb"
    header = _header(_json_of(data) if is_binary else data)
    parts = [[_triangles(part, header) for part in mesh["primitives"]] for mesh in header.get("meshes", [])]
    sizes = [
        sum(unfolded(header["accessors"][part["attributes"]["POSITION"]]["count"], faces) for part, faces in pairs)
        for pairs in map(zip, (mesh["primitives"] for mesh in header.get("meshes", [])), parts)
    ]
    places = list(_instances(header))
    check_bytes(file, sum(sizes) + sum(sizes[mesh] for mesh in places), "unfolds to", memory=3.0)
    declared = sum(sum(parts[mesh]) for mesh in places)
    if not declared:
        return trimesh.Scene(), 0
    kind = "glb" if is_binary else "gltf"
    loaded = trimesh.load_scene(
        io.BytesIO(data), file_type=kind, resolver=_Beside(file), process=False, skip_materials=True
    )
    primitives = [part for mesh in header["meshes"] for part in mesh["primitives"]]
    if len(primitives) != len(loaded.geometry):
        raise Fault(f"declares {len(primitives)} parts, and {len(loaded.geometry)} were read")
    for primitive, geometry in zip(primitives, loaded.geometry.values(), strict=True):
        _compare(np.asarray(geometry.vertices), header["accessors"][primitive["attributes"]["POSITION"]])
    return loaded, declared


def _triangles(primitive: dict[str, Any], header: dict[str, Any]) -> int:
    """Triangles that a part must have, once everything about it is known to be read right."""
    mode = primitive.get("mode", _TRIANGLES)
    if mode != _TRIANGLES:
        raise unread(f"a part of {_MODES.get(mode, f'points or lines (mode {mode})')}")
    _refuse_extensions(primitive)
    if "POSITION" not in primitive["attributes"]:
        raise unread("a part without positions of its own")
    corners = _count(primitive["attributes"]["POSITION"], "VEC3", header)
    if "indices" in primitive:
        corners = _count(primitive["indices"], "SCALAR", header)
    if corners < 3 or corners % 3:
        raise Fault(f"has a part of {corners} corners, which do not make triangles")
    return corners // 3


def _count(number: int, kind: str, header: dict[str, Any]) -> int:
    """Rows of an accessor whose numbers lie as they are in a buffer, within it."""
    accessor = _item(header, "accessors", number)
    if "sparse" in accessor:
        raise unread(f"a sparse accessor ({number})")
    if "bufferView" not in accessor:
        raise unread(f"an accessor ({number}) without data, as compression leaves it")
    component = accessor["componentType"]
    if kind == "VEC3" and component != 5126:
        raise unread(f"quantised positions (accessor {number})")
    if accessor["type"] != kind or component not in _WIDTHS or (kind == "SCALAR") == (component == 5126):
        raise Fault(f"has accessor {number} of {accessor['type']} {component}, where {kind} must be")
    view = _item(header, "bufferViews", accessor["bufferView"])
    _refuse_extensions(view)
    width, count, start = _WIDTHS[component], accessor["count"], accessor.get("byteOffset", 0)
    stride, first = view.get("byteStride", width), view.get("byteOffset", 0)
    end = start + (count - 1) * stride + width
    buffer = _item(header, "buffers", view["buffer"])
    if min(start, first) < 0 or count < 1 or stride < width or end > view["byteLength"]:
        raise Fault("has an accessor that goes beyond its view, or is empty")
    if first + view["byteLength"] > buffer["byteLength"]:
        raise Fault("has a view of a buffer that goes beyond its end")
    return int(count)


def _instances(header: dict[str, Any]) -> Iterator[int]:
    """The mesh of each place of the scene where one stands."""
    scenes, nodes = header.get("scenes", []), header.get("nodes", [])
    if not scenes and header.get("meshes"):
        raise unread("meshes in no scene", "export it again with its scene")
    if len(scenes) > 1 and "scene" not in header:
        raise unread(f"{len(scenes)} scenes of which none is the default", "export one scene")
    seen: set[int] = set()
    roots = _item(header, "scenes", header.get("scene", 0)).get("nodes", []) if scenes else []
    pending = [(number, 1) for number in roots]
    while pending:
        number, level = pending.pop()
        if level > _DEEPEST:
            raise Fault(f"has more than {_DEEPEST} nodes within each other")
        if number in seen or not 0 <= number < len(nodes):
            raise Fault(f"names node {number} twice, or it is not there; nodes form trees")
        seen.add(number)
        node = nodes[number]
        _refuse_extensions(node)
        pending += [(child, level + 1) for child in node.get("children", [])]
        if not any(np.asarray(node.get("rotation", [1.0]), dtype=np.float64)):
            raise Fault("has a node with a rotation of length 0")
        if "camera" in node and ("mesh" in node or node.get("children")):
            raise unread("a mesh at or below a camera", "hang the camera below the mesh")
        if "mesh" in node:
            mesh = _item(header, "meshes", node["mesh"])
            if "skin" in node:
                raise unread("a mesh that a skin moves", "apply its pose, and export it without the skin")
            if any(node.get("weights", mesh.get("weights", []))):
                raise unread("a mesh that a morph moves", "apply the morph, and export it as it then is")
            yield node["mesh"]


def _compare(points: Floats, accessor: dict[str, Any]) -> None:
    """Hold the vertices that were read against the number and the bounds that their accessor declares."""
    if len(points) != accessor["count"]:
        raise Fault(f"declares {accessor['count']} vertices of a part, and {len(points)} were read")
    if "min" in accessor and "max" in accessor and np.isfinite(points).all():
        declared = np.array([accessor["min"], accessor["max"]], dtype=np.float64)
        measured = np.array([points.min(axis=0), points.max(axis=0)])
        if declared.shape != (2, 3) or not (np.abs(declared - measured) <= 1e-5 * np.abs(measured).max()).all():
            raise Fault(f"declares bounds of a part that are {declared.tolist()}, and {measured.tolist()} were read")


def _refuse_extensions(thing: dict[str, Any]) -> None:
    foreign = [name for name in thing.get("extensions", {}) if not name.startswith(_LOOKS)]
    if foreign:
        raise unread(f"a part with the extension {foreign[0]}")


def _item(header: dict[str, Any], kind: str, number: int) -> dict[str, Any]:
    items = header.get(kind, [])
    if not 0 <= number < len(items):
        raise Fault(f"names number {number} of its {len(items)} {kind}")
    item: dict[str, Any] = items[number]
    return item


def _json_of(data: bytes) -> bytes:
    """The header of a GLB file, whose chunks fill it to its end."""
    if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
        raise Fault("does not begin with the head of a GLB file of version 2")
    length, at = int.from_bytes(data[8:12], "little"), 12
    if length != len(data):
        raise Fault(f"has {len(data)} bytes and declares {length}")
    while at < length:
        at += 8 + int.from_bytes(data[at : at + 4], "little")
    if at != length or data[16:20] != b"JSON":
        raise Fault("has a chunk that goes beyond its end, or no header in JSON")
    return data[20 : 20 + int.from_bytes(data[12:16], "little")]


def _header(data: bytes) -> dict[str, Any]:
    try:
        text = data.decode("utf-8-sig")
        check_nesting(text, "[{", "]}")
        header = json.loads(text)
    except ValueError as error:
        raise Fault(f"has a header that is no JSON ({error})") from error
    if not isinstance(header, dict):
        raise Fault("has a header that is no object of JSON")
    version = str(header.get("asset", {}).get("version", ""))
    if not version.startswith("2."):
        raise Fault(f"is of version {version or 'none'}; glTF 2 is read")
    _refuse_extensions({"extensions": dict.fromkeys(header.get("extensionsRequired", []))})
    return header


class _Beside(Mapping[str, bytes]):
    """Files that a glTF file names: beside it or below, and nowhere else."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __getitem__(self, uri: str) -> bytes:
        folder = self.file.parent
        other = folder / unquote(uri)
        if not other.resolve().is_relative_to(folder.resolve()):
            raise Fault(f"has its data in {uri!r:.80}, outside of its folder")
        return read_bytes(other, "buffer of glTF")

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


Named = dict[str, Element | None]
"""Elements by their ids; none where two have one."""

_LEFT: Final = frozenset(["asset", "extra", "evaluate_scene", "instance_camera", "instance_light"])
"""Children of a node that have no shape."""

_PLACES: Final = 100_000
"""Places of a scene, at most, beyond the elements of the file: a few nodes that hold others unfold into any number."""

_WITHOUT_SURFACE: Final = frozenset(["source", "vertices", "extra", "lines", "linestrips"])
"""Children of a mesh that have no surface."""


def read_collada(file: Path) -> Surface:
    """Triangles of the file's scene, its unit turned into metres, its axes as they are; lines are left.

    Raises FileError if the file is truncated or malformed, and GeometryError if there is a surface that is not read, or
    a polygon can be cut in several ways.
    """
    root = parse_xml(read_bytes(file, "mesh", memory=20.0))
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != "COLLADA":
        raise Fault(f"holds {root.tag}, not COLLADA")
    named: Named = {}
    for element in root.iter():
        if name := element.get("id"):
            named[name] = None if name in named else element
    unit = root.find("asset/unit")
    metres = float(unit.get("meter", "1")) if unit is not None else 1.0
    if not (math.isfinite(metres) and metres > 0.0):
        raise Fault(f"has a unit of {metres:g} metres")
    instance = root.find("scene/instance_visual_scene")
    if instance is None:
        raise unread("no scene that is shown; its geometries stand nowhere", "export it again with its scene")
    scene = _target(instance, named)
    if scene.tag != "visual_scene":
        raise Fault(f"names {scene.tag} as its scene")
    places: list[tuple[Element, Floats]] = []
    visits, most = 0, _PLACES + sum(1 for _ in root.iter())
    pending: list[tuple[Element, Floats, tuple[Element, ...]]] = [
        (child, np.diag([metres, metres, metres, 1.0]), ()) for child in reversed(list(scene))
    ]
    while pending:
        element, above, path = pending.pop()
        visits += 1
        if visits > most or len(path) > _DEEPEST:
            raise Fault(f"puts nodes into nodes, {len(path)} deep, and {visits} in all or more")
        if element.tag in _LEFT:
            continue
        if element.tag == "instance_node":
            element = _target(element, named)
        if element.tag == "node":
            if element in path:
                raise Fault(f"has the node {element.get('id')!r} within itself")
            transform, shapes = _local(element)
            pending += [(child, above @ transform, (*path, element)) for child in reversed(shapes)]
        elif element.tag == "instance_geometry":
            places.append((_target(element, named), above))
        else:
            raise unread(f"a {element.tag} in its scene")
    arrays: dict[Element, Floats] = {}
    known = {each: _surfaces(each, named, arrays) for each in dict.fromkeys(each for each, _ in places)}
    sizes = {each: sum(unfolded(len(points), len(faces)) for points, faces in known[each]) for each in known}
    check_bytes(file, sum(sizes[each] for each, _ in places), "unfolds to", memory=3.0)
    return joined([placed(surface, above) for each, above in places for surface in known[each]])


def _target(instance: Element, named: Named) -> Element:
    url = instance.get("url", "")
    if not url.startswith("#"):
        raise unread(f"a {instance.tag} of another file ({url!r})", "export it again as one file")
    target = named.get(url[1:])
    if target is None:
        raise Fault(f"names {url!r}, which is not there, or there twice")
    return target


def _local(node: Element) -> tuple[Floats, list[Element]]:
    """Transform of a node in its parent, and the children that are no transforms."""
    transform, shapes = np.eye(4), []
    for child in node:
        if child.tag in ("lookat", "skew"):
            raise unread(f"a node with the transform {child.tag}", "export it again with matrices")
        if child.tag not in _TRANSFORMS:
            shapes.append(child)
            continue
        size, matrix = _TRANSFORMS[child.tag]
        numbers = np.array((child.text or "").split(), dtype=np.float64)
        if len(numbers) != size:
            raise Fault(f"has a {child.tag} of {len(numbers)} numbers; it has {size}")
        transform = transform @ matrix(numbers)
    return transform, shapes


def _translation(offset: Floats) -> Floats:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def _rotation(values: Floats) -> Floats:
    """Turn about an axis by an angle in degrees (Rodrigues)."""
    length = float(np.linalg.norm(values[:3]))
    x, y, z = values[:3] / length if length > 0.0 else values[:3]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(values[3])
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return matrix


_TRANSFORMS: Final[dict[str, tuple[int, Callable[[Floats], Floats]]]] = {
    "matrix": (16, lambda values: values.reshape(4, 4)),
    "translate": (3, _translation),
    "rotate": (4, _rotation),
    "scale": (3, lambda values: np.diag([*values, 1.0])),
}
"""How many numbers each transform of a node has, and its matrix."""


def _surfaces(geometry: Element, named: Named, arrays: dict[Element, Floats]) -> list[Surface]:
    """Surfaces of a geometry, one for each of its primitives."""
    surfaces = []
    for shape in geometry:
        if shape.tag in ("asset", "extra"):
            continue
        if shape.tag != "mesh":
            raise unread(f"a geometry that is a {shape.tag}")
        surfaces += [_primitive(part, named, arrays) for part in shape if part.tag not in _WITHOUT_SURFACE]
    return surfaces


def _primitive(part: Element, named: Named, arrays: dict[Element, Floats]) -> Surface:
    lists = [_corners(p, part) for p in part.findall("p")]
    corners = np.concatenate([np.empty(0, dtype=np.int64), *lists])
    count = int(part.get("count", "0"))
    points = _positions(part, named, arrays) if count else np.empty((0, 3))
    if part.find("ph") is not None:
        raise unread("a polygon with holes")
    if part.tag == "triangles":
        if len(corners) != 3 * count:
            raise Fault(f"declares {count} triangles and holds {len(corners)} corners of them")
        sizes = np.full(count, 3)
    elif part.tag == "polylist":
        counts = part.find("vcount")
        sizes = _integers(counts) if counts is not None else np.empty(0, dtype=np.int64)
    elif part.tag == "polygons":
        sizes = np.array(list(map(len, lists)), dtype=np.int64)
    else:
        raise unread(f"a mesh with {part.tag}")
    if len(sizes) != count:
        raise Fault(f"declares {count} {part.tag} and holds {len(sizes)}")
    return points, triangulated(points, corners, sizes)


def _inputs(element: Element, semantic: str) -> list[Element]:
    return [given for given in element.findall("input") if given.get("semantic") == semantic]


def _corners(p: Element, part: Element) -> Ints:
    """Vertex numbers of a list, in which other numbers stand between them."""
    stride = 1 + max((int(given.get("offset", "0")) for given in part.findall("input")), default=0)
    given = _inputs(part, "VERTEX")
    numbers = _integers(p)
    if len(given) != 1 or len(numbers) % stride:
        raise Fault(f"has {part.tag} with {len(given)} inputs VERTEX and {len(numbers)} numbers, {stride} each")
    return numbers[int(given[0].get("offset", "0")) :: stride]


def _positions(part: Element, named: Named, arrays: dict[Element, Floats]) -> Floats:
    """Points of the vertices that a primitive names; ``arrays`` are those whose text was read before."""
    vertices = [_source(given, named) for given in _inputs(part, "VERTEX")]
    sources = [_source(given, named) for element in vertices for given in _inputs(element, "POSITION")]
    if len(sources) != 1:
        raise Fault(f"has {part.tag} with {len(sources)} sources of positions; they have one")
    accessor = sources[0].find("technique_common/accessor")
    if accessor is None:
        raise Fault("has a source of positions without an accessor")
    array = _source(accessor, named)
    if array.tag not in ("float_array", "int_array"):
        raise Fault(f"has positions in {array.tag}")
    values = arrays.get(array)
    if values is None:
        values = arrays[array] = np.array((array.text or "").split(), dtype=np.float64)
    count, stride = int(accessor.get("count", "0")), int(accessor.get("stride", "1"))
    first = int(accessor.get("offset", "0"))
    columns = [i for i, param in enumerate(accessor.findall("param")) if param.get("name")]
    names = [param.get("name") for param in accessor.findall("param") if param.get("name")]
    if names != ["X", "Y", "Z"] or columns[-1] >= stride or first < 0 or count < 0:
        raise Fault(f"has positions with the columns {names}; they are X, Y, Z")
    if len(values) != int(array.get("count", len(values))) or len(values) < first + count * stride:
        raise Fault(f"has {len(values)} numbers of positions, and declares more or fewer")
    return values[first : first + count * stride].reshape(count, stride)[:, columns]


def _source(given: Element, named: Named) -> Element:
    name = given.get("source", "")
    source = named.get(name[1:]) if name.startswith("#") else None
    if source is None:
        raise Fault(f"names the source {name!r}, which is not in it, or in it twice")
    return source


def _integers(element: Element) -> Ints:
    try:
        return np.array((element.text or "").split(), dtype=np.int64)
    except ValueError as error:
        raise Fault(f"has a {element.tag} with something else than whole numbers ({error})") from error


# What trimesh logs of a bad file is said by the one error that is raised for it.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

_RECORD: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle in a binary STL file, after a head of 84 bytes."""

_FACET: Final = re.compile(
    rb"\bfacet normal \S+ \S+ \S+ outer loop" + 3 * rb" vertex (\S+) (\S+) (\S+)" + rb" endloop endfacet\b"
)
_SOLIDS: Final = re.compile(rb"^[ \t]*(end)?solid\b[^\n]*", re.MULTILINE)


def read_mesh(path: str | os.PathLike[str]) -> tuple[Floats, Ints]:
    """Vertices, shape (V, 3), metres, and triangles, shape (F, 3), of a file; its suffix says how it is read.

    The parts of a scene are put where its transforms say, and joined. Coordinates are metres: those of ``.glb`` and
    ``.gltf`` are by definition, those of ``.dae`` are turned into metres from the unit that the file names, and those
    of the other formats, which name none, are taken to be. Axes are left as they are, whichever the file may call up.

    Nothing is mended or merged, and nothing of a surface is left out: a file with a part that is not read is refused
    with GeometryError. So is a polygon with more than three corners if its triangles are not certain, because the
    corners are out of one plane by more than rounding, or because no fan around one of them covers it. Lines and
    points are left out in ``.obj``, ``.ply`` and ``.dae``, which often hold them besides; they are refused in
    ``.glb`` and ``.gltf``. An ``.obj`` that is cut between two lines, or within its very last number, cannot be told
    from a whole one: nothing in it counts.
    """
    file = existing(path, _KIND)
    suffix = suffix_of(file, _READERS, "the suffix says how a mesh is read", "mesh")
    with decoding(file, _KIND):
        vertices, faces = _READERS[suffix](file)
        if not len(faces):
            raise _without_triangles(str(file), "cloud of points" if len(vertices) else "")
        finite(vertices, f"vertices of {file}")
        wrong = faces[(faces < 0) | (faces >= len(vertices))]
        if len(wrong):
            raise Fault(f"has a face that names vertex {wrong[0]}, counted from 0, of {len(vertices)}")
    return vertices, np.ascontiguousarray(faces)


def _stl(file: Path) -> Surface:
    """Triangles of an STL file, three vertices of their own each."""
    data = read_bytes(file, _KIND, memory=12.0)
    declared = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + _RECORD.itemsize * declared and len(data) >= 84:
        vertices = np.frombuffer(data, _RECORD, declared, 84)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid":
        vertices = _stl_text(data)
    else:
        held = max(0.0, (len(data) - 84) / _RECORD.itemsize)
        raise Fault(f"declares {declared} triangles and has bytes for {held:g}, as a binary STL file")
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)


def _stl_text(data: bytes) -> Floats:
    """The corners of the triangles of an STL file in text."""
    text = data.lower().replace(b"\r", b"\n")
    lines = list(_SOLIDS.finditer(text))
    kinds = [bool(line[1]) for line in lines]
    if not kinds or kinds != [False, True] * (len(kinds) // 2) or text[lines[-1].end() :].strip(b" \t\n\0"):
        raise Fault("does not go from solid to endsolid, as an STL file in text does")
    if b"\0" in text[: lines[-1].end()]:  # which numbers would end with
        raise Fault("is not text")
    if any(b"endfacet" in line[0] for line in lines):
        raise Fault("has facets on a line of solid or endsolid; they need lines of their own")
    text = b" ".join(_SOLIDS.sub(b"", text).split())  # patterns that look for blanks take the square of a long run
    facets = _FACET.findall(text)
    counts = [text.count(word) for word in (b"facet", b"normal", b"vertex")]
    if counts != [2 * len(facets), len(facets), 3 * len(facets)]:
        raise Fault(f"has words of facets beside its {len(facets)} whole ones")
    return numbers_of([word for facet in facets for word in facet], float).reshape(-1, 3)


def _gltf(file: Path) -> Surface:
    """Triangles of a glTF scene, each mesh where its nodes put it: refused where it declares more or fewer."""
    scene, declared = load_gltf(file)
    vertices, faces = flattened(scene, str(file)) if declared else joined([])
    if len(faces) != declared:
        problem, rule = f"holds {declared} triangles, and {len(faces)} were read", "none may be lost or made up"
        raise Fault(problem, rule, "write it again as binary STL", value=(declared, len(faces)))
    return vertices, faces


def _ply(file: Path) -> Surface:
    vertices, corners, sizes = read_ply(file)
    return vertices, triangulated(vertices, corners, sizes)


_READERS: Final[dict[str, Callable[[Path], Surface]]] = {
    ".stl": _stl,
    ".obj": read_obj,
    ".ply": _ply,
    ".off": read_off,
    ".glb": _gltf,
    ".gltf": _gltf,
    ".dae": read_collada,
}
"""Which function reads a file, by suffix."""

SUFFIXES: Final = tuple(_READERS)
"""Formats that are read."""


def flattened(shape: Any, name: str) -> tuple[Floats, Ints]:
    """Vertices and faces of a trimesh.Trimesh or trimesh.Scene, whose parts are placed and joined.

    Raises InputError if it is something else, or a coordinate is not finite, and GeometryError if there are no
    triangles, or something else besides; ``name`` is what messages call it.
    """
    import trimesh

    if isinstance(shape, trimesh.Scene):
        parts = [(shape.geometry[part], transform) for transform, part in _placed(shape)]
    elif isinstance(shape, trimesh.parent.Geometry):
        parts = [(shape, np.eye(4))]
    else:
        hint = "pass a file name, a trimesh.Trimesh, a trimesh.Scene, or vertices and faces"
        raise InputError(name, f"is a {type(shape).__name__}", "a mesh is needed", hint, value=shape)
    surfaces = []
    for part, transform in parts:
        if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
            what = "cloud of points" if isinstance(part, trimesh.PointCloud) else "part without triangles"
            if len(parts) > 1:
                problem, rule = f"has a {what} ({type(part).__name__}) among its meshes", "it would be lost"
                raise GeometryError(name, problem, rule, "remove it, or pass the meshes alone", value=part)
            raise _without_triangles(name, f"{what} ({type(part).__name__})")
        points = finite(part.vertices, f"vertices of {name}")
        surfaces.append(placed((points, np.asarray(part.faces, dtype=np.int64)), transform))
    if not surfaces:
        raise _without_triangles(name, "")
    return joined(surfaces)


def _placed(scene: Any) -> list[tuple[Floats, str]]:
    """Transform and name of each part of a scene, once for each place where it stands."""
    return [scene.graph[node] for node in scene.graph.nodes_geometry]


def _without_triangles(name: str, what: str) -> GeometryError:
    if not what:
        return GeometryError(name, "is empty", "a mesh needs triangles", "check what was exported")
    hint = "for points use Workspace.from_points, or make a mesh of it first"
    return GeometryError(name, f"is a {what}", "a mesh needs triangles", hint)
