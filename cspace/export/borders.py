"""The border of the free space as a mesh: PLY, OBJ and STL.

PLY and OBJ keep every bit of the coordinates and the shared vertices. STL holds single precision, about seven digits,
and three corners of its own for each triangle.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, Floats, Ints
from cspace.errors import InputError
from cspace.files.access import replacing
from cspace.grid import Grid
from cspace.limits import check_memory
from cspace.raster.bitmaps import boundary_mesh

_BYTES: Final = 160
"""For each square of the border: its corners, its triangles, and its share of the vertices."""

MOST: Final = 2**31 - 1
"""Triangles that every format can count."""

BLOCK: Final = 2**16
"""Rows that are encoded at once."""


def free_border(state: NDArray[np.uint8], grid: Grid) -> tuple[Floats, Ints]:
    """The border of the union of the closed FREE cells of a slice in space: vertices (V, 3), metres, and faces (F, 3).

    Every cell face between a FREE cell and one that is not, or the outside of the grid, becomes two triangles, whose
    normals point out of the free space: counterclockwise where seen from outside it. Triangles share their vertices,
    each ``lower + spacing * index`` and none twice: every edge belongs to an even number of them, two, or four where
    FREE cells touch in an edge only.

    Raises InputError if there is no FREE cell, or the border does not fit into memory.
    """
    free = np.pad(state == FREE, 1)
    count = sum(int(np.count_nonzero(np.diff(free, axis=axis))) for axis in range(3))
    if not count:
        raise InputError(
            "the map",
            "has no FREE cell",
            "a border needs at least one",
            "build it with a smaller spacing, robot or margin",
        )
    check_memory(_BYTES * count, "the border of the free space", grid)
    vertices, faces, turns = boundary_mesh(free[1:-1, 1:-1, 1:-1], grid.spacing, grid.lower)
    return vertices, np.where(turns[:, None] < 0, faces[:, ::-1], faces)


def write_border(state: NDArray[np.uint8], grid: Grid, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write :func:`free_border` as a mesh file that ends in ``.ply``, ``.obj`` or ``.stl``.

    Raises InputError as :func:`free_border`, or where the format cannot hold the mesh, and FileError as
    :func:`cspace.files.access.replacing`.
    """
    with replacing(path, overwrite) as temporary:
        vertices, faces = free_border(state, grid)
        suffix = Path(path).suffix.lower()
        if len(faces) > MOST:
            raise InputError(
                "path",
                f"is {path} for a mesh of {len(faces)} triangles",
                f"a {suffix} file holds at most {MOST}",
                "build the map with a larger spacing or smaller bounds",
                value=path,
            )
        with temporary.open("wb") as file:
            WRITERS[suffix](file, vertices, faces)


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
                "path",
                f"names an STL file for coordinates from {vertices.min()} to {vertices.max()}",
                "they do not keep apart in single precision, and such a file holds no other",
                "write .ply or .obj instead",
            )
        normals = np.cross(edges[:, 0] / scale, edges[:, 1] / scale)
        rows = np.zeros(len(block), dtype=[("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        rows["normal"] = normals / np.linalg.norm(normals, axis=1, keepdims=True)
        rows["corners"] = corners
        file.write(rows.tobytes())


def _blocks(table: NDArray[Any]) -> Iterator[NDArray[Any]]:
    return (table[start : start + BLOCK] for start in range(0, len(table), BLOCK))


WRITERS: Final[Mapping[str, Callable[[IO[bytes], Floats, Ints], None]]] = {
    ".ply": _write_ply,
    ".obj": _write_obj,
    ".stl": _write_stl,
}
"""Mesh formats, by suffix."""
