"""Triangle meshes from files and from trimesh objects.

A mesh is read with all of its triangles or refused. trimesh reads PLY, GLB and glTF, with
``process=False``, and a separate count of the file's triangles must agree with its result. This
package reads STL, OBJ and COLLADA itself. For STL the census is the reading. In OBJ files trimesh
moves triangles whose corners count backwards or are written in mixed forms, loses those on lines
with a leading blank, and cuts bent polygons into fans that leave the polygon. pycollada drops
unknown elements and warns on NumPy 2.5.

In glTF, trimesh skips triangle fans, fills sparse and compressed accessors with zeros, does not
scale quantised numbers, and ignores instances, skins and morphs and everything below a camera node.
This module refuses all of these by name, and counts the triangles and vertices of the rest.
"""

from __future__ import annotations

import io
import json
import logging
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np

from cspace.errors import GeometryError, InputError
from cspace.files.access import (
    ContentError,
    check_file,
    check_suffix,
    decoding,
    parse_numbers,
    read_bytes,
)
from cspace.files.plain import check_nesting, parse_xml
from cspace.files.polygons import (
    join_surfaces,
    read_obj,
    read_ply,
    surface_bytes,
    transform_surface,
    triangulate,
    unsupported_part,
)
from cspace.limits import check_bytes
from cspace.support.arrays import Floats, Ints, StrPath, Surface
from cspace.support.check import check_finite

_MESH_KIND: Final = "mesh"

_APPEARANCE_PREFIXES: Final = (
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp", "MSFT_texture_"),
)
"""Prefixes of the glTF extensions that do not change the shape."""

_MAX_NODE_LEVELS: Final = 256
"""Largest depth of nested scene nodes."""

_TRIANGLES_MODE: Final = 4
"""Mode of a glTF primitive that consists of triangles."""

_MODE_NAMES: Final = {5: "strips of triangles", 6: "fans of triangles"}
"""Names of further modes of a glTF primitive, for messages."""

_FLOAT_TYPE: Final = 5126
"""glTF component type of 32-bit floats."""

_ROW_BYTES: Final = {5121: 1, 5123: 2, 5125: 4, _FLOAT_TYPE: 12}
"""Bytes of an index, or of a position for floats, by glTF component type."""


def _read_gltf(file: Path) -> Surface:
    """Read the triangles of a glTF scene.

    Raises FileError if the file or a buffer is missing, truncated, malformed, or not read as
    declared. Raises GeometryError if it holds anything but triangles, or if its shape depends on an
    extension, a skin, a morph, or on quantised, sparse or compressed numbers.
    """
    import trimesh

    data = read_bytes(file, _MESH_KIND, memory=4.0)
    is_binary = file.suffix.lower() == ".glb"
    text = _glb_json(data) if is_binary else data
    check_bytes(file, len(text), "has a header of", 20.0, "max_text_bytes")
    header = _parse_gltf_header(text)
    meshes = [mesh["primitives"] for mesh in header.get("meshes", [])]
    triangles = [sum(_count_triangles(part, header) for part in mesh) for mesh in meshes]
    vertices = [sum(_count_vertices(part, header) for part in mesh) for mesh in meshes]
    instances = list(_instances(header))
    # A mesh may be placed several times, so the memory is checked before trimesh copies it.
    placed = [*range(len(meshes)), *instances]
    size = sum(surface_bytes(vertices[mesh], triangles[mesh]) for mesh in placed)
    check_bytes(file, size, "unfolds to", memory=3.0)
    declared = sum(triangles[mesh] for mesh in instances)
    if not declared:
        return join_surfaces([])
    scene = trimesh.load_scene(
        io.BytesIO(data),
        file_type="glb" if is_binary else "gltf",
        resolver=_FolderFiles(file),
        process=False,
        skip_materials=True,
    )
    counts = [_count_vertices(part, header) for mesh in meshes for part in mesh]
    found = [len(part.vertices) for part in scene.geometry.values()]
    surface = flatten_trimesh(scene, str(file))
    if counts != found or len(surface[1]) != declared:
        problem = f"holds {declared} triangles but {len(surface[1])} were read"
        rule, hint = "nothing may be lost or made up", "write it again as binary STL"
        raise ContentError(f"{problem}, in parts of {found!s:.60} vertices", rule, hint)
    return surface


