"""Plane geometries from shapely objects, GeoJSON and WKT."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace._files.access import decoding, read_text
from cspace._files.crs import check_crs, check_own_crs
from cspace._files.fields import Fields, Ledger
from cspace._files.geometries import check_shapes, make_curve_error, split_parts
from cspace._files.plain import check_nesting, read_json
from cspace._support.arrays import StrPath
from cspace._support.check import check_known, find_sizes
from cspace._support.kinds import make_kind_error, suggest_call
from cspace._support.limits import check_file_memory
from cspace._support.reporting import warn_user
from cspace.errors import FileError, GeometryError, InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

POLYGON_SUFFIXES: Final = (".geojson", ".json", ".wkt")

_POLYGONS_KIND: Final = "file of polygons"

_BYTES_PER_POINT: Final = 1000.0
"""Maximum memory, in bytes, of one point of a file, as an object and again in its collection."""

_WKT: Final = re.compile(
    r"\s*(?:SRID\s*=\s*(?P<srid>\d+)\s*;\s*)?"
    r"(?:POINT|LINESTRING|LINEARRING|POLYGON|MULTI\w+|GEOMETRYCOLLECTION|CIRCULARSTRING"
    r"|COMPOUNDCURVE|CURVEPOLYGON|TIN|TRIANGLE|POLYHEDRALSURFACE)"
    r"\s*(?:(?:ZM|Z|M)\s*)?(?:\(|EMPTY)",
    re.IGNORECASE,
)

FIELDS: Final = (
    Fields(
        "`.geojson`, `.json`, `__geo_interface__`",
        honoured=(
            "`type`, `features`, `geometry`, `geometries`, `coordinates`; `crs` or `coordRefSys` "
            "of a UTM zone; altitudes of zero"
        ),
        refused="`crs` or `coordRefSys` in degrees, or web Mercator; other altitudes; `place`",
        warned=(
            "other `crs`; coordinates like degrees; `radius`, `buffer`, `width`, "
            "`thickness` in `properties`"
        ),
        harmless=(
            "bbox conformsTo copyright description featureType fileName generator id links name "
            "numberMatched numberReturned time timeStamp timestamp title xy_coordinate_resolution"
        ),
    ),
    Fields(
        "`.wkt`, shapely",
        honoured="type; SRID of a UTM zone",
        refused="SRID in degrees, or web Mercator; Z; curves; surfaces",
        warned="other SRID",
    ),
    Fields(
        "VDA 5050 zone sets, `.json`",
        honoured=(
            "`zoneSet`, `zones`, `zoneId`, `zoneType`; `vertices`, `x`, `y`; `maximumSpeed` in "
            "`planners.SpeedZones`"
        ),
        refused="fewer than three `vertices`; unknown types",
        warned="zones of other types; unknown fields",
        harmless=(
            "headerId timestamp version manufacturer serialNumber mapId zoneSetId "
            "zoneSetDescriptor zoneDescriptor maximumSpeed releaseLossBehavior entryActions "
            "duringActions exitActions priorityFactor penaltyFactor direction directedLimitation "
            "bidirectedLimitation"
        ),
    ),
)


def read_shapes(source: Any, name: str = "polygons") -> list[BaseGeometry]:
    """Return the simple geometries of all obstacles in `source`, which is `name` in messages.

    Each is valid and not empty. `source` is a shapely geometry; GeoJSON as a mapping (geometry,
    Feature or FeatureCollection); a WKT string; a file that ends in ``.geojson``, ``.json``
    (GeoJSON) or ``.wkt`` (one geometry, or one per line; truncation between two lines cannot be
    detected); an object with ``__geo_interface__``; or an iterable of these. Coordinates are
    metres. Polygons are filled; lines, rings and points are obstacles without an interior. In a
    zone set of VDA 5050, the zones of type BLOCKED are obstacles.

    Raises GeometryError if there is no geometry, or one is malformed, empty, self-crossing, curved,
    has coordinates that are not finite or three-dimensional, or a coordinate reference system in
    degrees.
    """
    # Each simple geometry has a name for messages, such as "polygons[2], part 0".
    names: list[str] = []
    shapes: list[BaseGeometry] = []
    for each, shape in _iterate_geometries(source, name):
        parts = split_parts(shape, each)
        shapes += parts
        if len(parts) == 1:
            names.append(each)
        else:
            names += [f"{each}, part {index}" for index in range(len(parts))]
    if not shapes:
        raise GeometryError(name, "holds no geometry", "obstacles must cover some ground")
    check_shapes(shapes, names)
    return shapes


def is_wkt(text: str) -> bool:
    """Return True if a text begins like a geometry in WKT."""
    return bool(_WKT.match(text))


def _iterate_geometries(source: Any, name: str) -> Iterator[tuple[str, BaseGeometry]]:
    """Yield name and shape of every geometry in `source`."""
    import shapely

    check_own_crs(source, name)
    if isinstance(source, shapely.Geometry):
        yield name, source
    elif isinstance(source, Mapping):
        yield from _read_geojson(source, name)
    elif hasattr(source, "__geo_interface__"):
        yield from _read_geojson(source.__geo_interface__, name)
    elif isinstance(source, str | os.PathLike):
        yield from _read_text_geometries(source, name)
    elif isinstance(source, Iterable) and not suggest_call(source, name):  # of any of these
        for index, item in enumerate(source):
            yield from _iterate_geometries(item, f"{name}[{index}]")
    else:
        rule = "it must be a shapely geometry, GeoJSON, WKT or a file of them"
        raise make_kind_error(source, name, rule)


def _read_text_geometries(source: StrPath, name: str) -> Iterator[tuple[str, BaseGeometry]]:
    """Yield the named geometries of a WKT string or a file."""
    # WKT has no suffix of a file, because it ends with a parenthesis or EMPTY.
    suffix = Path(source).suffix.lower()
    file = os.fspath(source)
    if suffix == ".wkt":
        yield from _read_wkt_file(file)
    elif suffix in POLYGON_SUFFIXES:
        document = read_json(source, _POLYGONS_KIND, each_list=_BYTES_PER_POINT)
        if not isinstance(document, dict):
            problem = f"holds a JSON {type(document).__name__}"
            raise FileError(file, problem, "GeoJSON is an object", suggest_call(document, file))
        yield from _read_geojson(document, file)
    elif isinstance(source, str) and is_wkt(source):
        yield name, _parse_wkt(source, name)
    else:
        rule = f"a string must be WKT or a file that ends in {', '.join(POLYGON_SUFFIXES)}"
        raise InputError(name, f"is {file[:60]!r}", rule)


def _read_wkt_file(file: str) -> Iterator[tuple[str, BaseGeometry]]:
    """Yield the geometries of a WKT file, one or a line each."""
    text = read_text(file, _POLYGONS_KIND, 10.0, "max_text_bytes")
    points = 1 + text.count(",")
    check_file_memory(file, f"holds {points:,} points", _BYTES_PER_POINT * points)
    if not is_wkt(text):
        problem = f"begins with {text[:40]!r}"
        raise FileError(file, problem, "it must hold WKT")
    lines = [line for line in text.split("\n") if line.strip()]
    if not all(map(is_wkt, lines)):  # a geometry of several lines
        lines = [text]
    for number, line in enumerate(lines, start=1):
        place = f"{file}, geometry {number}" if len(lines) > 1 else file
        yield place, _parse_wkt(line, place)


def _parse_wkt(text: str, name: str) -> BaseGeometry:
    """Parse a geometry in WKT.

    Raises GeometryError if it is malformed.
    """
    import shapely

    if "\0" in text:  # the parser would stop there silently
        problem = "is not WKT: it holds a NUL character"
        raise GeometryError(name, problem, "it must be text")
    try:
        with decoding(name, "WKT geometry"):
            check_nesting(text, "(", ")")
        found = _WKT.match(text)
        srid = found["srid"] if found else None
        if srid:
            text = text.partition(";")[2]
        with np.errstate(invalid="ignore"):  # a later check refuses NaN by name
            return shapely.set_srid(shapely.from_wkt(text), int(srid or 0))
    except NotImplementedError as error:
        raise make_curve_error(name) from error
    except (shapely.errors.ShapelyError, ValueError) as error:
        problem = f"is not WKT: {' '.join(str(error).split())}"
        raise GeometryError(name, problem, "it must be whole") from error


def _read_geojson(document: Mapping[str, Any], name: str) -> Iterator[tuple[str, BaseGeometry]]:
    """Yield the geometries of GeoJSON, or of the zones of a zone set."""
    if "zoneSet" in document:
        for zone, area in read_zones(document, name, "BLOCKED"):
            yield f"{name}, {zone.where}", area
        return
    ledger = _open_part(document, name)
    yield from _parse_geojson(ledger)
    ledger.close(name)


_ZONE_TYPES: Final = (
    *("BLOCKED", "LINE_GUIDED", "RELEASE", "COORDINATED_REPLANNING", "SPEED_LIMIT", "ACTION"),
    *("PRIORITY", "PENALTY", "DIRECTED", "BIDIRECTED"),
)


def read_zones(
    document: Mapping[str, Any], name: str, kind: str
) -> list[tuple[Ledger, BaseGeometry]]:
    """Return the zones of one type in a zone set of VDA 5050, with their areas.

    ``name`` is that of the document in messages. Warns once of zones of other types.

    Raises FileError if a field is missing or malformed, or no zone is of this type.
    """
    import shapely

    found: list[tuple[Ledger, BaseGeometry]] = []
    others: Counter[str] = Counter()
    with decoding(name, "zone set"):
        whole = Ledger(document, "the zone set", FIELDS[2])
        for zone in whole.child("zoneSet").children("zones", "zone", name="zoneId"):
            corners = [vertex.numbers("xy") for vertex in zone.children("vertices", "vertex")]
            if len(corners) < 3:
                raise zone.fail(f"has {len(corners)} vertices", "it must have at least three")
            word = check_known(zone.need("zoneType"), f"{name}, {zone.where}", _ZONE_TYPES)
            if word == kind:
                found.append((zone, shapely.Polygon(corners)))
                check_shapes([found[-1][1]], [f"{name}, {zone.where}"])
            else:
                others[word] += 1
        listed = ", ".join(f"{count} {word}" for word, count in sorted(others.items()))
        if not found:
            raise whole.fail(f"has no zone of type {kind}", f"its zones are {listed or 'none'}")
        whole.close(name)
    if others:
        warn_user(f"{name}: only zones of type {kind} are read here, not {listed}")
    return found


_MEMBERS: Final = {
    "FeatureCollection": ("features", "feature"),
    "GeometryCollection": ("geometries", "part"),
}
"""Field of the members of a collection, and their name in messages."""


def _parse_geojson(part: Ledger) -> Iterator[tuple[str, BaseGeometry]]:
    """Yield the geometries of a GeoJSON geometry, Feature or FeatureCollection."""
    from shapely.geometry import shape

    name, kind = part.where, part.get("type")
    _check_frame(part)
    # Collections and features hold geometries, in which the recursion ends.
    if isinstance(kind, str) and kind in _MEMBERS:
        field, member_name = _MEMBERS[kind]
        members = part.get(field)
        if not isinstance(members, list | tuple):
            problem = f"has {field} {members!r:.60}"
            raise GeometryError(name, problem, "they must be a list")
        for index, member in enumerate(members):
            yield from _parse_geojson(_open_part(member, f"{name}, {member_name} {index}", part))
    elif kind == "Feature":
        properties = part.get("properties", {})
        if isinstance(properties, Mapping):
            sizes = find_sizes(map(str, properties))  # which some programs draw around geometries
            if sizes:
                part.inner(sizes, name, "properties")
        yield from _parse_geojson(_open_part(part.get("geometry"), name, part))
    elif not isinstance(kind, str):
        fields = ", ".join(map(str, part.fields)) or "nothing"
        rule = "GeoJSON has 'type' and 'coordinates', as RFC 7946 says"
        raise GeometryError(name, f"has no type, only {fields:.100}", rule, part.hint)
    elif "coordinates" not in part.fields:
        rule = "GeoJSON has geometries, features and collections of them, as RFC 7946 says"
        raise GeometryError(name, f"is of type {kind!r:.40}, without coordinates", rule, "")
    else:
        part.get("coordinates")
        try:
            with np.errstate(invalid="ignore"):
                geometry = shape(part.fields)
        except Exception as error:  # shapely raises anything for coordinates that are no numbers
            problem = f"of type {kind!r:.40} is not GeoJSON: {' '.join(str(error).split()):.200}"
            rule = "it must hold 'type' and 'coordinates' as RFC 7946 says"
            raise GeometryError(name, problem, rule) from error
        yield name, geometry


def _check_frame(part: Ledger) -> None:
    """Refuse coordinates not in metres, or not those of the geometry."""
    name = part.where
    if isinstance(part.get("place"), Mapping):
        raise GeometryError(
            name,
            "has a place, the geometry of JSON-FG in its own coordinates",
            "only geometry is read",
        )
    systems = part.get("coordRefSys", [])
    for system in systems if isinstance(systems, list) else [systems]:
        check_crs(system, name)
    crs = part.get("crs")
    if crs is not None:
        properties = crs.get("properties") if isinstance(crs, Mapping) else None
        check_crs(properties.get("name", crs) if isinstance(properties, Mapping) else crs, name)


def _open_part(document: Any, name: str, whole: Ledger | None = None) -> Ledger:
    """Return the ledger of a document, feature or geometry."""
    if not isinstance(document, Mapping):
        problem = f"has geometry {document!r:.60}"
        raise GeometryError(name, problem, "an obstacle needs one")
    return Ledger(document, name, FIELDS[0], document=whole.document if whole else None)
