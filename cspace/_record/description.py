"""Names, types, axes and units of a map's arrays."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace import __version__
from cspace._grid import Grid
from cspace._record.contents import Contents
from cspace._rotations import Rotations
from cspace._shapes import Shape, shape_from_spec
from cspace._support.arrays import AXES, STATE_NAMES, read_only

FORMAT: Final = "cspace-map"
VERSION: Final = 7
"""Version of the format, frozen by docs/reference/format.md; a reader refuses all others."""


class StoredArray(NamedTuple):
    """Type, axes and attributes of a stored array.

    Attributes
    ----------
    axes : tuple of str
        Names of the axes; "cells" stands for the axes of the grid.
    dtype : str
    fill_value : number
        Value that readers give to missing entries. It never makes a cell FREE.
    attributes : mapping
        Attributes, after the CF conventions.
    sizes : mapping of str to int
        Lengths of axes that all maps share.
    """

    axes: tuple[str, ...]
    dtype: str
    fill_value: Any
    attributes: Mapping[str, Any]
    sizes: Mapping[str, int] = {}


def _describe(
    axes: str, dtype: str, fill_value: Any, long_name: str, **attributes: Any
) -> StoredArray:
    """Describe an array; ``axes`` are names separated by spaces."""
    all_attributes = {"long_name": long_name, **attributes}
    return StoredArray(tuple(axes.split()), dtype, fill_value, all_attributes)


def _describe_floats(axes: str, long_name: str, units: str, **attributes: str) -> StoredArray:
    """Describe an array of float64; missing entries are NaN."""
    return _describe(axes, "float64", math.nan, long_name, units=units, **attributes)


ARRAYS: Final[dict[str, StoredArray]] = {
    "cell_states": _describe(
        "slice cells",
        "uint8",
        255,
        "state of the configurations in a cell",
        flag_values=list(range(len(STATE_NAMES))),
        flag_meanings=" ".join(STATE_NAMES),
    ),
    "outer": _describe("cells", "bool", True, "workspace cells that meet an obstacle"),
    "inner": _describe("cells", "bool", True, "workspace cells that lie in obstacles"),
    "unknown": _describe("cells", "bool", True, "workspace cells that nothing is known of"),
    "scene_outer": _describe("x y z", "bool", True, "cells in space that meet an obstacle"),
    "scene_inner": _describe("x y z", "bool", True, "cells in space that lie in obstacles"),
    "scene_unknown": _describe("x y z", "bool", True, "cells in space that nothing is known of"),
    "overlap_counts": _describe(
        "slice cells",
        "int32",
        -1,
        "number of coinciding pairs of obstacle cell and robot offset",
        units="1",
    ),
    "slice_of": _describe(
        "rotation",
        "int64",
        np.iinfo(np.int64).max,
        "slice that serves a rotation cell",
        comment="where cell_states has the axis slice, cell_states.isel(slice=slice_of) has the "
        "axis rotation",
    ),
    "exterior": _describe(
        "slice corner",
        "int64",
        np.iinfo(np.int64).max,
        "first and last cell of the box of cells that are MIXED outside the grid, and the state "
        "of those beyond it",
    ),
    "distances": _describe(
        "slice cells",
        "float32",
        0.0,
        "distance from the center of a cell to the nearest cell that is not FREE, in cells",
        units="1",
    ),
    "distance_boxes": _describe_floats(
        "slice bound axis",
        "corners of the box of all cells that are not FREE, in cells",
        "1",
    ),
    "shapes": _describe(
        "byte", "int8", -1, "obstacles as a JSON list of what makes each shape again"
    ),
    **{
        axis: _describe_floats(axis, f"{axis} of the middle of a cell", "m", axis=axis.upper())
        for axis in AXES
    },
}
"""Every array that a map may hold, except those that describe its rotation cells."""

DERIVED: Final = ("distances", "distance_boxes")
"""Arrays for readers without this package. This package ignores them, and computes them itself."""


def describe_arrays() -> dict[str, StoredArray]:
    """Describe all arrays of a map, by name.

    They are :data:`ARRAYS`, and the arrays that describe rotation cells of every kind.
    """
    return _describe_arrays(Rotations._list_kinds())


@cache
def _describe_arrays(kinds: tuple[type[Rotations], ...]) -> dict[str, StoredArray]:
    """Describe all arrays of a map, with these kinds of rotation cells."""
    descriptions = dict(ARRAYS)
    for kind in kinds:
        for name, coordinate in kind._COORDINATES.items():
            # The first axis counts the rotation cells; the coordinate names and sizes the others.
            axes = " ".join(["rotation", *coordinate.axes])
            # The CF attribute ``bounds`` names the array with the boundaries of the cells.
            bounds = {"bounds": coordinate.bounds} if coordinate.bounds else {}
            description = _describe_floats(axes, coordinate.about, coordinate.units, **bounds)
            descriptions[name] = description._replace(sizes=coordinate.axes)
    return descriptions


def list_axes(name: str, dim: int) -> tuple[str, ...]:
    """Return an array's axes, in ``dim`` dimensions."""
    # "cells" stands for the axes of the grid.
    axes: list[str] = []
    for axis in describe_arrays()[name].axes:
        axes += AXES[:dim] if axis == "cells" else [axis]
    return tuple(axes)