def _count_vertices(primitive: dict[str, Any], header: dict[str, Any]) -> int:
    """Return the number of vertices of a glTF primitive."""
    return int(header["accessors"][primitive["attributes"]["POSITION"]]["count"])


def _count_triangles(primitive: dict[str, Any], header: dict[str, Any]) -> int:
    """Return the number of triangles of a glTF primitive.

    Raises GeometryError if trimesh would misread the primitive, and ContentError if it is
    malformed.
    """
    mode = primitive.get("mode", _TRIANGLES_MODE)
    if mode != _TRIANGLES_MODE:
        raise unsupported_part(
            f"a part of {_MODE_NAMES.get(mode, f'points or lines (mode {mode})')}"
        )
    _refuse_extensions(primitive)
    if "POSITION" not in primitive["attributes"]:
        raise unsupported_part("a part without positions of its own")
    corners = _check_accessor(primitive["attributes"]["POSITION"], "VEC3", header)
    if "indices" in primitive:
        corners = _check_accessor(primitive["indices"], "SCALAR", header)
    if corners < 3 or corners % 3:
        raise ContentError(f"has a part of {corners} corners, which is not a multiple of 3")
    return corners // 3


def _check_accessor(number: int, kind: str, header: dict[str, Any]) -> int:
    """Return the number of rows of a glTF accessor.

    ``kind`` is "VEC3" for positions or "SCALAR" for indices. Raises GeometryError if the accessor
    is sparse, compressed or quantised, and ContentError if it is malformed or exceeds its buffer.
    """
    accessor = _look_up(header, "accessors", number)
    if "sparse" in accessor:
        raise unsupported_part(f"a sparse accessor ({number})")
    if "bufferView" not in accessor:
        raise unsupported_part(f"an accessor ({number}) without data, as after compression")
    component = accessor["componentType"]
    if kind == "VEC3" and component != _FLOAT_TYPE:
        raise unsupported_part(f"quantised positions (accessor {number})")
    if (
        accessor["type"] != kind
        or component not in _ROW_BYTES
        or (kind == "SCALAR") == (component == _FLOAT_TYPE)
    ):
        raise ContentError(
            f"has accessor {number} of {accessor['type']} {component} instead of {kind}"
        )
    view = _look_up(header, "bufferViews", accessor["bufferView"])
    _refuse_extensions(view)
    # Offsets, strides and ends are in bytes: of the accessor in its view, and of the view in its
    # buffer.
    width, count, start = _ROW_BYTES[component], accessor["count"], accessor.get("byteOffset", 0)
    stride, view_start = view.get("byteStride", width), view.get("byteOffset", 0)
    end = start + (count - 1) * stride + width
    buffer = _look_up(header, "buffers", view["buffer"])
    if min(start, view_start) < 0 or count < 1 or stride < width or end > view["byteLength"]:
        raise ContentError("has an accessor that is empty or exceeds its view")
    if view_start + view["byteLength"] > buffer["byteLength"]:
        raise ContentError("has a view that exceeds its buffer")
    return int(count)


def _instances(header: dict[str, Any]) -> Iterator[int]:
    """Yield the mesh index of each mesh instance.

    Only instances in the scene count. Raises ContentError if the nodes are not trees. Raises
    GeometryError if a mesh is in no scene, below a camera, or moved by a skin or morph.
    """
    scenes, nodes = header.get("scenes", []), header.get("nodes", [])
    if not scenes and header.get("meshes"):
        raise unsupported_part("meshes in no scene", "export it again with its scene")
    if len(scenes) > 1 and "scene" not in header:
        raise unsupported_part(
            f"{len(scenes)} scenes of which none is the default", "export one scene"
        )
    seen: set[int] = set()
    roots = _look_up(header, "scenes", header.get("scene", 0)).get("nodes", []) if scenes else []
    pending = [(number, 1) for number in roots]
    while pending:
        number, level = pending.pop()
        if level > _MAX_NODE_LEVELS:
            raise ContentError(f"has more than {_MAX_NODE_LEVELS} nested nodes")
        if number in seen or not 0 <= number < len(nodes):
            raise ContentError(
                f"names node {number} twice, or it is missing; nodes must form trees"
            )
        seen.add(number)
        node = nodes[number]
        _refuse_extensions(node)
        pending += [(child, level + 1) for child in node.get("children", [])]
        if not any(np.asarray(node.get("rotation", [1.0]), dtype=np.float64)):
            raise ContentError("has a node with a rotation of length 0")
        if "camera" in node and ("mesh" in node or node.get("children")):
            raise unsupported_part("a mesh at or below a camera", "hang the camera below the mesh")
        if "mesh" in node:
            _refuse_moved_mesh(node, _look_up(header, "meshes", node["mesh"]))
            yield node["mesh"]


