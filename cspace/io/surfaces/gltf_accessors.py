"""Accessors of glTF: arrays of numbers in buffers."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.io.surfaces.parts import damaged, unread

Numbers = NDArray[Any]

_TYPES: Final = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS: Final = {"SCALAR": 1, "VEC3": 3}


class Accessors:
    """The arrays that a glTF header describes.

    Parameters
    ----------
    header : dict
    buffers : list of bytes or None
    file : Path
        For messages.
    """

    def __init__(self, header: dict[str, Any], buffers: list[bytes | None], file: Path) -> None:
        self._accessors = header.get("accessors", [])
        self._views = header.get("bufferViews", [])
        self._buffers = buffers
        self._file = file

    def values(self, number: int, kind: str) -> Numbers:
        """Rows of an accessor: floats, where it has several columns, and else whole numbers.

        Raises
        ------
        FileError
            If it is not there, of another kind, or goes beyond its buffer.
        GeometryError
            If its numbers are nowhere in the file.
        """
        if not 0 <= number < len(self._accessors):
            raise damaged(self._file, f"names accessor {number} of {len(self._accessors)}")
        accessor = self._accessors[number]
        width, dtype = _WIDTHS[kind], np.dtype(_TYPES[accessor["componentType"]])
        if accessor["type"] != kind or (kind == "SCALAR" and dtype.kind != "u"):
            raise damaged(self._file, f"has accessor {number} of {accessor['type']} {dtype}, where {kind} must be")
        if "bufferView" in accessor:
            values = self._rows(accessor, accessor["count"], width, dtype)
        elif "sparse" in accessor:
            values = np.zeros((accessor["count"], width), dtype=dtype)
        else:
            raise unread(self._file, f"an accessor ({number}) without data, as compression leaves it")
        if "sparse" in accessor:
            values = self._substituted(values, accessor["sparse"], width, dtype)
        return values if kind == "SCALAR" else _scaled(values, bool(accessor.get("normalized")))

    def _substituted(self, values: Numbers, sparse: dict[str, Any], width: int, dtype: np.dtype[Any]) -> Numbers:
        count, indices = sparse["count"], sparse["indices"]
        where = self._rows(indices, count, 1, np.dtype(_TYPES[indices["componentType"]]))[:, 0].astype(np.int64)
        if (where < 0).any() or (where >= len(values)).any():
            raise damaged(self._file, "has a sparse accessor that goes beyond its end")
        values = values.copy()
        values[where] = self._rows(sparse["values"], count, width, dtype)
        return values

    def _rows(self, place: dict[str, Any], count: int, width: int, dtype: np.dtype[Any]) -> Numbers:
        """Rows that lie in a view, ``byteStride`` apart."""
        if not 0 <= place["bufferView"] < len(self._views):
            raise damaged(self._file, f"names view {place['bufferView']} of {len(self._views)}")
        view = self._views[place["bufferView"]]
        if "EXT_meshopt_compression" in view.get("extensions", {}):
            raise unread(self._file, "data compressed by EXT_meshopt_compression")
        data = self._buffers[view["buffer"]]
        if data is None:
            raise damaged(self._file, f"has no data for buffer {view['buffer']}")
        first, row = view.get("byteOffset", 0), width * dtype.itemsize
        raw = np.frombuffer(data[first : first + view["byteLength"]], dtype=np.uint8)
        start, stride = place.get("byteOffset", 0), view.get("byteStride", row)
        if len(raw) < view["byteLength"] or min(start, first) < 0 or stride < row or count < 1:
            raise damaged(self._file, "has a view of a buffer that goes beyond its end, or an empty accessor")
        if start + (count - 1) * stride + row > len(raw):
            raise damaged(self._file, "has an accessor that goes beyond its view")
        return np.ndarray((count, width), dtype, raw, start, (stride, dtype.itemsize)).copy()


def _scaled(values: Numbers, normalized: bool) -> Numbers:
    """Coordinates as floats; normalised integers are parts of the largest."""
    floats = values.astype(np.float64)
    if not normalized or values.dtype.kind == "f":
        return floats
    return np.asarray(np.maximum(floats / np.iinfo(values.dtype).max, -1.0))
