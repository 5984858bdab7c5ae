"""Functions on the files of commands: check outputs, read paths, prepare stores."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cspace.errors import FileError, InputError

if TYPE_CHECKING:
    from cspace import Workspace


def check_outputs(paths: Iterable[Path | None], suffixes: Collection[str], overwrite: bool) -> None:
    """Check that outputs and their images can be written.

    Raises InputError if a suffix, in lower case, is not in ``suffixes``, or if two outputs are the
    same file; FileError if a folder is missing or not writable, or if an output exists and
    ``overwrite`` is not set.
    """
    from cspace.inside import check_output

    outputs = [path for path in paths if path is not None]
    for path in outputs:
        suffix = path.suffix.lower()
        if suffix not in suffixes:
            problem = f"ends in {path.suffix!r}"
            rule = f"it must be one of {', '.join(filter(None, suffixes))}"
            raise InputError(str(path), problem, rule)
        check_output(path, overwrite)
        if suffix in (".yaml", ".yml"):  # a ROS map has an image beside it
            check_output(path.with_suffix(".pgm"), overwrite)
    if len({path.resolve() for path in outputs}) < len(outputs):
        names = ", ".join(map(str, outputs))
        raise InputError(names, "name a file twice", "they must differ")


def check_folder(folder: Path) -> None:
    """Raise FileError unless a folder is writable or can be created."""
    from cspace.inside import check_output

    nearest_existing = folder
    while not nearest_existing.exists():
        nearest_existing = nearest_existing.parent
    check_output(nearest_existing / folder.name, overwrite=True)


def read_path(file: Path, axes: Sequence[str]) -> list[list[float]]:
    """Read configurations of a path by ``cspace plan``.

    The file is CSV with a row of names and a row for each configuration, or JSON with the
    configurations under ``path``. Raises FileError if the file cannot be read, has no path, or has
    other axes than ``axes``.
    """
    import numpy as np

    # A file that is no table of numbers fails in the block; later checks refuse other tables.
    columns = ", ".join(axes)
    rule = f"the map's axes are {columns}"
    try:
        names, rows = _read_table(file, axes)
        points = np.array(rows, dtype=np.float64)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        rule = f"it must be CSV with the columns {columns}, or JSON with such rows under path"
        raise FileError(str(file), "has no path", rule) from error
    if names != list(axes):
        raise FileError(str(file), f"has {', '.join(names)}", rule)
    if not len(points):
        raise FileError(str(file), "has no configuration", "a path has at least one")
    if points.shape[1:] != (len(axes),):
        raise FileError(str(file), f"has an array {points.shape}", rule)
    return [list(row) for row in points.tolist()]


def _read_table(file: Path, axes: Sequence[str]) -> tuple[list[str], Any]:
    """Return the column names and the rows of a path file, unchecked.

    JSON without names has the columns ``axes``. Numbers of CSV are texts.
    """
    from cspace.inside import read_document

    document = read_document(file, "path")
    if file.suffix.lower() == ".json":
        return list(document.get("axes", axes)), document["path"]
    header, *rows = document or [[]]
    # The path of a car has an additional column: its direction of driving.
    columns = [column for column, name in enumerate(header) if name != "direction"]
    texts = [(row + [""] * len(header)) for row in rows if row]
    return [header[column] for column in columns], [[row[k] for k in columns] for row in texts]


def prepare_store(output: Path, overwrite: bool) -> None:
    """Check that a store can be created or resumed.

    With ``overwrite``, remove an old one.

    Raises InputError if the suffix is not .zarr; FileError if something else exists, or if the path
    is not writable.
    """
    from cspace.inside import MapFolder

    exists = MapFolder(output).exists() or MapFolder(output, tiles=True).exists()
    check_outputs([output], (".zarr",), overwrite=exists)
    if exists and overwrite:
        MapFolder(output).remove()


def open_lazily(workspace: Path, **options: Any) -> Workspace:
    """Open a workspace, without reading its cells if its format allows that."""
    from cspace import Workspace

    if options.get("solid") != "fill":
        with suppress(InputError):  # most readers have no option ``lazy``
            return Workspace.open(workspace, lazy=True, **options)
    return Workspace.open(workspace, **options)


def select_window(space: Any, box: Sequence[float] | None) -> Any:
    """Select the part of a map to export.

    That is the window in ``box`` of a tiled map, or a map in memory itself. Raises InputError if a
    tiled map has no box, or a map in memory has one.
    """
    from cspace import CSpace

    if isinstance(space, CSpace) != (box is None):
        problem = "is missing" if box is None else "is given"
        rule = "export writes parts of tiled maps, and whole maps in memory"
        raise InputError("window", problem, rule)
    if box is None:
        return space
    dim = len(box) // 2
    return space.window(box[:dim], box[dim:])
