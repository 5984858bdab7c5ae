"""Triangle meshes from files and from trimesh objects.

A mesh is read with all of its triangles or refused. trimesh reads binary PLY, and this package
reads the rest itself. In OBJ files trimesh moves triangles whose corners count backwards or are
written in mixed forms, loses those on lines with a leading blank, and cuts bent polygons into fans
that leave the polygon. pycollada drops lines, controllers, skews and geometries of other files.

In glTF, trimesh skips triangle fans, fills sparse and compressed accessors with zeros, does not
scale quantised numbers, and ignores instances, skins and morphs and everything below a camera node.
This module refuses by name what it does not read.
"""

from __future__ import annotations

import base64
import itertools
import json
import logging
import math
import os
import re
import struct
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Literal, NamedTuple, TypeAlias
from urllib.parse import unquote
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._files.access import (
    ContentError,
    check_suffix,
    decoding,
    parse_numbers,
    read_bytes,
)
from cspace._files.fields import Fields
from cspace._files.plain import check_nesting, parse_xml
from cspace._files.polygons import (
    cover_lines,
    join_surfaces,
    read_obj,
    read_ply,
    surface_bytes,
    transform_surface,
    triangulate,
    unsupported_part,
)
from cspace._files.unit_notes import warn_of_notes, warn_of_units
from cspace._support.arrays import Floats, Ints, StrPath, Surface
from cspace._support.check import check_finite, check_word
from cspace._support.kinds import make_kind_error, suggest_call
from cspace._support.limits import check_bytes
from cspace._support.reporting import warn_user
from cspace._support.units import METRES
from cspace.errors import GeometryError

Json = dict[str, Any]
"""An object of a glTF header."""

Up: TypeAlias = Literal["x", "y", "z"]
"""Axis of a mesh that points up."""

UPRIGHT: Final[Mapping[Up, Floats]] = {
    "x": np.array([(0.0, -1.0, 0.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0)]),
    "y": np.array([(1.0, 0.0, 0.0), (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)]),
    "z": np.eye(3),
}
"""Rotation that makes an axis point along z, shape (3, 3), by the axis; as in COLLADA and glTF."""

_MESH_KIND: Final = "mesh"

GLTF_SUFFIXES: Final = (".glb", ".gltf")
"""Suffixes of glTF files, in which y points up."""

_APPEARANCE_PREFIXES: Final = (
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_xmp",
    "MSFT_texture_",
)
"""Prefixes of the glTF extensions that do not change the shape."""

FIELDS: Final = (
    Fields(
        "`.glb`, `.gltf`",
        honoured="metres; `scene`; `matrix`, `translation`, `rotation`, `scale` of nodes",
        refused=(
            "skins and morphs; sparse, quantised or compressed numbers; extensions except of the "
            "appearance; parts without triangles"
        ),
        warned="y is up (`up=`; in a URDF it becomes z); animations",
    ),
    Fields(
        "`.dae`",
        honoured="`unit meter`; `matrix`, `translate`, `rotate`, `scale`; instances; lines",
        refused="parts of another unit; `lookat`, `skew`; controllers",
        warned="`up_axis` (`up=`); by default Y_UP; animations",
    ),
    Fields(
        "`.stl`",
        honoured="text or binary",
        warned="a unit in the header",
    ),
    Fields(
        "`.obj`",
        honoured="negative indices; lines and points beside faces",
        refused="weights; surfaces of curves; other files",
        warned="a unit, a shift or an upright axis in a comment",
    ),
    Fields(
        "`.ply`",
        honoured="`format`; types and order of properties",
        refused="edges; lists of other elements than `face`",
        warned="a unit, a shift or an upright axis in a comment",
    ),
)

_TRIANGLES_MODE: Final = 4
"""Mode of a glTF primitive that consists of triangles."""

_MODE_NAMES: Final = {5: "strips of triangles", 6: "fans of triangles"}
"""Names of further modes of a glTF primitive, for messages."""

_ROW_TYPES: Final[dict[str, dict[int, Any]]] = {
    "VEC3": {5126: ("<f4", 3)},
    "SCALAR": {5121: "<u1", 5123: "<u2", 5125: "<u4"},
}
"""Data type of a row of a glTF accessor, by its type and component type."""