def _refuse_moved_mesh(node: dict[str, Any], mesh: dict[str, Any]) -> None:
    """Refuse a mesh that a skin or a morph moves."""
    if "skin" in node:
        raise unsupported_part(
            "a mesh that a skin moves", "apply its pose and export it without the skin"
        )
    if any(node.get("weights", mesh.get("weights", []))):
        raise unsupported_part("a mesh that a morph moves", "apply the morph before exporting")


def _refuse_extensions(element: dict[str, Any]) -> None:
    """Refuse a glTF element with an unknown extension.

    Raises GeometryError, except for extensions of the appearance alone.
    """
    foreign = [
        name for name in element.get("extensions", {}) if not name.startswith(_APPEARANCE_PREFIXES)
    ]
    if foreign:
        raise unsupported_part(f"a part with the extension {foreign[0]}")


def _look_up(header: dict[str, Any], kind: str, number: int) -> dict[str, Any]:
    """Return an element of a glTF header.

    ``kind`` is the name of its list, and ``number`` its index. Raises ContentError if the list is
    shorter.
    """
    items = header.get(kind, [])
    if not 0 <= number < len(items):
        raise ContentError(f"names number {number} of its {len(items)} {kind}")
    item: dict[str, Any] = items[number]
    return item


def _glb_json(data: bytes) -> bytes:
    """Return the JSON header of a GLB file.

    Raises ContentError if its chunks do not fill the file exactly.
    """
    if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
        raise ContentError("does not begin with a GLB header of version 2")
    length, position = int.from_bytes(data[8:12], "little"), 12
    if length != len(data):
        raise ContentError(f"has {len(data)} bytes but declares {length}")
    while position < length:
        position += 8 + int.from_bytes(data[position : position + 4], "little")
    if position != length or data[16:20] != b"JSON":
        raise ContentError("has a chunk that exceeds the file, or no header in JSON")
    return data[20 : 20 + int.from_bytes(data[12:16], "little")]


def _parse_gltf_header(data: bytes) -> dict[str, Any]:
    """Parse the JSON header of a glTF file.

    Raises ContentError if it is malformed or not of version 2.
    """
    try:
        text = data.decode("utf-8-sig")
        check_nesting(text, "[{", "]}")
        header = json.loads(text)
    except ValueError as error:
        raise ContentError(f"has a header that is not JSON ({error})") from error
    if not isinstance(header, dict):
        raise ContentError("has a header that is not a JSON object")
    version = str(header.get("asset", {}).get("version", ""))
    if not version.startswith("2."):
        raise ContentError(f"is of version {version or 'none'}; only glTF 2 is read")
    _refuse_extensions({"extensions": dict.fromkeys(header.get("extensionsRequired", []))})
    return header


class _FolderFiles(Mapping[str, bytes]):
    """Files that a glTF file names, by URI.

    They must lie within its folder. trimesh looks them up here.
    """

    def __init__(self, file: Path) -> None:
        self.file = file

    def __getitem__(self, uri: str) -> bytes:
        folder = self.file.parent
        other = folder / unquote(uri)
        if not other.resolve().is_relative_to(folder.resolve()):
            raise ContentError(f"has its data in {uri!r:.80}, outside its folder")
        return read_bytes(other, "buffer of glTF")

    def __iter__(self) -> Iterator[str]:
        return iter(())

    def __len__(self) -> int:
        return 0


Named = dict[str, Element | None]
"""Elements of a file by id; None if two elements share the id."""

_SHAPELESS_CHILDREN: Final = frozenset(
    ["asset", "extra", "evaluate_scene", "instance_camera", "instance_light"]
)
"""Tags of the children of a node that have no shape."""

_MAX_EXTRA_VISITS: Final = 100_000
"""Largest number of node visits beyond the number of elements; a few nested instances can unfold
without end."""

_SURFACELESS_CHILDREN: Final = frozenset(["source", "vertices", "extra", "lines", "linestrips"])
"""Tags of the children of a mesh that have no surface."""


