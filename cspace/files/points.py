"""Point clouds from files.

``.pcd`` is the format of the Point Cloud Library (Rusu and Cousins, 2011).
"""

# PCD is read here because pypcd4 1.5 trusts the sizes that a header declares, and needs two more
# packages.

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from cspace.arrays import Floats, StrPath
from cspace.errors import GeometryError
from cspace.files.access import (
    ContentError,
    check_suffix,
    decoding,
    iterate_header_lines,
    read_bytes,
    read_columns,
    read_text,
)
from cspace.files.formats import read_npy
from cspace.files.polygons import read_ply

_PCD_KIND: Final = "PCD file"

_PCD_TYPES: Final = {("F", 4), ("F", 8), *((kind, size) for kind in "IU" for size in (1, 2, 4, 8))}
_MAX_POINT_BYTES: Final = 2**20
"""Maximum size of one point in bytes, far more than any scanner or descriptor writes."""

_PCD_KEYS: Final = (
    *("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT"),
    *("WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"),
)


def read_points(path: StrPath) -> Floats:
    """Read a point cloud, shape (n, 3), in metres.

    The suffix selects the format. ``.npy``: an array of shape (n, 3). ``.xyz``, ``.txt``, ``.csv``:
    lines of x, y and z, separated by blanks or commas, with ``#`` before comments. ``.ply``: its
    vertices. ``.pcd``: the format of the Point Cloud Library. Colours, normals and other columns
    are skipped. Truncation of a text between two lines, or within its last number, cannot be
    detected.

    Raises GeometryError if there are no points, or if a ``.ply`` has surfaces other than faces.
    Also if a point is not finite: many sensors write NaN where they saw nothing, which is neither
    free nor occupied.
    """
    suffix = check_suffix(path, CLOUD_READERS, "the suffix selects the format", "points")
    read = CLOUD_READERS[suffix]
    with decoding(path, "point cloud"):
        points = read(path)
        if not len(points):
            raise ContentError(
                "holds no point",
                "a cloud needs one",
                "check how it was written",
                kind=GeometryError,
            )
        broken = int((~np.isfinite(points).all(axis=1)).sum())
        if broken:
            problem = f"holds {broken} points of {len(points)} that are not finite"
            rule = "a missing return is neither free nor occupied"
            hint = "drop them before writing: points[np.isfinite(points).all(axis=1)]"
            raise ContentError(problem, rule, hint, kind=GeometryError)
    return points


def _read_npy(path: StrPath) -> Floats:
    """Read the points of a ``.npy`` file, shape (n, 3)."""
    array = read_npy(path)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        rule = "a cloud is one array of numbers of shape (n, 3)"
        raise ContentError(
            f"holds shape {array.shape} and type {array.dtype}", rule, "save one of that shape"
        )
    return np.array(array, dtype=np.float64)


def _read_text(path: StrPath) -> Floats:
    """Read the points of a text file, shape (n, 3).

    Further columns are ignored.
    """
    rows = read_columns(read_text(path, "point cloud", memory=12.0))
    if len(rows) and rows.shape[1] < 3:
        raise ContentError(
            f"has {rows.shape[1]} columns", "points have x, y and z", "write three columns"
        )
    return np.ascontiguousarray(rows[:, :3]) if len(rows) else np.zeros((0, 3))


@dataclass(frozen=True, slots=True)
class _PcdHeader:
    """Content of the text before the points."""

    fields: tuple[str, ...]
    types: tuple[np.dtype[np.generic], ...]
    counts: tuple[int, ...]
    points: int
    data: str
    lines: int

    @property
    def record(self) -> np.dtype[np.void]:
        """Data type of one point.

        Fields are named by index, because padding fields share one name.
        """
        return np.dtype(
            [(str(n), *entry) for n, entry in enumerate(zip(self.types, self.counts, strict=True))]
        )

    @property
    def xyz(self) -> list[int]:
        """Indices of the coordinate fields."""
        return [self.fields.index(axis) for axis in "xyz"]


def read_pcd(path: str | os.PathLike[str]) -> Floats:
    """Read the coordinates of a ``.pcd`` file, shape (n, 3).

    They are in the unit of the file. Coordinates are NaN where the sensor saw nothing. The data may
    be ``ascii`` or ``binary``. The fields ``x``, ``y`` and ``z`` may have any numeric type; others
    are skipped. ``VIEWPOINT`` is not applied, as in the Point Cloud Library. Truncation of an
    ``ascii`` file within its last number cannot be detected.
    """
    content = read_bytes(path, _PCD_KIND, memory=12.0)
    header, end = _parse_pcd_header(content)
    points = _DECODERS[header.data](header, content[end:])
    return np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)


