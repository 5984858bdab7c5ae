"""glTF 2.0 and GLB: the triangles of a scene, read by trimesh and held against the header.

trimesh passes over fans of triangles, fills sparse and compressed accessors with zeros, takes quantised numbers as they
are, leaves out instances, skins and morphs, and loses what hangs below a node with a camera. All of these are refused
here by name; the triangles of the rest are counted, and its bounds compared with those that the header declares.
"""

# trimesh reads the arrays. The header is read here because trimesh 5.2 drops or moves parts of a scene silently.

from __future__ import annotations

import io
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np

from cspace.arrays import Floats
from cspace.files.access import Fault, read_bytes
from cspace.files.plain import check_nesting
from cspace.files.polygons import unfolded, unread
from cspace.limits import check_bytes

_KIND: Final = "mesh"

_LOOKS: Final = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp", "MSFT_texture_")
"""Extensions, by their first letters, that leave the shape as it is."""

_DEEPEST: Final = 256
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
