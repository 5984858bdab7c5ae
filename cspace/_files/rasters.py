"""Placement of xarrays by their coordinates."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from cspace._files.crs import check_crs
from cspace._files.fields import Fields, Ledger
from cspace._support.arrays import Floats
from cspace._support.check import check_dims, check_finite, check_kind
from cspace._support.kinds import BRING_YOUR_FILE
from cspace._support.reporting import tell_apart
from cspace._support.units import METRES
from cspace.errors import InputError

_CRS_ATTRIBUTES: Final = ("crs_wkt", "spatial_ref", "grid_mapping_name")
"""Attributes of a coordinate that name a reference system; the first one counts."""

_PLACE_ATTRIBUTES: Final = ("transform", "geotransform", "crs", "crs_wkt", "spatial_ref", "res")
"""Attributes of a raster that give it a place; its coordinates have to say it."""

FIELDS: Final = (
    Fields(
        "xarray",
        honoured="coordinates, in either direction; their order",
        refused=(
            "unequal steps; steps other than the spacing; of a coordinate, `units`, `unit` or "
            "`uom` other than metres, `positive` down, another `axis`, a `standard_name` of "
            "degrees or depth; `scale_factor`, `add_offset`, `_fillvalue` of 0 or 1, where not "
            "decoded, or a `missing_value`; `flag_meanings`, `long_name` or a name by which 1 is "
            "free; `crs`, `crs_wkt`, `spatial_ref` or `grid_mapping_name` in degrees; `transform`, "
            "`geotransform` or `res` without coordinates; y, x without coordinates; `inner` at "
            "another place"
        ),
        warned=(
            "another `crs`; `valid_range`, `valid_min`, `valid_max`, and attributes that are not "
            "named here, in small or large letters"
        ),
        harmless=(
            "area_or_point _array_dimensions actual_range bounds cell_methods cell_measures class "
            "dimension_labels dimension_list _netcdf4coordinates _netcdf4dimid "
            "comment conventions coordinates created date description flag_masks flag_values "
            "grid_mapping history institution missing_chunks name note references source "
            "title version"
        ),
    ),
    Fields(
        "`.zarr`",
        honoured="shape, type, chunks, `fill_value`",
        refused="dimensions other than x, y (and z); other codecs",
    ),
)


def place_raster(array: Any, spacing: float, name: str = "occupied") -> tuple[Any, Floats | None]:
    """Return an array in ascending coordinates, and its corner.

    The corner is in metres, and None for an array without coordinates. Coordinates are those of
    xarray, the centers of cells; arrays of other packages have none.

    Raises InputError if the coordinates are not cells of `spacing`, in metres.
    """
    check_kind(array, name)
    coordinates = getattr(array, "coords", {}) if hasattr(array, "isel") else {}
    attributes = _open_attributes(array, name)
    places = [key for key in _PLACE_ATTRIBUTES if attributes.get(key) is not None]
    _check_meaning(array, attributes, name)
    # Cells have no unit, and their name does not matter; positions are in those of coordinates.
    attributes.taken.add("standard_name")
    if attributes.fields.get("units") in (*METRES, "1"):
        attributes.taken.add("units")
    attributes.close(attributes.where)
    array = _drop_other_dimensions(array)
    if hasattr(array, "ncattrs"):  # a variable of netCDF4, whose values are masked
        check_dims(array, name)
        array = array[...]
    axes = [axis for axis in "xyz" if axis in getattr(array, "dims", ())]
    if not axes or len(axes) != len(array.dims) or not set(axes) <= set(coordinates):
        _refuse_another_place(array, coordinates, places, name)
        return array, None
    systems = [attributes.get("crs")]
    for coordinate in coordinates.values():
        named = map(coordinate.attrs.get, _CRS_ATTRIBUTES)
        systems.append(next(filter(None, named), None))
    for crs in filter(None, systems):
        check_crs(crs, name)
    array = array.transpose(*axes)
    lower = np.zeros(len(axes))
    for index, axis in enumerate(axes):
        label = f"{name}.{axis}"
        _check_axis(array[axis], axis, label)
        centers = check_finite(array[axis].values, label)
        if centers[0] > centers[-1]:
            array = array.isel({axis: slice(None, None, -1)})
            centers = centers[::-1]
        _check_steps(array[axis].values, centers, spacing, label)
        lower[index] = centers[0] - 0.5 * spacing
    return array.drop_vars(axes), lower


def _drop_other_dimensions(array: Any) -> Any:
    """Drop single-entry dimensions beside x, y and z."""
    for dimension in set(getattr(array, "dims", ())) - set("xyz"):
        if hasattr(array, "isel") and array.sizes[dimension] == 1:
            array = array.isel({dimension: 0}, drop=True)
    return array


def _open_attributes(array: Any, name: str) -> Ledger:
    """Open an array's attributes, by lower-case names."""
    attributes = getattr(array, "attrs", {})
    if hasattr(array, "ncattrs"):  # of netCDF4
        attributes = {key: array.getncattr(key) for key in array.ncattrs()}
    lowered: dict[str, Any] = {}
    if isinstance(attributes, Mapping):
        lowered = {str(key).lower(): value for key, value in attributes.items()}
    return Ledger(lowered, f"{name}, attributes", FIELDS[0])


def _refuse_another_place(array: Any, coordinates: Any, attributes: list[str], name: str) -> None:
    """Raise InputError for a place without a coordinate for each dimension.

    ``attributes`` are those of its attributes that give a place.
    """
    places = [str(key) for key in coordinates if key not in array.dims] + attributes
    if places:
        raise InputError(
            name,
            f"has its place in {', '.join(places):.80}",
            "each dimension needs coordinates, the centers of its cells in metres",
        )


