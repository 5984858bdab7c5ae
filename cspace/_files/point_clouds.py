"""Point clouds from files.

``.pcd`` is the format of the Point Cloud Library (Rusu and Cousins, 2011).
"""

# PCD is read here because pypcd4 1.5 trusts the sizes that a header declares, and needs two more
# packages.

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from typing import Final

import numpy as np

from cspace._files.access import (
    ContentError,
    check_suffix,
    decoding,
    iterate_header_lines,
    read_bytes,
    read_columns,
    read_text,
)
from cspace._files.crs import list_degrees, refuse_degrees
from cspace._files.fields import Fields, warn_of_names
from cspace._files.lazy_arrays import read_npy
from cspace._files.polygons import read_ply, read_ply_header
from cspace._files.unit_notes import warn_of_notes
from cspace._support.arrays import Floats, StrPath
from cspace._support.check import find_sizes
from cspace._support.kinds import BRING_YOUR_FILE
from cspace._support.reporting import warn_user
from cspace.errors import GeometryError

_PCD_KEYS: Final = (
    *("VERSION", "FIELDS", "COLUMNS", "SIZE", "TYPE", "COUNT"),
    *("WIDTH", "HEIGHT", "VIEWPOINT", "POINTS", "DATA"),
)
"""Keys of the lines of a PCD header."""

_NO_VIEWPOINT: Final = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
"""Position and quaternion of a viewpoint at the origin."""

FIELDS: Final = (
    Fields(
        "`.pcd`",
        honoured="FIELDS, SIZE, TYPE, COUNT; WIDTH, HEIGHT, POINTS; DATA",
        refused="binary_compressed; NaN, unless dropped",
        warned="VIEWPOINT; a radius or size; bytes after the points; a unit or shift in a comment",
    ),
    Fields(
        "`.xyz`, `.txt`, `.csv`",
        honoured="names of columns",
        refused="columns without x, y and z; NaN, unless dropped",
        warned="a unit or a shift in a comment; a radius or size",
    ),
    Fields(
        "`.npy`",
        honoured="order, byte order, type",
        refused="objects; other numbers",
    ),
)


def read_points(path: StrPath, drop_missing: bool = False) -> Floats:
    """Read a point cloud, shape (n, 3), in metres.

    The suffix selects the format. ``.npy``: an array of shape (n, 3). ``.xyz``, ``.txt``, ``.csv``:
    lines of numbers, separated by blanks or commas, with ``#`` before comments; the first line may
    name the columns, otherwise x, y and z come first. ``.ply``: its vertices. ``.pcd``: the format
    of the Point Cloud Library. Colours, normals and other columns are skipped. Truncation of a text
    between two lines, or within its last number, cannot be detected. With `drop_missing`, points
    that are not finite are dropped.

    Raises GeometryError if there are no points, or if a ``.ply`` has surfaces other than faces.
    Also if a point is not finite: many sensors write NaN where they saw nothing, which is neither
    free nor occupied.
    """
    suffix = check_suffix(path, CLOUD_READERS, "the suffix selects the format", "points")
    with decoding(path, "point cloud"):
        points = CLOUD_READERS[suffix](path)
        if drop_missing:
            points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            raise ContentError("holds no point", "a cloud needs one", kind=GeometryError)
        broken = np.count_nonzero(~np.isfinite(points).all(axis=1))
        if broken:
            problem = f"holds {broken} points of {len(points)} that are not finite"
            rule = "a missing return is neither free nor occupied"
            hint = "pass drop_missing=True to leave them out"
            raise ContentError(problem, rule, hint, kind=GeometryError)
    warn_of_notes(path)
    return points


def _warn_of_sizes(path: StrPath, names: Iterable[str]) -> None:
    """Warn of columns that give points a size, which nobody reads."""
    ignored = find_sizes(names)
    warn_of_names(str(path), ignored, ignored)


def _read_npy(path: StrPath) -> Floats:
    """Read points of a ``.npy`` file, shape (n, 3)."""
    array = read_npy(path)
    if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in "fiu":
        problem = f"holds shape {array.shape} and type {array.dtype}"
        rule = "a cloud is one array of points of shape (n, 3), and cells are boolean"
        raise ContentError(problem, rule)
    _refuse_cells(array)
    return np.array(array, dtype=np.float64, order="C")


def _read_text(path: StrPath) -> Floats:
    """Read points of a text file, shape (n, 3).

    Further columns are ignored.
    """
    text = read_text(path, "point cloud", memory=12.0)
    names, lines = _find_rows(text)
    rows = read_columns(text.split("\n", lines)[-1], lines + 1)  # shape (n, columns)
    if rows.shape[1] < 3:
        problem = f"has {rows.shape[1]} columns" if len(rows) else "holds no point"
        raise ContentError(problem, "points have x, y and z", BRING_YOUR_FILE, kind=GeometryError)
    if not names:
        _check_unnamed(rows)
        return np.ascontiguousarray(rows[:, :3])
    lower = [name.lower() for name in names]
    columns = [lower.index(axis) for axis in "xyz" if lower.count(axis) == 1]
    if len(columns) != 3 or len(names) != rows.shape[1]:
        refuse_degrees(names)
        problem = f"has {rows.shape[1]} columns under the heading {' '.join(names):.60}"
        rule = "it must name every column, and x, y and z once each, in metres"
        raise ContentError(problem, rule)
    _warn_of_sizes(path, names)
    return np.ascontiguousarray(rows[:, columns])


