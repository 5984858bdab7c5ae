"""Names that packages give to the columns of tables, to entries of rows, and to axes of arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Final

import numpy as np

_COLUMNS: Final = (
    "dtype.names",  # of structured arrays, h5py and astropy
    "column_names",  # of pyarrow
    "columns",  # of pandas, polars and DuckDB
    "dtype.fields",  # of a Series of structs of polars
    "_fields",  # of named tuples
    "__fields__",  # of rows of pyspark
    "keys",  # of rows of databases, and of a Series of pandas
)
"""Where packages keep the names of a table's columns, or of a row's entries."""

_DIMENSIONS: Final = (
    "dims",  # of xarray and scipp, and labels or scales of h5py
    "dimensions",  # of netCDF4 and h5netcdf
    "dim_names",  # of pyarrow
    "dim_coords",  # of iris
    "axes",  # of larray and hist
    "names",  # of torch
    "metadata.dimension_names",  # of zarr
    "attrs._ARRAY_DIMENSIONS",
    "domain.labels",  # of tensorstore
    "schema.domain",  # of tiledb
)
"""Where packages keep the names of an array's dimensions."""


def list_columns(values: Any) -> tuple[str, ...]:
    """Return the names of a table's columns or of a row's entries, or an empty tuple."""
    paths = () if type(values) is tuple or isinstance(values, Mapping) else _COLUMNS
    for path in paths:
        names = _follow(values, path)
        if callable(names):
            names = names() if path == "keys" else None
        if names is not None and are_names(names):
            return tuple(str(getattr(each, "name", each)) for each in names)
    return ()


def are_names(labels: Iterable[Any]) -> bool:
    """Return True if labels are names; numbers only count columns or rows."""
    return np.asarray(list(labels)).dtype.kind not in "iuf"


def takes_names(values: Any, axis: str) -> bool:
    """Return True if a name finds an entry of values, as in a table, which is no mapping."""
    try:
        values[axis]
    except Exception:  # of any package
        return False
    return not isinstance(values, Mapping)


def list_dimensions(array: Any) -> tuple[str, ...]:
    """Return the names of an array's dimensions, or an empty tuple."""
    paths = () if type(array) is np.ndarray else _DIMENSIONS
    for path in paths:
        found = _follow(array, path)
        names = [_name_dimension(each) for each in found] if isinstance(found, Iterable) else []
        if any(names):
            return tuple(names)
    return ()


def _name_dimension(dimension: Any) -> str:
    """Return the name or label of a dimension, or its first scale in h5py, or ""."""
    if isinstance(dimension, str) or dimension is None:
        return dimension or ""
    name = getattr(dimension, "label", None) or getattr(dimension, "name", None)
    if not name and hasattr(dimension, "label"):
        name = next(iter(dimension), "")
    return str(name() if callable(name) else name or "")


def _follow(value: Any, path: str) -> Any:
    """Return the attribute at the end of a dotted path, or the entry of a mapping, or None."""
    *owners, name = path.split(".")
    for owner in owners:
        value = getattr(value, owner, None)
        if isinstance(value, Mapping):
            return value.get(name)
    return getattr(value, name, None)
