"""Files of the command line: outputs, checked before any work, saved paths, and what a saved map is of."""

from __future__ import annotations

import csv
import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

from cspace.errors import FileError, InputError


def check_outputs(paths: Collection[Path], suffixes: Collection[str], overwrite: bool) -> None:
    """Check that files, and those that are written beside them, can be written, before work that would be lost.

    Raises InputError if a suffix, in lower case, is none of the ``suffixes``, or two outputs have the same name, and
    FileError if a folder is missing or may not be written, or if an output exists and may not be replaced.
    """
    from cspace.files.access import check_output

    for path in paths:
        if path.suffix.lower() not in suffixes:
            mend = f"use one of {', '.join(suffix for suffix in suffixes if suffix)}"
            raise InputError(str(path), f"ends in {path.suffix!r}", "the suffix says what to write", mend, value=path)
        image = [path.with_suffix(".pgm")] if path.suffix.lower() in (".yaml", ".yml") else []
        for target in (path, *image):
            check_output(target, overwrite)
    if len({path.resolve() for path in paths}) < len(paths):
        raise InputError(
            ", ".join(map(str, paths)), "name one file twice", "outputs differ", "choose another name", value=paths
        )


def check_folder(folder: Path) -> None:
    """Check that a folder is there or can be made, and can be written.

    Raises FileError if not.
    """
    there = folder
    while not there.exists() and there != there.parent:
        there = there.parent
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        fault = f"cannot be written: {there.resolve()} is not a folder that may be written"
        raise FileError(str(folder), fault, "outputs need one", "choose another")


def axes_of_map(file: Path) -> tuple[str, ...]:
    """Return the names of the numbers of a saved map's configurations.

    Read from its metadata alone: a map in space is large, and a wrong option is reported at once.

    Raises FileError if the file is not a map that can be opened.
    """
    from cspace.opening import open_map
    from cspace.store.saved import read_metadata

    try:
        return tuple(read_metadata(file)["axes"].split())
    except Exception:  # Whatever is wrong with the map, opening it raises the better error.
        return open_map(file).axes


def units_of_map(file: Path) -> tuple[str, ...]:
    """Return the units of these numbers: "m", "rad", or "1" for those of a quaternion.

    Raises FileError if the file is not a map that can be opened.
    """
    from cspace.opening import open_map
    from cspace.rotations import Rotations
    from cspace.store.saved import read_metadata

    try:
        metadata = read_metadata(file)
        axes, units = metadata["axes"].split(), metadata.get("units", "").split()
    except Exception:  # As above.
        return open_map(file).units
    # Files of earlier versions have no units; they are in metres.
    known = Rotations.all_units()
    return (*units, *(known.get(axis, "m") for axis in axes[len(units) :]))


def read_path(file: Path, axes: Sequence[str]) -> list[list[float]]:
    """The configurations of a path, as ``cspace plan`` writes it, on a map whose configurations are ``axes``.

    That is a CSV file with one configuration in a row below one row of names, or JSON with the configurations under
    ``path``; metres, and radians.

    Raises FileError if the file cannot be read or holds no path, or one of other configurations.
    """
    mend = "let cspace plan write a path on this map"
    try:
        names, rows = _table(file)
        points = [[float(value) for value in row] for row in rows]
        if any(len(point) != len(points[0]) for point in points):
            raise ValueError
    except (ValueError, TypeError, KeyError, csv.Error) as error:
        rule = f"it is a CSV file with the columns {', '.join(axes)}, or a JSON file with rows of them under path"
        raise FileError(str(file), "holds no path", rule, mend) from error
    if names != tuple(axes) and (names or (points and len(points[0]) != len(axes))):
        rule = f"the configurations of the map are {', '.join(axes)}"
        raise FileError(str(file), f"holds {', '.join(names) or 'others'}", rule, mend)
    if not points:
        raise FileError(str(file), "holds no configuration", "a path has at least one", mend)
    return points


def _table(file: Path) -> tuple[tuple[str, ...], Any]:
    """Names of a path's columns, where the file has them, and its configurations."""
    from cspace.files.access import read_text
    from cspace.files.plain import read_json

    if file.suffix.lower() == ".json":
        record = read_json(file, "path")
        if not isinstance(record, dict):
            raise ValueError
        return tuple(record.get("axes", ())), record["path"]
    rows = list(csv.reader(read_text(file, "path").splitlines()))
    # A car's path has a column more: whether it drives ahead or back.
    columns = [number for number, name in enumerate(rows[0] if rows else ()) if name != "direction"]
    names = tuple(rows[0][number] for number in columns)
    return names, [[row[number] for number in columns] if len(row) == len(rows[0]) else row for row in rows[1:]]
