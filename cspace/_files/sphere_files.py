"""Files of spheres that stand for the links of a robot."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from typing import Any, Final, TypeAlias
from xml.etree.ElementTree import Element, SubElement

from cspace._files.access import ContentError, check_suffix, decoding, read_bytes
from cspace._files.fields import Fields
from cspace._files.plain import parse_finite, parse_xml, read_json, read_yaml

Sphere: TypeAlias = tuple[list[float], float]
"""Center in the frame of a link, and radius, metres."""

SPHERE_SUFFIXES: Final = (".yaml", ".yml", ".json", ".srdf")
"""Suffixes of the files that are read."""

_KIND: Final = "file of spheres"
"""Kind of file, for messages."""

FIELDS: Final = (
    Fields(
        "`spheres=` of a URDF: cuRobo's `.yaml`, foam's `.json`, `.srdf`",
        honoured="centers and radii of the spheres of each link",
        refused="radii that are not above zero",
        warned="links that the URDF lacks",
    ),
)


def read_spheres(path: str | os.PathLike[str]) -> dict[str, list[Sphere]]:
    """Read the spheres of each link.

    Raises InputError for another suffix, and FileError if the file is missing or malformed.
    """
    suffix = check_suffix(path, SPHERE_SUFFIXES, "spheres are read from such files", "spheres")
    entries: Any
    if suffix == ".srdf":
        data = read_bytes(path, _KIND, 20.0, "max_description_bytes")
        with decoding(path, _KIND):
            entries = _list_srdf_links(parse_xml(data))
            return _convert_links(entries)
    if suffix == ".json":
        entries = read_json(path, _KIND, limit="max_description_bytes")
        with decoding(path, _KIND):
            links = _check_table(entries, "the file")
            entries = {name: _check_table(links[name], name).get("spheres") for name in links}
            return _convert_links(entries)
    entries = read_yaml(path, _KIND)
    with decoding(path, _KIND):
        # A description of a robot for cuRobo has the spheres two levels down.
        for key in ("robot_cfg", "kinematics", "collision_spheres"):
            entries = _check_table(entries, "the file").get(key, entries)
        return _convert_links(entries)


def _list_srdf_links(root: Element) -> dict[str, list[dict[str, Any]]]:
    """Return the attributes of the spheres of each link of an SRDF, with numbers parsed."""
    links: dict[str, list[dict[str, Any]]] = {}
    for approximation in root.findall("link_sphere_approximation"):
        spheres = links.setdefault(approximation.get("link", ""), [])
        for sphere in approximation.findall("sphere"):
            radius = parse_finite(sphere.get("radius", ""))
            spheres.append(
                {
                    "center": parse_finite(sphere.get("center", "")),
                    "radius": radius[0] if len(radius) == 1 else None,
                }
            )
    return links


def _check_table(value: Any, name: str) -> Mapping[str, Any]:
    """Return a table of a file, or raise ContentError."""
    if not isinstance(value, Mapping):
        raise ContentError(f"has no table of links, but {name} is a {type(value).__name__}")
    return value


def _convert_links(links: Any) -> dict[str, list[Sphere]]:
    """Check the spheres of all links, and return their centers and radii."""
    table = _check_table(links, "collision_spheres")
    converted = {
        name: [_convert_sphere(name, sphere) for sphere in spheres]
        for name, spheres in table.items()
        if isinstance(spheres, list)
    }
    for name in table:
        if not converted.get(name):
            raise ContentError(f"has no spheres of link {name!r}")
    if not converted:
        raise ContentError("has no spheres")
    return converted


def _convert_sphere(link: str, sphere: Any) -> Sphere:
    """Return the center and radius of a sphere; raise ContentError if they are not numbers."""
    entry = _check_table(sphere, link)
    center = entry.get("center", entry.get("origin"))
    radius: Any = entry.get("radius")
    numbers = [*center, radius] if isinstance(center, list) else []
    is_valid = len(numbers) == 4 and all(
        isinstance(number, int | float) and math.isfinite(number) for number in numbers
    )
    if not is_valid or radius <= 0.0:
        raise ContentError(
            f"has a sphere of link {link!r} with center {center!r} and radius {radius!r}",
            "a center is three finite numbers, and a radius one above zero",
            "correct that sphere",
        )
    *place, size = map(float, numbers)
    return place, size


def replace_geometry(root: Element, links: Mapping[str, Iterable[Sphere]]) -> None:
    """Replace the collision geometry of the links of a URDF by spheres."""
    for link in root.findall("link"):
        spheres = links.get(link.get("name", ""))
        if spheres is None:
            continue
        for collision in link.findall("collision"):
            link.remove(collision)
        for center, radius in spheres:
            collision = SubElement(link, "collision")
            SubElement(collision, "origin", xyz=join_numbers(center), rpy="0 0 0")
            geometry = SubElement(collision, "geometry")
            SubElement(geometry, "sphere", radius=repr(radius))


def join_numbers(numbers: list[float]) -> str:
    """Return numbers as an attribute, without loss."""
    return " ".join(map(repr, numbers))
