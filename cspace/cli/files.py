"""Files of commands: checks of outputs, path files, saved maps and stores."""

from __future__ import annotations

import csv
import os
import shutil
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cspace.errors import FileError, InputError

if TYPE_CHECKING:
    from cspace.space import CSpace
    from cspace.tiles.space import TiledCSpace


def check_outputs(paths: Collection[Path], suffixes: Collection[str], overwrite: bool) -> None:
    """Check that output files, and images written beside them, can be written.

    Raises InputError if a suffix, in lower case, is not in ``suffixes``, or if two outputs are the
    same file; FileError if a folder is missing or not writable, or if an output exists and
    ``overwrite`` is not set.
    """
    from cspace.files.access import check_output

    for path in paths:
        if path.suffix.lower() not in suffixes:
            hint = f"use one of {', '.join(suffix for suffix in suffixes if suffix)}"
            raise InputError(
                str(path),
                f"ends in {path.suffix!r}",
                "the suffix says what to write",
                hint,
                value=path,
            )
        image = [path.with_suffix(".pgm")] if path.suffix.lower() in (".yaml", ".yml") else []
        for target in (path, *image):
            check_output(target, overwrite)
    if len({path.resolve() for path in paths}) < len(paths):
        names = ", ".join(map(str, paths))
        raise InputError(
            names, "name a file twice", "they must differ", "choose another name", value=paths
        )


def check_folder(folder: Path) -> None:
    """Check that a folder is writable, or can be created.

    Raise FileError otherwise.
    """
    existing = folder
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    if not existing.is_dir() or not os.access(existing, os.W_OK | os.X_OK):
        problem = f"cannot be written: {existing.resolve()} is not a writable folder"
        raise FileError(str(folder), problem, "outputs need a writable folder", "choose another")


def read_path(file: Path, axes: Sequence[str]) -> list[list[float]]:
    """Read the configurations of a path written by ``cspace plan``.

    The file is CSV with a row of names and a row for each configuration, or JSON with the
    configurations under ``path``. Raises FileError if the file cannot be read, has no path, or has
    other axes than ``axes``.
    """
    hint = "write a path on this map with cspace plan"
    try:
        names, rows = _read_table(file)
        points = [[float(value) for value in row] for row in rows]
        if any(len(point) != len(points[0]) for point in points):
            raise ValueError
    except (ValueError, TypeError, KeyError, csv.Error) as error:
        rule = (
            f"it must be CSV with the columns {', '.join(axes)}, or JSON with such rows under path"
        )
        raise FileError(str(file), "has no path", rule, hint) from error
    if names != tuple(axes) and (names or (points and len(points[0]) != len(axes))):
        problem = f"has {', '.join(names) or f'{len(points[0])} columns'}"
        raise FileError(str(file), problem, f"the map's axes are {', '.join(axes)}", hint)
    if not points:
        raise FileError(str(file), "has no configuration", "a path has at least one", hint)
    return points


def _read_table(file: Path) -> tuple[tuple[str, ...], Any]:
    """Return the column names, if any, and the rows of a path."""
    from cspace.files.access import read_text
    from cspace.files.plain import read_json

    if file.suffix.lower() == ".json":
        record = read_json(file, "path")
        if not isinstance(record, dict):
            raise ValueError
        return tuple(record.get("axes", ())), record["path"]
    rows = list(csv.reader(read_text(file, "path").splitlines()))
    # The path of a car has an additional column: its direction of driving.
    columns = [index for index, name in enumerate(rows[0] if rows else ()) if name != "direction"]
    names = tuple(rows[0][index] for index in columns)
    return names, [
        [row[index] for index in columns] if len(row) == len(rows[0]) else row for row in rows[1:]
    ]


def prepare_store(output: Path, overwrite: bool) -> None:
    """Check that a store can be created or resumed at a path.

    Remove an old store if ``overwrite`` is set. Raises InputError if the suffix is not .zarr, and
    FileError if something else exists or the path is not writable.
    """
    from cspace.record.save import read_format

    exists = bool(read_format(output))
    check_outputs([output], (".zarr",), overwrite=exists)
    if exists and overwrite:
        shutil.rmtree(output)


def lazy_option(workspace: Path, options: dict[str, Any]) -> dict[str, Any]:
    """Return ``{"lazy": True}`` if cells can stay in their file, or {}."""
    from cspace.workspace import reader_of

    try:
        reader_of(workspace, [*options, "lazy"])
    except InputError:
        return {}
    return {} if options.get("solid") == "fill" else {"lazy": True}


def select_window(space: CSpace | TiledCSpace, box: Sequence[float] | None) -> CSpace:
    """Return a map in memory, or a window of a tiled map.

    Raises InputError if the map is tiled and ``box`` is None, or the other way round.
    """
    from cspace.tiles.space import TiledCSpace

    if isinstance(space, TiledCSpace):
        if box is None:
            hint = "select a part with --window"
            raise InputError("MAP", "is a tiled map", "export needs it in memory", hint)
        return space.window(box[: len(box) // 2], box[len(box) // 2 :])
    if box is not None:
        raise InputError("window", "is given", "it is for tiled maps", "omit it", value=box)
    return space
