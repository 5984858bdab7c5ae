"""Point clouds from files.

``.pcd`` is the format of the Point Cloud Library (Rusu and Cousins, 2011).
"""

# PCD is read here because pypcd4 1.5 trusts the sizes that a header declares, and needs two more packages.

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Floats, StrPath
from cspace.compiling import allocating
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
from cspace.limits import check_bytes

_PCD_KIND: Final = "PCD file"

_PCD_TYPES: Final = {("F", 4), ("F", 8), *((kind, size) for kind in "IU" for size in (1, 2, 4, 8))}
_MAX_POINT_BYTES: Final = 2**20
"""Maximum size of one point in bytes, far more than any scanner or descriptor writes."""

_MAX_LZF_RATIO: Final = 88
"""Maximum number of bytes that one byte of LZF unpacks to: three bytes can copy 264."""

_PCD_KEYS: Final = (
    *("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT"),
    *("WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"),
)


def read_points(path: StrPath) -> Floats:
    """Read a point cloud, shape (n, 3), in metres.

    The suffix selects the format. ``.npy``: an array of shape (n, 3). ``.xyz``, ``.txt``, ``.csv``: lines of x, y
    and z, separated by blanks or commas, with ``#`` before comments. ``.ply``: its vertices. ``.pcd``: the format
    of the Point Cloud Library. Colours, normals and other columns are skipped. Truncation of a text between two
    lines, or within its last number, cannot be detected.

    Raises GeometryError if there are no points, or if a ``.ply`` has surfaces other than faces. Also if a point is
    not finite: many sensors write NaN where they saw nothing, which is neither free nor occupied.
    """
    read = CLOUD_READERS[check_suffix(path, CLOUD_READERS, "the suffix selects the format", "points")]
    read = CLOUD_READERS[check_suffix(path, CLOUD_READERS, "the suffix says how a cloud is written", "points")]
    with decoding(path, "point cloud"):
        points = read(path)
        if not len(points):
            raise ContentError("holds no point", "a cloud needs one", "check how it was written", kind=GeometryError)
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
        raise ContentError(f"holds shape {array.shape} and type {array.dtype}", rule, "save one of that shape")
    return np.array(array, dtype=np.float64)


def _read_text(path: StrPath) -> Floats:
    """Read the points of a text file, shape (n, 3).

    Further columns are ignored.
    """
    rows = read_columns(read_text(path, "point cloud", memory=12.0))
    if len(rows) and rows.shape[1] < 3:
        raise ContentError(f"has {rows.shape[1]} columns", "points have x, y and z", "write three columns")
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
        return np.dtype([(str(n), *entry) for n, entry in enumerate(zip(self.types, self.counts, strict=True))])

    @property
    def xyz(self) -> list[int]:
        """Indices of the coordinate fields."""
        return [self.fields.index(axis) for axis in "xyz"]


def read_pcd(path: str | os.PathLike[str]) -> Floats:
    """Read the coordinates of a ``.pcd`` file, shape (n, 3).

    They are in the unit of the file. Coordinates are NaN where the sensor saw nothing. The data may be ``ascii``,
    ``binary`` or ``binary_compressed``. The fields ``x``, ``y`` and ``z`` may have any numeric type; others are
    skipped. ``VIEWPOINT`` is not applied, as in the Point Cloud Library. Truncation of an ``ascii`` file within its
    last number cannot be detected.
    """
    content = read_bytes(path, _PCD_KIND, memory=12.0)
    header, end = _parse_pcd_header(content)
    points = _DECODERS[header.data](header, content[end:], os.fspath(path))
    return np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)


def _parse_pcd_header(content: bytes) -> tuple[_PcdHeader, int]:
    """Return the header and the position of the byte after it."""
    entries: dict[str, list[str]] = {}
    end = 0
    for number, (line, after) in enumerate(iterate_header_lines(content), start=1):
        key, *values = line.partition("#")[0].split() or [""]
        if key and key not in _PCD_KEYS:
            rule = f"a PCD header has lines of {', '.join(_PCD_KEYS)}"
            raise ContentError(f"line {number} is {line[:40]!r}", rule, "the file is damaged or of another format")
        if key:
            entries["FIELDS" if key == "COLUMNS" else key] = values
        end = after
        if key == "DATA":
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "DATA") if key not in entries]
    if missing or not ("POINTS" in entries or {"WIDTH", "HEIGHT"} <= entries.keys()):
        raise ContentError(f"lacks {' and '.join(missing) or 'POINTS'} in its header, which ends with DATA")
    return _check_pcd_header(entries, number), end