def make_grid(metadata: Mapping[str, Any]) -> Grid:
    """Return the grid that a map's metadata describe."""
    shape = tuple(metadata["shape"])
    axes = metadata["axes"].split()[: len(shape)]
    units = metadata["units"].split()
    frame_id = str(metadata.get("frame_id", ""))
    return Grid(metadata["lower"], metadata["spacing"], shape, axes, units, frame_id)


def make_scene_grid(metadata: Mapping[str, Any], grid: Grid) -> Grid:
    """Return the grid of the workspace of a map on a grid; with a floor, it is in space."""
    if "floor_m" not in metadata:
        return grid
    lower = (*grid.lower, metadata["scene_lowest_m"])
    shape = (*grid.shape, metadata["scene_layers"])
    return Grid(lower, grid.spacing, shape, frame_id=grid.frame_id)


class NamedArray(NamedTuple):
    """An array of a map, with its axes by name.

    Attributes
    ----------
    axes : tuple of str
    values : array-like
    attributes : dict of str to plain values
    """

    axes: tuple[str, ...]
    values: Any
    attributes: dict[str, Any]


def describe_array(name: str, values: Any, grid: Grid) -> NamedArray:
    """Add its axes and attributes to an array of a map on a grid.

    The centers along an axis get the name and unit of the axis.
    """
    attributes = dict(describe_arrays()[name].attributes)
    if name in AXES[: grid.dim]:
        number = AXES.index(name)
        attributes["long_name"] = f"{grid.axes[number]} of the middle of a cell"
        attributes["units"] = grid.units[number]
    return NamedArray(list_axes(name, grid.dim), values, attributes)


def make_metadata(contents: Contents) -> dict[str, Any]:
    """Return the metadata of a map, as plain values by name.

    ``lower`` and ``spacing`` are in the ``units`` of the cells; ``axes`` names the numbers of a
    configuration; ``rotations`` is the number of rotation cells; ``robot`` is JSON text for
    ``Robot.from_spec``. ``inner`` is 1 if BLOCKED is proven, else 0. ``frame_id`` is left out if it
    is not known. With a floor, ``floor_m`` is its height, and the scene in space has
    ``scene_layers`` layers of cells from the height ``scene_lowest_m`` on.
    """
    grid = contents.grid
    more: dict[str, Any] = {"frame_id": grid.frame_id} if grid.frame_id else {}
    if contents.floor is not None:
        scene = contents.workspace.grid
        more |= {"floor_m": contents.floor}
        more |= {"scene_lowest_m": scene.lower[2], "scene_layers": scene.shape[2]}
    return {
        "format": FORMAT,
        "format_version": VERSION,
        "library_version": __version__,
        "lower": list(grid.lower),
        "spacing": grid.spacing,
        "shape": list(grid.shape),
        "axes": " ".join(contents.axes),
        "units": " ".join(grid.units),
        "outside": contents.outside,
        "margin_m": float(contents.margin),
        "rotations": len(contents.rotations),
        "slices": len(contents.states),
        "robot": json.dumps(contents.robot.spec, sort_keys=True),
        "workspace_source": contents.workspace.source,
        "inner": int(contents.proves_blocked),
        **more,
    }


