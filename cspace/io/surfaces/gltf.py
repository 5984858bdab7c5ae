"""glTF 2.0 and GLB: the triangles of a scene, where its nodes put them."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np

from cspace.io.surfaces.gltf_accessors import Accessors
from cspace.io.surfaces.parts import (
    Floats,
    Integers,
    Surface,
    check_corners,
    damaged,
    fan_of,
    joined,
    placed,
    strip_of,
    unread,
)

_MAGIC: Final = b"glTF"
_JSON: Final = b"JSON"
_BINARY: Final = b"BIN\0"

_LOOKS: Final = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp")
"""Extensions, by their first letters, that leave the shape as it is."""

_KNOWN: Final = ("KHR_mesh_quantization",)
_SHAPES: Final = ("EXT_mesh_gpu_instancing", "KHR_implicit_shapes")
"""Extensions of nodes that add to the shape, though a reader may pass over them."""

_CUT: Final[dict[int, Callable[[Integers], Integers]]] = {
    4: lambda corners: corners.reshape(-1, 3),
    5: strip_of,
    6: fan_of,
}
"""Triangles of a primitive, by its mode."""

_TRIANGLES: Final = 4


def read_gltf(file: Path) -> Surface:
    """Triangles of the file's scene, as it stands where nothing is animated.

    Raises
    ------
    FileError
        If the file or a buffer is missing, truncated or malformed.
    GeometryError
        If there is something besides triangles, or shapes that depend on an extension, a skin or a morph.
    """
    header, binary = _chunks(file) if file.suffix.lower() == ".glb" else (_parsed(file.read_bytes(), file), None)
    version = str(header.get("asset", {}).get("version", ""))
    if not version.startswith("2."):
        raise damaged(file, f"is of version {version or 'none'}; glTF 2 is read")
    foreign = [e for e in header.get("extensionsRequired", []) if not e.startswith(_LOOKS) and e not in _KNOWN]
    if foreign:
        raise unread(file, f"shapes that need the extension {foreign[0]}")
    accessors = Accessors(header, [_buffer(b, i, binary, file) for i, b in enumerate(header.get("buffers", []))], file)
    parts: list[Surface] = []
    seen: set[int] = set()
    pending = [(root, np.eye(4)) for root in reversed(_roots(header, file))]
    while pending:
        number, above = pending.pop()
        if number in seen or not 0 <= number < len(header.get("nodes", [])):
            raise damaged(file, f"names node {number} twice, or it is not there; nodes form trees")
        seen.add(number)
        node = header["nodes"][number]
        transform = above @ _local(node, file)
        pending += [(child, transform) for child in reversed(node.get("children", []))]
        shape = next((name for name in node.get("extensions", {}) if name in _SHAPES), None)
        if shape:
            raise unread(file, f"a node with the extension {shape}")
        if "mesh" in node:
            mesh = _item(header, "meshes", node["mesh"], file)
            _check_rigid(node, mesh, file)
            parts += [placed(_primitive(p, accessors, file), transform) for p in mesh["primitives"]]
    return joined(parts)


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


def _check_rigid(node: dict[str, Any], mesh: dict[str, Any], file: Path) -> None:
    if "skin" in node:
        raise unread(file, "a mesh that a skin moves", "apply its pose, and export it without the skin")
    if any(node.get("weights", mesh.get("weights", []))):
        raise unread(file, "a mesh that a morph moves", "apply the morph, and export it as it then is")


def _primitive(primitive: dict[str, Any], accessors: Accessors, file: Path) -> Surface:
    mode = primitive.get("mode", _TRIANGLES)
    if mode not in _CUT:
        raise unread(file, f"a part of points or lines (mode {mode}), without triangles", "remove it")
    if "POSITION" not in primitive["attributes"]:
        raise unread(file, "a part without positions of its own")
    points: Floats = accessors.values(primitive["attributes"]["POSITION"], "VEC3")
    if "indices" in primitive:
        corners = accessors.values(primitive["indices"], "SCALAR").astype(np.int64).reshape(-1)
    else:
        corners = np.arange(len(points))
    if len(corners) < 3 or (mode == _TRIANGLES and len(corners) % 3):
        raise damaged(file, f"has a part of {len(corners)} corners, which do not make triangles")
    check_corners(corners, len(points), file)
    return points, _CUT[mode](corners)


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


def _chunks(file: Path) -> tuple[dict[str, Any], bytes | None]:
    """Header and binary chunk of a GLB file."""
    data = file.read_bytes()
    if data[:4] != _MAGIC or int.from_bytes(data[4:8], "little") != 2:
        raise damaged(file, "does not begin with the head of a GLB file of version 2")
    length, at = int.from_bytes(data[8:12], "little"), 12
    if length != len(data):
        raise damaged(file, f"has {len(data)} bytes and declares {length}")
    chunks: list[tuple[bytes, bytes]] = []
    while at < length:
        size = int.from_bytes(data[at : at + 4], "little")
        chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        if len(chunks[-1][1]) != size or at + 8 > length:
            raise damaged(file, "has a chunk that goes beyond its end")
        at += 8 + size
    if not chunks or chunks[0][0] != _JSON:
        raise damaged(file, "has no header in JSON")
    return _parsed(chunks[0][1], file), chunks[1][1] if len(chunks) > 1 and chunks[1][0] == _BINARY else None


def _parsed(data: bytes, file: Path) -> dict[str, Any]:
    try:
        header = json.loads(data)
    except ValueError as error:
        raise damaged(file, f"has a header that is no JSON ({error})") from error
    if not isinstance(header, dict):
        raise damaged(file, "has a header that is no object of JSON")
    return header


def _buffer(buffer: dict[str, Any], number: int, binary: bytes | None, file: Path) -> bytes | None:
    """Bytes of a buffer; none where they are nowhere, which matters only if they are asked for."""
    uri = buffer.get("uri")
    if uri is None:
        data = binary if number == 0 else None
    elif uri.startswith("data:"):
        data = base64.b64decode(uri.partition("base64,")[2])
    else:
        other = file.parent / unquote(uri)
        if not other.is_file():
            raise damaged(file, f"has its data in {uri!r}, which does not exist beside it")
        data = other.read_bytes()
    if data is not None and len(data) < buffer["byteLength"]:
        raise damaged(file, f"has buffer {number} of {len(data)} bytes, and declares {buffer['byteLength']}")
    return data