def read_collada(file: Path) -> Surface:
    """Read the triangles of a COLLADA scene, in metres.

    Axes stay as they are; lines are skipped.

    Raises FileError if the file is truncated or malformed. Raises GeometryError if it has an
    unsupported surface or a polygon whose triangles are ambiguous.
    """
    root = parse_xml(read_bytes(file, "mesh", 20.0, "max_text_bytes"))
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != "COLLADA":
        raise ContentError(f"holds {root.tag}, not COLLADA")
    named: Named = {}
    for element in root.iter():
        if name := element.get("id"):
            named[name] = None if name in named else element
    unit = root.find("asset/unit")
    metres = float(unit.get("meter", "1")) if unit is not None else 1.0
    if not (math.isfinite(metres) and metres > 0.0):
        raise ContentError(f"has a unit of {metres:g} metres")
    instances = _place_geometries(root, named, metres)
    # A geometry may be placed several times, so the memory is checked before it is copied.
    arrays: dict[Element, Floats] = {}
    surfaces = {
        each: _read_surfaces(each, named, arrays)
        for each in dict.fromkeys(each for each, _ in instances)
    }
    sizes = {
        each: sum(surface_bytes(len(points), len(faces)) for points, faces in surfaces[each])
        for each in surfaces
    }
    check_bytes(file, sum(sizes[each] for each, _ in instances), "unfolds to", memory=3.0)
    return join_surfaces(
        [transform_surface(surface, pose) for each, pose in instances for surface in surfaces[each]]
    )


def _place_geometries(root: Element, named: Named, metres: float) -> list[tuple[Element, Floats]]:
    """List the placed geometries of a COLLADA scene.

    Each has its transform, shape (4, 4), which contains the scale to ``metres`` per unit. Raises
    ContentError if nodes are nested without end, and GeometryError if the scene has an unsupported
    element.
    """
    instance = root.find("scene/instance_visual_scene")
    if instance is None:
        raise unsupported_part("geometries in no scene", "export it again with its scene")
    scene = _resolve_instance(instance, named)
    if scene.tag != "visual_scene":
        raise ContentError(f"names {scene.tag} as its scene")
    instances: list[tuple[Element, Floats]] = []
    visits, max_visits = 0, _MAX_EXTRA_VISITS + sum(1 for _ in root.iter())
    # Elements to visit, depth first, with the transform and the nodes above them.
    pending: list[tuple[Element, Floats, tuple[Element, ...]]] = [
        (child, np.diag([metres, metres, metres, 1.0]), ()) for child in reversed(list(scene))
    ]
    while pending:
        element, above, path = pending.pop()
        visits += 1
        if visits > max_visits or len(path) > _MAX_NODE_LEVELS:
            raise ContentError(f"nests nodes {len(path)} deep, and {visits} in all or more")
        if element.tag in _SHAPELESS_CHILDREN:
            continue
        if element.tag == "instance_node":
            element = _resolve_instance(element, named)
        if element.tag == "node":
            if element in path:
                raise ContentError(f"has the node {element.get('id')!r} within itself")
            transform, children = _local_transform(element)
            pending += [
                (child, above @ transform, (*path, element)) for child in reversed(children)
            ]
        elif element.tag == "instance_geometry":
            instances.append((_resolve_instance(element, named), above))
        else:
            raise unsupported_part(f"a {element.tag} in its scene")
    return instances


def _resolve_instance(instance: Element, named: Named) -> Element:
    """Return the element that an instance refers to.

    Raises GeometryError if it is in another file, and ContentError if it is missing.
    """
    url = instance.get("url", "")
    if not url.startswith("#"):
        raise unsupported_part(
            f"a {instance.tag} of another file ({url!r})", "export it again as one file"
        )
    target = named.get(url[1:])
    if target is None:
        raise ContentError(f"names {url!r}, which is missing or repeated")
    return target


def _local_transform(node: Element) -> tuple[Floats, list[Element]]:
    """Return the transform and the children of a node.

    ``node`` is of COLLADA. Its children are returned without the elements of its transform, which
    has shape (4, 4), from the node to its parent.
    """
    transform, children = np.eye(4), []
    for child in node:
        if child.tag in ("lookat", "skew"):
            raise unsupported_part(
                f"a node with the transform {child.tag}", "export it again with matrices"
            )
        if child.tag not in _TRANSFORMS:
            children.append(child)
            continue
        size, matrix = _TRANSFORMS[child.tag]
        numbers = np.array((child.text or "").split(), dtype=np.float64)
        if len(numbers) != size:
            raise ContentError(f"has a {child.tag} of {len(numbers)} numbers; it has {size}")
        transform = transform @ matrix(numbers)
    return transform, children


