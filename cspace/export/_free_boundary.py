"""Boundary of the free space as a mesh: PLY, OBJ and STL.

PLY and OBJ keep the exact coordinates and share vertices. STL has single precision, about seven
digits, and separate corners for each triangle.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Final

import numpy as np

from cspace import FREE, Grid
from cspace.errors import InputError
from cspace.inside import Floats, Ints, States, StrPath, Surface, Voxels, replacing


def free_boundary(state: States, grid: Grid) -> Surface:
    """Return the boundary mesh of a slice's FREE cells.

    Vertices have shape (V, 3), metres, and faces (F, 3). Every cell face between a FREE cell and
    another cell, or the exterior of the grid, becomes two triangles with normals out of the free
    space (counterclockwise from outside). Vertices are ``lower + spacing * index``, each only once.
    Every edge belongs to two triangles, or to four if FREE cells touch only in that edge.

    Raises InputError if there is no FREE cell.
    """
    free = state == FREE
    if not free.any():
        rule = "a boundary needs at least one"
        raise InputError("the map", "has no FREE cell", rule)
    return Voxels(free, grid.spacing, np.array(grid.lower)).closed_surface


def write_boundary(state: States, grid: Grid, path: StrPath, overwrite: bool = False) -> None:
    """Write the boundary of the free space as a mesh file.

    The suffix is ``.ply``, ``.obj`` or ``.stl``.

    Raises InputError as :func:`free_boundary`, or if the format cannot hold the mesh. Raises
    FileError as :func:`cspace._files.access.replacing`.
    """
    write_mesh = WRITERS[Path(path).suffix.lower()]
    with replacing(path, overwrite) as temporary:
        vertices, faces = free_boundary(state, grid)
        with temporary.open("wb") as file:
            write_mesh(file, vertices, faces)


def _write_ply(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    """Write a mesh as binary PLY."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    file.write(header.encode())
    file.write(vertices.astype("<f8").tobytes())
    # A face is the number of its corners, then their indices.
    rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"] = 3
    rows["corners"] = faces
    file.write(rows.tobytes())


def _write_obj(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    """Write a mesh as OBJ."""
    # The repr of a float is the shortest text that reads back as the same float.
    file.writelines(b"v %r %r %r\n" % tuple(vertex) for vertex in vertices.tolist())
    file.writelines(b"f %d %d %d\n" % tuple(face) for face in (faces + 1).tolist())


def _write_stl(file: IO[bytes], vertices: Floats, faces: Ints) -> None:
    """Write a mesh as binary STL.

    Raises InputError if single precision merges corners.
    """
    with np.errstate(over="ignore", under="ignore"):
        corners = vertices.astype("<f4")[faces]
    # Two edges of each face. Rounding may shorten them, but a coordinate that differs must still
    # differ, or else the mesh would collapse there.
    edges = np.diff(vertices[faces], axis=1)
    are_merged = (edges != 0.0) & (np.diff(corners, axis=1) == 0.0)
    if are_merged.any() or not np.isfinite(corners).all():
        problem = f"names an STL file for coordinates from {vertices.min()} to {vertices.max()}"
        rule = "STL has single precision, in which some coordinates coincide"
        raise InputError("path", problem, rule)
    record = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
    rows = np.zeros(len(faces), dtype=record)
    first_edges, second_edges = np.moveaxis(edges, 1, 0)
    # Normals are parallel to an axis, so their signs are unit vectors.
    rows["normal"] = np.sign(np.cross(first_edges, second_edges))
    rows["corners"] = corners
    # A comment of 80 bytes, the number of triangles in 4 bytes, and the triangles.
    file.write(b"binary STL, metres".ljust(80))
    file.write(len(faces).to_bytes(4, "little"))
    file.write(rows.tobytes())


WRITERS: Final[Mapping[str, Callable[[IO[bytes], Floats, Ints], None]]] = {
    ".ply": _write_ply,
    ".obj": _write_obj,
    ".stl": _write_stl,
}
"""Writer of each suffix."""
