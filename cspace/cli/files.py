"""Files of commands: outputs, checked before any work, paths, saved maps and stores of tiles."""

from __future__ import annotations

import csv
import os
import shutil
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cspace.errors import FileError, InputError, optional

if TYPE_CHECKING:
    from cspace.space import CSpace
    from cspace.tiles.space import TiledCSpace


def check_outputs(paths: Collection[Path], suffixes: Collection[str], overwrite: bool) -> None:
    """Check that files, and those that are written beside them, can be written, before work that would be lost.

    Raises InputError if a suffix, in lower case, is none of the ``suffixes``, or two outputs have the same name, and
    FileError if a folder is missing or may not be written, or if an output exists and may not be replaced.
    """
    from cspace.files.access import check_output

    for path in paths:
        if path.suffix.lower() not in suffixes:
            hint = f"use one of {', '.join(suffix for suffix in suffixes if suffix)}"
            raise InputError(str(path), f"ends in {path.suffix!r}", "the suffix says what to write", hint, value=path)
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
        problem = f"cannot be written: {there.resolve()} is not a folder that may be written"
        raise FileError(str(folder), problem, "outputs need one", "choose another")


def axes_of_map(file: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the numbers of a saved map's configurations, and their units: "m", "rad", or "1".

    Read from its metadata alone: a map in space is large, and a wrong option is reported at once.

    Raises FileError if the file is not a map that can be opened.
    """
    from cspace.opening import open_map
    from cspace.rotations import Rotations
    from cspace.store import read_metadata

    try:
        metadata = read_metadata(file)
        axes, units = metadata["axes"].split(), metadata.get("units", "").split()
    except Exception:  # Whatever is wrong with the map, opening it raises the better error.
        space = open_map(file)
        return space.axes, space.units
    known = Rotations.all_units()
    return tuple(axes), (*units, *(known.get(axis, "m") for axis in axes[len(units) :]))


def read_path(file: Path, axes: Sequence[str]) -> list[list[float]]:
    """The configurations of a path, as ``cspace plan`` writes it, on a map whose configurations are ``axes``.

    That is a CSV file with one configuration in a row below one row of names, or JSON with the configurations under
    ``path``; metres, and radians.

    Raises FileError if the file cannot be read or holds no path, or one of other configurations.
    """
    hint = "let cspace plan write a path on this map"
    try:
        names, rows = _table(file)
        points = [[float(value) for value in row] for row in rows]
        if any(len(point) != len(points[0]) for point in points):
            raise ValueError
    except (ValueError, TypeError, KeyError, csv.Error) as error:
        rule = f"it is a CSV file with the columns {', '.join(axes)}, or a JSON file with rows of them under path"
        raise FileError(str(file), "holds no path", rule, hint) from error
    if names != tuple(axes) and (names or (points and len(points[0]) != len(axes))):
        rule = f"the configurations of the map are {', '.join(axes)}"
        raise FileError(str(file), f"holds {', '.join(names) or 'others'}", rule, hint)
    if not points:
        raise FileError(str(file), "holds no configuration", "a path has at least one", hint)
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


def make_room(output: Path, overwrite: bool) -> None:
    """Check that a store can be made at a path, or gone on with; an old one is removed if it may be replaced.

    Raises InputError if the suffix is not that of a store, and FileError if there is something else, or nothing can be
    written.
    """
    from cspace.store import is_store

    there = is_store(output)
    check_outputs([output], (".zarr",), overwrite=there)
    if there and overwrite:
        shutil.rmtree(output)


@contextmanager
def resumable(output: Path, overwrite: bool) -> Iterator[None]:
    """Say of an interruption in the block, if a store has been begun, that the same command resumes."""
    from cspace.store import is_store

    try:
        yield
    except KeyboardInterrupt as interrupt:
        if not is_store(output):
            raise
        command = "the same command without --overwrite" if overwrite else "the same command"
        raise KeyboardInterrupt(f"{command} resumes with {output}") from interrupt


def lazily(workspace: Path, options: dict[str, Any]) -> dict[str, Any]:
    """The option that makes the reader of a workspace leave the cells in their file, if it has it."""
    from cspace.workspace import reader_of

    try:
        reader_of(workspace, [*options, "lazy"])
    except InputError:
        return {}
    return {} if options.get("solid") == "fill" else {"lazy": True}


@contextmanager
def cluster(address: str | None) -> Iterator[Any]:
    """The client of a cluster at an address; None without one.

    Raises MissingPackageError if dask is not installed, and InputError if nothing answers there.
    """
    if address is None:
        yield None
        return
    from cspace.tiles.work import CLUSTER

    try:
        client = optional("distributed", CLUSTER, "distributed").Client(address, timeout=10)
    except (OSError, ValueError, TimeoutError) as error:
        problem, rule = f"is {address!r}, where nothing answers ({error})", "it must be the address of a dask scheduler"
        raise InputError("--scheduler", problem, rule, "start one, with dask scheduler", value=address) from error
    with client:
        yield client


def part_of(space: CSpace | TiledCSpace, box: Sequence[float] | None) -> CSpace:
    """The map itself; of one in tiles, the window in a box.

    Raises InputError if a map in tiles lacks a box, or another one has it.
    """
    from cspace.tiles.space import TiledCSpace

    if isinstance(space, TiledCSpace):
        if box is None:
            rule = "what is written is made in memory"
            raise InputError("MAP", "is in tiles", rule, "add --window, a box in metres, for a part of it")
        return space.window(box[: len(box) // 2], box[len(box) // 2 :])
    if box is not None:
        raise InputError("--window", "is given", "it is for maps in tiles", "leave it out", value=box)
    return space
