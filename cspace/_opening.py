"""``open_map``, which opens a saved map in memory or as a tiled map."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cspace._files.access import inspect_path, suggest_file
from cspace._record.save import MapFolder
from cspace._space import CSpace
from cspace._support.arrays import StrPath
from cspace._support.check import names_options
from cspace.errors import FileError

if TYPE_CHECKING:
    from cspace._tiles.tiled_space import TiledCSpace


@names_options
def open_map(path: StrPath, *, cache_bytes: int = 2**30) -> CSpace | TiledCSpace:
    """Open a saved map, or a map in tiles.

    Parameters
    ----------
    path : path-like
        A Zarr folder that :meth:`cspace.CSpace.save` or :func:`cspace.build` with a ``store``
        wrote.
    cache_bytes : int
        Memory for open tiles of a map in tiles; at least one stays open.

    Returns
    -------
    CSpace or TiledCSpace
        Equal to the map that was saved or built. A map in tiles stays in its folder.

    Raises
    ------
    FileError
        If the map is missing, unreadable, truncated or changed, of another version of the format,
        or replaced by another process while it is read; then open it again.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> field = cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1)
    >>> space = cspace.build(field, cspace.Robot.disc(0.2))
    >>> space.save("map.zarr")
    >>> cspace.open("map.zarr").count() == space.count()
    True
    """
    _check_folder(path)
    if MapFolder(path, tiles=True).exists():
        from cspace._tiles.tiled_space import open_tiles

        return open_tiles(path, cache_bytes)
    saved = MapFolder(path)
    contents, _ = saved.read()
    with saved.reporting_damage():
        return CSpace(contents)


open = open_map  # noqa: A001 - its public name, cspace.open


def _check_folder(path: StrPath) -> None:
    """Raise FileError unless a path is a folder."""
    file, what = inspect_path(path, "saved map")
    if what == "a folder":
        return
    problem = "is not a saved map" if what else "does not exist"
    rule = "a saved map is a Zarr folder"
    hint = suggest_file(file)
    if file.suffix.lower() == ".npz":
        rule = f"{rule}; .npz is an export, for numpy.load"
    raise FileError(str(file), problem, rule, hint)