def _translation(offset: Floats) -> Floats:
    """Return the matrix of a translation, shape (4, 4).

    `offset` has shape (3,).
    """
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def _rotation(values: Floats) -> Floats:
    """Return the matrix of a rotation, shape (4, 4).

    `values`, shape (4,), are the axis and the angle in degrees (Rodrigues, 1840).
    """
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
"""Number of values of each transform of a COLLADA node, and the function that makes its matrix."""


def _read_surfaces(geometry: Element, named: Named, arrays: dict[Element, Floats]) -> list[Surface]:
    """Read the primitives of a COLLADA geometry as surfaces.

    ``arrays`` caches the parsed arrays.
    """
    surfaces = []
    for element in geometry:
        if element.tag in ("asset", "extra"):
            continue
        if element.tag != "mesh":
            raise unsupported_part(f"a geometry that is a {element.tag}")
        surfaces += [
            _read_primitive(part, named, arrays)
            for part in element
            if part.tag not in _SURFACELESS_CHILDREN
        ]
    return surfaces


def _read_primitive(part: Element, named: Named, arrays: dict[Element, Floats]) -> Surface:
    """Read the triangles of a COLLADA primitive.

    Raises GeometryError for an unsupported kind of primitive, and ContentError if counts disagree.
    """
    lists = [_read_corners(indices, part) for indices in part.findall("p")]
    corners = np.concatenate([np.empty(0, dtype=np.int64), *lists])
    count = int(part.get("count", "0"))
    points = _read_positions(part, named, arrays) if count else np.empty((0, 3))
    if part.find("ph") is not None:
        raise unsupported_part("a polygon with holes")
    if part.tag == "triangles":
        if len(corners) != 3 * count:
            raise ContentError(f"declares {count} triangles but holds {len(corners)} corners")
        sizes = np.full(count, 3)
    elif part.tag == "polylist":
        counts = part.find("vcount")
        sizes = _parse_integers(counts) if counts is not None else np.empty(0, dtype=np.int64)
    elif part.tag == "polygons":
        sizes = np.array(list(map(len, lists)), dtype=np.int64)
    else:
        raise unsupported_part(f"a mesh with {part.tag}")
    if len(sizes) != count:
        raise ContentError(f"declares {count} {part.tag} but holds {len(sizes)}")
    return points, triangulate(points, corners, sizes)


def _find_inputs(element: Element, semantic: str) -> list[Element]:
    """List the inputs of a COLLADA element by meaning.

    ``semantic`` is the meaning, e.g. "VERTEX".
    """
    return [each for each in element.findall("input") if each.get("semantic") == semantic]


def _read_corners(indices: Element, part: Element) -> Ints:
    """Return vertex indices of a COLLADA primitive.

    The result has shape (n,). Each corner has an index for every input of the primitive; the offset
    of the input VERTEX selects one of them.
    """
    stride = 1 + max((int(each.get("offset", "0")) for each in part.findall("input")), default=0)
    inputs = _find_inputs(part, "VERTEX")
    numbers = _parse_integers(indices)
    if len(inputs) != 1 or len(numbers) % stride:
        raise ContentError(
            f"has {part.tag} with {len(inputs)} inputs VERTEX and {len(numbers)} numbers, "
            f"{stride} each"
        )
    return numbers[int(inputs[0].get("offset", "0")) :: stride]


