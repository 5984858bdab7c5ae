"""``build``: from a workspace and a robot to the certified map of the robot's configurations.

A cell is proven FREE if the outer raster of the robot, moved there, overlaps no outer cell of the workspace, and
BLOCKED if the inner raster overlaps an inner cell (see ``docs/explanation/certificate.md``).
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

from cspace.check import check_count, check_not_negative, check_word
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
    """Options of :func:`build` for maps in memory and in stores."""

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
    """Build the map of a robot's configurations.

    The robot translates and may rotate.

    Parameters
    ----------
    workspace : Workspace
        The obstacles, in the plane or in space.
    robot : Robot, or shape
        The robot, of the same dimension. A shape (a ``trimesh.Trimesh``, a shapely polygon, or any other argument of
        :meth:`CSpace.add_obstacle`) is a robot with its reference point at the origin of the shape.
    rotations : int, array-like or Rotations, optional
        Rotation cells; if left out, the robot does not rotate. For rotations in the plane, or about z in space: the
        number of equal yaw cells, the first centred at 0, or the boundaries of the cells in radians, ascending over 2
        pi. For all rotations in space: :meth:`cspace.Rotations.quaternions`. FREE and BLOCKED are then proven for every
        position and every rotation in a cell. Slices that are equal by a symmetry of the robot are stored once. A map
        of more than 2^29 states in 8 slices or more, without overlap counts, takes two bits per state instead of a
        byte; queries answer the same, and queries that need all states in bytes raise InputError if these do not fit.
    inner : bool
        Also prove cells BLOCKED. Otherwise every cell that is not FREE is MIXED, at half the work.
    counts : bool
        Store the overlap counts of the outer rasters as :attr:`CSpace.overlap_counts`.
    method : {"auto", "fft", "direct"}
        The engine; the map is the same, cell for cell. "fft" correlates by transforms. "direct" dilates 64 cells at a
        time. "auto" selects "direct", unless the robot has very many rows, or counts are requested, which need
        transforms.
    outside : {"blocked", "free"}
        State of all space outside the workspace's bounds.
    margin : float
        Metres by which the robot is grown for FREE; BLOCKED is proven for the robot without the margin.
    workers : int, optional
        Threads; by default one for each core that the process may use.
    progress : callable, optional
        Called with (steps done, all steps); a step is a tile if there is a store.
    store : path-like, optional
        Folder to build the map into, tile by tile, for maps that do not fit into memory; see
        ``docs/howto/large_maps.md``. The same call resumes an interrupted build. Overlap counts are not stored.
    tile : int or sequence of int
        Largest number of cells of a tile along each axis. The longest sides are halved until a tile has at most 2^28
        states.
    client : dask.distributed.Client, optional
        Cluster whose workers make the tiles; threads of this process if left out. All workers must see the folder of
        the store.

    Returns
    -------
    CSpace
        With a store, a :class:`cspace.TiledCSpace`.

    Raises
    ------
    InputError
        If an argument is invalid, the robot is far too large for the workspace's spacing, or the map does not fit into
        free memory; the message names settings that fit.
    FileError
        If the store is of another map or cannot be written, or the workspace changes while it is read.

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
    margin, cells = check_not_negative(margin, "margin", GROWN), Rotations.of(rotations)
    for name, given, kind, is_wrong, example in (
        ("workspace", workspace, "Workspace", not isinstance(workspace, Workspace), "Workspace.from_array(...) first"),
        ("robot", robot, "Robot", isinstance(robot, Workspace | str | os.PathLike), "Robot.parse('disc:0.3') second"),
    ):
        if is_wrong:
            hint = f"call build(workspace, robot), e.g. with {example}"
            raise InputError(name, f"is a {type(given).__name__}", f"it must be a {kind}", hint, value=given)
    robot = robot_of(robot)
    _check(workspace, robot, cells, method, counts, outside, workers)
    if store is not None:
        from cspace.tiles.build import Settings, build_tiles
        from cspace.tiles.space import TiledCSpace

        if counts:
            hint = "leave it out and build windows of the map with counts"
            raise InputError("counts", "is True with a store", "a store has no counts", hint, value=counts)
        settings: Settings = {
            "rotations": cells,
            "inner": inner,
            "method": method,
            "outside": outside,
            "margin": margin,
            "client": client,
            "workers": workers,
            "progress": progress,
            "build": build,
        }
        return TiledCSpace(build_tiles(workspace, robot, store, tile, settings))
    if client is not None:
        hint = "pass store='map.zarr'"
        raise InputError("client", "is given without a store", "its workers make tiles", hint, value=client)
    workspace = workspace._in_memory()
    grid = workspace.grid
    slice_of = cells._slices_for(robot.shape)
    slices = int(slice_of.max()) + 1
    bytes_of_rasters = raster_bytes(robot, grid.spacing, margin, cells, slices)
    if is_packed(grid.shape, slices, counts):
        bytes_of_rasters = min(bytes_of_rasters, SLICE_BYTES * slices)  # a few slices at a time have rasters
    needed = map_bytes(grid.shape, slices, counts) + bytes_of_rasters
    check_fits = partial(
        check_memory, grid=grid, fewer=cells._argument_for_fewer, slices=slices, rasters=bytes_of_rasters
    )
    check_fits(needed, "the map", fixed=TRANSFORM_BYTES, seconds=build_seconds(grid.shape, slices))
    rasters, exterior, overlaps = None, None, None
    states: Stack

    def correlate(
        pairs: Sequence[RasterPair], engines: int, workers: int | None, progress: Progress | None
    ) -> tuple[Correlation, RasterGroups]:
        """Prepare the correlation of some slices.

        The memory of ``engines``, which work in parallel, is checked.
        """
        groups = group_rasters(pairs, inner)
        correlation = Correlation.create(method, groups, outside, workers, progress, counts)
        memory = engines * max(correlation.engine.bytes_needed(grid.shape, group, workers) for group in groups)
        if memory > TRANSFORM_BYTES:  # the first check above included TRANSFORM_BYTES
            check_fits(needed + memory - TRANSFORM_BYTES, "the map, with the scratch memory of its engine,")
        return correlation, groups

    if is_packed(grid.shape, slices, counts):
        # Each thread completes a batch of slices, from rasters to packed states, before it takes the next, so that few
        # slices are in bytes at a time. All threads share one slice if a slice is large.
        states = packed = PackedStates((slices, *grid.shape))
        table, lock = np.empty((slices, 2 * grid.dim + 1), dtype=np.int64), Lock()
        tasks = raster_tasks(robot, grid.spacing, margin, cells)
        large, capacity = grid.size > SCRATCH_BYTES, max(1, SCRATCH_BYTES // grid.size)
        threads = 1 if large else workers or cores()

        def fill_batch(batch: Sequence[RasterTask]) -> str:
            made = list(itertools.chain.from_iterable(task() for task in batch))
            scratch, precision = np.empty((min(capacity, len(made)), *grid.shape), dtype=np.uint8), ""
            for start in range(0, len(made), capacity):
                indices, pairs = zip(*made[start : start + capacity], strict=True)
                correlation, groups = correlate(pairs, threads, workers if large else 1, None)
                filled = correlation.fill(workspace.outer, workspace.inner, groups, scratch[: len(pairs)], None)
                precision = max(precision, filled)
                with lock:
                    for index, slice_states in zip(indices, scratch, strict=False):
                        packed.write(index, slice_states)
                table[list(indices)] = Exterior.of(workspace.outer, pairs, outside).table
            return precision

        batch_size = max(1, capacity * len(tasks) // slices)
        batches = [tasks[k : k + batch_size] for k in range(0, len(tasks), batch_size)]
        advance = None if progress is None else partial(_report_progress, progress, slices, len(batches))
        precision = max(in_threads(fill_batch, batches, threads, advance))
        exterior = Exterior(table)
    else:
        rasters = slice_rasters(robot, grid.spacing, margin, cells)
        correlation, groups = correlate(rasters, 1, workers, progress)
        states = np.empty((slices, *grid.shape), dtype=np.uint8)
        overlaps = np.empty(states.shape, dtype=np.int32) if counts else None
        precision = correlation.fill(workspace.outer, workspace.inner, groups, states, overlaps)
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


def _report_progress(progress: Progress, slices: int, batches: int, done: int) -> None:
    """Report the slices of the batches that are done."""
    progress(slices * done // batches, slices)


def _check(
    workspace: Workspace,
    robot: Robot,
    rotations: Rotations,
    method: str,
    counts: bool,
    outside: str,
    workers: int | None,
) -> None:
    """Raise InputError if an argument is invalid."""
    if workspace.grid.dim != robot.dim:
        problem = f"has {robot.dim} dimensions but the workspace has {workspace.grid.dim}"
        hint = "use robot.footprint()" if robot.dim == 3 else "use a robot in space, or a workspace in the plane"
        raise InputError("robot", problem, "they must agree", hint, value=robot)
    rotations._check_dimension(robot.dim)
    if workers is not None:
        check_count(workers, "workers", 1, hint="leave it out for all cores")
    check_word(method, "method", METHODS, "leave it out")
    if counts and method != "auto" and not ENGINES[method].COUNTS:
        problem, hint = f"is {method!r} and counts is True", "use method='fft' or method='auto'"
        raise InputError("method", problem, "only transforms give counts", hint, value=method)
    check_word(outside, "outside", OUTSIDES)
