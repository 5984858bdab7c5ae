"""Files of spheres that stand for the links of a robot."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Mapping
from typing import Any, Final, TypeAlias
from xml.etree.ElementTree import Element, SubElement

from cspace.inside import (
    Fields,
    Ledger,
    check_suffix,
    decoding,
    read_document,
    read_xml,
    warn_user,
)

Sphere: TypeAlias = tuple[list[float], float]
"""Center in the frame of a link, and radius, metres."""

_KIND: Final = "file of spheres"
"""Kind of file, for messages."""

FIELDS: Final = (
    Fields(
        "`spheres=` of a URDF: cuRobo's `.yaml`, foam's `.json`, `.srdf`",
        honoured=(
            "`robot_cfg`, `kinematics`, `collision_spheres`; `spheres` of each link; `center` or "
            "`origin`, `radius`"
        ),
        refused=(
            "radii of zero, or below in other files than cuRobo's; `collision_sphere_buffer`; "
            "XRDF's `format`"
        ),
        warned=(
            "`self_collision_buffer`; spheres that cuRobo disables, of a radius below zero; "
            "links that the URDF lacks"
        ),
        harmless="mean best worst version use_usd_kinematics usd_path usd_robot_root "
        "usd_flip_joints usd_flip_joint_limits isaac_usd_path urdf_path asset_root_path "
        "external_asset_path external_robot_configs base_link ee_link link_names lock_joints "
        "extra_links extra_collision_spheres collision_link_names mesh_link_names "
        "self_collision_ignore load_collision_spheres use_global_cumul use_external_assets cspace "
        "add_object_link robot_name format_version grasp_contact_link_names load_dynamics "
        "tool_frames",
    ),
)


def read_spheres(path: str | os.PathLike[str]) -> dict[str, list[Sphere]]:
    """Read the spheres of each link.

    A warning counts the spheres of cuRobo's files that have a radius below zero, which disables
    them, and are left out. A link that has no other spheres is left out too.

    Raises InputError for another suffix, and FileError if the file is missing or malformed.
    """
    # Suffixes of the files that are read.
    suffix = check_suffix(
        path, (".yaml", ".yml", ".json", ".srdf"), "spheres are read from such files", "spheres"
    )
    content: Any
    if suffix == ".srdf":
        content = _list_srdf_links(read_xml(path, _KIND))
    else:
        content = read_document(path, _KIND, "max_description_bytes")
    with decoding(path, _KIND):
        document = table = Ledger(content, "file", FIELDS[0])
        # A description of a robot for cuRobo has the spheres two levels down.
        for key in ("robot_cfg", "kinematics", "collision_spheres"):
            rule = "a table of links and their spheres is read"
            table.refuse("format", rule=rule)
            rule = "it enlarges the spheres, and is not read"
            table.refuse("collision_sphere_buffer", 0, rule=rule)
            if key in table.fields:
                table = _open_links(table, key)
        table.skip()
        lowest = 0.0 if suffix in (".srdf", ".json") else -math.inf
        links = {name: _read_link(table, name, lowest) for name in table.fields}
        if not links:
            raise table.fail("has no spheres", "it must have those of one link")
    document.close(os.fspath(path))
    enabled = {name: [each for each in links[name] if each[1] > 0.0] for name in links}
    disabled = sum(len(links[name]) - len(enabled[name]) for name in links)
    if disabled:
        warn_user(
            f"{os.fspath(path)}: {disabled} spheres have a radius below zero, which disables them "
            "in cuRobo, and are left out; a link without others keeps the geometry of the URDF"
        )
    return {name: spheres for name, spheres in enabled.items() if spheres}


def _open_links(table: Ledger, key: str) -> Ledger:
    """Take the table in a field; refuse other forms with advice."""
    value = table.get(key)
    rule = "it must be a table of links"
    if isinstance(value, str):
        raise table.fail(f"has {key} {value!r:.60}", rule)
    if isinstance(value, list):
        raise table.fail(f"has a list as {key}", rule)
    return table.child(key)


def _list_srdf_links(root: Element) -> dict[str, list[dict[str, Any]]]:
    """Return attributes of SRDF links' spheres, with parsed numbers."""
    links: dict[str, list[dict[str, Any]]] = {}
    for approximation in root.findall("link_sphere_approximation"):
        spheres = links.setdefault(approximation.get("link", ""), [])
        for sphere in approximation.findall("sphere"):
            radius = parse_numbers(sphere.get("radius", ""))
            spheres.append(
                {
                    "center": parse_numbers(sphere.get("center", "")),
                    "radius": radius[0] if len(radius) == 1 else sphere.get("radius"),
                }
            )
    return links


def parse_numbers(text: str) -> list[float]:
    """Parse finite numbers between blanks, or return an empty list."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        return []
    return numbers if all(map(math.isfinite, numbers)) else []


def _read_link(table: Ledger, name: str, lowest: float) -> list[Sphere]:
    """Return the spheres of a link, of a list or foam's table.

    ``lowest`` is the lowest radius, metres.
    """
    entry = table.fields[name]
    link = table.inner({"spheres": entry} if isinstance(entry, list) else entry, f"link {name!r}")
    spheres = [_read_sphere(sphere, lowest) for sphere in link.children("spheres", "sphere")]
    if not spheres:
        raise link.fail("has no spheres", "it must have some")
    return spheres


def _read_sphere(sphere: Ledger, lowest: float) -> Sphere:
    """Return a sphere's center and radius, negative if disabled."""
    key = "origin" if "origin" in sphere.fields else "center"
    sphere.need(key)
    center = [sphere.check_number(key, number) for number in sphere.entries(key)]
    radius = sphere.number("radius", lowest=lowest)
    if len(center) != 3 or radius == 0.0:
        problem = f"has the {key} {center} and the radius {radius:g}"
        rule = "a center is three numbers, and a radius one above zero"
        raise sphere.fail(problem, rule)
    return center, radius


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
