"""Areas with speeds of GeoJSON, of zone sets of VDA 5050, and of masks of Nav2."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias

from shapely.geometry import shape

from cspace.errors import InputError
from cspace.inside import (
    StrPath,
    as_shape,
    check_known,
    check_number,
    check_positive,
    check_suffix,
    check_word,
    decoding,
    read_document,
    read_zones,
    warn_of_likely_degrees,
    warn_user,
)
from cspace.ros import read_mask

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

Unit: TypeAlias = Literal["percent", "m/s"]
"""Unit of the speeds of a mask."""

Zone: TypeAlias = tuple["BaseGeometry", float]
"""An area and its speed, m/s."""

SUFFIXES: Final = (".geojson", ".json")
"""Suffixes of files of zones."""


def read_zone_file(path: StrPath, speed: str | None) -> list[Zone]:
    """Read zones with speeds, as for :meth:`planners.SpeedZones.open`."""
    check_suffix(path, SUFFIXES, "the suffix selects the format, and from_mask reads masks")
    file = os.fspath(path)
    document = read_document(path, "file of zones")
    if not isinstance(document, dict) or "zoneSet" not in document:
        areas = as_shape(path)  # refuses wrong coordinates
        warn_of_likely_degrees(areas.outer.bounds, file)
        return list(_iterate_features(document, file, speed))
    if speed is not None:
        rule = "zone sets of VDA 5050 have maximumSpeed"
        raise InputError("speed", f"is {speed!r}", rule)
    zones = []
    with decoding(path, "zone set"):
        for zone, area in read_zones(document, file, "SPEED_LIMIT"):
            name = f"{file}, maximumSpeed of {zone.where}"
            zones.append((area, check_positive(zone.need("maximumSpeed"), name, "m/s")))
    return zones


_SPELLINGS: Final = {
    **dict.fromkeys(("metre", "meter"), "m"),
    **dict.fromkeys(("kilometre", "kilometer"), "km"),
    **dict.fromkeys(("centimetre", "centimeter"), "cm"),
    **dict.fromkeys(("millimetre", "millimeter"), "mm"),
    "mile": "mi",
    "mph": "mi/h",
    "foot": "ft",
    "feet": "ft",
    "fpm": "ft/min",
    "ip": "inch/s",
    "mpm": "m/min",
    "kmhr": "km/h",
    "inche": "inch",
    "sec": "s",
    "second": "s",
    "minute": "min",
    "hr": "h",
    "hour": "h",
    **dict.fromkeys(("kt", "knot"), "kn"),
    **dict.fromkeys(("pct", "percentage", "share", "fraction", "factor", "ratio"), "percent"),
}
"""Units of speed, of length and of time by other spellings, in lower case and singular."""

_SPEED_UNIT: Final = re.compile(
    r"(?:^| |speed|velocity)(?:(mm|cm|km?|mi?|ft?|inch)[ /]?p?(s|min|h)|(kn)|percent)(?: |$)"
)
"""Pattern of a unit of speed in words."""

_METRES: Final = {
    "mm": 1e-3,
    "cm": 1e-2,
    "m": 1.0,
    "k": 1e3,
    "km": 1e3,
    "inch": 0.0254,
    "f": 0.3048,
    "ft": 0.3048,
    "mi": 1609.344,
}
"""Metres of each unit of length."""

_SECONDS: Final = {"s": 1.0, "min": 60.0, "h": 3600.0}
"""Seconds of each unit of time."""


def _find_unit(name: str, file: str) -> tuple[str, float]:
    """Return the unit of speed in a property's name, and its m/s.

    Raises InputError for a share of a speed.
    """
    text = re.sub(r"(?<=[a-z\d])(?=[A-Z])", "_", name).lower().replace("%", " percent ")
    words = [_SPELLINGS.get(word.removesuffix("s"), word) for word in re.split(r"[\W_]+", text)]
    found = _SPEED_UNIT.search(" ".join(word for word in words if word not in ("p", "per")))
    if found is None and text.partition(":")[0] == "maxspeed":
        warn_user(f"{file}: {name} is taken as km/h, as in OpenStreetMap")
        return "km/h", 1.0 / 3.6
    if found is None:
        return "m/s", 1.0
    if "percent" in found[0]:
        raise InputError("speed", f"is {name!r}", "a zone has a speed, not a share of one")
    length, time, knots = found.groups()
    if knots:
        return knots, 1852.0 / 3600.0
    if (length, time) == ("m", "h"):  # mph
        length = "mi"
    return f"{length}/{time}", _METRES[length] / _SECONDS[time]


def _iterate_features(document: dict[str, Any], file: str, speed: str | None) -> Iterator[Zone]:
    """Yield areas and speeds of GeoJSON with valid geometries."""
    unit, factor = _find_unit(speed or "", file)
    for number, feature in enumerate(document.get("features", [document])):
        name = f"{file}, feature {number}"
        properties = feature.get("properties")
        if not isinstance(properties, dict):
            properties = {}
        if speed is None:
            rule = (
                f"it names the property in m/s; {name}, has {', '.join(properties) or 'none':.200}"
            )
            raise InputError("speed", "is missing", rule)
        check_known(speed, f"property of {name},", properties)
        value = check_positive(properties[speed], f"{speed} of {name},", unit)
        yield shape(feature.get("geometry", feature)), factor * value


def read_mask_zones(
    mask: object, unit: Unit, base: float, multiplier: float, max_velocity: float | None
) -> tuple[list[Zone], str | None]:
    """Read zones and frame of a mask, as for :meth:`planners.SpeedZones.from_mask`."""
    check_word(unit, "unit", ("percent", "m/s"))
    factor, most = 1.0, float("inf")
    if unit == "percent":
        if max_velocity is None:
            rule = "per cent are those of the largest speed, m/s"
            raise InputError("max_velocity", "is missing", rule)
        factor, most = check_positive(max_velocity, "max_velocity", "m/s") / 100.0, 100.0
    elif max_velocity is not None:
        raise InputError("max_velocity", f"is {max_velocity!r}", "it is for per cent")
    base, multiplier = check_number(base, "base"), check_number(multiplier, "multiplier")
    areas, frame_id = read_mask(mask)
    zones, others = [], []
    for value, area in areas.items():
        speed = base + multiplier * value
        if value < 0:
            others.append("unknown")
        elif 0.0 < speed <= most:
            zones.append((area, factor * speed))
        else:
            others.append(f"{value} ({speed:g} {unit})")
    listed = f"cells without a limit, as in Nav2, are {', '.join(others) or 'all':.100}"
    if not zones:
        rule = f"a value above 0 gives {base:g} + {multiplier:g} * value in {unit}"
        raise InputError("mask", "has no cell with a limit", f"{rule}; {listed}")
    if others:
        warn_user(f"mask: {listed}")
    return zones, frame_id or None
