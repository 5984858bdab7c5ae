"""Boundary of the free space as a mesh in PLY, which keeps the exact coordinates."""

from __future__ import annotations

import numpy as np

from cspace import FREE, Grid
from cspace.errors import InputError
from cspace.inside import States, StrPath, Surface, Voxels, replacing


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
    """Write the boundary of the free space as a binary PLY file.

    Raises InputError as :func:`free_boundary`, and FileError as
    :func:`cspace._files.access.replacing`.
    """
    with replacing(path, overwrite) as temporary:
        vertices, faces = free_boundary(state, grid)
        header = (
            "ply\nformat binary_little_endian 1.0\n"
            f"element vertex {len(vertices)}\n"
            "property double x\nproperty double y\nproperty double z\n"
            f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        )
        # A face is the number of its corners, then their indices.
        rows = np.empty(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
        rows["count"] = 3
        rows["corners"] = faces
        with temporary.open("wb") as file:
            file.write(header.encode())
            file.write(vertices.astype("<f8").tobytes())
            file.write(rows.tobytes())
