"""Checks that coordinates are in metres: reference systems, and signs of degrees."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib import import_module
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._files.access import ContentError
from cspace._support.kinds import BRING_YOUR_FILE
from cspace._support.reporting import warn_user
from cspace.errors import GeometryError, UnitWarning

_LAST_NUMBER: Final = re.compile(r"(\d+)h?\W*$")
"""Code of a system: EPSG:4326, urn:ogc:def:crs:EPSG::4326, .../EPSG/0/4326, ...:CRS84h, or WKT."""

_NOT_METRES: Final = frozenset({84, 83, 27, 3857, 900913, *range(4000, 5000)})
"""Codes of longitude and latitude, and of the web Mercator projection, which stretches lengths."""

_DEGREES: Final = re.compile(
    r"^(?!.*PROJC).*GEO[GD]|proj=(longlat|latlong)|latitude_longitude", re.S
)
"""Longitude and latitude in WKT, PROJ and the CF conventions; WKT projects them by PROJCS."""

_DEGREE_AXIS: Final = re.compile(r"(?<![a-z])(lon|lat|lng|long|longitude|latitude)(?![a-z])")
"""Name of an axis in degrees, in lower case."""

_MAX_DEGREES: Final = np.array([180.0, 90.0])

_UTM_ZONES: Final = (
    *(range(32601, 32661), range(32701, 32761)),  # WGS 84, north and south
    *(range(25828, 25839), range(26901, 26924), range(28348, 28359)),  # ETRS89, NAD83, GDA94
)
"""Codes of transverse Mercator zones in metres; some codes beside them are in feet."""


def check_crs(crs: Any, name: str) -> None:
    """Refuse a reference system not in metres; warn of unknown ones.

    `crs` is its name, code or WKT, or an object that has one of them as its text. The units of
    national systems are those that pyproj knows, if it is installed.

    Raises GeometryError if it is longitude and latitude, web Mercator, or in feet.
    """
    text = str(crs)
    found = _LAST_NUMBER.search(text)
    code = int(found[1]) if found else 0
    if any(code in zones for zones in _UTM_ZONES):
        return
    is_known = getattr(crs, "is_geographic", False) or _DEGREES.search(text) or code in _NOT_METRES
    if is_known or not _may_be_metres(text):
        problem = f"has the coordinate reference system {text:.60}"
        raise GeometryError(
            name, problem, "its units are not metres on the ground", BRING_YOUR_FILE
        )
    warn_user(
        f"{name}: its coordinates in {text:.60} are read as metres; {BRING_YOUR_FILE}", UnitWarning
    )


def check_own_crs(source: Any, name: str) -> None:
    """Check the reference system of an object that has one, as those of geopandas."""
    crs = getattr(source, "crs", None)
    if crs is not None:
        check_crs(crs, name)


def _may_be_metres(text: str) -> bool:
    """Return False if pyproj is installed, and knows the system in other units."""
    try:
        axes = import_module("pyproj").CRS(text).axis_info
    except (ImportError, RuntimeError):  # not installed, or no system that it knows
        return True
    return all(axis.unit_conversion_factor == 1.0 for axis in axes[:2])


def list_degrees(names: Iterable[str]) -> list[str]:
    """Return the names of longitudes and latitudes."""
    return [name for name in names if _DEGREE_AXIS.search(name.lower())]


def refuse_degrees(names: Iterable[str]) -> None:
    """Raise ContentError if an axis is a longitude or latitude."""
    named = list_degrees(names)
    if named:
        rule = "coordinates are metres, not degrees"
        raise ContentError(f"has coordinates in {', '.join(named):.60}", rule, BRING_YOUR_FILE)


def warn_of_likely_degrees(corners: ArrayLike, name: str) -> None:
    """Warn of a box, shape (2, 2 or 3), whose place looks like one in degrees."""
    corners = np.asarray(corners)[:, :2]
    size = np.ptp(corners, axis=0).max()
    distance = np.linalg.norm(corners.mean(axis=0))
    fits = (np.abs(corners) <= _MAX_DEGREES).all()
    # Distance from the origin, over the size of the box, above which degrees are suspected.
    if fits and 0.0 < 50.0 * size < distance:
        warn_user(
            f"{name}: its coordinates look like degrees, and are read as metres; {BRING_YOUR_FILE}",
            UnitWarning,
        )
