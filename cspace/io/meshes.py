"""Meshes from files, and from the objects of trimesh."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import CspaceError, GeometryError, InputError
from cspace.grid import finite
from cspace.io.input import existing, unreadable
from cspace.io.surfaces.collada import read_collada
from cspace.io.surfaces.gltf import read_gltf
from cspace.io.surfaces.obj import read_obj
from cspace.io.surfaces.off import read_off
from cspace.io.surfaces.parts import Floats, Integers, Surface, check_corners, damaged, joined, placed
from cspace.io.surfaces.ply import read_ply
from cspace.io.surfaces.stl import read_stl

_READERS: Final[dict[str, Callable[[Path], Surface]]] = {
    ".stl": read_stl,
    ".obj": read_obj,
    ".ply": read_ply,
    ".off": read_off,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".dae": read_collada,
}
"""Which function reads a file, by suffix."""

SUFFIXES: Final = tuple(_READERS)
"""Formats that are read."""

_KIND: Final = "mesh"


def read_mesh(path: str | os.PathLike[str]) -> tuple[Floats, Integers]:
    """Read the triangles of a file.

    The parts of a scene are put where its transforms say, and joined. Coordinates are metres: those of ``.glb`` and
    ``.gltf`` are by definition, those of ``.dae`` are turned into metres from the unit that the file names, and those
    of the other formats, which name none, are taken to be. Axes are left as they are, whichever the file may call up.

    Nothing is mended or merged, and nothing of a surface is left out: a file with a part that is not read is refused.
    So is a polygon with more than three corners if its triangles are not certain, because the corners are out of one
    plane by more than rounding, or because no fan around one of them covers it. Lines and points are left out in
    ``.obj``, ``.ply`` and ``.dae``, which often hold them besides; they are refused in ``.glb`` and ``.gltf``.

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
        If the file is missing, cannot be read, is malformed or is truncated.
    GeometryError
        If the file has no triangles, has surfaces that are not read, or has polygons that can be cut in several ways.
    """
    file = existing(path, _KIND)
    suffix = file.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(
            f"{file} ends in {suffix!r}; the suffix says how a mesh is read; use one of {', '.join(SUFFIXES)}"
        )
    try:
        vertices, faces = _READERS[suffix](file)
    except (MemoryError, CspaceError):
        raise
    except OSError as error:
        raise unreadable(file, _KIND, error) from error
    except Exception as error:  # What damage leads to may be anything.
        raise damaged(file, f"cannot be read as a {_KIND} ({type(error).__name__}: {error})") from error
    if not len(faces):
        raise _without_triangles(str(file), "cloud of points" if len(vertices) else "")
    finite(vertices, f"vertices of {file}")
    check_corners(faces, len(vertices), file)
    return vertices, np.ascontiguousarray(faces)


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
        parts = [(shape.geometry[part], transform) for transform, part in _placed(shape)]
    elif isinstance(shape, trimesh.parent.Geometry):
        parts = [(shape, np.eye(4))]
    else:
        raise InputError(
            f"{name} is a {type(shape).__name__}; a mesh is needed; pass a file name, a trimesh.Trimesh, a "
            "trimesh.Scene, or vertices and faces"
        )
    surfaces = []
    for part, transform in parts:
        if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
            what = "cloud of points" if isinstance(part, trimesh.PointCloud) else "part without triangles"
            if len(parts) > 1:
                raise GeometryError(
                    f"{name} has a {what} ({type(part).__name__}) among its meshes; it would be lost; remove it, or "
                    "pass the meshes alone"
                )
            raise _without_triangles(name, f"{what} ({type(part).__name__})")
        points = finite(part.vertices, f"vertices of {name}")
        surfaces.append(placed((points, np.asarray(part.faces, dtype=np.int64)), transform))
    if not surfaces:
        raise _without_triangles(name, "")
    return joined(surfaces)


def _without_triangles(name: str, what: str) -> GeometryError:
    if not what:
        return GeometryError(f"{name} is empty; a mesh needs triangles; check what was exported")
    return GeometryError(
        f"{name} is a {what}; a mesh needs triangles; for points use Workspace.from_points, or make a mesh of it first"
    )


def _placed(scene: Any) -> list[tuple[NDArray[np.float64], str]]:
    """Transform and name of each part of a scene, once for each place where it stands."""
    return [scene.graph[node] for node in scene.graph.nodes_geometry]
