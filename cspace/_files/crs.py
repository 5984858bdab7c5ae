"""Check of coordinate reference systems: maps are in metres."""

from __future__ import annotations

import re
from typing import Any, Final

from cspace._support.reporting import warn_user
from cspace.errors import GeometryError, UnitWarning

PROJECT: Final = "project it to metres, e.g. ogr2ogr -t_srs EPSG:32632 (your UTM zone) new old"

_LAST_NUMBER: Final = re.compile(r"(\d+)\W*$")
"""Code of a system: EPSG:4326, urn:ogc:def:crs:EPSG::4326, .../EPSG/0/4326, ...:CRS84, or WKT."""

_NOT_METRES: Final = frozenset({84, 83, 27, 3857, 900913, *range(4000, 5000)})
"""Codes of longitude and latitude, and of the web Mercator projection, which stretches lengths."""

_DEGREES: Final = ("GEOG", "+proj=longlat", "latitude_longitude")
"""First letters of longitude and latitude in WKT, PROJ and the CF conventions."""

_UTM_ZONES: Final = (
    *(range(32601, 32661), range(32701, 32761)),  # WGS 84, north and south
    *(range(25828, 25839), range(26901, 26924), range(28348, 28359)),  # ETRS89, NAD83, GDA94
)
"""Codes of transverse Mercator zones in metres; some codes beside them are in feet."""


def check_crs(crs: Any, name: str) -> None:
    """Refuse a reference system not in metres; warn of unknown ones.

    `crs` is its name, code or WKT, or an object that has one of them as its text.

    Raises GeometryError if it is longitude and latitude, or web Mercator.
    """
    text = str(crs)
    found = _LAST_NUMBER.search(text)
    code = int(found[1]) if found else 0
    is_geographic = getattr(crs, "is_geographic", False) or text.lstrip().startswith(_DEGREES)
    if is_geographic or code in _NOT_METRES:
        problem = f"has the coordinate reference system {text:.60}"
        raise GeometryError(name, problem, "its units are not metres on the ground", PROJECT)
    if not any(code in zones for zones in _UTM_ZONES):
        warn_user(
            f"{name}: its coordinates in {text:.60} are read as metres; {PROJECT}", UnitWarning
        )
