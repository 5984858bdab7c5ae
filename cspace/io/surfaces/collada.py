"""COLLADA: the triangles of a scene, where its nodes put them, in metres."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np

from cspace.io.surfaces.collada_meshes import Named, mesh_surfaces
from cspace.io.surfaces.parts import Floats, Surface, damaged, joined, placed, unread

_LEFT: Final = frozenset(["asset", "extra", "evaluate_scene", "instance_camera", "instance_light"])
"""Children of a node that have no shape."""


def read_collada(file: Path) -> Surface:
    """Triangles of the file's scene, its unit turned into metres, its axes as they are; lines are left.

    Raises
    ------
    FileError
        If the file is truncated or malformed.
    GeometryError
        If there is a surface that is not read, or a polygon can be cut in several ways.
    """
    try:
        root = ElementTree.fromstring(file.read_bytes())
    except ElementTree.ParseError as error:
        raise damaged(file, f"is no XML ({error})") from error
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != "COLLADA":
        raise damaged(file, f"holds {root.tag}, not COLLADA")
    named: Named = {}
    for element in root.iter():
        if name := element.get("id"):
            named[name] = None if name in named else element
    unit = root.find("asset/unit")
    metres = float(unit.get("meter", "1")) if unit is not None else 1.0
    if not (math.isfinite(metres) and metres > 0.0):
        raise damaged(file, f"has a unit of {metres:g} metres")
    instance = root.find("scene/instance_visual_scene")
    if instance is None:
        raise unread(file, "no scene that is shown; its geometries stand nowhere", "export it again with its scene")
    scene = _target(instance, named, file)
    if scene.tag != "visual_scene":
        raise damaged(file, f"names {scene.tag} as its scene")
    parts: list[Surface] = []
    known: dict[Element, list[Surface]] = {}
    pending: list[tuple[Element, Floats, tuple[Element, ...]]] = [
        (child, np.diag([metres, metres, metres, 1.0]), ()) for child in reversed(list(scene))
    ]
    while pending:
        element, above, path = pending.pop()
        if element.tag in _LEFT:
            continue
        if element.tag == "instance_node":
            element = _target(element, named, file)
        if element.tag == "node":
            if element in path:
                raise damaged(file, f"has the node {element.get('id')!r} within itself")
            transform, shapes = _local(element, file)
            pending += [(child, above @ transform, (*path, element)) for child in reversed(shapes)]
        elif element.tag == "instance_geometry":
            geometry = _target(element, named, file)
            if geometry not in known:
                known[geometry] = mesh_surfaces(geometry, named, file)
            parts += [placed(surface, above) for surface in known[geometry]]
        else:
            raise unread(file, f"a {element.tag} in its scene")
    return joined(parts)


def _target(instance: Element, named: Named, file: Path) -> Element:
    url = instance.get("url", "")
    if not url.startswith("#"):
        raise unread(file, f"a {instance.tag} of another file ({url!r})", "export it again as one file")
    target = named.get(url[1:])
    if target is None:
        raise damaged(file, f"names {url!r}, which is not there, or there twice")
    return target


def _local(node: Element, file: Path) -> tuple[Floats, list[Element]]:
    """Transform of a node in its parent, and the children that are no transforms."""
    transform, shapes = np.eye(4), []
    for child in node:
        if child.tag in ("lookat", "skew"):
            raise unread(file, f"a node with the transform {child.tag}", "export it again with matrices")
        if child.tag not in _TRANSFORMS:
            shapes.append(child)
            continue
        size, matrix = _TRANSFORMS[child.tag]
        numbers = np.array((child.text or "").split(), dtype=np.float64)
        if len(numbers) != size:
            raise damaged(file, f"has a {child.tag} of {len(numbers)} numbers; it has {size}")
        transform = transform @ matrix(numbers)
    return transform, shapes


def _translation(offset: Floats) -> Floats:
    matrix = np.eye(4)
    matrix[:3, 3] = offset
    return matrix


def _rotation(values: Floats) -> Floats:
    """Turn about an axis by an angle in degrees (Rodrigues)."""
    length = float(np.linalg.norm(values[:3]))
    x, y, z = values[:3] / length if length > 0.0 else values[:3]
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.radians(values[3])
    matrix = np.eye(4)
    matrix[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * cross @ cross
    return matrix


_TRANSFORMS: Final[dict[str, tuple[int, Callable[[Floats], Floats]]]] = {
    "matrix": (16, lambda values: values.reshape(4, 4)),
    "translate": (3, _translation),
    "rotate": (4, _rotation),
    "scale": (3, lambda values: np.diag([*values, 1.0])),
}
"""How many numbers each transform of a node has, and its matrix."""
