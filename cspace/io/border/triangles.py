"""Mesh files, written: PLY and OBJ keep every bit of the coordinates and the shared vertices, STL neither.

STL holds single precision, about seven digits, and three corners of its own for each triangle.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_MOST: Final = 2**31 - 1
"""Triangles that every format can count."""

_BLOCK: Final = 2**16
"""Rows that are encoded at once."""


def writer_of(path: str | os.PathLike[str]) -> Callable[[IO[bytes], Floats, Ints], None]:
    """The function that writes a mesh to an open file in the format that the suffix of ``path`` names.

    It takes the file, the vertices, shape (V, 3), in metres, and the faces, shape (F, 3), rows of vertices.

    Raises
    ------
    InputError
        If the suffix is none of :data:`WRITERS`; the function raises it where its format cannot hold the mesh.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            f"{Path(path)} ends in {suffix!r}; the suffix says which mesh to write; use one of {', '.join(WRITERS)}"
        )

    def write(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
        if len(faces) > _MOST:
            raise InputError(
                f"the mesh has {len(faces)} triangles; a {suffix} file holds at most {_MOST}; build the map with a "
                "larger spacing or smaller bounds"
            )
        WRITERS[suffix](file, vertices, faces)

    return write


def _write_ply(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    file.write(header.encode())
    for block in _blocks(vertices):
        file.write(block.astype("<f8").tobytes())
    for block in _blocks(faces):
        rows = np.empty(len(block), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        rows["count"], rows["corners"] = 3, block
        file.write(rows.tobytes())


def _write_obj(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    # The shortest text of a float that reads back as the same one is its repr.
    for start, table, form in ((0, vertices, "v %r %r %r\n"), (1, faces, "f %r %r %r\n")):
        for block in _blocks(table):
            file.write((form * len(block) % tuple((block + start).ravel().tolist())).encode())


def _write_stl(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    with np.errstate(over="ignore", under="ignore"):
        single = vertices.astype("<f4")
    file.write(b"binary STL, metres".ljust(80) + np.uint32(len(faces)).astype("<u4").tobytes())
    scale = np.ptp(vertices, axis=0).max()
    for block in _blocks(faces):
        corners = single[block]
        edges = np.diff(vertices[block], axis=1)
        if not np.isfinite(corners).all() or ((edges != 0.0) & (np.diff(corners, axis=1) == 0.0)).any():
            raise InputError(
                f"coordinates from {vertices.min()} to {vertices.max()} do not keep apart in single precision, and an "
                "STL file holds no other; write .ply or .obj instead"
            )
        normals = np.cross(edges[:, 0] / scale, edges[:, 1] / scale)
        rows = np.zeros(len(block), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        rows["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        rows["corners"] = corners
        file.write(rows.tobytes())


def _blocks(table: NDArray[Any]) -> Iterator[NDArray[Any]]:
    return (table[start : start + _BLOCK] for start in range(0, len(table), _BLOCK))


WRITERS: Final[Mapping[str, Callable[[IO[bytes], Floats, Ints], None]]] = {
    ".ply": _write_ply,
    ".obj": _write_obj,
    ".stl": _write_stl,
}
"""Mesh formats, by suffix."""
