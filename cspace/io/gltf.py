"""glTF 2.0 and GLB: the triangles of a scene, where its nodes put them.

trimesh reads the numbers; which of them are triangles, how many there must be, and where each mesh stands is told here
from the header, because trimesh passes over fans, fills sparse and compressed accessors with zeros, and loses the
transforms of nodes with cameras. What it does not read right is refused by name.
"""

from __future__ import annotations

import base64
import binascii
import io
import json
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np

from cspace.io.input import damaged, existing, read_bytes
from cspace.io.plain import check_nesting
from cspace.io.polygons import Floats, Surface, joined, placed, unread

_KIND: Final = "mesh"

_LOOKS: Final = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp", "MSFT_texture_")
"""Extensions, by their first letters, that leave the shape as it is."""

_SHAPES: Final = ("EXT_mesh_gpu_instancing", "KHR_implicit_shapes")
"""Extensions of nodes that add to the shape, though a reader may pass over them."""

_TRIANGLES: Final = 4
_FLOAT: Final = 5126
_UNSIGNED: Final = (5121, 5123, 5125)


def read_gltf(file: Path) -> Surface:
    """Triangles of the file's scene, as it stands where nothing is animated.

    Raises
    ------
    FileError
        If the file or a buffer is missing, truncated or malformed, or other triangles were read than are declared.
    GeometryError
        If there is something besides triangles, or shapes that depend on an extension, a skin, a morph, or on numbers
        that are quantised, sparse or compressed.
    """
    import trimesh

    data = read_bytes(file, _KIND, memory=4.0)
    is_binary = file.suffix.lower() == ".glb"
    header = _header(_json_of(data, file) if is_binary else data, file)
    _check_buffers(header, data, is_binary, file)
    counts = [[_census(part, header, file) for part in mesh["primitives"]] for mesh in header.get("meshes", [])]
    if not any(counts):
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int64)
    loaded = trimesh.load_scene(
        io.BytesIO(data),
        file_type="glb" if is_binary else "gltf",
        resolver=_Beside(file),
        process=False,
        skip_materials=True,
    )
    parts = list(loaded.geometry.values())
    if len(parts) != sum(map(len, counts)):
        raise damaged(file, f"declares {sum(map(len, counts))} parts, and {len(parts)} were read")
    surfaces: list[list[Surface]] = []
    for mesh, triangles in zip(header["meshes"], counts, strict=True):
        surfaces.append([])
        for primitive, declared in zip(mesh["primitives"], triangles, strict=True):
            part = parts.pop(0)
            points, faces = np.asarray(part.vertices, dtype=np.float64), np.asarray(part.faces, dtype=np.int64)
            _compare(points, len(faces), declared, header["accessors"][primitive["attributes"]["POSITION"]], file)
            surfaces[-1].append((points, faces))
    return joined([placed(part, place) for mesh, place in _instances(header, file) for part in surfaces[mesh]])


def _compare(points: Floats, faces: int, declared: int, accessor: dict[str, Any], file: Path) -> None:
    """Hold a part that was read against the census and the bounds that its accessor declares."""
    if faces != declared or len(points) != accessor["count"]:
        raise damaged(
            file,
            f"declares {declared} triangles and {accessor['count']} vertices of a part, and {faces} and {len(points)} "
            "were read",
        )
    if "min" in accessor and "max" in accessor and np.isfinite(points).all():
        told = np.array([accessor["min"], accessor["max"]], dtype=np.float64)
        found = np.array([points.min(axis=0), points.max(axis=0)])
        slack = 1e-5 * np.abs(found).max() + 1e-30
        if told.shape != (2, 3) or not (np.abs(told - found) <= slack).all():
            raise damaged(file, f"declares bounds of a part that are {told.tolist()}, and {found.tolist()} were read")


