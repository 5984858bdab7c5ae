"""Shapes of the links of a URDF."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import Floats, Surface
from cspace.check import check_point, finite, positive
from cspace.errors import InputError, warn_user
from cspace.files.meshes import read_mesh
from cspace.files.polygons import joined, placed
from cspace.files.urdf import (
    GEOMETRIES,
    PackageDirs,
    find_meshes,
    fixed_links,
    load_urdf,
    package_folders,
    root_link,
    zero_poses,
)
from cspace.shapes.bounded import BoundedShape, Pair, capsule, cylinder
from cspace.shapes.mesh import Mesh, Solid
from cspace.shapes.shape import Shape
from cspace.shapes.voxels import Box

if TYPE_CHECKING:
    from yourdfpy import URDF


def read_urdf(
    path: str | os.PathLike[str],
    link: str | Sequence[str] | None = None,
    package_dirs: PackageDirs = (),
    primitives: bool = True,
) -> list[Surface]:
    """Read the surface of a robot's collision geometry, in the frame of the first link, metres.

    Links are those of :meth:`cspace.Robot.from_urdf`. If something is curved, return two surfaces: one around it and
    one within. Without ``primitives``, only meshes are taken, and anything else is refused.

    Raises FileError if the file or a mesh is missing or malformed; InputError if there is no such link, the links have
    no collision geometry, or a size is not above zero; and MissingPackageError if yourdfpy is not installed.
    """
    folders = package_folders(package_dirs)
    file = os.fspath(path)
    urdf = load_urdf(path)
    base, rigid = root_link(urdf), fixed_links(urdf)
    links = rigid if link is None else [link] if isinstance(link, str) else list(link)
    for name in links:
        if name not in urdf.link_map:
            raise InputError(
                "link", f"is {name!r}", f"{file} has {', '.join(urdf.link_map)}", "name one of these", value=name
            )
    pairs, meshes, poses = [], find_meshes(urdf, links, path, folders), zero_poses(urdf)
    for name in links:
        pose: Floats = np.linalg.solve(poses[links[0]], poses[name]).astype(np.float64)
        for number, collision in enumerate(urdf.link_map[name].collisions):
            place = f"{file}: link {name!r}, collision {number}"
            if not primitives and collision.geometry.mesh is None:
                raise InputError(
                    "solid",
                    f"is 'surface', and {place} is a box, a cylinder or a sphere, which is solid",
                    "only a mesh can be a surface without an inside",
                    "leave it out, or name links that have only meshes",
                    value="surface",
                )
            transform = pose if collision.origin is None else pose @ finite(collision.origin, f"{place}: origin")
            outer, inner = _sides(collision.geometry, meshes, place)
            moved = placed(outer, transform)
            pairs.append((moved, moved if inner is outer else placed(inner, transform)))
    has_shape = [name for name in urdf.link_map if urdf.link_map[name].collisions]
    if not pairs:
        mend = f"name links that have: {', '.join(has_shape)}" if has_shape else "add <collision> to its links"
        raise InputError(
            "link", f"is {', '.join(links) or 'not there'}", "no such link has collision geometry", mend, value=link
        )
    if link is None and (left := [name for name in has_shape if name not in rigid]):
        warn_user(
            f"{file}: {', '.join(left)} move against {base} and are left out; name all the links that you want, and "
            "they are put where their joints are at zero"
        )
    curved = any(outer is not inner for outer, inner in pairs)
    return [joined(side) for side in list(zip(*pairs, strict=True))[: 1 + curved]]


def shapes_of(
    urdf: URDF, link: str, path: str | os.PathLike[str], meshes: Mapping[str, Path], solid: Solid
) -> Iterator[tuple[Shape, Floats]]:
    """Yield the shapes of a link's collision geometry, each with its pose in the frame of the link, shape (4, 4).

    ``meshes`` are the files from :func:`find_meshes`; ``solid`` says what of them has an inside.

    Raises FileError if a mesh is malformed, and InputError if a size is not above zero.
    """
    for number, collision in enumerate(urdf.link_map[link].collisions):
        place = f"{os.fspath(path)}: link {link!r}, collision {number}"
        surface, within = _sides(collision.geometry, meshes, place)
        outer = Mesh(*surface, solid if collision.geometry.mesh is not None else "auto", place)
        outer.warn_if_open(fills=False)
        shape = outer if within is surface else BoundedShape(outer, Mesh.of(within))
        yield shape, np.eye(4) if collision.origin is None else finite(collision.origin, f"{place}: origin")


def _sides(geometry: Any, meshes: Mapping[str, Path], place: str) -> Pair:
    """A surface around a collision geometry, and one within; the same one where it is not curved."""
    kind = next(name for name in GEOMETRIES if getattr(geometry, name) is not None)
    return _SHAPES[kind](getattr(geometry, kind), meshes, f"{place}: {kind}")


def _box(box: Any, meshes: Mapping[str, Path], place: str) -> Pair:
    sides = check_point(box.size, f"{place}: size", 3).tolist()
    surface = Box.of([positive(side, f"{place}: size") for side in sides]).surface
    return surface, surface


def _mesh(mesh: Any, meshes: Mapping[str, Path], place: str) -> Pair:
    scale = finite(np.broadcast_to(1.0 if mesh.scale is None else mesh.scale, 3), f"{place}: scale")
    if not scale.all():
        raise InputError(f"{place}: scale", f"is {scale.tolist()}", "no factor may be zero", "correct it", value=scale)
    surface = placed(read_mesh(meshes[str(mesh.filename)]), np.diag([*scale, 1.0]))
    return surface, surface


def _round(make: Callable[..., Pair], names: Sequence[str], shape: Any, meshes: Mapping[str, Path], place: str) -> Pair:
    return make(*(positive(getattr(shape, name), f"{place}: {name}") for name in names))


_SHAPES: Final[Mapping[str, Callable[[Any, Mapping[str, Path], str], Pair]]] = {
    "box": _box,
    "cylinder": partial(_round, cylinder, ("radius", "length")),
    "sphere": partial(_round, partial(capsule, length=0.0), ("radius",)),
    "mesh": _mesh,
}
"""What makes the surfaces of a geometry, by its name."""