def _parse_pcd_header(content: bytes) -> tuple[_PcdHeader, int]:
    """Return the header and the position of the byte after it."""
    entries: dict[str, list[str]] = {}
    end = 0
    for number, (line, after) in enumerate(iterate_header_lines(content), start=1):
        key, *values = line.partition("#")[0].split() or [""]
        if key and key not in _PCD_KEYS:
            rule = f"a PCD header has lines of {', '.join(_PCD_KEYS)}"
            raise ContentError(
                f"line {number} is {line[:40]!r}", rule, "the file is damaged or of another format"
            )
        if key:
            entries["FIELDS" if key == "COLUMNS" else key] = values
        end = after
        if key == "DATA":
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "DATA") if key not in entries]
    if missing or not ("POINTS" in entries or {"WIDTH", "HEIGHT"} <= entries.keys()):
        raise ContentError(
            f"lacks {' and '.join(missing) or 'POINTS'} in its header, which ends with DATA"
        )
    return _check_pcd_header(entries, number), end


def _check_pcd_header(entries: dict[str, list[str]], lines: int) -> _PcdHeader:
    """Check the entries of a header and convert them."""
    fields = tuple(entries["FIELDS"])
    try:
        sizes = [int(word) for word in entries["SIZE"]]
        counts = tuple(int(word) for word in entries.get("COUNT", ["1"] * len(fields)))
        points = _parse_pcd_size(entries)
    except (ValueError, IndexError) as error:
        raise ContentError(
            f"has a malformed header: {error}; SIZE, COUNT and POINTS hold whole numbers"
        ) from error
    types = list(zip(entries["TYPE"], sizes, strict=False))
    complete = len(fields) == len(sizes) == len(entries["TYPE"]) == len(counts)
    if not complete or not set(types) <= _PCD_TYPES or min(counts, default=0) < 0:
        rule = "each field needs a type F, I or U, a size of 1, 2, 4 or 8 bytes and a count"
        raise ContentError(f"has fields {fields} of types {types} and counts {counts}; {rule}")
    coordinates = [field for field in fields if field in ("x", "y", "z")]
    if sorted(coordinates) != ["x", "y", "z"] or any(
        counts[fields.index(axis)] != 1 for axis in "xyz"
    ):
        raise ContentError(
            f"has the fields {' '.join(fields)}; a cloud in space has x, y and z, once each"
        )
    length = sum(size * count for size, count in zip(sizes, counts, strict=True))
    if length > _MAX_POINT_BYTES:
        raise ContentError(
            f"says {length} bytes per point, by SIZE and COUNT; at most {_MAX_POINT_BYTES} are read"
        )
    dtypes = tuple(np.dtype(f"<{kind.lower()}{size}") for kind, size in types)
    return _PcdHeader(fields, dtypes, counts, points, _parse_pcd_data(entries), lines)


def _parse_pcd_size(entries: dict[str, list[str]]) -> int:
    """Return the number of points.

    Raises ValueError or IndexError if an entry is no number.
    """
    grid = [int(entries[key][0]) for key in ("WIDTH", "HEIGHT") if key in entries]
    points = int(entries["POINTS"][0]) if "POINTS" in entries else math.prod(grid)
    if min([points, *grid]) < 0 or (len(grid) == 2 and math.prod(grid) != points):
        size = " x ".join(map(str, grid))
        raise ContentError(f"says {points} points in {size}, which do not agree")
    return points


def _parse_pcd_data(entries: dict[str, list[str]]) -> str:
    """Return the encoding of the points."""
    data = " ".join(entries["DATA"])
    if data == "binary_compressed":
        hint = "convert it: pcl_convert_pcd_ascii_binary in.pcd out.pcd 1, or with open3d"
        raise ContentError("holds compressed points", "only ascii and binary are read", hint)
    if data not in _DECODERS:
        raise ContentError(
            f"says DATA {data!r:.60}", f"it must be one of {', '.join(_DECODERS)}", "write it again"
        )
    return data


def _decode_ascii(header: _PcdHeader, body: bytes) -> Floats:
    """Decode the points of a text PCD file, shape (n, 3)."""
    rows = read_columns(body.decode("latin-1"), header.lines + 1)
    starts = np.cumsum([0, *header.counts])
    if len(rows) != header.points:
        raise ContentError(f"holds {len(rows)} points but its header says {header.points}")
    if len(rows) and rows.shape[1] != starts[-1]:
        raise ContentError(f"has {rows.shape[1]} columns but its header says {starts[-1]}")
    return rows[:, starts[header.xyz]] if len(rows) else np.zeros((0, 3))


def _decode_binary(header: _PcdHeader, body: bytes) -> Floats:
    """Decode the points of a binary PCD file, shape (n, 3)."""
    record = header.record
    if len(body) < header.points * record.itemsize:
        raise ContentError(
            f"holds {len(body) // record.itemsize} points but its header says {header.points}"
        )
    cloud = np.frombuffer(body, dtype=record, count=header.points)
    return np.stack([cloud[str(n)].astype(np.float64) for n in header.xyz], axis=1)


_DECODERS: Final[dict[str, Callable[[_PcdHeader, bytes], Floats]]] = {
    "ascii": _decode_ascii,
    "binary": _decode_binary,
}

CLOUD_READERS: Final[dict[str, Callable[[StrPath], Floats]]] = {
    ".npy": _read_npy,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".csv": _read_text,
    ".ply": lambda path: read_ply(path)[0],
    ".pcd": read_pcd,
}
"""Reader of each suffix."""