def collect_arrays(contents: Contents, with_inner: bool = False) -> dict[str, NamedArray]:
    """Return the arrays of a map by name, with axes and attributes, without copies of cells.

    Names are those of :func:`describe_arrays`.

    Optional arrays are ``inner`` if it differs from ``outer`` or is wanted, ``unknown`` if there
    are such cells, ``overlap_counts`` if the map has them, the arrays of rotation cells if the
    robot rotates, and ``shapes`` if the obstacles have shapes. With a floor, the workspace is that
    seen from above, and arrays ``scene_...`` hold that in space.
    """
    # Arrays that every map has come first.
    workspace = contents.ground
    grid = contents.grid
    arrays: dict[str, Any] = {
        "cell_states": read_only(contents.states),
        "outer": workspace.outer,
        "slice_of": contents.slice_of,
    }
    if with_inner or workspace.inner is not workspace.outer:
        arrays["inner"] = workspace.inner
    if workspace.unknown is not None:
        arrays["unknown"] = workspace.unknown
    if contents.exterior is not None:
        arrays["exterior"] = contents.exterior.table
    if contents.overlap_counts is not None:
        arrays["overlap_counts"] = read_only(contents.overlap_counts)
    arrays |= {axis: grid.centers(i) for i, axis in enumerate(AXES[: grid.dim])}
    scene = contents.workspace
    if contents.floor is not None:
        arrays |= {"z": scene.grid.centers(2), "scene_outer": scene.outer}
        if scene.inner is not scene.outer:
            arrays["scene_inner"] = scene.inner
        if scene.unknown is not None:
            arrays["scene_unknown"] = scene.unknown
    arrays |= {**contents.rotations._stored_arrays, **encode_shapes(scene.shapes)}
    return {name: describe_array(name, array, grid) for name, array in arrays.items()}


def encode_shapes(shapes: Sequence[Shape] | None) -> dict[str, NDArray[Any]]:
    """Return ``{"shapes": array}``, or {} if the obstacles have no shapes."""
    if shapes is None:
        return {}
    specs = json.dumps([shape.spec for shape in shapes])
    # The bytes are signed, because netCDF 3 has no unsigned ones.
    return {"shapes": np.frombuffer(specs.encode(), dtype=np.int8)}


def decode_shapes(array: NDArray[Any]) -> tuple[Shape, ...]:
    """Decode the obstacles in an array ``shapes``; raise ValueError if invalid."""
    try:
        return tuple(shape_from_spec(spec) for spec in json.loads(array.tobytes()))
    except Exception as error:  # shapely and the shapes raise any error for invalid data
        raise ValueError(
            f"'shapes' tells of no obstacles ({type(error).__name__}: {error})"
        ) from error


def find_rotation_arrays(names: Iterable[str]) -> tuple[str, ...]:
    """Return names of arrays that describe rotation cells.

    ``names`` are those of all arrays of a map. The result is empty if the robot does not rotate.
    """
    all_names = set(names)
    for kind in Rotations._list_kinds():
        coordinates = tuple(kind._COORDINATES)
        # The first name of a kind of rotation cells is that of no other kind.
        if coordinates and coordinates[0] in all_names:
            return coordinates
    return ()
