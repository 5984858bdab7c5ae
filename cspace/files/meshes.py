"""Meshes from files, and from the objects of trimesh: all triangles that a file holds, or an error that names it.

PLY, GLB and glTF are read by trimesh, with ``process=False``, and counted: a census of the file, made apart from the
reading, must agree with what was read. STL, OBJ, OFF and COLLADA are read here. Of STL the census is the reading.
trimesh moves triangles of OBJ where corners count backwards or are written in more than one way, loses those of lines
that begin with a blank, and lays polygons that bend as fans that stick out of them; COLLADA it reads through a package
that drops what it does not know, and without its unit.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import numpy as np

from cspace.arrays import Floats, Ints, Surface
from cspace.check import finite
from cspace.errors import GeometryError, InputError
from cspace.files.access import Fault, decoding, existing, numbers_of, read_bytes, suffix_of
from cspace.files.collada import read_collada
from cspace.files.gltf import load_gltf
from cspace.files.ply import read_ply
from cspace.files.polygons import joined, placed, read_obj, read_off, triangulated

# What trimesh logs of a bad file is said by the one error that is raised for it.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

_KIND: Final = "mesh"

_RECORD: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle in a binary STL file, after a head of 84 bytes."""

_FACET: Final = re.compile(
    rb"\bfacet normal \S+ \S+ \S+ outer loop" + 3 * rb" vertex (\S+) (\S+) (\S+)" + rb" endloop endfacet\b"
)
_SOLIDS: Final = re.compile(rb"^[ \t]*(end)?solid\b[^\n]*", re.MULTILINE)


def read_mesh(path: str | os.PathLike[str]) -> tuple[Floats, Ints]:
    """Vertices, shape (V, 3), metres, and triangles, shape (F, 3), of a file; its suffix says how it is read.

    The parts of a scene are put where its transforms say, and joined. Coordinates are metres: those of ``.glb`` and
    ``.gltf`` are by definition, those of ``.dae`` are turned into metres from the unit that the file names, and those
    of the other formats, which name none, are taken to be. Axes are left as they are, whichever the file may call up.

    Nothing is mended or merged, and nothing of a surface is left out: a file with a part that is not read is refused
    with GeometryError. So is a polygon with more than three corners if its triangles are not certain, because the
    corners are out of one plane by more than rounding, or because no fan around one of them covers it. Lines and
    points are left out in ``.obj``, ``.ply`` and ``.dae``, which often hold them besides; they are refused in
    ``.glb`` and ``.gltf``. An ``.obj`` that is cut between two lines, or within its very last number, cannot be told
    from a whole one: nothing in it counts.
    """
    file = existing(path, _KIND)
    suffix = suffix_of(file, _READERS, "the suffix says how a mesh is read", "mesh")
    with decoding(file, _KIND):
        vertices, faces = _READERS[suffix](file)
        if not len(faces):
            raise _without_triangles(str(file), "cloud of points" if len(vertices) else "")
        finite(vertices, f"vertices of {file}")
        wrong = faces[(faces < 0) | (faces >= len(vertices))]
        if len(wrong):
            raise Fault(f"has a face that names vertex {wrong[0]}, counted from 0, of {len(vertices)}")
    return vertices, np.ascontiguousarray(faces)


def _stl(file: Path) -> Surface:
    """Triangles of an STL file, three vertices of their own each."""
    data = read_bytes(file, _KIND, memory=12.0)
    declared = int.from_bytes(data[80:84], "little")
    if len(data) == 84 + _RECORD.itemsize * declared and len(data) >= 84:
        vertices = np.frombuffer(data, _RECORD, declared, 84)["corners"].reshape(-1, 3).astype(np.float64)
    elif data.lstrip()[:5].lower() == b"solid":
        vertices = _stl_text(data)
    else:
        held = max(0.0, (len(data) - 84) / _RECORD.itemsize)
        raise Fault(f"declares {declared} triangles and has bytes for {held:g}, as a binary STL file")
    return vertices, np.arange(len(vertices), dtype=np.int64).reshape(-1, 3)