def _read_gltf(file: Path) -> tuple[Surface, Up]:
    """Read the triangles of a glTF scene, whose y points up.

    Raises FileError if the file or a buffer is missing, truncated or malformed. Raises
    GeometryError if it holds anything but triangles, or if its shape depends on an extension, a
    skin, a morph, or on quantised, sparse or compressed numbers.
    """
    text = read_bytes(file, _MESH_KIND, memory=4.0)
    embedded = b""
    if file.suffix.lower() == ".glb":
        text, embedded = _split_glb(text)
    check_bytes(file, len(text), "has a header of", 20.0, "max_text_bytes")
    header = _parse_gltf_header(text)
    _warn_of_animations(file, header.get("animations", []))
    for buffer in header.get("buffers", []):
        buffer["content"] = _read_buffer(buffer, embedded, file)
    # For each mesh, the points and corners of its primitives, as views of the buffers.
    primitives = [
        [_read_gltf_part(primitive, header) for primitive in mesh["primitives"]]
        for mesh in map(_refuse_extensions, header.get("meshes", []))
    ]
    placed = list(_place_gltf_meshes(header))
    # Primitives may share arrays.
    parts = itertools.chain.from_iterable(primitives[mesh] for mesh, _ in placed)
    _check_copies(file, [(len(points), len(corners) // 3) for points, corners in parts])
    surfaces = {
        mesh: [_make_gltf_surface(points, corners) for points, corners in primitives[mesh]]
        for mesh, _ in placed
    }
    return _join_placed(surfaces, placed), "y"


def _check_copies(file: Path, sizes: Iterable[tuple[int, int]]) -> None:
    """Check the memory of placed copies, of points and faces each, before they are made."""
    unfolded_bytes = sum(itertools.starmap(surface_bytes, sizes))
    check_bytes(file, unfolded_bytes, "unfolds to", memory=3.0)


def _warn_of_animations(file: Path, animations: Collection[Any]) -> None:
    """Warn that parts which move are read at rest."""
    if animations:
        warn_user(
            f"{file}: it has {len(animations)} animations, which are not read; no part is where "
            "they move it, only at rest"
        )


def _join_placed(
    surfaces: Mapping[Any, list[Surface]], placed: Iterable[tuple[Any, Floats]]
) -> Surface:
    """Join copies of meshes, each with its transform.

    `surfaces` are the parts of each mesh; `placed` has the mesh and the transform of each copy.
    """
    copies: list[Surface] = []
    for mesh, pose in placed:
        if (pose[3] != (0.0, 0.0, 0.0, 1.0)).any():
            problem = f"has a matrix with the last row {pose[3].tolist()}"
            raise ContentError(problem, "it must be 0, 0, 0, 1")
        copies += [transform_surface(surface, pose) for surface in surfaces[mesh]]
    return join_surfaces(copies)


def _make_gltf_surface(points: Floats, corners: Ints | range) -> Surface:
    """Make a surface of triangles from successive corners."""
    vertices = points.astype(np.float64)
    sizes = np.full(len(corners) // 3, 3)
    return vertices, triangulate(vertices, np.asarray(corners, dtype=np.int64), sizes)


def _read_gltf_part(part: Json, header: Json) -> tuple[Floats, Ints | range]:
    """Return points (V, 3) and corners (3 F,) of a glTF primitive.

    Raises GeometryError if it holds anything but triangles.
    """
    mode = part.get("mode", _TRIANGLES_MODE)
    if mode != _TRIANGLES_MODE:
        kind = _MODE_NAMES.get(mode, f"points or lines (mode {mode})")
        raise unsupported_part(f"a part of {kind}")
    _refuse_extensions(part)
    if "POSITION" not in part["attributes"]:
        raise unsupported_part("a part without positions of its own")
    points = _read_accessor(part["attributes"]["POSITION"], "VEC3", header)
    if "indices" in part:
        return points, _read_accessor(part["indices"], "SCALAR", header)
    return points, range(len(points))


def _read_accessor(number: int, kind: str, header: Json) -> NDArray[Any]:
    """Return a glTF accessor's rows, as a view.

    ``kind`` is "VEC3" for positions or "SCALAR" for indices. Raises GeometryError if the accessor
    is sparse, compressed or quantised, and ContentError if it is malformed or exceeds its buffer.
    """
    accessor = _refuse_extensions(_look_up(header, "accessors", number))
    if "sparse" in accessor:
        raise unsupported_part(f"a sparse accessor ({number})")
    if "bufferView" not in accessor:
        raise unsupported_part(f"an accessor ({number}) without data, as after compression")
    if accessor["type"] != kind:
        raise ContentError(f"has accessor {number} of {accessor['type']} instead of {kind}")
    component = accessor["componentType"]
    if component not in _ROW_TYPES[kind]:
        raise unsupported_part(f"quantised {kind} of type {component} (accessor {number})")
    record = np.dtype([("row", _ROW_TYPES[kind][component])])
    view = _look_up(header, "bufferViews", accessor["bufferView"])
    _refuse_extensions(view)
    content = _slice_buffer(view, header)
    count = accessor["count"]
    # The offset and the stride of rows are in bytes.
    start = accessor.get("byteOffset", 0)
    stride = view.get("byteStride", record.itemsize)
    end = start + (count - 1) * stride + record.itemsize
    if start < 0 or count < 1 or stride < record.itemsize or end > len(content):
        raise ContentError("has an accessor that is empty or exceeds its view")
    return np.ndarray(count, record, content, start, stride)["row"]


def _slice_buffer(view: Json, header: Json) -> memoryview:
    """Return the bytes of a glTF buffer view, without a copy."""
    start = view.get("byteOffset", 0)
    end = start + view["byteLength"]
    if min(start, end) < 0:
        raise ContentError("has a view that exceeds its buffer")
    buffer = _look_up(header, "buffers", view["buffer"])
    return memoryview(buffer["content"])[start:end]


def _read_buffer(buffer: Json, embedded: bytes, file: Path) -> bytes:
    """Return the content of a glTF buffer.

    ``embedded`` is the binary chunk of the file. Other files must lie within its folder.
    """
    # The bytes are in the file itself, in the text of the header, or in a file of their own.
    uri = buffer.get("uri")
    if uri is None:
        content = embedded
    elif uri.startswith("data:"):
        content = base64.b64decode(uri.partition(",")[2], validate=True)
    else:
        buffer_file = file.parent / unquote(uri)
        if not buffer_file.resolve().is_relative_to(file.parent.resolve()):
            problem = f"has its data in {uri!r:.80}, outside its folder"
            raise ContentError(problem, "such files are not read")
        content = read_bytes(buffer_file, "buffer of glTF")
    if len(content) < buffer["byteLength"]:
        raise ContentError(f"has a buffer of {len(content)} bytes, fewer than it declares")
    return content


def _place_gltf_meshes(header: Json) -> Iterator[tuple[int, Floats]]:
    """Yield each mesh's index and transform (4, 4).

    Raises ContentError if the nodes are not trees. Raises GeometryError if a mesh is in no scene,
    or moved by a skin or a morph.
    """
    scenes = header.get("scenes", [])
    nodes = header.get("nodes", [])
    if not scenes and header.get("meshes"):
        raise unsupported_part("meshes in no scene")
    if len(scenes) > 1 and "scene" not in header:
        raise unsupported_part(f"{len(scenes)} scenes of which none is the default")
    if not scenes:
        return
    scene = _refuse_extensions(_look_up(header, "scenes", header.get("scene", 0)))
    # Nodes to visit, each with the transform of the node above it.
    pending = [(number, np.eye(4)) for number in scene.get("nodes", [])]
    seen: set[int] = set()
    while pending:
        number, parent_pose = pending.pop()
        if number in seen or not 0 <= number < len(nodes):
            raise ContentError(f"names node {number} twice, or it is missing; nodes form trees")
        seen.add(number)
        node = nodes[number]
        _refuse_extensions(node)
        pose = parent_pose @ _parse_gltf_transform(node)
        pending += [(child, pose) for child in node.get("children", [])]
        if "mesh" in node:
            _refuse_moved_mesh(node, _look_up(header, "meshes", node["mesh"]))
            yield node["mesh"], pose


def _parse_gltf_transform(node: Json) -> Floats:
    """Return a glTF node's transform to its parent, shape (4, 4)."""
    from scipy.spatial.transform import Rotation

    if "matrix" in node:  # its numbers go column by column
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    scale = np.array(node.get("scale", [1.0, 1.0, 1.0]), dtype=np.float64)
    rotation = Rotation.from_quat(node.get("rotation", [0.0, 0.0, 0.0, 1.0])).as_matrix()
    offset = node.get("translation", [0.0, 0.0, 0.0])
    # A node is scaled along its own axes, then rotated, then moved.
    return _make_affine(rotation * scale, offset)


def _make_affine(linear: Floats, offset: ArrayLike = 0.0) -> Floats:
    """Make an affine transform's matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = linear  # shape (3, 3)
    matrix[:3, 3] = offset  # shape (3,)
    return matrix


def _refuse_moved_mesh(node: Json, mesh: Json) -> None:
    """Refuse a mesh moved by a skin or morph."""
    if "skin" in node:
        raise unsupported_part("a mesh that a skin moves")
    weights = node.get("weights") or mesh.get("weights") or []
    if any(weights):
        raise unsupported_part("a mesh that a morph moves")


def _refuse_extensions(element: Json) -> Json:
    """Return a glTF element; refuse one with unknown extensions.

    Raises GeometryError, except for extensions of the appearance alone.
    """
    for name in element.get("extensions", {}):
        if not name.startswith(_APPEARANCE_PREFIXES):
            raise unsupported_part(f"a part with the extension {name}")
    return element


def _look_up(header: Json, kind: str, number: int) -> Json:
    """Return an element of a glTF header.

    ``kind`` is the name of its list, and ``number`` its index. Raises ContentError if the list is
    shorter.
    """
    items: list[Json] = header.get(kind, [])
    if not 0 <= number < len(items):
        raise ContentError(f"names number {number} of its {len(items)} {kind}")
    return items[number]


def _split_glb(data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON header and the binary chunk of a GLB file.

    Raises ContentError if its chunks do not fill the file exactly.
    """
    # A header of 12 bytes, then chunks, each with its size and kind in 8 bytes before it.
    magic, version, length = struct.unpack_from("<4sII", data)
    if magic != b"glTF" or version != 2:
        raise ContentError("does not begin with a GLB header of version 2")
    chunks: dict[bytes, bytes] = {}
    position = 12
    while position < len(data):
        size, kind = struct.unpack_from("<I4s", data, position)
        start = position + 8
        position = start + size
        chunks.setdefault(kind, data[start:position])
    if not position == length == len(data):
        raise ContentError(f"has {len(data)} bytes but declares {length}, and chunks to {position}")
    return chunks[b"JSON"], chunks.get(b"BIN\0", b"")


def _parse_gltf_header(data: bytes) -> Json:
    """Parse the JSON header of a glTF file.

    Raises ContentError if it is malformed or not of version 2.
    """
    text = data.decode("utf-8-sig")
    check_nesting(text, "[{", "]}")
    header: Json = json.loads(text)
    version = str(header["asset"]["version"])
    if not version.startswith("2."):
        problem = f"is of version {version}"
        raise ContentError(problem, "only glTF 2 is read")
    required = dict.fromkeys(header.get("extensionsRequired", []))
    _refuse_extensions({"extensions": required})
    return _refuse_extensions(header)


_SHAPELESS_CHILDREN: Final = frozenset(
    ["asset", "extra", "evaluate_scene", "instance_camera", "instance_light"]
)
"""Tags of the children of a node that have no shape."""

_DATA_CHILDREN: Final = frozenset(["source", "vertices", "extra"])
"""Tags of the children of a mesh that have no shape."""


class _Collada(NamedTuple):
    """Elements of a COLLADA file.

    Attributes
    ----------
    root : Element
        Its tags have no namespace.
    named : dict of str to Element or None
        Elements by id; None if two elements share the id.
    arrays : dict of Element to ndarray
        Arrays that are parsed already.
    """

    root: Element
    named: dict[str, Element | None]
    arrays: dict[Element, Floats]

    def resolve(self, reference: Element, attribute: str = "source") -> Element:
        """Return the element that an element's attribute names.

        Raises GeometryError if it is in another file, and ContentError if it is missing or
        repeated.
        """
        url = reference.get(attribute, "")
        if not url.startswith("#"):
            raise unsupported_part(f"a {reference.tag} of another file ({url!r})")
        target = self.named.get(url[1:])
        if target is None:
            raise ContentError(f"names {url!r}, which is missing or repeated")
        return target


def _read_collada(file: Path) -> tuple[Surface, Up]:
    """Read a COLLADA scene, metres, and the axis up.

    Axes stay as they are; lines are skipped.

    Raises FileError if the file is truncated or malformed. Raises GeometryError if it has an
    unsupported surface or a polygon whose triangles are ambiguous.
    """
    collada = _parse_collada(read_bytes(file, _MESH_KIND, 20.0, "max_text_bytes"))
    _warn_of_animations(file, collada.root.findall("library_animations//channel"))
    placed = list(_place_geometries(collada))
    surfaces = {geometry: _read_surfaces(geometry, collada) for geometry, _ in placed}
    parts = itertools.chain.from_iterable(surfaces[geometry] for geometry, _ in placed)
    _check_copies(file, [(len(points), len(faces)) for points, faces in parts])
    axis = _read_asset(collada.root, "up_axis", lambda element: element.text) or "Y_UP"
    if axis not in _UP_BY_NAME:
        raise ContentError(f"has the up_axis {axis!r}", f"there are {', '.join(_UP_BY_NAME)}")
    return _join_placed(surfaces, placed), _UP_BY_NAME[axis]


_UP_BY_NAME: Final[Mapping[str, Up]] = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}
"""Axis by its name in COLLADA."""


def _parse_collada(data: bytes) -> _Collada:
    """Parse a COLLADA file; list elements by id."""
    root = parse_xml(data)
    named: dict[str, Element | None] = {}
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
        name = element.get("id")
        if name:
            named[name] = None if name in named else element
    if root.tag != "COLLADA":
        rule = "a .dae file has COLLADA as its root"
        raise ContentError(f"holds {root.tag:.60}", rule)
    return _Collada(root, named, {})


class _PendingElement(NamedTuple):
    """An element of a COLLADA scene to visit, and the transform and nodes above it."""

    element: Element
    parent_pose: Floats
    nodes_above: tuple[Element, ...]


def _place_geometries(collada: _Collada) -> Iterator[tuple[Element, Floats]]:
    """Yield each COLLADA geometry and its transform (4, 4) to metres.

    Raises ContentError if nodes are nested without end, and GeometryError if the scene has an
    unsupported element.
    """
    metres_per_unit = _read_unit(collada.root)
    to_metres = _make_affine(metres_per_unit * np.eye(3))
    visits = 0
    # Largest number of node visits beyond the number of elements; a few nested instances can unfold
    # without end.
    max_visits = 100_000 + sum(1 for _ in collada.root.iter())
    # The last pending element is the next one, so children are appended in reverse.
    children = reversed(_find_scene(collada))
    pending = [_PendingElement(child, to_metres, ()) for child in children]
    while pending:
        element, parent_pose, nodes_above = pending.pop()
        visits += 1
        # Largest depth of nested nodes of COLLADA.
        if visits > max_visits or len(nodes_above) > 256:
            raise ContentError(f"nests nodes {len(nodes_above)} deep, and {visits} in all or more")
        if element.tag in _SHAPELESS_CHILDREN:
            continue
        if element.tag == "instance_node":
            element = collada.resolve(element, "url")
        if element.tag == "instance_geometry":
            yield collada.resolve(element, "url"), parent_pose
        elif element.tag != "node":
            raise unsupported_part(f"a {element.tag} in its scene")
        elif element in nodes_above:
            raise ContentError(f"has the node {element.get('id')!r} within itself")
        else:
            pose = parent_pose @ _parse_collada_transform(element)
            nodes = (*nodes_above, element)
            inner = (child for child in reversed(element) if child.tag not in _TRANSFORMS)
            pending += [_PendingElement(child, pose, nodes) for child in inner]


def _read_unit(root: Element) -> float:
    """Return the metres per unit of a COLLADA file."""
    metres = float(_read_asset(root, "unit", lambda unit: unit.get("meter")) or 1.0)
    if not (math.isfinite(metres) and metres > 0.0):
        problem = f"has a unit of {metres:g} metres"
        raise ContentError(problem, "it must be above zero")
    return metres


def _read_asset(root: Element, tag: str, read_value: Callable[[Element], str | None]) -> str | None:
    """Return the value of an asset element, or None.

    Raises ContentError if parts of the file have another value.
    """
    elements = [element for asset in root.iter("asset") for element in asset.findall(tag)]
    values = {(read_value(element) or "").strip() for element in elements}
    if len(values) > 1:
        raise unsupported_part(f"parts of another {tag}")
    return next(iter(values), None)


def _find_scene(collada: _Collada) -> Element:
    """Return the scene of a COLLADA file."""
    instance = collada.root.find("scene/instance_visual_scene")
    if instance is None:
        raise unsupported_part("geometries in no scene")
    scene = collada.resolve(instance, "url")
    if scene.tag != "visual_scene":
        raise ContentError(f"names {scene.tag} as its scene")
    return scene


def _parse_collada_transform(node: Element) -> Floats:
    """Return a COLLADA node's transform to its parent, shape (4, 4)."""
    transform = np.eye(4)
    for child in node:
        if child.tag not in _TRANSFORMS:
            continue
        count, make_matrix = _TRANSFORMS[child.tag]
        numbers = np.array((child.text or "").split(), dtype=np.float64)
        if len(numbers) != count:
            raise ContentError(f"has a {child.tag} of {len(numbers)} numbers; it has {count}")
        transform = transform @ make_matrix(numbers)
    return transform


def _make_rotation(values: Floats) -> Floats:
    """Return the matrix of a rotation, shape (3, 3).

    `values`, shape (4,), are the axis and the angle in degrees.
    """
    from scipy.spatial.transform import Rotation

    *axis, angle = values
    length = np.linalg.norm(axis) or 1.0  # an axis of zeros turns nothing
    rotation_vector = angle * (np.array(axis) / length)
    return np.asarray(Rotation.from_rotvec(rotation_vector, degrees=True).as_matrix())


_TRANSFORMS: Final[dict[str, tuple[int, Callable[[Floats], Floats]]]] = {
    "matrix": (16, lambda values: values.reshape(4, 4)),
    "translate": (3, lambda values: _make_affine(np.eye(3), values)),
    "rotate": (4, lambda values: _make_affine(_make_rotation(values))),
    "scale": (3, lambda values: _make_affine(np.diag(values))),
}
"""Number of values of each transform of a COLLADA node, and the function that makes its matrix."""


def _read_surfaces(geometry: Element, collada: _Collada) -> list[Surface]:
    """Read the primitives of a COLLADA geometry as surfaces."""
    surfaces = []
    for element in geometry:
        if element.tag in ("asset", "extra"):
            continue
        if element.tag != "mesh":
            raise unsupported_part(f"a geometry that is a {element.tag}")
        primitives = [child for child in element if child.tag not in _DATA_CHILDREN]
        surfaces += [_read_collada_part(primitive, collada) for primitive in primitives]
    return surfaces


def _read_collada_part(part: Element, collada: _Collada) -> Surface:
    """Read the triangles of a COLLADA primitive.

    Raises GeometryError for an unsupported kind of primitive, and ContentError if counts disagree.
    """
    lists = [_parse_integers(indices.text) for indices in part.findall("p")]
    numbers = np.concatenate([np.empty(0, dtype=np.int64), *lists])
    count = int(part.get("count", "0"))
    if not count and not len(numbers):
        return join_surfaces([])
    # Each corner has an index for every input; the offset of the input VERTEX selects one of them.
    offsets = [int(element.get("offset", "0")) for element in part.findall("input")]
    stride = 1 + max(offsets, default=0)
    inputs = part.findall("input[@semantic='VERTEX']")
    if len(inputs) != 1 or any(len(indices) % stride for indices in lists):
        problem = f"has {part.tag} with {len(inputs)} inputs VERTEX"
        raise ContentError(f"{problem} and {len(numbers)} numbers, {stride} for a corner")
    sizes = _count_corners(part, [len(indices) // stride for indices in lists])
    if len(sizes) != count:
        raise ContentError(f"declares {count} {part.tag} but holds {len(sizes)}")
    vertex_offset = int(inputs[0].get("offset", "0"))
    corners = numbers[vertex_offset::stride]
    points = _read_positions(collada.resolve(inputs[0]), collada)
    # Tags of the children of a mesh that are lines.
    if part.tag in ("lines", "linestrips"):
        corners = cover_lines(corners, sizes)
        sizes = np.full(len(corners) // 3, 3)
    return points, triangulate(points, corners, sizes)


def _count_corners(part: Element, list_sizes: list[int]) -> Ints:
    """Return the number of corners of each polygon of a COLLADA primitive.

    `list_sizes` has the number of corners in each list of the primitive.
    """
    if part.find("ph") is not None:
        raise unsupported_part("a polygon with holes")
    if part.tag == "triangles":
        # The declared count is not used, because a wrong one may need more memory than there is.
        return np.full(sum(list_sizes) // 3, 3)
    if part.tag == "polylist":
        return _parse_integers(part.findtext("vcount"))
    if part.tag == "lines":
        return np.full(sum(list_sizes) // 2, 2)
    if part.tag in ("polygons", "linestrips"):
        return np.array(list_sizes, dtype=np.int64)
    raise unsupported_part(f"a mesh with {part.tag}")


def _read_positions(vertices: Element, collada: _Collada) -> Floats:
    """Return COLLADA vertices (n, 3), in the file's units."""
    inputs = vertices.findall("input[@semantic='POSITION']")
    if len(inputs) != 1:
        raise ContentError(f"has vertices with {len(inputs)} sources of positions instead of one")
    # The input names a source, whose accessor names an array of numbers.
    accessor = collada.resolve(inputs[0]).find("technique_common/accessor")
    if accessor is None:
        raise ContentError("has a source of positions without an accessor")
    array = collada.resolve(accessor)
    if array not in collada.arrays:
        collada.arrays[array] = np.array((array.text or "").split(), dtype=np.float64)
    values = collada.arrays[array]
    # The accessor takes ``count`` rows of ``stride`` numbers, from the number ``first`` on.
    count = int(accessor.get("count", "0"))
    stride = int(accessor.get("stride", "1"))
    first = int(accessor.get("offset", "0"))
    names = [param.get("name") for param in accessor.findall("param")]
    if list(filter(None, names)) != ["X", "Y", "Z"] or len(names) > stride:
        problem = f"has positions with the columns {names}"
        raise ContentError(problem, "they must be X, Y and Z")
    end = first + count * stride
    declared = int(array.get("count", len(values)))
    if min(first, count) < 0 or len(values) != declared or end > declared:
        raise ContentError(f"has {len(values)} numbers of positions but declares another count")
    columns = [names.index(axis) for axis in "XYZ"]
    return values[first:end].reshape(count, stride)[:, columns]


def _parse_integers(text: str | None) -> Ints:
    """Parse a text as integers, shape (n,)."""
    return np.array((text or "").split(), dtype=np.int64)


# Silence trimesh's log of a bad file, because the error that is raised gives the reason.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

_STL_HEADER_BYTES: Final = 84
"""Size, in bytes, of the header of a binary STL file; its last four bytes count the triangles."""

STL_RECORD: Final = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
"""Layout of a triangle in a binary STL file; the records follow the header."""

_FACET: Final = re.compile(
    rb"\bfacet normal \S+ \S+ \S+ outer loop"
    + 3 * rb" vertex (\S+) (\S+) (\S+)"
    + rb" endloop endfacet\b"
)
"""A facet of a text STL file, in lower case, with single blanks."""

_SOLIDS: Final = re.compile(rb"^[ \t]*(end)?solid\b[^\n]*", re.MULTILINE)
"""A line of a text STL file that begins or ends a solid."""


def read_mesh(path: StrPath, up: Up | None = "z", *, in_metres: bool = True) -> Surface:
    """Read the vertices and triangles of a mesh file.

    The suffix selects the format. Parts of a scene are transformed and joined. Coordinates of
    ``.glb`` and ``.gltf`` are metres by definition, coordinates of ``.dae`` are converted from the
    file's unit, and other formats are assumed to be in metres. A warning names a file whose comment
    says otherwise, unless the caller scales it (``in_metres`` is False).

    The axis ``up`` of the file becomes z. By default axes stay as they are, whichever axis the file
    calls up, as in ROS (rviz, MoveIt). With None they stay too, and a warning says so if the file
    calls another axis up.

    Nothing is repaired, merged or dropped: a file with an unsupported part is refused with
    GeometryError. A polygon of four or more corners is refused too if its triangles are ambiguous:
    its corners are out of plane by more than rounding, or no fan around one of them covers it.
    Lines and points of ``.obj`` and ``.dae`` are surfaces without area; those of other formats are
    refused. Truncation of an ``.obj`` between two lines, or within its
    last number, cannot be detected.

    Returns
    -------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)
        Vertex indices.
    """
    suffix = check_suffix(path, _READERS, "the suffix selects the format", "mesh")
    with decoding(path, _MESH_KIND):
        (vertices, faces), declared_up = _READERS[suffix](Path(path))
        if not len(faces):
            content = "cloud of points" if len(vertices) else ""
            raise _make_empty_error(os.fspath(path), content)
        check_finite(vertices, f"vertices of {path}")
    if up is None and declared_up != "z":
        warn_user(
            f"{os.fspath(path)}: {declared_up} points up in the file, and its axes stay as they "
            f"are, as in ROS; pass up={declared_up!r} to turn it upright, or up='z' to keep them"
        )
    if in_metres:
        warn_of_notes(path)
    return turn_upright(vertices, up or "z"), np.ascontiguousarray(faces)


def turn_upright(vertices: Floats, up: Up) -> Floats:
    """Turn vertices, shape (V, 3), so that an axis points along z."""
    check_word(up, "up", tuple(UPRIGHT))
    return vertices if up == "z" else vertices @ UPRIGHT[up].T


def _read_stl(file: Path) -> tuple[Surface, Up]:
    """Read the triangles of an STL file.

    It may be binary or text. Triangles share no vertices.
    """
    data = read_bytes(file, _MESH_KIND, memory=12.0)
    count_field = data[_STL_HEADER_BYTES - 4 : _STL_HEADER_BYTES]
    declared = int.from_bytes(count_field, "little")
    # Binary files may begin with "solid" too, so their exact size decides.
    if len(data) == _STL_HEADER_BYTES + STL_RECORD.itemsize * declared:
        records = np.frombuffer(data, STL_RECORD, declared, _STL_HEADER_BYTES)
        vertices = records["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid":
        vertices = _parse_stl_text(data)
    else:
        present = max(0.0, (len(data) - _STL_HEADER_BYTES) / STL_RECORD.itemsize)
        raise ContentError(
            f"declares {declared} triangles but has bytes for {present:g}, as a binary STL file"
        )
    return (vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)), "z"


def _parse_stl_text(data: bytes) -> Floats:
    """Parse the corners of a text STL file.

    Returns shape (3 F, 3). Raises ContentError if anything but whole facets is found.
    """
    text = data.lower().replace(b"\r", b"\n").rstrip(b" \t\n\0")
    lines = list(_SOLIDS.finditer(text))
    are_ends = [bool(line[1]) for line in lines]
    if are_ends != [False, True] * (len(lines) // 2) or lines[-1].end() != len(text):
        raise ContentError("does not go from solid to endsolid, as a text STL file must")
    if b"\0" in text:  # a NUL would end a number
        raise ContentError("is not text")
    if any(b"endfacet" in line[0] for line in lines):
        problem = "has facets on a line of solid or endsolid"
        raise ContentError(f"{problem}; they need lines of their own")
    # Single blanks, because patterns that skip blanks take quadratic time on long runs of them.
    text = b" ".join(_SOLIDS.sub(b"", text).split())
    facets = _FACET.findall(text)
    # Nothing but whole facets: "facet" also ends "endfacet", so it occurs twice in each.
    counts = [text.count(word) for word in (b"facet", b"normal", b"vertex")]
    if counts != [2 * len(facets), len(facets), 3 * len(facets)]:
        raise ContentError(f"has stray words of facets besides its {len(facets)} whole ones")
    words = list(itertools.chain.from_iterable(facets))
    return parse_numbers(words, float).reshape(-1, 3)


def _read_ply(file: Path) -> tuple[Surface, Up]:
    """Read the polygons of a PLY file as triangles."""
    vertices, corners, sizes = read_ply(file)
    return (vertices, triangulate(vertices, corners, sizes)), "z"


_READERS: Final[dict[str, Callable[[Path], tuple[Surface, Up]]]] = {
    ".stl": _read_stl,
    ".obj": lambda file: (read_obj(file), "z"),
    ".ply": _read_ply,
    **dict.fromkeys(GLTF_SUFFIXES, _read_gltf),
    ".dae": _read_collada,
}
"""Function that reads a file and the axis that it calls up, by suffix."""

MESH_SUFFIXES: Final = tuple(_READERS)
"""Suffixes of the files that :func:`read_mesh` reads."""


def flatten_trimesh(shape: Any) -> Surface:
    """Join the meshes of a trimesh object.

    Returns vertices, shape (V, 3), and faces, shape (F, 3).

    Raises InputError if it is of another type or a coordinate is not finite. Raises GeometryError
    if it has no triangles, or anything but triangles.
    """
    import trimesh

    if isinstance(shape, trimesh.Scene):
        placed = map(shape.graph.get, shape.graph.nodes_geometry)
        parts = [(shape.geometry[mesh], transform) for transform, mesh in placed]
    elif isinstance(shape, trimesh.parent.Geometry):
        parts = [(shape, np.eye(4))]
    else:
        raise make_kind_error(shape, "mesh", "a mesh is needed")
    if shape.units not in (None, *METRES):
        warn_of_units("mesh", f"units = {shape.units}")
    # Refuse what has no triangles instead of leaving it out.
    surfaces = []
    for geometry, transform in parts:
        if not isinstance(geometry, trimesh.Trimesh) or not len(geometry.faces):
            is_cloud = isinstance(geometry, trimesh.PointCloud)
            content = "cloud of points" if is_cloud else "part without triangles"
            content = f"{content} ({type(geometry).__name__})"
            if len(parts) == 1:
                raise _make_empty_error("mesh", content, suggest_call(geometry, "mesh"))
            problem = f"has a {content} among its meshes"
            raise GeometryError("mesh", problem, "it would be lost")
        points = check_finite(geometry.vertices, "vertices of mesh")
        surface = points, np.asarray(geometry.faces, dtype=np.int64)
        surfaces.append(transform_surface(surface, transform))
    if not surfaces:
        raise _make_empty_error("mesh", "")
    return join_surfaces(surfaces)


def _make_empty_error(name: str, content: str, hint: str = "") -> GeometryError:
    """Return the error for a mesh without triangles.

    ``content`` names the other content, or is empty.
    """
    if not content:
        return GeometryError(name, "is empty", "a mesh needs triangles")
    return GeometryError(name, f"is a {content}", "a mesh needs triangles", hint)