def _check_unnamed(rows: Floats) -> None:
    """Refuse rows without names of columns that do not begin with x, y and z."""
    count, columns = rows.shape
    _refuse_cells(rows)
    problem = ""
    if count > 1 and (rows[0] == np.arange(columns)).all():
        problem = "begins with the numbers of its columns"
    elif (
        columns > 3 and count > 2 and rows[0, 0] in (0.0, 1.0) and (np.diff(rows[:, 0]) == 1).all()
    ):
        problem = "begins each row with its number"
    if problem:
        rule = "rows without names of columns begin with x, y and z, in metres"
        raise ContentError(problem, rule)


def _refuse_cells(rows: Floats) -> None:
    """Raise ContentError for rows of free, occupied and unknown cells."""
    # No eight points are the corners of a cube, and they have three coordinates.
    if rows.shape[1] > 3 or len(rows) > 8:
        # Values that programs write for cells.
        levels = (-1, 0, 1, 100, 254, 255)
        if np.isin(rows[0], levels).all() and np.isin(rows, levels).all():
            rule = "a cloud has points, in metres"
            raise ContentError("holds the values of cells", rule, BRING_YOUR_FILE)


_BRACKETS: Final = re.compile(r"[\[(][^\])]*[\])]")
"""Unit of a column."""

_COUNTER: Final = re.compile(r"i|n|id|idx|index|n[or]|label|class|t|time|(time)?stamps?|frame|seq")
"""Name, in lower case, of a column before the coordinates."""

_NO_NAME: Final = re.compile(r"(\"\")?[,;\t]")
"""Beginning of a heading whose first column has no name."""

_WORD: Final = re.compile(r"[^\s,;\"']+")


def _find_rows(text: str) -> tuple[list[str], int]:
    """Return a text's column names and the lines before its rows.

    A heading is a line of words alone, or a comment with words that begin or end with x, y and z,
    or name degrees, or begin with the name of a counter. Without a heading, there are no names.
    """
    names: list[str] = []
    # Number of characters in which the first row of a text begins, or it has no heading.
    start = text[: 2**16]
    lines = (start if start == text else start.rpartition("\n")[0]).split("\n")
    rows = filter(None, map(_WORD.findall, lines))
    first_row = next((row for row in rows if _is_number(row[0])), [])
    for number, line in enumerate(lines):
        content = line.strip()
        is_comment = content.startswith(("#", "//"))
        words = _WORD.findall(content)
        is_heading = not any(map(_is_number, words))
        if is_comment:
            words = _WORD.findall(_BRACKETS.sub(" ", content.lstrip("#/")))
            is_heading = len(words) == len(first_row) and _names_columns(words)
        if words and is_heading:
            # pandas and R write an index, whose column has no name.
            has_index = _NO_NAME.match(line) and len(words) == len(first_row) - 1
            names = ["", *words] if has_index else words
        elif words and not is_comment:
            return names, number
    return names, len(lines)


def _names_columns(words: list[str]) -> bool:
    """Return True if a comment of as many words as columns is a heading, and no sentence."""
    lower = list(map(str.lower, words))
    ends = ({word[end] for word in lower} for end in (0, -1))
    has_axes = any({"x", "y", "z"} <= end for end in ends)
    has_counter = len(words) > 3 and _COUNTER.fullmatch(lower[0])
    return bool(has_axes or has_counter or list_degrees(words))


