"""The border of the free space as triangles, for a robot that translates in space."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.io.border.triangles import writer_of
from cspace.io.output import replacing
from cspace.states import FREE

if TYPE_CHECKING:
    from cspace.space import CSpace

_BYTES: Final = 96
"""For each square of the border: its triangles, and its share of the vertices."""


def free_border(space: CSpace) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The border of the union of the closed FREE cells.

    Every cell face between a FREE cell and one that is not, or the outside of the grid, becomes two triangles, whose
    normals point out of the free space. Triangles share their vertices: every edge belongs to an even number of them,
    two, or four where FREE cells touch in an edge only.

    Parameters
    ----------
    space : CSpace
        Of a robot that translates in space.

    Returns
    -------
    vertices : ndarray of float64, shape (V, 3)
        Metres, each ``lower + spacing * index``; none twice.
    faces : ndarray of int64, shape (F, 3)
        Rows of ``vertices``, counterclockwise where seen from outside the free space.

    Raises
    ------
    InputError
        If the map is one of the plane, has no FREE cell, or its border does not fit into memory.
    """
    from cspace.io.border._kernels import count_squares, fill_triangles
    from cspace.memory import check_memory

    grid = space.grid
    if grid.dim != 3:
        cells = " x ".join(map(str, grid.shape))
        raise InputError(
            f"the map has {cells} cells in the plane; the border of the free space is a surface only in space; export "
            "a .vti or .yaml file of it instead"
        )
    squares = count_squares(space.state, FREE)
    if not squares:
        raise InputError(
            "the map has no FREE cell; a border needs at least one; build it with a smaller spacing, robot or margin"
        )
    check_memory(_BYTES * squares, "the border of the free space", grid.shape, grid.spacing)
    # Every lattice point of the border belongs to three squares at least, and every square has four.
    corners = np.empty((4 * squares // 3, 3), dtype=np.int32)
    faces = np.empty((2 * squares, 3), dtype=np.int64)
    used = fill_triangles(space.state, FREE, corners, faces)
    vertices: NDArray[np.float64] = np.asarray(grid.lower) + grid.spacing * corners[:used]
    return vertices, faces


def write_border(space: CSpace, path: str | os.PathLike[str], overwrite: bool = False) -> None:
    """Write :func:`free_border` as a mesh file.

    Parameters
    ----------
    space : CSpace
    path : path-like
        Ends in ``.ply``, ``.obj`` or ``.stl``; see :mod:`cspace.io.border.triangles`.
    overwrite : bool
        Whether an existing file may be replaced.

    Raises
    ------
    InputError
        As :func:`free_border`, or where the format cannot hold the mesh.
    FileError
        If the file exists and may not be replaced, or cannot be written.
    """
    writer = writer_of(path)
    with replacing(path, overwrite) as temporary:
        vertices, faces = free_border(space)
        with temporary.open("wb") as file:
            writer(file, vertices, faces)