def _read_positions(part: Element, named: Named, arrays: dict[Element, Floats]) -> Floats:
    """Return the vertex positions of a COLLADA primitive.

    The result has shape (n, 3), in units of the file. `arrays` caches the parsed arrays.
    """
    vertices = [_resolve_source(given, named) for given in _find_inputs(part, "VERTEX")]
    sources = [
        _resolve_source(given, named)
        for element in vertices
        for given in _find_inputs(element, "POSITION")
    ]
    if len(sources) != 1:
        raise ContentError(
            f"has {part.tag} with {len(sources)} sources of positions instead of one"
        )
    accessor = sources[0].find("technique_common/accessor")
    if accessor is None:
        raise ContentError("has a source of positions without an accessor")
    array = _resolve_source(accessor, named)
    if array.tag not in ("float_array", "int_array"):
        raise ContentError(f"has positions in {array.tag}")
    values = arrays.get(array)
    if values is None:
        values = arrays[array] = np.array((array.text or "").split(), dtype=np.float64)
    count, stride = int(accessor.get("count", "0")), int(accessor.get("stride", "1"))
    first = int(accessor.get("offset", "0"))
    columns = [i for i, param in enumerate(accessor.findall("param")) if param.get("name")]
    names = [param.get("name") for param in accessor.findall("param") if param.get("name")]
    if names != ["X", "Y", "Z"] or columns[-1] >= stride or first < 0 or count < 0:
        raise ContentError(f"has positions with the columns {names} instead of X, Y, Z")
    if len(values) != int(array.get("count", len(values))) or len(values) < first + count * stride:
        raise ContentError(f"has {len(values)} numbers of positions but declares another count")
    return values[first : first + count * stride].reshape(count, stride)[:, columns]


def _resolve_source(given: Element, named: Named) -> Element:
    """Return the element that an input refers to.

    Raises ContentError if it is missing or repeated.
    """
    name = given.get("source", "")
    source = named.get(name[1:]) if name.startswith("#") else None
    if source is None:
        raise ContentError(f"names the source {name!r}, which is missing or repeated")
    return source


def _parse_integers(element: Element) -> Ints:
    """Parse the text of an element as integers.

    The result has shape (n,).
    """
    try:
        return np.array((element.text or "").split(), dtype=np.int64)
    except ValueError as error:
        raise ContentError(
            f"has a {element.tag} that holds more than whole numbers ({error})"
        ) from error


# Silence trimesh's log of a bad file, because the error that is raised gives the reason.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

_STL_RECORD: Final = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
"""Layout of a triangle in a binary STL file; the records follow a header of 84 bytes."""

_FACET: Final = re.compile(
    rb"\bfacet normal \S+ \S+ \S+ outer loop"
    + 3 * rb" vertex (\S+) (\S+) (\S+)"
    + rb" endloop endfacet\b"
)
"""A facet of a text STL file, in lower case, with single blanks."""

_SOLIDS: Final = re.compile(rb"^[ \t]*(end)?solid\b[^\n]*", re.MULTILINE)
"""A line of a text STL file that begins or ends a solid."""


def read_mesh(path: StrPath) -> tuple[Floats, Ints]:
    """Read the vertices and triangles of a mesh file.

    The suffix selects the format. Parts of a scene are transformed and joined. Coordinates of
    ``.glb`` and ``.gltf`` are metres by definition, coordinates of ``.dae`` are converted from the
    file's unit, and other formats are assumed to be in metres. Axes stay as they are, whichever
    axis the file calls up.

    Nothing is repaired, merged or dropped: a file with an unsupported part is refused with
    GeometryError. A polygon of four or more corners is refused too if its triangles are ambiguous:
    its corners are out of plane by more than rounding, or no fan around one of them covers it.
    Lines and points are skipped in ``.obj``, ``.ply`` and ``.dae``, where they are common, and
    refused in ``.glb`` and ``.gltf``. Truncation of an ``.obj`` between two lines, or within its
    last number, cannot be detected.

    Returns
    -------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        Vertex indices.
    """
    file = check_file(path, _MESH_KIND)
    suffix = check_suffix(file, _READERS, "the suffix selects the format", "mesh")
    with decoding(file, _MESH_KIND):
        vertices, faces = _READERS[suffix](file)
        if not len(faces):
            raise _without_triangles(str(file), "cloud of points" if len(vertices) else "")
        check_finite(vertices, f"vertices of {file}")
        wrong = faces[(faces < 0) | (faces >= len(vertices))]
        if len(wrong):
            raise ContentError(
                f"has a face that names vertex {wrong[0]}, counted from 0, of {len(vertices)}"
            )
    return vertices, np.ascontiguousarray(faces)


def _read_stl(file: Path) -> Surface:
    """Read the triangles of an STL file.

    It may be binary or text. Triangles share no vertices.
    """
    data = read_bytes(file, _MESH_KIND, memory=12.0)
    declared = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + _STL_RECORD.itemsize * declared and len(data) >= 84:
        vertices = (
            np.frombuffer(data, _STL_RECORD, declared, 84)["corners"]
            .reshape(-1, 3)
            .astype(np.float64)
        )
    elif data.lstrip()[:5].lower() == b"solid":
        vertices = _parse_stl_text(data)
    else:
        held = max(0.0, (len(data) - 84) / _STL_RECORD.itemsize)
        raise ContentError(
            f"declares {declared} triangles but has bytes for {held:g}, as a binary STL file"
        )
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)


