"""COLLADA: the triangles of a scene, where its nodes put them, in metres."""

# COLLADA is read here because pycollada drops what it does not know and warns on NumPy 2.5.

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element

import numpy as np

from cspace.arrays import Floats, Ints, Surface
from cspace.files.access import Fault, read_bytes
from cspace.files.plain import parse_xml
from cspace.files.polygons import joined, placed, triangulated, unfolded, unread
from cspace.limits import check_bytes

Named = dict[str, Element | None]
"""Elements by their ids; none where two have one."""

_LEFT: Final = frozenset(["asset", "extra", "evaluate_scene", "instance_camera", "instance_light"])
"""Children of a node that have no shape."""

_DEEPEST: Final = 256

_PLACES: Final = 100_000
"""Places of a scene, at most, beyond the elements of the file: a few nodes that hold others unfold into any number."""

_WITHOUT_SURFACE: Final = frozenset(["source", "vertices", "extra", "lines", "linestrips"])
"""Children of a mesh that have no surface."""


def read_collada(file: Path) -> Surface:
    """Triangles of the file's scene, its unit turned into metres, its axes as they are; lines are left.

    Raises FileError if the file is truncated or malformed, and GeometryError if there is a surface that is not read, or
    a polygon can be cut in several ways.
    """
    root = parse_xml(read_bytes(file, "mesh", memory=20.0))
    for element in root.iter():
        element.tag = str(element.tag).rpartition("}")[2]
    if root.tag != "COLLADA":
        raise Fault(f"holds {root.tag}, not COLLADA")
    named: Named = {}
    for element in root.iter():
        if name := element.get("id"):
            named[name] = None if name in named else element
    unit = root.find("asset/unit")
    metres = float(unit.get("meter", "1")) if unit is not None else 1.0
    if not (math.isfinite(metres) and metres > 0.0):
        raise Fault(f"has a unit of {metres:g} metres")
    instance = root.find("scene/instance_visual_scene")
    if instance is None:
        raise unread("no scene that is shown; its geometries stand nowhere", "export it again with its scene")
    scene = _target(instance, named)
    if scene.tag != "visual_scene":
        raise Fault(f"names {scene.tag} as its scene")
    places: list[tuple[Element, Floats]] = []
    visits, most = 0, _PLACES + sum(1 for _ in root.iter())
    pending: list[tuple[Element, Floats, tuple[Element, ...]]] = [
        (child, np.diag([metres, metres, metres, 1.0]), ()) for child in reversed(list(scene))
    ]
    while pending:
        element, above, path = pending.pop()
        visits += 1
        if visits > most or len(path) > _DEEPEST:
            raise Fault(f"puts nodes into nodes, {len(path)} deep, and {visits} in all or more")
        if element.tag in _LEFT:
            continue
        if element.tag == "instance_node":
            element = _target(element, named)
        if element.tag == "node":
            if element in path:
                raise Fault(f"has the node {element.get('id')!r} within itself")
            transform, shapes = _local(element)
            pending += [(child, above @ transform, (*path, element)) for child in reversed(shapes)]
        elif element.tag == "instance_geometry":
            places.append((_target(element, named), above))
        else:
            raise unread(f"a {element.tag} in its scene")
    arrays: dict[Element, Floats] = {}
    known = {each: _surfaces(each, named, arrays) for each in dict.fromkeys(each for each, _ in places)}
    sizes = {each: sum(unfolded(len(points), len(faces)) for points, faces in known[each]) for each in known}
    check_bytes(file, sum(sizes[each] for each, _ in places), "unfolds to", memory=3.0)
    return joined([placed(surface, above) for each, above in places for surface in known[each]])


def _target(instance: Element, named: Named) -> Element:
    url = instance.get("url", "")
    if not url.startswith("#"):
        raise unread(f"a {instance.tag} of another file ({url!r})", "export it again as one file")
    target = named.get(url[1:])
    if target is None:
        raise Fault(f"names {url!r}, which is not there, or there twice")
    return target


def _local(node: Element) -> tuple[Floats, list[Element]]:
    """Transform of a node in its parent, and the children that are no transforms."""
    transform, shapes = np.eye(4), []
    for child in node:
        if child.tag in ("lookat", "skew"):
            raise unread(f"a node with the transform {child.tag}", "export it again with matrices")
        if child.tag not in _TRANSFORMS:
            shapes.append(child)
            continue
        size, matrix = _TRANSFORMS[child.tag]
        numbers = np.array((child.text or "").split(), dtype=np.float64)
        if len(numbers) != size:
            raise Fault(f"has a {child.tag} of {len(numbers)} numbers; it has {size}")
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