def _is_number(word: str) -> bool:
    """Return True if a word is a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True


def _read_ply_points(path: StrPath) -> Floats:
    """Read vertices of a ``.ply`` file, shape (n, 3)."""
    header = read_ply_header(path)
    _warn_of_sizes(path, [name for name, _ in header.properties["vertex"]])
    faces = header.counts.get("face", 0)
    if faces:
        warn_user(f"{path}: only the points of its {faces} faces are read")
    return read_ply(path)[0]


def read_pcd(path: StrPath) -> Floats:
    """Read coordinates of a ``.pcd`` file, shape (n, 3).

    They are in the unit of the file. Coordinates are NaN where the sensor saw nothing. The data may
    be ``ascii`` or ``binary``. The fields ``x``, ``y`` and ``z`` may have any numeric type; others
    are skipped. ``VIEWPOINT`` is warned of and not applied. Truncation of an
    ``ascii`` file within its last number cannot be detected.
    """
    # A header of text lines, then the points as text or as records.
    content = read_bytes(path, "PCD file", memory=12.0)
    entries, header_lines, header_end = _parse_pcd_header(content)
    encoding = " ".join(entries["DATA"])
    if encoding == "binary_compressed":
        raise ContentError(
            "holds compressed points", "only ascii and binary are read", BRING_YOUR_FILE
        )
    if encoding not in ("ascii", "binary"):
        problem = f"says DATA {encoding!r:.60}"
        raise ContentError(problem, "it must be ascii or binary")
    try:
        counts = [int(word) for word in entries.get("COUNT", ["1"] * len(entries["FIELDS"]))]
        record = _make_record(entries, counts)
        expected = _count_points(entries)
        viewpoint = [float(word) for word in entries.get("VIEWPOINT", _NO_VIEWPOINT)]
    except (TypeError, ValueError, IndexError) as error:
        rule = "fields need types F, I or U, a SIZE and a COUNT, and POINTS is their number"
        raise ContentError(f"has a malformed header: {error}", rule) from error
    fields = _find_coordinates(entries["FIELDS"], counts)
    _warn_of_sizes(path, entries["FIELDS"])
    if viewpoint != _NO_VIEWPOINT:
        warn_user(
            f"{path}: its VIEWPOINT is not applied, as in the Point Cloud Library: points count as "
            "they are"
        )
    if encoding == "binary":
        count = (len(content) - header_end) // record.itemsize
        if count < expected:
            raise ContentError(f"holds {count} points but its header says {expected}")
        excess = len(content) - header_end - expected * record.itemsize
        if excess:
            warn_user(
                f"{path}: it has {excess} bytes after its {expected} points, which are skipped; "
                "if its line ends were converted, all points are wrong"
            )
        cloud = np.frombuffer(content, record, expected, header_end)
        return np.concatenate([cloud[str(field)] for field in fields], axis=1, dtype=np.float64)
    rows = read_columns(content[header_end:].decode("latin-1"), header_lines + 1)
    if len(rows) != expected:
        raise ContentError(f"holds {len(rows)} points but its header says {expected}")
    if not expected:
        return np.zeros((0, 3))
    if rows.shape[1] != sum(counts):
        raise ContentError(f"has {rows.shape[1]} columns but its header says {sum(counts)}")
    # A field before x, y or z may have several columns.
    columns = [sum(counts[:field]) for field in fields]
    return np.ascontiguousarray(rows[:, columns])


def _parse_pcd_header(content: bytes) -> tuple[dict[str, list[str]], int, int]:
    """Return a PCD header's entries, lines and size."""
    entries: dict[str, list[str]] = {}
    end = 0
    for number, (line, after) in enumerate(iterate_header_lines(content), start=1):
        key, *values = line.partition("#")[0].split() or [""]
        if key and key not in _PCD_KEYS:
            rule = f"a PCD header has lines of {', '.join(_PCD_KEYS)}"
            raise ContentError(f"line {number} is {line[:40]!r}", rule)
        if key:
            entries["FIELDS" if key == "COLUMNS" else key] = values
        end = after
        if key == "DATA":
            break
    missing = [key for key in ("FIELDS", "SIZE", "TYPE", "DATA") if key not in entries]
    if missing or not ("POINTS" in entries or {"WIDTH", "HEIGHT"} <= entries.keys()):
        names = " and ".join(missing) or "POINTS"
        raise ContentError(f"lacks {names} in its header, which ends with DATA")
    return entries, number, end


def _make_record(entries: dict[str, list[str]], counts: list[int]) -> np.dtype[np.void]:
    """Return the data type of one point of a binary PCD file.

    Fields are named by index, because padding fields share one name. Raises TypeError or ValueError
    if there is no such type.
    """
    if not set(entries["TYPE"]) <= set("FIU"):
        raise ValueError(f"its types are {' '.join(entries['TYPE'])}")
    indices = range(len(entries["FIELDS"]))
    columns = zip(indices, entries["TYPE"], entries["SIZE"], counts, strict=True)
    return np.dtype(
        [
            (str(index), f"<{kind.lower()}{int(size)}", (count,))
            for index, kind, size, count in columns
        ]
    )


def _count_points(entries: dict[str, list[str]]) -> int:
    """Return the number of points in a PCD header.

    Raises ValueError or IndexError if an entry is no number, or they disagree.
    """
    sides = [int(entries[key][0]) for key in ("WIDTH", "HEIGHT") if key in entries]
    points = int(entries["POINTS"][0]) if "POINTS" in entries else math.prod(sides)
    if min([points, *sides]) < 0 or (len(sides) == 2 and math.prod(sides) != points):
        size = " x ".join(map(str, sides))
        raise ValueError(f"{points} points in {size} do not agree")
    return points


def _find_coordinates(fields: list[str], counts: list[int]) -> list[int]:
    """Return indices of the fields x, y and z."""
    indices = [fields.index(axis) for axis in "xyz" if fields.count(axis) == 1]
    if len(indices) != 3 or any(counts[index] != 1 for index in indices):
        refuse_degrees(fields)
        problem = f"has the fields {' '.join(fields)}"
        rule = "a cloud in space has x, y and z, once each, in metres"
        raise ContentError(problem, rule)
    return indices


CLOUD_READERS: Final[dict[str, Callable[[StrPath], Floats]]] = {
    ".npy": _read_npy,
    ".xyz": _read_text,
    ".txt": _read_text,
    ".csv": _read_text,
    ".ply": _read_ply_points,
    ".pcd": read_pcd,
}
"""Reader of each suffix."""