def _census(primitive: dict[str, Any], header: dict[str, Any], file: Path) -> int:
    """Triangles that a part must have, once everything about it is known to be read right."""
    mode = primitive.get("mode", _TRIANGLES)
    if mode != _TRIANGLES:
        what = {5: "strips of triangles", 6: "fans of triangles"}.get(mode, f"points or lines (mode {mode})")
        raise unread(file, f"a part of {what}, without plain triangles")
    for extension in primitive.get("extensions", {}):
        if not extension.startswith(_LOOKS):
            raise unread(file, f"a part with the extension {extension}")
    if "POSITION" not in primitive["attributes"]:
        raise unread(file, "a part without positions of its own")
    points = _accessor(header, primitive["attributes"]["POSITION"], "VEC3", (_FLOAT,), file)
    corners = points["count"]
    if "indices" in primitive:
        corners = _accessor(header, primitive["indices"], "SCALAR", _UNSIGNED, file)["count"]
    if corners < 3 or corners % 3:
        raise damaged(file, f"has a part of {corners} corners, which do not make triangles")
    return int(corners) // 3


def _accessor(header: dict[str, Any], number: int, kind: str, types: tuple[int, ...], file: Path) -> dict[str, Any]:
    """An accessor whose numbers lie as they are in a buffer, within it."""
    accessor = _item(header, "accessors", number, file)
    if "sparse" in accessor:
        raise unread(file, f"a sparse accessor ({number})")
    if "bufferView" not in accessor:
        raise unread(file, f"an accessor ({number}) without data, as compression leaves it")
    if kind == "VEC3" and accessor["componentType"] != _FLOAT:
        raise unread(file, f"quantised positions (accessor {number})")
    if accessor["type"] != kind or accessor["componentType"] not in types:
        raise damaged(
            file, f"has accessor {number} of {accessor['type']} {accessor['componentType']}, where {kind} must be"
        )
    view = _item(header, "bufferViews", accessor["bufferView"], file)
    for extension in view.get("extensions", {}):
        raise unread(file, f"data with the extension {extension}")
    width = {5121: 1, 5123: 2, 5125: 4, _FLOAT: 12}[accessor["componentType"]]
    count, start, stride = accessor["count"], accessor.get("byteOffset", 0), view.get("byteStride", width)
    buffer = _item(header, "buffers", view["buffer"], file)
    first = view.get("byteOffset", 0)
    if min(start, first) < 0 or stride < width or count < 1 or first + view["byteLength"] > buffer["byteLength"]:
        raise damaged(file, "has a view of a buffer that goes beyond its end, or an empty accessor")
    if start + (count - 1) * stride + width > view["byteLength"]:
        raise damaged(file, "has an accessor that goes beyond its view")
    return accessor


def _instances(header: dict[str, Any], file: Path) -> list[tuple[int, Floats]]:
    """Mesh and transform of each place where one stands in the scene."""
    nodes, found = header.get("nodes", []), []
    seen: set[int] = set()
    pending = [(root, np.eye(4)) for root in reversed(_roots(header, file))]
    while pending:
        number, above = pending.pop()
        if number in seen or not 0 <= number < len(nodes):
            raise damaged(file, f"names node {number} twice, or it is not there; nodes form trees")
        seen.add(number)
        node = nodes[number]
        transform = above @ _local(node, file)
        pending += [(child, transform) for child in reversed(node.get("children", []))]
        shape = next((name for name in node.get("extensions", {}) if name in _SHAPES), None)
        if shape:
            raise unread(file, f"a node with the extension {shape}")
        if "mesh" in node:
            mesh = _item(header, "meshes", node["mesh"], file)
            if "skin" in node:
                raise unread(file, "a mesh that a skin moves", "apply its pose, and export it without the skin")
            if any(node.get("weights", mesh.get("weights", []))):
                raise unread(file, "a mesh that a morph moves", "apply the morph, and export it as it then is")
            found.append((node["mesh"], transform))
    return found


def _roots(header: dict[str, Any], file: Path) -> list[int]:
    scenes = header.get("scenes", [])
    if not scenes:
        if header.get("meshes"):
            raise unread(file, "meshes in no scene", "export it again with its scene")
        return []
    if len(scenes) > 1 and "scene" not in header:
        raise unread(file, f"{len(scenes)} scenes of which none is the default", "export one scene")
    roots: list[int] = _item(header, "scenes", header.get("scene", 0), file).get("nodes", [])
    return roots


