"""Plane geometries from shapely objects, GeoJSON and WKT."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import FileError, GeometryError, InputError
from cspace.io.input import read_text

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

SUFFIXES: Final = (".geojson", ".json", ".wkt")

_WKT: Final = re.compile(
    r"\s*(POINT|LINESTRING|LINEARRING|POLYGON|MULTI\w+|GEOMETRYCOLLECTION)\s*(Z|M|ZM)?\s*(\(|EMPTY)", re.IGNORECASE
)


def read_shapes(source: Any) -> list[BaseGeometry]:
    """Obstacles from anything that describes them.

    Coordinates are metres; no coordinate system is looked at. Polygons are filled; lines, rings and points are
    obstacles without an inside.

    Parameters
    ----------
    source : shapely geometry, mapping, str, path-like, or iterable of these
        A geometry; GeoJSON as a mapping (geometry, Feature or FeatureCollection); a WKT string; or a file that ends in
        ``.geojson``, ``.json`` (GeoJSON) or ``.wkt`` (one geometry, or one on each line).

    Returns
    -------
    list of shapely Polygon, LineString, LinearRing and Point
        The parts of all geometries, each valid and not empty.

    Raises
    ------
    GeometryError
        If there is no geometry, or one is malformed, empty, self-crossing, or has coordinates that are not finite or
        three for each point; the message says which.
    InputError
        If ``source`` is something else.
    FileError
        If the file is missing or is not JSON or WKT.
    """
    named = [part for name, shape in _geometries(source, "polygons") for part in _parts(shape, name)]
    names, shapes = [name for name, _ in named], [shape for _, shape in named]
    if not shapes:
        raise GeometryError(
            "polygons holds no geometry; obstacles must cover some ground; pass at least one polygon, line or point, "
            "or use Workspace.from_array for a map without obstacles"
        )
    _check(names, shapes)
    return shapes


def _geometries(source: Any, name: str) -> Iterator[tuple[str, BaseGeometry]]:
    """Every geometry of ``source``, with a name for messages."""
    import shapely

    if isinstance(source, shapely.Geometry):
        yield name, source
    elif isinstance(source, Mapping):
        yield from _from_geojson(source, name)
    elif isinstance(source, str | os.PathLike):
        yield from _from_text(source, name)
    elif isinstance(source, Iterable):
        for index, item in enumerate(source):
            yield from _geometries(item, f"{name}[{index}]")
    else:
        raise InputError(
            f"{name} is {source!r}; it must be a shapely geometry, GeoJSON, WKT or a file of them; pass e.g. "
            "shapely.box(0, 0, 1, 1)"
        )


def _from_text(source: str | os.PathLike[str], name: str) -> Iterator[tuple[str, BaseGeometry]]:
    """A WKT string or a file."""
    suffix = Path(source).suffix.lower()
    if suffix not in SUFFIXES:
        if isinstance(source, str) and _WKT.match(source):
            yield name, _from_wkt(source, name)
            return
        raise InputError(
            f"{name} is {os.fspath(source)[:60]!r}; a string must be WKT or a file that ends in {', '.join(SUFFIXES)}; "
            "pass e.g. 'POINT (1 2)'"
        )
    text, file = read_text(source, "file of polygons"), os.fspath(source)
    if suffix == ".wkt":
        lines = [line for line in text.split("\n") if line.strip()]
        if lines and all(_WKT.match(line) for line in lines):
            for number, line in enumerate(lines, start=1):
                yield f"{file}, geometry {number}", _from_wkt(line, f"{file}, geometry {number}")
        elif _WKT.match(text):
            yield file, _from_wkt(text, file)
        else:
            raise FileError(f"{file} begins with {text[:40]!r}; it must hold WKT; write e.g. 'POINT (1 2)'")
        return
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FileError(f"{file} is not JSON: {error}; it must hold GeoJSON; mend that place") from error
    if not isinstance(document, dict):
        raise FileError(
            f"{file} holds a JSON {type(document).__name__}; GeoJSON is an object; write e.g. {{'type': ...}}"
        )
    yield from _from_geojson(document, file)


def _from_wkt(text: str, name: str) -> BaseGeometry:
    import shapely

    if "\0" in text:  # where the parser would stop without a word
        raise GeometryError(f"{name} is not WKT: it holds a NUL character; mend {text[:60]!r}")
    try:
        with np.errstate(invalid="ignore"):  # NaN is refused by name later
            return shapely.from_wkt(text)
    except (shapely.errors.ShapelyError, NotImplementedError, ValueError) as error:
        raise GeometryError(f"{name} is not WKT: {str(error).strip()}; mend {text[:60]!r}") from error


def _from_geojson(document: Mapping[str, Any], name: str) -> Iterator[tuple[str, BaseGeometry]]:
    """A geometry, Feature or FeatureCollection."""
    import shapely
    from shapely.geometry import shape

    kind = document.get("type")
    if kind == "FeatureCollection":
        features = document.get("features")
        if not isinstance(features, list) or not all(isinstance(feature, Mapping) for feature in features):
            raise GeometryError(f"{name} has features {features!r:.60}; they must be a list of objects; mend the file")
        for index, feature in enumerate(features):
            yield from _from_geojson(feature, f"{name}, feature {index}")
        return
    if kind == "Feature":
        inner = document.get("geometry")
        if not isinstance(inner, Mapping):
            raise GeometryError(f"{name} has geometry {inner!r}; an obstacle needs one; remove the feature or mend it")
        yield from _from_geojson(inner, name)
        return
    try:
        with np.errstate(invalid="ignore"):
            geometry = shape(document)
    except (shapely.errors.ShapelyError, ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise GeometryError(
            f"{name} of type {kind!r} is not GeoJSON: {str(error).strip()}; it must hold 'type' and 'coordinates' as "
            "RFC 7946 says; mend it"
        ) from error
    yield name, geometry


def _parts(shape: BaseGeometry, name: str) -> Iterator[tuple[str, BaseGeometry]]:
    """The simple geometries of a collection; a simple one itself."""
    if shape.is_empty or not hasattr(shape, "geoms"):
        yield name, shape
        return
    for index, part in enumerate(shape.geoms):
        yield from _parts(part, f"{name}, part {index}")


def _check(names: list[str], shapes: list[BaseGeometry]) -> None:
    """Raise GeometryError for the first shape that breaks a rule."""
    import shapely

    array = np.array(shapes, dtype=object)
    points, owners = shapely.get_coordinates(array, return_index=True)
    broken = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(broken):
        x, y = points[broken[0]]
        raise GeometryError(
            f"{names[owners[broken[0]]]} has a vertex at ({x}, {y}); NaN and infinities are refused; drop or replace it"
        )
    for which in np.flatnonzero(shapely.is_empty(array)):
        raise GeometryError(f"{names[which]} is empty; an obstacle must cover some ground; leave it out or fill it")
    for which in np.flatnonzero(shapely.has_z(array)):
        raise GeometryError(
            f"{names[which]} has z coordinates; obstacles in the plane have two; drop them with shapely.force_2d, if "
            "their height does not matter"
        )
    for which in np.flatnonzero(~shapely.is_valid(array)):
        raise GeometryError(
            f"{names[which]} is not valid: {shapely.is_valid_reason(array[which])}; a border may not cross itself; "
            "redraw it, or try shapely.make_valid"
        )