def _check_pcd_header(entries: dict[str, list[str]], lines: int) -> _PcdHeader:
    """Check the entries of a header and convert them."""
    fields = tuple(entries["FIELDS"])
    try:
        sizes = [int(word) for word in entries["SIZE"]]
        counts = tuple(int(word) for word in entries.get("COUNT", ["1"] * len(fields)))
        grid = [int(entries[key][0]) for key in ("WIDTH", "HEIGHT") if key in entries]
        points = int(entries["POINTS"][0]) if "POINTS" in entries else math.prod(grid)
    except (ValueError, IndexError) as error:
        raise ContentError(f"has a malformed header: {error}; SIZE, COUNT and POINTS hold whole numbers") from error
    types = list(zip(entries["TYPE"], sizes, strict=False))
    if not (len(fields) == len(sizes) == len(entries["TYPE"]) == len(counts)) or not set(types) <= _PCD_TYPES:
        rule = "each field needs a type F, I or U, a size of 1, 2, 4 or 8 bytes and a count"
        raise ContentError(f"has fields {fields} of types {types} and counts {counts}; {rule}")
    coordinates = [field for field in fields if field in ("x", "y", "z")]
    if sorted(coordinates) != ["x", "y", "z"] or any(counts[fields.index(axis)] != 1 for axis in "xyz"):
        raise ContentError(f"has the fields {' '.join(fields)}; a cloud in space has x, y and z, once each")
    if min(*counts, points, *grid) < 0 or (len(grid) == 2 and math.prod(grid) != points):
        size = " x ".join(map(str, grid))
        raise ContentError(f"says {points} points in {size}, with counts {counts}, which do not agree")
    length = sum(size * count for size, count in zip(sizes, counts, strict=True))
    if length > _MAX_POINT_BYTES:
        raise ContentError(f"says {length} bytes per point, by SIZE and COUNT; at most {_MAX_POINT_BYTES} are read")
    data = " ".join(entries["DATA"])
    if data not in _DECODERS:
        raise ContentError(f"says DATA {data!r:.60}", f"it must be one of {', '.join(_DECODERS)}", "write it again")
    dtypes = tuple(np.dtype(f"<{kind.lower()}{size}") for kind, size in types)
    return _PcdHeader(fields, dtypes, counts, points, data, lines)


def _decode_ascii(header: _PcdHeader, body: bytes, file: str) -> Floats:
    """Decode the points of a text PCD file, shape (n, 3)."""
    rows = read_columns(body.decode("latin-1"), header.lines + 1)
    starts = np.cumsum([0, *header.counts])
    if len(rows) != header.points:
        raise ContentError(f"holds {len(rows)} points but its header says {header.points}")
    if len(rows) and rows.shape[1] != starts[-1]:
        raise ContentError(f"has {rows.shape[1]} columns but its header says {starts[-1]}")
    return rows[:, starts[header.xyz]] if len(rows) else np.zeros((0, 3))


def _decode_binary(header: _PcdHeader, body: bytes, file: str) -> Floats:
    """Decode the points of a binary PCD file, shape (n, 3)."""
    record = header.record
    if len(body) < header.points * record.itemsize:
        raise ContentError(f"holds {len(body) // record.itemsize} points but its header says {header.points}")
    cloud = np.frombuffer(body, dtype=record, count=header.points)
    return np.stack([cloud[str(n)].astype(np.float64) for n in header.xyz], axis=1)


def _decode_compressed(header: _PcdHeader, body: bytes, file: str) -> Floats:
    """Unpack points that are stored field after field.

    The packed and unpacked sizes come first; LZF packs the rest.
    """
    wanted = header.points * header.record.itemsize
    if header.points == 0:
        return np.zeros((0, 3))
    if len(body) < 8:
        raise ContentError(f"holds {len(body)} bytes after its header; it needs at least 8")
    packed, unpacked = (int(size) for size in np.frombuffer(body, dtype="<u4", count=2))
    if len(body) - 8 < packed:
        raise ContentError(f"holds {len(body) - 8} bytes of packed points but its header says {packed}")
    if unpacked != wanted:
        size = f"{header.points} points of {header.record.itemsize} bytes are {wanted}"
        raise ContentError(f"says {unpacked} bytes of points; {size}")
    if wanted > _MAX_LZF_RATIO * packed:
        raise ContentError(f"says {packed} packed bytes for {wanted}; one unpacks to at most {_MAX_LZF_RATIO}")
    check_bytes(file, wanted, "unpacks to", memory=4.0)
    plain = np.empty(wanted, dtype=np.uint8)
    if unpack_lzf(np.frombuffer(body, dtype=np.uint8, count=packed, offset=8), plain) != wanted:
        raise ContentError(f"does not unpack to the declared {wanted} bytes")
    widths = [header.points * kind.itemsize * n for kind, n in zip(header.types, header.counts, strict=True)]
    starts = np.cumsum([0, *widths])
    columns = [plain[starts[n] : starts[n + 1]].view(header.types[n]) for n in header.xyz]
    return np.stack([column.astype(np.float64) for column in columns], axis=1)


@allocating
def unpack_lzf(packed: NDArray[np.uint8], out: NDArray[np.uint8]) -> int:
    """Unpack LZF (Lehmann) into `out`.

    LZF alternates runs of literal bytes and copies of bytes written before. Return the number of bytes written, or
    -1 if the packed bytes are truncated, refer back before the first byte, or exceed `out`.
    """
    read, written = 0, 0
    while read < len(packed):
        control = np.int64(packed[read])
        read += 1
        if control < 32:
            length = control + 1
            if read + length > len(packed) or written + length > len(out):
                return -1
            for _ in range(length):
                out[written] = packed[read]
                written += 1
                read += 1
            continue
        length = control >> 5
        if length == 7:
            if read == len(packed):
                return -1
            length += np.int64(packed[read])
            read += 1
        length += 2
        if read == len(packed):
            return -1
        source = written - ((control & 31) << 8) - np.int64(packed[read]) - 1
        read += 1
        if source < 0 or written + length > len(out):
            return -1
        for _ in range(length):
            out[written] = out[source]
            written += 1
            source += 1
    return written


_DECODERS: Final[dict[str, Callable[[_PcdHeader, bytes, str], Floats]]] = {
    "ascii": _decode_ascii,
    "binary": _decode_binary,
    "binary_compressed": _decode_compressed,
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