def _item(header: dict[str, Any], kind: str, number: int, file: Path) -> dict[str, Any]:
    items = header.get(kind, [])
    if not 0 <= number < len(items):
        raise damaged(file, f"names number {number} of its {len(items)} {kind}")
    item: dict[str, Any] = items[number]
    return item


def _local(node: dict[str, Any], file: Path) -> Floats:
    """Transform of a node in its parent: matrix, or translation, rotation and scale."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    x, y, z, w = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64)
    length = x * x + y * y + z * z + w * w
    if not length > 0.0:
        raise damaged(file, "has a node with a rotation of length 0")
    s = 2.0 / length
    turn = np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    )
    transform[:3, :3] = turn * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    transform[:3, 3] = node.get("translation", (0, 0, 0))
    return transform


def _json_of(data: bytes, file: Path) -> bytes:
    """The header of a GLB file, whose chunks fill it to its end."""
    if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
        raise damaged(file, "does not begin with the head of a GLB file of version 2")
    length, at = int.from_bytes(data[8:12], "little"), 12
    if length != len(data):
        raise damaged(file, f"has {len(data)} bytes and declares {length}")
    while at < length:
        at += 8 + int.from_bytes(data[at : at + 4], "little")
    if at != length or data[16:20] != b"JSON":
        raise damaged(file, "has a chunk that goes beyond its end, or no header in JSON")
    return data[20 : 20 + int.from_bytes(data[12:16], "little")]


def _header(data: bytes, file: Path) -> dict[str, Any]:
    try:
        text = data.decode("utf-8-sig")
        check_nesting(text, str(file), "[{", "]}")
        header = json.loads(text)
    except ValueError as error:
        raise damaged(file, f"has a header that is no JSON ({error})") from error
    if not isinstance(header, dict):
        raise damaged(file, "has a header that is no object of JSON")
    version = str(header.get("asset", {}).get("version", ""))
    if not version.startswith("2."):
        raise damaged(file, f"is of version {version or 'none'}; glTF 2 is read")
    foreign = [name for name in header.get("extensionsRequired", []) if not name.startswith(_LOOKS)]
    if foreign:
        raise unread(file, f"shapes that need the extension {foreign[0]}")
    return header


def _check_buffers(header: dict[str, Any], data: bytes, is_binary: bool, file: Path) -> None:
    """Hold each buffer to the length that is declared."""
    for number, buffer in enumerate(header.get("buffers", [])):
        uri = buffer.get("uri")
        if uri is not None:
            held = len(_Beside(file)[uri])
        elif is_binary and number == 0:
            after = 20 + int.from_bytes(data[12:16], "little")
            if data[after + 4 : after + 8] != b"BIN\0":
                raise damaged(file, "has no data for buffer 0")
            held = len(data) - after - 8
        else:
            raise damaged(file, f"has no data for buffer {number}")
        if held < buffer["byteLength"]:
            raise damaged(file, f"has buffer {number} of {held} bytes, and declares {buffer['byteLength']}")


class _Beside:
    """Files that a glTF file names: beside it or below, and nowhere else."""

    def __init__(self, file: Path) -> None:
        self.file = file

    def __getitem__(self, uri: str) -> bytes:
        if uri.startswith("data:"):
            try:
                return base64.b64decode(uri.partition("base64,")[2], validate=True)
            except binascii.Error as error:
                raise damaged(self.file, f"has data in its text that are no base64 ({error})") from error
        folder = self.file.parent
        other = folder / unquote(uri)
        if not other.resolve().is_relative_to(folder.resolve()):
            raise damaged(self.file, f"has its data in {uri!r:.80}, outside of its folder")
        if not other.is_file():
            raise damaged(self.file, f"has its data in {uri!r:.80}, which does not exist beside it")
        return read_bytes(existing(other, _KIND), _KIND)

    def get(self, name: str) -> bytes:
        """As trimesh asks for it."""
        return self[name]
