"""Meshes of COLLADA: sources of numbers, and primitives that name them."""

from __future__ import annotations

from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from cspace.io.surfaces.parts import (
    Floats,
    Integers,
    Surface,
    check_corners,
    damaged,
    fan_of,
    strip_of,
    unread,
)
from cspace.io.surfaces.polygons import triangulated

Named = dict[str, Element | None]

_LEFT: Final = frozenset(["source", "vertices", "extra", "lines", "linestrips"])
"""Children of a mesh that have no surface."""

_RUNS: Final = {"tristrips": strip_of, "trifans": fan_of}
"""Triangles of each list of corners."""


def mesh_surfaces(geometry: Element, named: Named, file: Path) -> list[Surface]:
    """Surfaces of a geometry, one for each of its primitives.

    Parameters
    ----------
    geometry : Element
    named : dict of Element
        By their ids; none where two have one.
    file : Path
        For messages.

    Raises
    ------
    FileError
        If something is missing or malformed.
    GeometryError
        If there is a surface that is not read.
    """
    surfaces = []
    for shape in geometry:
        if shape.tag in ("asset", "extra"):
            continue
        if shape.tag != "mesh":
            raise unread(file, f"a geometry that is a {shape.tag}")
        surfaces += [_primitive(part, named, file) for part in shape if part.tag not in _LEFT]
    return surfaces


def _primitive(part: Element, named: Named, file: Path) -> Surface:
    lists = [_corners(p, part, file) for p in part.findall("p")]
    corners = np.concatenate([np.empty(0, dtype=np.int64), *lists])
    count = int(part.get("count", "0"))
    points = _positions(part, named, file) if count else np.empty((0, 3))
    check_corners(corners, len(points), file)
    if part.tag == "triangles":
        if len(corners) != 3 * count:
            raise damaged(file, f"declares {count} triangles and holds {len(corners)} corners of them")
        return points, corners.reshape(-1, 3)
    if part.tag == "polylist":
        counts = part.find("vcount")
        sizes = _integers(counts, file) if counts is not None else np.empty(0, dtype=np.int64)
    elif part.tag in ("polygons", *_RUNS):
        if part.find("ph") is not None:
            raise unread(file, "a polygon with holes")
        sizes = np.array(list(map(len, lists)), dtype=np.int64)
    else:
        raise unread(file, f"a mesh with {part.tag}")
    if len(sizes) != count:
        raise damaged(file, f"declares {count} {part.tag} and holds {len(sizes)}")
    if part.tag not in _RUNS:
        return points, triangulated(points, corners, sizes, file)
    if count and int(sizes.min()) < 3:
        raise damaged(file, f"has {part.tag} of {int(sizes.min())} corners; they have three or more")
    faces = [_RUNS[part.tag](run) for run in lists]
    return points, np.concatenate([np.empty((0, 3), dtype=np.int64), *faces])


def _inputs(element: Element, semantic: str) -> list[Element]:
    return [given for given in element.findall("input") if given.get("semantic") == semantic]


def _corners(p: Element, part: Element, file: Path) -> Integers:
    """Vertex numbers of a list, in which other numbers stand between them."""
    stride = 1 + max((int(given.get("offset", "0")) for given in part.findall("input")), default=0)
    given = _inputs(part, "VERTEX")
    numbers = _integers(p, file)
    if len(given) != 1 or len(numbers) % stride:
        raise damaged(file, f"has {part.tag} with {len(given)} inputs VERTEX and {len(numbers)} numbers, {stride} each")
    return numbers[int(given[0].get("offset", "0")) :: stride]


def _positions(part: Element, named: Named, file: Path) -> Floats:
    """Points of the vertices that a primitive names."""
    vertices = [_source(given, named, file) for given in _inputs(part, "VERTEX")]
    sources = [_source(given, named, file) for element in vertices for given in _inputs(element, "POSITION")]
    if len(sources) != 1:
        raise damaged(file, f"has {part.tag} with {len(sources)} sources of positions; they have one")
    accessor = sources[0].find("technique_common/accessor")
    if accessor is None:
        raise damaged(file, "has a source of positions without an accessor")
    array = _source(accessor, named, file)
    if array.tag not in ("float_array", "int_array"):
        raise damaged(file, f"has positions in {array.tag}")
    values = np.array((array.text or "").split(), dtype=np.float64)
    count, stride = int(accessor.get("count", "0")), int(accessor.get("stride", "1"))
    first = int(accessor.get("offset", "0"))
    columns = [i for i, param in enumerate(accessor.findall("param")) if param.get("name")]
    names = [param.get("name") for param in accessor.findall("param") if param.get("name")]
    if names != ["X", "Y", "Z"] or columns[-1] >= stride or first < 0 or count < 0:
        raise damaged(file, f"has positions with the columns {names}; they are X, Y, Z")
    if len(values) != int(array.get("count", len(values))) or len(values) < first + count * stride:
        raise damaged(file, f"has {len(values)} numbers of positions, and declares more or fewer")
    return values[first : first + count * stride].reshape(count, stride)[:, columns]


def _source(given: Element, named: Named, file: Path) -> Element:
    name = given.get("source", "")
    source = named.get(name[1:]) if name.startswith("#") else None
    if source is None:
        raise damaged(file, f"names the source {name!r}, which is not in it, or in it twice")
    return source


def _integers(element: Element, file: Path) -> Integers:
    try:
        return np.array((element.text or "").split(), dtype=np.int64)
    except ValueError as error:
        raise damaged(file, f"has a {element.tag} with something else than whole numbers ({error})") from error