def _parse_stl_text(data: bytes) -> Floats:
    """Parse the corners of a text STL file.

    Returns shape (3 F, 3). Raises ContentError if anything but whole facets is found.
    """
    text = data.lower().replace(b"\r", b"\n")
    lines = list(_SOLIDS.finditer(text))
    kinds = [bool(line[1]) for line in lines]
    if (
        not kinds
        or kinds != [False, True] * (len(kinds) // 2)
        or text[lines[-1].end() :].strip(b" \t\n\0")
    ):
        raise ContentError("does not go from solid to endsolid, as a text STL file must")
    if b"\0" in text[: lines[-1].end()]:  # a NUL would end a number
        raise ContentError("is not text")
    if any(b"endfacet" in line[0] for line in lines):
        raise ContentError(
            "has facets on a line of solid or endsolid; they need lines of their own"
        )
    # Single blanks, because patterns that skip blanks take quadratic time on long runs of them.
    text = b" ".join(_SOLIDS.sub(b"", text).split())
    facets = _FACET.findall(text)
    counts = [text.count(word) for word in (b"facet", b"normal", b"vertex")]
    if counts != [2 * len(facets), len(facets), 3 * len(facets)]:
        raise ContentError(f"has stray words of facets besides its {len(facets)} whole ones")
    return parse_numbers([word for facet in facets for word in facet], float).reshape(-1, 3)


def _read_ply(file: Path) -> Surface:
    """Read the polygons of a PLY file as triangles."""
    vertices, corners, sizes = read_ply(file)
    return vertices, triangulate(vertices, corners, sizes)


_READERS: Final[dict[str, Callable[[Path], Surface]]] = {
    ".stl": _read_stl,
    ".obj": read_obj,
    ".ply": _read_ply,
    ".glb": _read_gltf,
    ".gltf": _read_gltf,
    ".dae": read_collada,
}
"""Function that reads a file, by suffix."""

MESH_SUFFIXES: Final = tuple(_READERS)
"""Suffixes of the files that :func:`read_mesh` reads."""


def flatten_trimesh(shape: Any, name: str) -> tuple[Floats, Ints]:
    """Join the meshes of a trimesh object.

    Returns vertices, shape (V, 3), and faces, shape (F, 3). `name` is the argument that messages
    name.

    Raises InputError if it is of another type or a coordinate is not finite. Raises GeometryError
    if it has no triangles, or anything but triangles.
    """
    import trimesh

    if isinstance(shape, trimesh.Scene):
        placed = map(shape.graph.get, shape.graph.nodes_geometry)
        parts = [(shape.geometry[part], transform) for transform, part in placed]
    elif isinstance(shape, trimesh.parent.Geometry):
        parts = [(shape, np.eye(4))]
    else:
        hint = "pass a file name, a trimesh.Trimesh, a trimesh.Scene, or vertices and faces"
        raise InputError(
            name, f"is a {type(shape).__name__}", "a mesh is needed", hint, value=shape
        )
    surfaces = []
    for part, transform in parts:
        if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
            content = (
                "cloud of points"
                if isinstance(part, trimesh.PointCloud)
                else "part without triangles"
            )
            if len(parts) > 1:
                problem = f"has a {content} ({type(part).__name__}) among its meshes"
                raise GeometryError(
                    name,
                    problem,
                    "it would be lost",
                    "remove it, or pass the meshes alone",
                    value=part,
                )
            raise _without_triangles(name, f"{content} ({type(part).__name__})")
        points = check_finite(part.vertices, f"vertices of {name}")
        surfaces.append(
            transform_surface((points, np.asarray(part.faces, dtype=np.int64)), transform)
        )
    if not surfaces:
        raise _without_triangles(name, "")
    return join_surfaces(surfaces)


def _without_triangles(name: str, content: str) -> GeometryError:
    """Return the error for a mesh without triangles.

    ``content`` names the other content, or is empty.
    """
    if not content:
        return GeometryError(name, "is empty", "a mesh needs triangles", "check what was exported")
    hint = "use Workspace.from_points for points, or make a mesh of it first"
    return GeometryError(name, f"is a {content}", "a mesh needs triangles", hint)
