"""Meshes from files, and from the objects of trimesh: all triangles that a file holds, or an error that names it.

The files are read here, and what each declares is held against what it has: trimesh moves triangles of OBJ where
corners count backwards, drops those of other layouts, lays polygons that bend as fans that stick out of them, and
passes over much of PLY, glTF and COLLADA without a word.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from cspace.errors import GeometryError, InputError
from cspace.grid import finite
from cspace.io.collada import read_collada
from cspace.io.gltf import read_gltf
from cspace.io.input import by_suffix, decoding
from cspace.io.obj import read_obj
from cspace.io.off import read_off
from cspace.io.ply import read_ply
from cspace.io.polygons import Floats, Integers, Surface, joined, placed, triangulated
from cspace.io.stl import read_stl


def read_mesh(path: str | os.PathLike[str]) -> tuple[Floats, Integers]:
    """Read the triangles of a file.

    The parts of a scene are put where its transforms say, and joined. Coordinates are metres: those of ``.glb`` and
    ``.gltf`` are by definition, those of ``.dae`` are turned into metres from the unit that the file names, and those
    of the other formats, which name none, are taken to be. Axes are left as they are, whichever the file may call up.

    Nothing is mended or merged, and nothing of a surface is left out: a file with a part that is not read is refused.
    So is a polygon with more than three corners if its triangles are not certain, because the corners are out of one
    plane by more than rounding, or because no fan around one of them covers it. Lines and points are left out in
    ``.obj``, ``.ply`` and ``.dae``, which often hold them besides; they are refused in ``.glb`` and ``.gltf``. An
    ``.obj`` that is cut between two lines, or within its very last number, cannot be told from a whole one: nothing in
    it counts.

    Parameters
    ----------
    path : path-like
        ``.stl``, ``.obj``, ``.ply``, ``.off``, ``.glb``, ``.gltf`` or ``.dae``.

    Returns
    -------
    vertices : ndarray of float64, shape (V, 3)
        Metres.
    faces : ndarray of int64, shape (F, 3)

    Raises
    ------
    InputError
        If ``path`` is not a file name or ends otherwise, or a coordinate is not finite.
    FileError
        If the file is missing, too large, cannot be read, is malformed or is truncated, or other triangles were read
        than it holds.
    GeometryError
        If the file has no triangles, has surfaces that are not read, or has polygons that can be cut in several ways.
    """
    read = by_suffix(path, _READERS, "the suffix says how a mesh is read", "mesh")
    file = Path(path)
    with decoding(file, "mesh"):
        vertices, faces = read(file)
    if not len(faces):
        raise _without_triangles(str(file), "cloud of points" if len(vertices) else "")
    return finite(vertices, f"vertices of {file}"), np.ascontiguousarray(faces)


def _ply(file: Path) -> Surface:
    vertices, corners, sizes = read_ply(file)
    return vertices, triangulated(vertices, corners, sizes, file)


_READERS: Final[dict[str, Callable[[Path], Surface]]] = {
    ".stl": read_stl,
    ".obj": read_obj,
    ".ply": _ply,
    ".off": read_off,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".dae": read_collada,
}
"""Which function reads a file, by suffix."""

SUFFIXES: Final = tuple(_READERS)
"""Formats that are read."""


def flattened(shape: Any, name: str) -> tuple[Floats, Integers]:
    """Vertices and faces of a trimesh object, the parts of a scene placed and joined.

    Parameters
    ----------
    shape : trimesh.Trimesh or trimesh.Scene
    name : str
        What to call it in messages.

    Returns
    -------
    vertices : ndarray of float64, shape (V, 3)
    faces : ndarray of int64, shape (F, 3)

    Raises
    ------
    InputError
        If ``shape`` is something else, or a coordinate is not finite.
    GeometryError
        If there are no triangles, or something else besides.
    """
    import trimesh

    if isinstance(shape, trimesh.Scene):
        nodes = (shape.graph[node] for node in shape.graph.nodes_geometry)
        parts = [(shape.geometry[part], transform) for transform, part in nodes]
    elif isinstance(shape, trimesh.parent.Geometry):
        parts = [(shape, np.eye(4))]
    else:
        raise InputError(
            name,
            f"is a {type(shape).__name__}",
            "a mesh is needed",
            "pass a file name, a trimesh.Trimesh, a trimesh.Scene, or vertices and faces",
        )
    surfaces = []
    for part, transform in parts:
        if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
            what = "cloud of points" if isinstance(part, trimesh.PointCloud) else "part without triangles"
            if len(parts) > 1:
                raise GeometryError(
                    name,
                    f"has a {what} ({type(part).__name__}) among its meshes",
                    "it would be lost",
                    "remove it, or pass the meshes alone",
                )
            raise _without_triangles(name, f"{what} ({type(part).__name__})")
        points = finite(part.vertices, f"vertices of {name}")
        surfaces.append(placed((points, np.asarray(part.faces, dtype=np.int64)), transform))
    if not surfaces:
        raise _without_triangles(name, "")
    return joined(surfaces)


def _without_triangles(name: str, what: str) -> GeometryError:
    if not what:
        return GeometryError(name, "is empty", "a mesh needs triangles", "check what was exported")
    return GeometryError(
        name,
        f"is a {what}",
        "a mesh needs triangles",
        "for points use Workspace.from_points, or make a mesh of it first",
    )
