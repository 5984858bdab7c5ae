"""The obstacles themselves, where a map knows them, as arrays that keep every bit."""

from __future__ import annotations

import json
import operator
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

DIMENSIONS: Final[dict[str, tuple[str, ...]]] = {
    "geometry": ("byte",),
    "shapes": ("byte",),
    "vertices": ("vertex", "coordinate"),
    "faces": ("face", "corner"),
    "centers": ("ball", "coordinate"),
    "radii": ("ball",),
}
"""Arrays of :func:`geometry_arrays`, with the name of each axis."""

_TABLES: Final = {"mesh": ("vertices", "faces"), "balls": ("centers", "radii")}
"""The arrays that hold the rows of each kind of shape, one shape after the other."""


def geometry_arrays(shapes: Sequence[Any]) -> dict[str, NDArray[Any]]:
    """Obstacles as arrays.

    Parameters
    ----------
    shapes : sequence of shapely geometries, or of Mesh and Balls

    Returns
    -------
    dict of str to ndarray
        Of shapely geometries ``geometry``, the bytes of one GeometryCollection in WKB. Of meshes and balls ``shapes``,
        the bytes of a JSON list that tells the kind of each and its rows; then ``vertices``, shape (V, 3), and
        ``faces``, shape (F, 3), which count the vertices of their own mesh, and ``centers``, shape (n, d), and
        ``radii``, shape (n,), in metres, where there are such shapes. Bytes are signed, as netCDF 3 knows no others.
    """
    import shapely

    from cspace.shapes import Polygons

    if all(isinstance(shape, Polygons) for shape in shapes):
        parts = [part for shape in shapes for part in shape.geometries]
        return {"geometry": _as_bytes(shapely.to_wkb(shapely.GeometryCollection(parts), byte_order=1))}
    from cspace.shapes.mesh import Mesh
    from cspace.shapes.shape import frozen

    tables_of: dict[str, list[NDArray[Any]]] = {}
    entries: list[dict[str, Any]] = []
    for shape in shapes:
        is_mesh = isinstance(shape, Mesh)
        kind, about = ("mesh", {"solid": shape.solid, "source": shape.source}) if is_mesh else ("balls", {})
        tables = {name: getattr(shape, name) for name in _TABLES[kind]}
        entries.append({"kind": kind, **about, **{name: len(table) for name, table in tables.items()}})
        for name, table in tables.items():
            tables_of.setdefault(name, []).append(table)
    return {"shapes": _as_bytes(json.dumps(entries).encode())} | {
        name: frozen(np.concatenate(tables)) for name, tables in tables_of.items()
    }


def shapes_from(arrays: Mapping[str, NDArray[Any]]) -> tuple[Any, ...] | None:
    """The obstacles that :func:`geometry_arrays` wrote, or None where there are none of its arrays.

    Raises
    ------
    ValueError
        If the arrays hold no obstacles, or do not agree with each other.
    """
    if "geometry" in arrays:
        return _from_wkb(arrays["geometry"])
    if "shapes" not in arrays:
        return None
    try:
        entries = json.loads(arrays["shapes"].tobytes())
        makers = [(_MAKERS[entry["kind"]], _TABLES[entry["kind"]], entry) for entry in entries]
        rows = {name: iter(_rows(name, kind, entries, arrays)) for kind in _TABLES for name in _TABLES[kind]}
        return tuple(make(entry, *(next(rows[name]) for name in names)) for make, names, entry in makers)
    except (KeyError, TypeError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"'shapes' tells of no obstacles ({type(error).__name__}: {error})") from error


def _rows(
    name: str, kind: str, entries: Sequence[Mapping[str, Any]], arrays: Mapping[str, NDArray[Any]]
) -> list[NDArray[Any]]:
    """The rows of each shape of a kind in one of its tables."""
    counts = [operator.index(entry[name]) for entry in entries if entry["kind"] == kind]
    if not counts and name not in arrays:
        return []
    if min(counts, default=0) < 0:
        raise ValueError(f"'shapes' tells of {min(counts)} rows in {name!r}")
    if sum(counts) != len(arrays[name]):
        raise ValueError(f"{name!r} has {len(arrays[name])} rows and 'shapes' tells of {sum(counts)}")
    return np.split(arrays[name], np.cumsum(counts, dtype=np.int64)[:-1])


def _as_bytes(content: bytes) -> NDArray[np.int8]:
    return np.frombuffer(content, dtype=np.int8)


def _from_wkb(content: NDArray[np.int8]) -> tuple[Any, ...]:
    import shapely

    from cspace.shapes import Polygons

    try:
        collection = shapely.from_wkb(content.tobytes())
    except shapely.errors.ShapelyError as error:
        raise ValueError(f"'geometry' is not WKB: {error}") from error
    if not isinstance(collection, shapely.GeometryCollection):
        raise ValueError(f"'geometry' is a {collection.geom_type}, not a GeometryCollection")
    return (Polygons(tuple(collection.geoms)),)


def _mesh(entry: Mapping[str, Any], vertices: NDArray[Any], faces: NDArray[Any]) -> Any:
    from cspace.shapes.mesh import Mesh

    return Mesh(vertices, faces, solid=entry["solid"], source=str(entry["source"]))


def _balls(entry: Mapping[str, Any], centers: NDArray[Any], radii: NDArray[Any]) -> Any:
    from cspace.shapes import Balls

    if not len(radii) or not np.isfinite(centers).all() or not (np.isfinite(radii) & (radii >= 0.0)).all():
        raise ValueError("'centers' and 'radii' make no balls")
    return Balls(np.ascontiguousarray(centers), np.ascontiguousarray(radii))


_MAKERS: Final = {"mesh": _mesh, "balls": _balls}
"""What makes a shape again, by its kind."""