def _check_steps(values: Any, centers: Floats, spacing: float, label: str) -> None:
    """Raise InputError unless the centers of cells, ascending, are the spacing apart.

    ``values`` are the centers as they were given, whose rounding may be the reason.
    """
    expected = centers[0] + spacing * np.arange(len(centers))
    # Maximum distance of a coordinate from its place, in cells; float32 needs some.
    max_step_error = 1e-3
    if np.abs(centers - expected).max() <= max_step_error * spacing:
        return
    rounding = 0.5 * float(np.spacing(np.abs(centers).max().astype(np.float32)))
    if values.dtype == np.float32 and rounding > max_step_error * spacing:
        raise InputError(
            label,
            f"is float32, which rounds its coordinates by up to {rounding:.2g} m",
            f"they must be the spacing, {spacing:g} m, apart",
        )
    steps = np.diff(centers)
    low, high = (tell_apart(step, spacing)[0] for step in (steps.min(), steps.max()))
    problem = f"has steps from {low} to {high} m"
    median = float(np.median(steps))
    is_even = np.abs(steps - median).max() <= max_step_error * median
    hint = f"pass spacing={median:.6g}" if is_even else ""
    raise InputError(label, problem, f"they must be the spacing, {spacing:g} m", hint)


def _check_axis(coordinate: Any, axis: str, label: str) -> None:
    """Raise InputError unless a coordinate of an xarray is in metres, upwards."""
    attributes = _open_attributes(coordinate, label)
    name, own_axis, positive = (
        str(attributes.get(key, "")) for key in ("standard_name", "axis", "positive")
    )
    named = filter(None, map(attributes.get, ("units", "unit", "uom")))
    units = str(next(named, ""))
    if name in ("longitude", "latitude"):
        units = f"degrees of {name}"
    is_decoded = _is_decoded(attributes)
    # The caller checks the reference systems of all coordinates together.
    attributes.taken.update(_CRS_ATTRIBUTES, ("crs", "long_name"))
    attributes.taken.update(("valid_min", "valid_max", "valid_range"))  # none is missing
    attributes.close(attributes.where)
    if not is_decoded:
        raise _make_coded_error(label)
    if own_axis.lower() not in ("", axis):
        raise InputError(label, f"says that it is {own_axis}", "names must agree")
    if positive.lower() == "down" or name == "depth":
        raise InputError(label, "is positive downwards", "z must point up")
    if units not in METRES:
        raise InputError(label, f"is in {units!r:.40}", "it must be in metres", BRING_YOUR_FILE)


def _is_decoded(attributes: Ledger) -> bool:
    """Return True if an xarray's attributes keep its numbers' meaning."""
    scale, offset = attributes.get("scale_factor", 1), attributes.get("add_offset", 0)
    missing = np.append(attributes.get("_fillvalue", -1), attributes.get("missing_value", -1))
    return bool(scale == 1 and offset == 0 and not np.isin((0, 1), missing).any())


_FREE: Final = re.compile(
    r"(is_)?(free|empty|clear|open|passable|traversable|navigable|drive?able|walkable|"
    r"(un|not_)occupied)(_\w+)?"
)
_OCCUPIED: Final = re.compile(
    r"(occupied|blocked|obstacle|wall|lethal|solid|full|(un|im|non|not_)"
    r"(passable|traversable|navigable|drive?able|walkable))s?(_\w+)?"
)
"""Meanings of 0 and of 1, in lower case."""

_CODES: Final = re.compile(r"\b([01])\s*(?:=|:|\bis\b|\bmeans\b)\s*([a-z_]+)")
"""What a sentence says of 0 or 1, in lower case."""

_MISSING: Final = re.compile(r"\b(un(known|seen|observed|explored)|missing|no_?data|invalid)")
"""Meaning of cells that are neither free nor occupied, in lower case."""


def _check_meaning(array: Any, attributes: Ledger, name: str) -> None:
    """Refuse codes or flags by which 0 is not free, or 1 not occupied.

    Flags of other words are left to the warning of fields that are not read.
    """
    if not _is_decoded(attributes) and getattr(array, "dtype", None) != np.bool_:
        raise _make_coded_error(name)
    meanings = _list_meanings(attributes)
    flags = attributes.fields.get("flag_meanings")
    names = (attributes.get("long_name"), getattr(array, "name", None))
    named = str(next(filter(None, names), "")).lower().replace(" ", "_")
    zero, one = meanings.get(0, ""), meanings.get(1, "" if flags else named)
    if _OCCUPIED.fullmatch(zero) or _FREE.fullmatch(one) or _MISSING.search(f"{zero} {one}"):
        problem = f"says that 0 is {zero or 'not named'} and 1 is {one or 'not named'}"
        raise InputError(name, problem, "0 is free and 1 is occupied")
    if not flags or (_FREE.fullmatch(zero or "free") and _OCCUPIED.fullmatch(one)):
        attributes.taken.add("flag_meanings")


def _list_meanings(attributes: Ledger) -> dict[Any, str]:
    """Return what flags, or else a comment and a description, say of numbers."""
    fields = attributes.fields
    sentences = (str(fields.get(each) or "") for each in ("comment", "description"))
    codes = _CODES.findall(" ".join(sentences).lower())
    words = str(fields.get("flag_meanings") or "").lower().split()
    numbers = fields.get("flag_values", fields.get("flag_masks"))
    flags = np.arange(len(words)) if numbers is None else np.ravel(numbers)
    return {int(code): word for code, word in codes} | dict(
        zip(flags.tolist(), words, strict=False)
    )


def _make_coded_error(name: str) -> InputError:
    """Return the error for numbers that stand for others."""
    problem = "has scale_factor, add_offset or _FillValue"
    return InputError(name, problem, "then its numbers stand for others")
