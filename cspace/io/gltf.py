"""glTF 2.0 and GLB: the triangles of a scene, each mesh where its nodes put it.

Shapes that depend on more than triangles of plain numbers (strips and fans, sparse, compressed or quantised accessors,
instances, skins and morphs) are refused by name.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from cspace.io.input import damaged, read_bytes
from cspace.io.limits import check_bytes
from cspace.io.plain import check_nesting
from cspace.io.polygons import Floats, Surface, assembled, triangulated, unread

_LOOKS: Final = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_xmp", "MSFT_texture_")
"""Extensions, by their first letters, that leave the shape as it is."""

_DEEPEST: Final = 256
_TRIANGLES: Final = 4
_MODES: Final = {5: "strips of triangles", 6: "fans of triangles"}
_INDICES: Final[Mapping[int, np.dtype[Any]]] = {5121: np.dtype("u1"), 5123: np.dtype("<u2"), 5125: np.dtype("<u4")}
_POSITIONS: Final[Mapping[int, np.dtype[Any]]] = {5126: np.dtype(("<f4", 3))}
"""How the numbers of a corner and the coordinates of a vertex lie in a buffer, by the type of their component."""

Object = dict[str, Any]


def read_gltf(file: Path) -> Surface:
    """Triangles of the file's scene.

    Raises
    ------
    FileError
        If the file or a buffer is missing, truncated or malformed, or holds other numbers than it declares.
    GeometryError
        If there is something besides triangles, or shapes that depend on an extension, a skin, a morph, or on numbers
        that are quantised, sparse or compressed.
    """
    return _Reader(file).surface()


class _Reader:
    """One file: its header, and what was read of its buffers."""

    def __init__(self, file: Path) -> None:
        data = read_bytes(file, "mesh", memory=4.0)
        self.file = file
        self.chunk: bytes | None = None
        self.buffers: dict[int, bytes] = {}
        self.arrays: dict[int, NDArray[Any]] = {}
        self.unpacked = 0
        if file.suffix.lower() == ".glb":
            data, self.chunk = self._chunks(data)
        try:
            text = data.decode("utf-8-sig")
            check_nesting(text, str(file), "[{", "]}")
            header = json.loads(text)
        except ValueError as error:
            raise damaged(file, f"has a header that is no JSON ({error})") from error
        if not isinstance(header, dict):
            raise damaged(file, "has a header that is no object of JSON")
        self.header: Object = header
        version = str(header.get("asset", {}).get("version", ""))
        if not version.startswith("2."):
            raise damaged(file, f"is of version {version or 'none'}; glTF 2 is read")
        self._refuse_extensions({"extensions": dict.fromkeys(header.get("extensionsRequired", []))})

    def surface(self) -> Surface:
        """All triangles of the scene."""
        places = list(self._places())
        shown = {mesh for mesh, _ in places}
        meshes = self.header.get("meshes", [])
        parts = {mesh: [self._primitive(part) for part in meshes[mesh]["primitives"]] for mesh in range(len(meshes))}
        return assembled({mesh: parts[mesh] for mesh in shown}, places, self.file)

    def _chunks(self, data: bytes) -> tuple[bytes, bytes | None]:
        """The header of a GLB file, and its binary chunk, where there is one; chunks fill the file to its end."""
        if data[:4] != b"glTF" or int.from_bytes(data[4:8], "little") != 2:
            raise damaged(self.file, "does not begin with the head of a GLB file of version 2")
        length, at = int.from_bytes(data[8:12], "little"), 12
        if length != len(data):
            raise damaged(self.file, f"has {len(data)} bytes and declares {length}")
        chunks = []
        while at < length:
            size = int.from_bytes(data[at : at + 4], "little")
            chunks.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
            at += 8 + size
        if at != length or not chunks or chunks[0][0] != b"JSON":
            raise damaged(self.file, "has a chunk that goes beyond its end, or no header in JSON")
        return chunks[0][1], chunks[1][1] if len(chunks) > 1 and chunks[1][0] == b"BIN\0" else None

    def _places(self) -> Iterator[tuple[int, Floats]]:
        """The mesh of each place of the scene where one stands, and its transform."""
        scenes, nodes = self.header.get("scenes", []), self.header.get("nodes", [])
        if not scenes and self.header.get("meshes"):
            raise unread(self.file, "meshes in no scene", "export it again with its scene")
        if len(scenes) > 1 and "scene" not in self.header:
            raise unread(self.file, f"{len(scenes)} scenes of which none is the default", "export one scene")
        roots = self._item("scenes", self.header.get("scene", 0)).get("nodes", []) if scenes else []
        pending = [(number, 1, np.eye(4)) for number in roots]
        seen: set[int] = set()
        while pending:
            number, level, above = pending.pop()
            if level > _DEEPEST:
                raise damaged(self.file, f"has more than {_DEEPEST} nodes within each other")
            if number in seen or not 0 <= number < len(nodes):
                raise damaged(self.file, f"names node {number} twice, or it is not there; nodes form trees")
            seen.add(number)
            node = nodes[number]
            self._refuse_extensions(node)
            transform = above @ _local(node)
            pending += [(child, level + 1, transform) for child in node.get("children", [])]
            if "mesh" not in node:
                continue
            if "skin" in node:
                raise unread(self.file, "a mesh that a skin moves", "apply its pose, and export it without the skin")
            if any(node.get("weights", self._item("meshes", node["mesh"]).get("weights", []))):
                raise unread(self.file, "a mesh that a morph moves", "apply the morph, and export it as it then is")
            yield node["mesh"], transform

    def _primitive(self, part: Object) -> Surface:
        """A part of a mesh, once everything about it is known to be read right."""
        mode = part.get("mode", _TRIANGLES)
        if mode != _TRIANGLES:
            raise unread(self.file, f"a part of {_MODES.get(mode, f'points or lines (mode {mode})')}")
        self._refuse_extensions(part)
        if "POSITION" not in part["attributes"]:
            raise unread(self.file, "a part without positions of its own")
        points = self._accessor(part["attributes"]["POSITION"], "VEC3", _POSITIONS)
        corners = self._accessor(part["indices"], "SCALAR", _INDICES) if "indices" in part else np.arange(len(points))
        if len(corners) < 3 or len(corners) % 3:
            raise damaged(self.file, f"has a part of {len(corners)} corners, which do not make triangles")
        return points, triangulated(points, corners, np.full(len(corners) // 3, 3), self.file)

    def _accessor(self, number: int, kind: str, types: Mapping[int, np.dtype[Any]]) -> NDArray[Any]:
        """Rows of numbers that lie as they are in a buffer, within it, and within the bounds that are declared."""
        if number in self.arrays:
            return self.arrays[number]
        accessor = self._item("accessors", number)
        if "sparse" in accessor:
            raise unread(self.file, f"a sparse accessor ({number})")
        if "bufferView" not in accessor:
            raise unread(self.file, f"an accessor ({number}) without data, as compression leaves it")
        component, count = accessor["componentType"], accessor["count"]
        if kind == "VEC3" and component != 5126:
            raise unread(self.file, f"quantised positions (accessor {number})")
        if accessor["type"] != kind or component not in types:
            raise damaged(self.file, f"has accessor {number} of {accessor['type']} {component}, where {kind} must be")
        view = self._item("bufferViews", accessor["bufferView"])
        self._refuse_extensions(view)
        row = types[component]
        start, first, stride = accessor.get("byteOffset", 0), view.get("byteOffset", 0), view.get("byteStride", 0)
        stride = stride or row.itemsize
        end = start + (count - 1) * stride + row.itemsize
        if min(start, first) < 0 or count < 1 or stride < row.itemsize or end > view["byteLength"]:
            raise damaged(self.file, "has an accessor that goes beyond its view, or is empty")
        buffer = self._buffer(view["buffer"])
        if first + view["byteLength"] > len(buffer):
            raise damaged(self.file, "has a view of a buffer that goes beyond its end")
        self.unpacked += 24 * count
        check_bytes(self.file, self.unpacked, "unpacks to")
        found: NDArray[Any] = np.ndarray(
            (count, *row.shape), row.base, buffer, first + start, (stride, 4)[: 1 + len(row.shape)]
        )
        if "min" in accessor and "max" in accessor and np.isfinite(found).all():
            declared = np.array([accessor["min"], accessor["max"]], dtype=np.float64)
            bounds = np.array([found.min(axis=0), found.max(axis=0)], dtype=np.float64).reshape(2, -1)
            if declared.shape != bounds.shape or not (np.abs(declared - bounds) <= 1e-5 * np.abs(bounds).max()).all():
                was = f"{declared.tolist()}, and {bounds.tolist()} were read"
                raise damaged(self.file, f"declares bounds of a part that are {was}")
        self.arrays[number] = found.astype(np.float64 if kind == "VEC3" else np.int64)
        return self.arrays[number]

    def _buffer(self, number: int) -> bytes:
        """A buffer, whole: the chunk of a GLB file, text of base64, or a file beside this one or below."""
        if number not in self.buffers:
            buffer = self._item("buffers", number)
            uri, folder = buffer.get("uri"), self.file.parent
            if uri is None:
                data = self.chunk if number == 0 and self.chunk is not None else b""
            elif uri.startswith("data:"):
                data = base64.b64decode(uri.partition(",")[2])
            elif not (folder / unquote(uri)).resolve().is_relative_to(folder.resolve()):
                raise damaged(self.file, f"has its data in {uri!r:.80}, outside of its folder")
            else:
                data = read_bytes(folder / unquote(uri), "buffer of glTF")
            if len(data) < buffer["byteLength"]:
                raise damaged(self.file, f"has a buffer of {len(data)} bytes, and declares {buffer['byteLength']}")
            self.buffers[number] = data[: buffer["byteLength"]]
        return self.buffers[number]

    def _refuse_extensions(self, thing: Object) -> None:
        foreign = [name for name in thing.get("extensions", {}) if not name.startswith(_LOOKS)]
        if foreign:
            raise unread(self.file, f"a part with the extension {foreign[0]}")

    def _item(self, kind: str, number: int) -> Object:
        items: Sequence[Object] = self.header.get(kind, [])
        if not 0 <= number < len(items):
            raise damaged(self.file, f"names number {number} of its {len(items)} {kind}")
        return items[number]


def _local(node: Object) -> Floats:
    """Transform of a node in its parent."""
    from scipy.spatial.transform import Rotation

    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    transform = np.eye(4)
    turn = Rotation.from_quat(node.get("rotation", (0.0, 0.0, 0.0, 1.0))).as_matrix()
    transform[:3, :3] = turn * np.asarray(node.get("scale", (1.0, 1.0, 1.0)), dtype=np.float64)
    transform[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return transform