def _stl_text(data: bytes) -> Floats:
    """The corners of the triangles of an STL file in text."""
    text = data.lower().replace(b"\r", b"\n")
    lines = list(_SOLIDS.finditer(text))
    kinds = [bool(line[1]) for line in lines]
    if not kinds or kinds != [False, True] * (len(kinds) // 2) or text[lines[-1].end() :].strip(b" \t\n\0"):
        raise Fault("does not go from solid to endsolid, as an STL file in text does")
    if b"\0" in text[: lines[-1].end()]:  # which numbers would end with
        raise Fault("is not text")
    if any(b"endfacet" in line[0] for line in lines):
        raise Fault("has facets on a line of solid or endsolid; they need lines of their own")
    text = b" ".join(_SOLIDS.sub(b"", text).split())  # patterns that look for blanks take the square of a long run
    facets = _FACET.findall(text)
    counts = [text.count(word) for word in (b"facet", b"normal", b"vertex")]
    if counts != [2 * len(facets), len(facets), 3 * len(facets)]:
        raise Fault(f"has words of facets beside its {len(facets)} whole ones")
    return numbers_of([word for facet in facets for word in facet], float).reshape(-1, 3)


def _gltf(file: Path) -> Surface:
    """Triangles of a glTF scene, each mesh where its nodes put it: refused where it declares more or fewer."""
    scene, declared = load_gltf(file)
    vertices, faces = flattened(scene, str(file)) if declared else joined([])
    if len(faces) != declared:
        fault, rule = f"holds {declared} triangles, and {len(faces)} were read", "none may be lost or made up"
        raise Fault(fault, rule, "write it again as binary STL", value=(declared, len(faces)))
    return vertices, faces


def _ply(file: Path) -> Surface:
    vertices, corners, sizes = read_ply(file)
    return vertices, triangulated(vertices, corners, sizes)


_READERS: Final[dict[str, Callable[[Path], Surface]]] = {
    ".stl": _stl,
    ".obj": read_obj,
    ".ply": _ply,
    ".off": read_off,
    ".glb": _gltf,
    ".gltf": _gltf,
    ".dae": read_collada,
}
"""Which function reads a file, by suffix."""

SUFFIXES: Final = tuple(_READERS)
"""Formats that are read."""


def flattened(shape: Any, name: str) -> tuple[Floats, Ints]:
    """Vertices and faces of a trimesh.Trimesh or trimesh.Scene, whose parts are placed and joined.

    Raises InputError if it is something else, or a coordinate is not finite, and GeometryError if there are no
    triangles, or something else besides; ``name`` is what messages call it.
    """
    import trimesh

    if isinstance(shape, trimesh.Scene):
        parts = [(shape.geometry[part], transform) for transform, part in _placed(shape)]
    elif isinstance(shape, trimesh.parent.Geometry):
        parts = [(shape, np.eye(4))]
    else:
        raise InputError(
            name,
            f"is a {type(shape).__name__}",
            "a mesh is needed",
            "pass a file name, a trimesh.Trimesh, a trimesh.Scene, or vertices and faces",
            value=shape,
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
                    value=part,
                )
            raise _without_triangles(name, f"{what} ({type(part).__name__})")
        points = finite(part.vertices, f"vertices of {name}")
        surfaces.append(placed((points, np.asarray(part.faces, dtype=np.int64)), transform))
    if not surfaces:
        raise _without_triangles(name, "")
    return joined(surfaces)


def _placed(scene: Any) -> list[tuple[Floats, str]]:
    """Transform and name of each part of a scene, once for each place where it stands."""
    return [scene.graph[node] for node in scene.graph.nodes_geometry]


def _without_triangles(name: str, what: str) -> GeometryError:
    if not what:
        return GeometryError(name, "is empty", "a mesh needs triangles", "check what was exported")
    return GeometryError(
        name,
        f"is a {what}",
        "a mesh needs triangles",
        "for points use Workspace.from_points, or make a mesh of it first",
    )
