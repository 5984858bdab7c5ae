"""build: a workspace and a robot to the certified map of the robot's configurations.

With the rasters of :mod:`cspace.raster`, an overlap of zero between the workspace's outer cells and the robot's outer
offsets proves a cell FREE, and an overlap of the inner ones proves it BLOCKED (see ``docs/certificate.md``).
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace.check import check_word, not_negative, whole
from cspace.engines import ENGINES, METHODS
from cspace.engines.slices import (
    Correlation,
    Progress,
    RasterGroups,
    RasterPair,
    RasterTask,
    group_rasters,
    raster_bytes,
    raster_tasks,
    slice_rasters,
)
from cspace.errors import InputError
from cspace.limits import SCRATCH_BYTES, SLICE_BYTES, TRANSFORM_BYTES, build_seconds, check_memory, is_packed, map_bytes
from cspace.map.contents import Contents
from cspace.map.exterior import OUTSIDES, Exterior
from cspace.map.storage import PackedStates, Stack
from cspace.robot import GROWN, Robot, robot_of
from cspace.rotations import Rotations
from cspace.space import CSpace
from cspace.threads import cores, in_threads
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from distributed import Client

    from cspace.shapes import ShapeLike
    from cspace.tiles.space import TiledCSpace


class BuildOptions(TypedDict, total=False):
    """What :func:`build` takes, whatever becomes of the map."""

    rotations: int | ArrayLike | Rotations | None
    inner: bool
    counts: bool
    method: str
    outside: str
    margin: float
    workers: int | None
    progress: Progress | None


@overload
def build(
    workspace: Workspace, robot: Robot | ShapeLike, *, store: None = None, **options: Unpack[BuildOptions]
) -> CSpace: ...
@overload
def build(
    workspace: Workspace,
    robot: Robot | ShapeLike,
    *,
    store: str | os.PathLike[str],
    tile: int | Sequence[int] = 4096,
    client: Client | None = None,
    **options: Unpack[BuildOptions],
) -> TiledCSpace: ...
def build(
    workspace: Workspace,
    robot: Robot | ShapeLike,
    *,
    rotations: int | ArrayLike | Rotations | None = None,
    inner: bool = True,
    counts: bool = False,
    method: str = "auto",
    outside: str = "blocked",
    margin: float = 0.0,
    workers: int | None = None,
    progress: Progress | None = None,
    store: str | os.PathLike[str] | None = None,
    tile: int | Sequence[int] = 4096,
    client: Client | None = None,
) -> CSpace | TiledCSpace:
    """Map the configurations of a robot that translates, and may turn, in the plane or in space.

    Parameters
    ----------
    workspace : Workspace
        The obstacles.
    robot : Robot, or shape
        The robot, of the same dimension. A shape (a ``trimesh.Trimesh``, a shapely polygon, or anything else that
        :meth:`CSpace.add_obstacle` takes) is a robot whose reference point is its origin.
    rotations : int, array-like or Rotations, optional
        For a robot that turns, in space about the z axis: a number of equal cells of yaw, the first with its middle at
        0, or the borders of the cells in radians, ascending over a whole turn. For one that turns about any axis in
        space: :meth:`cspace.Rotations.quaternions`. FREE and BLOCKED are then proven for every position and every
        rotation of a cell. Slices that a symmetry of the robot repeats are computed and stored once. Of more than 2^29
        states, in 8 slices or more and without overlap counts, each is stored in two bits instead of a byte; look-ups
        answer alike, and what needs bytes of all of them refuses where they do not fit. If left out, the robot only
        translates.
    inner : bool
        Also prove cells BLOCKED. Without it, every cell that is not FREE is MIXED, at half the work.
    counts : bool
        Store the overlap counts of the outer rasters as :attr:`CSpace.overlap_counts`.
    method : {"auto", "fft", "direct"}
        The engine; the map is the same, cell for cell. "fft" correlates by transforms, "direct" dilates 64 cells at a
        time, and "auto" takes that unless the robot has very many rows, or overlap counts are wanted, which only
        the transforms give.
    outside : {"blocked", "free"}
        Whether what lies outside the workspace's bounds is obstacle or free.
    margin : float
        Metres by which the robot is grown for FREE; BLOCKED keeps to the robot as it is.
    workers : int, optional
        Threads; by default one for each core that the process may use.
    progress : callable, optional
        Called with (steps done, steps in all); with a store, of tiles.
    store : path-like, optional
        A folder to build the map into, tile by tile, for maps that do not fit into memory; see ``docs/large.md``. The
        same call again resumes a build that was stopped. Overlap counts are not stored.
    tile : int or sequence of int
        Cells of a tile along each axis, at most; the longest sides are halved until a tile has at most 2^28 cells.
    client : dask.distributed.Client, optional
        The cluster on whose workers tiles are made; threads of this process, if left out. The store must be a folder
        that all of them see.

    Returns
    -------
    CSpace
        With a store, a :class:`cspace.TiledCSpace`.

    Raises
    ------
    InputError
        If an argument breaks its rule, the robot is absurdly large at the workspace's spacing, or the map does not fit
        into the memory that is free; the message says what would.
    FileError
        If the store is of something else, or cannot be written, or the workspace changes while it is read.

    References
    ----------
    L. E. Kavraki, "Computation of configuration-space obstacles using the fast Fourier transform", 1995.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> occupied = np.zeros((40, 30), dtype=bool)
    >>> occupied[20, :20] = True
    >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.3))
    >>> space.is_free([1.0, 1.5])
    True
    """
    margin, cells = not_negative(margin, "margin", GROWN), Rotations.of(rotations)
    for name, given, kind, is_wrong, hint in (
        ("workspace", workspace, "Workspace", not isinstance(workspace, Workspace), "Workspace.from_array(...) first"),
        ("robot", robot, "Robot", isinstance(robot, Workspace | str | os.PathLike), "Robot.parse('disc:0.3') second"),
    ):
        if is_wrong:
            hint = f"call build(workspace, robot), with e.g. {hint}"
            raise InputError(name, f"is a {type(given).__name__}", f"it must be a {kind}", hint, value=given)
    robot = robot_of(robot)
    _check(workspace, robot, cells, method, counts, outside, workers)
    if store is not None:
        from cspace.tiles.build import Settings, build_tiles

        if counts:
            rule, hint = (
                "a store of tiles holds states alone",
                "leave it out, and take overlaps from windows of the map",
            )
            raise InputError("counts", "is True, with a store", rule, hint, value=counts)
        settings: Settings = {
            "rotations": cells,
            "inner": inner,
            "method": method,
            "outside": outside,
            "margin": margin,
            "client": client,
            "workers": workers,
            "progress": progress,
        }
        return build_tiles(workspace, robot, store, tile, settings)
    if client is not None:
        raise InputError(
            "client", "is given without a store", "its workers make tiles", "pass store='map.zarr'", value=client
        )
    workspace = workspace.in_memory()
    grid = workspace.grid
    slice_of = cells.slices_for(robot.shape)
    slices = int(slice_of.max()) + 1
    about_rasters = raster_bytes(robot, grid.spacing, margin, cells, slices)
    if is_packed(grid.shape, slices, counts):
        about_rasters = min(about_rasters, SLICE_BYTES * slices)  # only some are there at a time
    needed = map_bytes(grid.shape, slices, counts) + about_rasters
    check_fits = partial(check_memory, grid=grid, fewer=cells.fewer, slices=slices, rasters=about_rasters)
    check_fits(needed, "the map", fixed=TRANSFORM_BYTES, seconds=build_seconds(grid.shape, slices))
    rasters, exterior, overlaps = None, None, None
    states: Stack

    def correlation_of(
        pairs: Sequence[RasterPair], engines: int, workers: int | None, progress: Progress | None
    ) -> tuple[Correlation, RasterGroups]:
        """The engine for the rasters of slices, and these by side, where so many engines work in parallel."""
        sides = group_rasters(pairs, inner)
        correlation = Correlation.create(method, sides, outside, workers, progress, counts)
        own = engines * max(correlation.engine.bytes_needed(grid.shape, side, workers) for side in sides)
        if own > TRANSFORM_BYTES:  # what every build may take was looked at
            what = "the map, with what its engine needs for this robot,"
            check_fits(needed + own - TRANSFORM_BYTES, what)
        return correlation, sides

    if is_packed(grid.shape, slices, counts):
        # Each thread makes slices, from the robot's rasters to states in two bits, before it begins with others; all
        # make one together where that is large.
        states = packed = PackedStates((slices, *grid.shape))
        table, lock = np.empty((slices, 2 * grid.dim + 1), dtype=np.int64), Lock()
        parts = raster_tasks(robot, grid.spacing, margin, cells)
        large, room = grid.size > SCRATCH_BYTES, max(1, SCRATCH_BYTES // grid.size)
        threads = 1 if large else workers or cores()

        def settle(parts: Sequence[RasterTask]) -> str:
            made = list(itertools.chain.from_iterable(part() for part in parts))
            scratch, precision = np.empty((min(room, len(made)), *grid.shape), dtype=np.uint8), ""
            for start in range(0, len(made), room):
                numbers, pairs = zip(*made[start : start + room], strict=True)
                correlation, sides = correlation_of(pairs, threads, workers if large else 1, None)
                own = correlation.fill(workspace.outer, workspace.inner, sides, scratch[: len(pairs)], None)
                precision = max(precision, own)
                with lock:
                    for number, filled in zip(numbers, scratch, strict=False):
                        packed.write(number, filled)
                table[list(numbers)] = Exterior.of(workspace.outer, pairs, outside).table
            return precision

        each = max(1, room * len(parts) // slices)
        batches = [parts[k : k + each] for k in range(0, len(parts), each)]
        advance = None if progress is None else partial(_advance, progress, slices, len(batches))
        precision = max(in_threads(settle, batches, threads, advance))
        exterior = Exterior(table)
    else:
        rasters = slice_rasters(robot, grid.spacing, margin, cells)
        correlation, sides = correlation_of(rasters, 1, workers, progress)
        states = np.empty((slices, *grid.shape), dtype=np.uint8)
        overlaps = np.empty(states.shape, dtype=np.int32) if counts else None
        precision = correlation.fill(workspace.outer, workspace.inner, sides, states, overlaps)
    contents = Contents(
        workspace,
        robot,
        cells,
        slice_of,
        states,
        outside,
        margin,
        precision,
        overlaps,
        exterior=exterior,
        proves_blocked=inner,
    )
    return CSpace(contents, rasters)


def _advance(progress: Progress, total: int, parts: int, done: int) -> None:
    progress(total * done // parts, total)


def _check(
    workspace: Workspace,
    robot: Robot,
    rotations: Rotations,
    method: str,
    counts: bool,
    outside: str,
    workers: int | None,
) -> None:
    """Refuse arguments that break their rules, before any work."""
    if workspace.grid.dim != robot.dim:
        raise InputError(
            "robot",
            f"has {robot.dim} dimensions and the workspace {workspace.grid.dim}",
            "they must agree",
            "take both in the plane or both in space" + ", or its footprint, robot.footprint()" * (robot.dim == 3),
            value=robot,
        )
    rotations.check_dimension(robot.dim)
    if workers is not None:
        whole(workers, "workers", 1, hint="leave it out for all cores")
    check_word(method, "method", METHODS, "leave it out")
    if counts and method != "auto" and not ENGINES[method].COUNTS:
        rule = "this engine finds only whether there is any overlap; counts need the transforms"
        raise InputError(
            "method", f"is {method!r} and counts is True", rule, "use method='fft' or method='auto'", value=method
        )
    check_word(outside, "outside", OUTSIDES)
