"""Placement of xarrays by their coordinates."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from cspace._files.crs import check_crs
from cspace._files.fields import Fields
from cspace._support.arrays import Floats
from cspace._support.check import check_finite
from cspace.errors import InputError

_METRES: Final = ("", "m", "metre", "metres", "meter", "meters")
"""Values of the attribute ``units`` of a coordinate in metres."""

_CRS_ATTRIBUTES: Final = ("crs_wkt", "spatial_ref", "grid_mapping_name")
"""Attributes of a coordinate that name a reference system; the first one counts."""

_MAX_STEP_ERROR: Final = 1e-3
"""Maximum distance of a coordinate from its place, in cells; float32 needs some."""

FIELDS: Final = (
    Fields(
        "xarray",
        honoured="coordinates, in either direction; their order",
        refused=(
            "unequal steps; steps other than `spacing`; `units` other than metres; `positive` "
            "down; `scale_factor`, `add_offset`, `_FillValue` of 0 or 1, where not decoded; `crs` "
            "in degrees; y, x without coordinates; `inner` at another place"
        ),
        warned="other `crs`",
    ),
    Fields(
        "`.zarr`",
        honoured="shape, type, chunks, `fill_value`",
        refused="dimensions other than x, y (and z); other codecs",
    ),
)


def place_raster(array: Any, spacing: float, name: str = "occupied") -> tuple[Any, Floats | None]:
    """Return an array indexed as its coordinates ascend, without them, and its lower corner.

    The corner is in metres, and None for an array without coordinates. Coordinates are those of
    xarray, the centers of cells; arrays of other packages have none.

    Raises InputError if the coordinates are not cells of `spacing`, in metres.
    """
    coordinates = getattr(array, "coords", {})
    if hasattr(array, "iloc") or hasattr(array, "data_vars"):
        hint = "pass one array, indexed by ascending x and y"
        raise InputError(name, f"is a {type(array).__name__}", "its labels are not read", hint)
    axes = [axis for axis in "xyz" if axis in getattr(array, "dims", ())]
    if not axes or len(axes) != len(array.dims) or not set(axes) <= set(coordinates):
        return array, None
    systems = [array.attrs.get("crs")]
    for coordinate in coordinates.values():
        named = map(coordinate.attrs.get, _CRS_ATTRIBUTES)
        systems.append(next(filter(None, named), None))
    for crs in filter(None, systems):
        check_crs(crs, name)
    if array.dtype.kind != "b":
        _check_decoded(array, name)
    array = array.transpose(*axes)
    lower = np.zeros(len(axes))
    for index, axis in enumerate(axes):
        label = f"{name}.{axis}"
        _check_axis(array[axis], axis, label)
        centers = check_finite(array[axis].values, label)
        if centers[0] > centers[-1]:
            array = array.isel({axis: slice(None, None, -1)})
            centers = centers[::-1]
        expected = centers[0] + spacing * np.arange(len(centers))
        if np.abs(centers - expected).max() > _MAX_STEP_ERROR * spacing:
            steps = np.diff(centers)
            problem = f"has steps from {steps.min():g} to {steps.max():g} m"
            hint = f"pass spacing={np.median(steps):.6g}, or interpolate the array"
            raise InputError(label, problem, f"they must be the spacing, {spacing:g} m", hint)
        lower[index] = centers[0] - 0.5 * spacing
    return array.drop_vars(axes), lower


def _check_axis(coordinate: Any, axis: str, label: str) -> None:
    """Raise InputError unless a coordinate of an xarray is in metres, upwards."""
    attributes = coordinate.attrs
    units = str(attributes.get("units", attributes.get("unit", "")))
    _check_decoded(coordinate, label)
    if attributes.get("positive") == "down":
        hint = f"turn it, e.g. array.assign_coords({axis}=-array.{axis}.values)"
        raise InputError(label, "is positive downwards", "z must point up", hint)
    if units not in _METRES:
        hint = f"scale it, e.g. array.assign_coords({axis}=0.01 * array.{axis}.values) for cm"
        if units.startswith("deg"):
            hint = "project it, e.g. by array.rio.reproject of rioxarray"
        raise InputError(label, f"is in {units!r:.40}", "it must be in metres", hint)


def _check_decoded(array: Any, name: str) -> None:
    """Raise InputError if the attributes of an xarray give its numbers another meaning."""
    attributes = array.attrs
    is_scaled = attributes.get("scale_factor", 1) != 1 or attributes.get("add_offset", 0) != 0
    if is_scaled or attributes.get("_FillValue") in (0, 1):
        problem = "has scale_factor, add_offset or _FillValue"
        hint = "decode its dataset with xarray.decode_cf, or delete the attribute"
        raise InputError(name, problem, "then its numbers stand for others", hint)