def _surfaces(geometry: Element, named: Named, arrays: dict[Element, Floats]) -> list[Surface]:
    """Surfaces of a geometry, one for each of its primitives."""
    surfaces = []
    for shape in geometry:
        if shape.tag in ("asset", "extra"):
            continue
        if shape.tag != "mesh":
            raise unread(f"a geometry that is a {shape.tag}")
        surfaces += [_primitive(part, named, arrays) for part in shape if part.tag not in _WITHOUT_SURFACE]
    return surfaces


def _primitive(part: Element, named: Named, arrays: dict[Element, Floats]) -> Surface:
    lists = [_corners(p, part) for p in part.findall("p")]
    corners = np.concatenate([np.empty(0, dtype=np.int64), *lists])
    count = int(part.get("count", "0"))
    points = _positions(part, named, arrays) if count else np.empty((0, 3))
    if part.find("ph") is not None:
        raise unread("a polygon with holes")
    if part.tag == "triangles":
        if len(corners) != 3 * count:
            raise Fault(f"declares {count} triangles and holds {len(corners)} corners of them")
        sizes = np.full(count, 3)
    elif part.tag == "polylist":
        counts = part.find("vcount")
        sizes = _integers(counts) if counts is not None else np.empty(0, dtype=np.int64)
    elif part.tag == "polygons":
        sizes = np.array(list(map(len, lists)), dtype=np.int64)
    else:
        raise unread(f"a mesh with {part.tag}")
    if len(sizes) != count:
        raise Fault(f"declares {count} {part.tag} and holds {len(sizes)}")
    return points, triangulated(points, corners, sizes)


def _inputs(element: Element, semantic: str) -> list[Element]:
    return [given for given in element.findall("input") if given.get("semantic") == semantic]


def _corners(p: Element, part: Element) -> Ints:
    """Vertex numbers of a list, in which other numbers stand between them."""
    stride = 1 + max((int(given.get("offset", "0")) for given in part.findall("input")), default=0)
    given = _inputs(part, "VERTEX")
    numbers = _integers(p)
    if len(given) != 1 or len(numbers) % stride:
        raise Fault(f"has {part.tag} with {len(given)} inputs VERTEX and {len(numbers)} numbers, {stride} each")
    return numbers[int(given[0].get("offset", "0")) :: stride]


def _positions(part: Element, named: Named, arrays: dict[Element, Floats]) -> Floats:
    """Points of the vertices that a primitive names; ``arrays`` are those whose text was read before."""
    vertices = [_source(given, named) for given in _inputs(part, "VERTEX")]
    sources = [_source(given, named) for element in vertices for given in _inputs(element, "POSITION")]
    if len(sources) != 1:
        raise Fault(f"has {part.tag} with {len(sources)} sources of positions; they have one")
    accessor = sources[0].find("technique_common/accessor")
    if accessor is None:
        raise Fault("has a source of positions without an accessor")
    array = _source(accessor, named)
    if array.tag not in ("float_array", "int_array"):
        raise Fault(f"has positions in {array.tag}")
    values = arrays.get(array)
    if values is None:
        values = arrays[array] = np.array((array.text or "").split(), dtype=np.float64)
    count, stride = int(accessor.get("count", "0")), int(accessor.get("stride", "1"))
    first = int(accessor.get("offset", "0"))
    columns = [i for i, param in enumerate(accessor.findall("param")) if param.get("name")]
    names = [param.get("name") for param in accessor.findall("param") if param.get("name")]
    if names != ["X", "Y", "Z"] or columns[-1] >= stride or first < 0 or count < 0:
        raise Fault(f"has positions with the columns {names}; they are X, Y, Z")
    if len(values) != int(array.get("count", len(values))) or len(values) < first + count * stride:
        raise Fault(f"has {len(values)} numbers of positions, and declares more or fewer")
    return values[first : first + count * stride].reshape(count, stride)[:, columns]


def _source(given: Element, named: Named) -> Element:
    name = given.get("source", "")
    source = named.get(name[1:]) if name.startswith("#") else None
    if source is None:
        raise Fault(f"names the source {name!r}, which is not in it, or in it twice")
    return source


def _integers(element: Element) -> Ints:
    try:
        return np.array((element.text or "").split(), dtype=np.int64)
    except ValueError as error:
        raise Fault(f"has a {element.tag} with something else than whole numbers ({error})") from error
