"""Building of tiled maps, tile by tile."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from cspace import Robot, Workspace
from cspace._tiles.folder import (
    WORKSPACE_CELL_BYTES,
    TileFolder,
    grow_box,
    make_frame,
    make_stamp,
    to_slices,
    write_once,
)
from cspace._tiles.tiled_space import TiledCSpace
from cspace._tiles.work import run_tasks
from cspace.errors import FileError, InputError
from cspace.inside import Bools, Contents, MapFolder, StrPath

if TYPE_CHECKING:
    from distributed import Client

MAX_TILE_STATES: Final = 2**28
"""Maximum number of states in the interior of a tile, all of which are in memory at once."""


def build_tiles(
    workspace: Workspace,
    robot: Robot,
    store: StrPath,
    tile: int | Sequence[int],
    *,
    build: Callable[..., tuple[Contents, Any]],
    estimate: Callable[..., float],
    method: str,
    inner: bool,
    client: Client | None,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
    **options: Any,
) -> TiledCSpace:
    """Build a map into a folder of tiles, or resume a build.

    The caller, :func:`cspace.build`, has checked the other arguments; ``options`` are
    ``rotations``, ``outside`` and ``margin``. ``build`` makes a map in memory, and ``estimate``
    returns the bytes that it needs. Raises InputError if ``tile`` is invalid or a task exceeds the
    memory; FileError if ``store`` holds something else, cannot be written, or the workspace
    changes.
    """
    grid = workspace.grid
    stamp = workspace.cells.stamp
    frame = make_frame(workspace, robot, proves_blocked=inner, **options)
    slices = len(frame.states)
    sides = resolve_tile(tile, grid.shape, slices)
    layout = {
        "shape": list(grid.shape),
        "side": list(sides),
        "stamp": make_stamp(frame, grid.shape, sides, stamp),
        "source_stamp": stamp,
    }
    folder = _open_or_create(Path(store), frame, layout)
    build = partial(build, inner=inner, method=method, workers=1 if client else workers)
    # Tasks skip tiles that are whole, and build damaged ones again, of a complete map too.
    task = partial(build_tile, folder, workspace.cells, build)
    window = locate_window(folder)
    needed = estimate_tile_bytes(folder, window, estimate)
    grid = folder.sub_grid(np.array([[0] * len(window), window]))
    run_tasks(task, range(len(folder)), needed, grid, client, workers, progress)
    is_complete = folder.frame.exterior is not None
    return TiledCSpace(folder if is_complete else folder.complete())


def _open_or_create(path: Path, frame: Contents, layout: dict[str, Any]) -> TileFolder:
    """Open the folder of a build to resume, or create one.

    Raises FileError if the folder holds another map.
    """
    root = path.absolute()  # workers have other working folders
    saved = MapFolder(root, tiles=True)
    with saved.reporting_damage():
        folder = TileFolder(root, layout, frame)
    if saved.exists() or not write_once(root, frame, tiles=layout):
        folder = TileFolder.open(root)
    if folder.layout["stamp"] != layout["stamp"]:
        problem = "holds another map, or one of other obstacles"
        rule = "a build resumes only with the same robot, rotations, options and obstacles"
        raise FileError(str(path), problem, rule)
    return folder


def locate_window(folder: TileFolder) -> list[int]:
    """Return the largest number of cells, along each axis, of the window around a tile."""
    border = 2 * (folder.halo + folder.reach)
    return [min(side + border, n) for side, n in zip(folder.tile, folder.grid.shape, strict=True)]


def estimate_tile_bytes(
    folder: TileFolder, window: Sequence[int], estimate: Callable[..., float]
) -> float:
    """Estimate the memory to build one tile, in bytes.

    That is the memory for the map of the window around the tile, and for copies of it.
    """
    frame = folder.frame
    slices = folder.slices
    copies = (2 * WORKSPACE_CELL_BYTES + slices) * math.prod(window)
    spacing = frame.grid.spacing
    return copies + estimate(window, spacing, frame.robot, frame.rotations, frame.margin, slices)


class CellSource(Protocol):
    """Cells of a workspace, read a box at a time."""

    def read(self, box: tuple[slice, ...]) -> tuple[Bools, Bools]:
        """Return the outer and inner cells of a box."""

    @property
    def stamp(self) -> str:
        """Digest that changes when the cells change."""


def build_tile(
    folder: TileFolder, source: CellSource, build: Callable[..., tuple[Contents, Any]], tile: int
) -> None:
    """Build and write a tile, unless it is there.

    The states of a cell depend on the obstacles that the robot reaches from it. So the map of a
    window is built, larger than the tile by the robot's reach, and the tile is cut out of it.
    Raises FileError if the workspace has changed since the build began.
    """
    # An earlier build, another process, or a worker that was lost may have written the tile.
    path = folder.tile_path(tile)
    if path.exists():
        with suppress(FileError):
            folder.read_tile(tile)
            return
        # It is damaged, as after a power failure. A tile that was missing is never discarded:
        # another process may have written it meanwhile, and counts on it.
        MapFolder(path).remove()
    frame = folder.frame
    name = frame.workspace.source
    cells = folder.locate_tile(tile)
    window = folder.clip(grow_box(cells, folder.reach))
    outer, inner = source.read(to_slices(window))
    if source.stamp != folder.layout["source_stamp"]:
        problem = "has changed: its size, time or digest differs"
        raise FileError(name, problem, "the workspace must not change while a map is built")
    surroundings = Workspace(folder.sub_grid(window), outer, inner)
    built, _ = build(
        surroundings,
        frame.robot,
        frame.rotations,
        outside=frame.outside,
        margin=frame.margin,
        rasters=folder.rasters,
    )
    in_window = to_slices(cells - window[0])
    workspace = Workspace(folder.sub_grid(cells), outer[in_window], inner[in_window], source=name)
    folder.write_tile(tile, folder.make_part(workspace, built.states[:, *in_window]))


def resolve_tile(tile: int | Sequence[int], shape: Sequence[int], slices: int) -> tuple[int, ...]:
    """Return the number of cells of a tile along each axis.

    It is ``tile``, limited by the grid and by ``MAX_TILE_STATES``. Raises InputError unless
    ``tile`` is a positive integer, or one for each axis.
    """
    cells = np.asarray(tile)
    has_shape = cells.shape in ((), (len(shape),))
    if cells.dtype.kind not in "iu" or not has_shape or (cells < 1).any():
        rule = "it must be a positive integer, or one for each axis"
        raise InputError("tile", f"is {tile!r}", rule)
    sides = np.minimum(cells, shape)
    while slices * math.prod(sides.tolist()) > MAX_TILE_STATES and sides.max() > 1:
        longest = np.argmax(sides)
        sides[longest] = -(-sides[longest] // 2)  # half, rounded up
    return tuple(sides.tolist())
