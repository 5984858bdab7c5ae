"""``build``: from a workspace and a robot to the certified map of the robot's configurations.

A cell is proven FREE if the outer raster of the robot, moved there, overlaps no outer cell of the
workspace, and BLOCKED if the inner raster overlaps an inner cell (see
``docs/explanation/certificate.md``).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, TypedDict, Unpack, overload

import numpy as np
from numpy.typing import ArrayLike

from cspace.engines import ENGINES, METHODS, choose_engine
from cspace.engines.slices import (
    Progress,
    RasterPair,
    fill_states,
    group_rasters,
    raster_bytes,
    slice_rasters,
)
from cspace.errors import InputError, UnitWarning, warn_user
from cspace.grid import SLACK, Grid
from cspace.limits import check_memory, map_bytes
from cspace.record.contents import Contents
from cspace.record.exterior import OUTSIDES
from cspace.robot import GROWN, Robot, robot_of
from cspace.rotations import Rotations
from cspace.space import CSpace
from cspace.support.arrays import Floats
from cspace.support.check import check_count, check_not_negative, check_word
from cspace.support.words import Method, Outside
from cspace.workspace import Workspace, load_workspace

if TYPE_CHECKING:
    from distributed import Client

    from cspace.shapes import ShapeLike
    from cspace.tiles.space import TiledCSpace

MAX_OPEN_SIZE_RATIO: Final = 10.0
"""Longest side of a robot over that of a workspace without walls, above which a unit is wrong."""

MIN_ROBOT_CELLS: Final = 0.02
"""Longest side of a robot, in cells, below which its unit is probably wrong."""

MAX_ORIGIN_SIZES: Final = 10.0
"""Distance of a robot from its reference point, in its longest sides, that suggests an error."""


class BuildOptions(TypedDict, total=False):
    """Options of :func:`build` for maps in memory and in stores."""

    rotations: int | ArrayLike | Rotations | None
    inner: bool
    counts: bool
    method: Method
    outside: Outside
    margin: float
    workers: int | None
    progress: Progress | None


@overload
def build(
    workspace: Workspace,
    robot: Robot | ShapeLike,
    *,
    store: None = None,
    **options: Unpack[BuildOptions],
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
    method: Method = "auto",
    outside: Outside = "blocked",
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
        The robot, of the same dimension. A shape (a ``trimesh.Trimesh``, a shapely polygon, a
        short text of :meth:`Robot.parse`, or any other argument of :meth:`CSpace.add_obstacle`)
        is a robot with its reference point at the origin of the shape.
    rotations : int, array-like or Rotations, optional
        Rotation cells; if left out, the robot does not rotate. For rotations in the plane, or about
        z in space: the number of equal yaw cells, the first centred at 0, or the boundaries of the
        cells in radians, ascending over 2 pi. For all rotations in space:
        :meth:`cspace.Rotations.quaternions`. FREE and BLOCKED are then proven for every position
        and every rotation in a cell. Slices that are equal by a symmetry of the robot are stored
        once.
    inner : bool
        Also prove cells BLOCKED. Otherwise every cell that is not FREE is MIXED, at half the work.
    counts : bool
        Store the overlap counts of the outer rasters as :attr:`CSpace.overlap_counts`.
    method : {"auto", "fft", "direct"}
        The engine; the map is the same, cell for cell. "fft" correlates by transforms. "direct"
        dilates 64 cells at a time. "auto" selects "direct", unless the robot has very many rows, or
        counts are requested, which need transforms.
    outside : {"blocked", "free"}
        State of all space outside the workspace's bounds.
    margin : float
        Metres by which the robot is grown for FREE; BLOCKED is proven for the robot without the
        margin.
    workers : int, optional
        Threads; by default one for each core that the process may use.
    progress : callable, optional
        Called with (steps done, all steps); a step is a tile if there is a store.
    store : path-like, optional
        Folder to build the map into, tile by tile, for maps that do not fit into memory; see
        ``docs/howto/large_maps.md``. The same call resumes an interrupted build. Overlap counts are
        not stored.
    tile : int or sequence of int
        Largest number of cells of a tile along each axis. The longest sides are halved until a tile
        has at most 2^28 states.
    client : dask.distributed.Client, optional
        Cluster whose workers make the tiles; threads of this process if left out. All workers must
        see the folder of the store.

    Returns
    -------
    CSpace
        With a store, a :class:`cspace.TiledCSpace`.

    Raises
    ------
    InputError
        If an argument is invalid, the robot is far too large for the workspace's spacing, or the
        map does not fit into free memory; the message names settings that fit.
    FileError
        If the store is of another map or cannot be written, or the workspace changes while it is
        read.

    Warns
    -----
    UnitWarning
        If the robot is larger than the workspace, smaller than a fiftieth of a cell, or farther
        from its reference point than ten times its size, as in another unit than the metre. A
        point raises no warning. Without walls (``outside="free"``), the robot may be ten times as
        large as the workspace.

    References
    ----------
    L. E. Kavraki, "Computation of configuration-space obstacles using the fast Fourier
    transform", 1995.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> occupied = np.zeros((40, 30), dtype=bool)
    >>> occupied[20, :20] = True
    >>> space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.disc(0.3))
    >>> space.is_free([1.0, 1.5])
    True
    """
    # Check all arguments before any work.
    margin = check_not_negative(margin, "margin", GROWN)
    cells = Rotations.of(rotations)
    _check_types(workspace, robot)
    robot = robot_of(robot)
    _check(workspace, robot, cells, method, counts, outside, workers)
    _warn_of_units(workspace.grid, robot, cells, margin, outside)
    if store is not None:  # build tile by tile, into a folder
        from cspace.tiles.build import build_tiles
        from cspace.tiles.space import TiledCSpace

        if counts:
            hint = "leave it out and build windows of the map with counts"
            raise InputError("counts", "is True with a store", "a store has no counts", hint)
        folder = build_tiles(
            workspace,
            robot,
            store,
            tile,
            build=build_contents,
            method=method,
            inner=inner,
            client=client,
            workers=workers,
            progress=progress,
            rotations=cells,
            outside=outside,
            margin=margin,
        )
        return TiledCSpace(folder)
    if client is not None:
        hint = "pass store='map.zarr'"
        raise InputError("client", "is given without a store", "its workers make tiles", hint)
    contents, rasters = build_contents(
        load_workspace(workspace),
        robot,
        cells,
        inner=inner,
        counts=counts,
        method=method,
        outside=outside,
        margin=margin,
        workers=workers,
        progress=progress,
    )
    return CSpace(contents, rasters)


def build_contents(
    workspace: Workspace,
    robot: Robot,
    rotations: Rotations,
    *,
    inner: bool,
    counts: bool = False,
    method: Method,
    outside: Outside,
    margin: float,
    workers: int | None,
    progress: Progress | None = None,
) -> tuple[Contents, list[RasterPair]]:
    """Build a map of checked arguments, see :func:`build`, with the robot's rasters."""
    grid = workspace.grid
    slice_of = rotations.assign_slices(robot.shape)
    n_slices = int(slice_of.max()) + 1
    # Refuse what does not fit into memory, then rasterize the robot, then correlate.
    states_bytes = map_bytes(grid.shape, n_slices, counts)
    rasters_bytes = raster_bytes(robot, grid.spacing, margin, rotations, n_slices)
    check_memory(states_bytes + rasters_bytes, "the map", grid, slices=n_slices)
    rasters = slice_rasters(robot, grid.spacing, margin, rotations)
    groups = group_rasters(rasters, inner)
    outer_rasters = groups[0]
    name = choose_engine(outer_rasters, counts=counts) if method == "auto" else method
    states = np.empty((n_slices, *grid.shape), dtype=np.uint8)
    overlaps = np.empty(states.shape, dtype=np.int32) if counts else None
    cells = workspace.outer, workspace.inner
    fill_states(ENGINES[name], outside, cells, groups, states, overlaps, workers, progress)
    contents = Contents(
        workspace,
        robot,
        rotations,
        slice_of,
        states,
        outside,
        margin,
        overlap_counts=overlaps,
        proves_blocked=inner,
    )
    return contents, rasters


def _check_types(workspace: object, robot: object) -> None:
    """Raise InputError unless a workspace and perhaps a robot are given."""
    if not isinstance(workspace, Workspace):
        hint = "call build(workspace, robot), e.g. with Workspace.from_array(...) first"
        if isinstance(workspace, str | os.PathLike) and not isinstance(robot, Workspace):
            hint = f"read the file first: Workspace.open({os.fspath(workspace)!r})"
        problem = f"is a {type(workspace).__name__}"
        raise InputError("workspace", problem, "it must be a Workspace", hint)
    if isinstance(robot, Workspace):
        hint = "call build(workspace, robot), e.g. with Robot.parse('disc:0.3') second"
        raise InputError("robot", "is a Workspace", "it must be a Robot", hint)


def _check(
    workspace: Workspace,
    robot: Robot,
    rotations: Rotations,
    method: Method,
    counts: bool,
    outside: Outside,
    workers: int | None,
) -> None:
    """Raise InputError if an argument is invalid."""
    # The robot fits the workspace, the rotations fit the robot, and each word is known.
    if workspace.grid.dim != robot.dim:
        problem = f"has {robot.dim} dimensions but the workspace has {workspace.grid.dim}"
        hint = "use a robot in space, or a workspace in the plane"
        if robot.dim == 3:
            hint = "use robot.footprint()"
        raise InputError("robot", problem, "they must agree", hint)
    rotations.check_dimension(robot.dim)
    if workers is not None:
        check_count(workers, "workers", 1, hint="leave it out for all cores")
    check_word(method, "method", METHODS, "leave it out")
    if counts and method != "auto" and not ENGINES[method].COUNTS:
        problem = f"is {method!r} and counts is True"
        hint = "use method='fft' or method='auto'"
        raise InputError("method", problem, "only transforms give counts", hint)
    check_word(outside, "outside", OUTSIDES)


def _warn_of_units(
    grid: Grid,
    robot: Robot,
    rotations: Rotations,
    margin: float,
    outside: Outside,
) -> None:
    """Warn if a robot's size or place suggests another unit or origin."""
    lower, upper = robot.shape.outer.bounds
    sides = upper - lower
    workspace_sides = grid.spacing * np.array(grid.shape)
    size = float(sides.max())
    distance = float(np.linalg.norm(np.maximum(np.maximum(lower, -upper), 0.0)))
    if outside == "blocked" and not _may_fit(sides + 2.0 * margin, workspace_sides, rotations):
        grown = f"with a margin of {margin:g} m, " if margin > 0.0 else ""
        workspace_text = _sides_text(workspace_sides)
        problem = (
            f"{grown}the workspace is {workspace_text}, so it fits nowhere and no cell is FREE"
        )
        hint = "check the units of both (metres, not millimetres), and the workspace's bounds"
    elif outside == "free" and size > MAX_OPEN_SIZE_RATIO * workspace_sides.max():
        problem = f"the workspace is only {_sides_text(workspace_sides)}"
        hint = "check the units of both (metres, not millimetres)"
    elif 0.0 < size < MIN_ROBOT_CELLS * grid.spacing:
        share = f"1/{1.0 / MIN_ROBOT_CELLS:g}"
        problem = f"less than {share} of a cell of {grid.spacing:g} m, so it counts as a point"
        hint = "check its unit (metres, not kilometres): scale it, or use a smaller spacing"
    elif distance > MAX_ORIGIN_SIZES * size > 0.0:
        center = (lower + upper) / 2.0
        move = ", ".join(f"{0.0 - coordinate:g}" for coordinate in center)  # no "-0"
        problem = f"it lies {distance:g} m from its origin, the reference point of configurations"
        hint = f"move its center there, by ({move}) m, and check the units (metres)"
    else:
        return
    warn_user(f"the robot is {_sides_text(sides)} large; {problem}; {hint}", UnitWarning)


def _may_fit(sides: Floats, workspace_sides: Floats, rotations: Rotations) -> bool:
    """Return False if a box fits nowhere in a workspace, however it turns.

    A box longer than the diagonal of the axes that rotations mix does not fit. Without rotations,
    each axis counts alone; yaw mixes x and y.
    """
    mixed_axes = 1
    if rotations.names:
        mixed_axes = 3 if "qw" in rotations.names else 2
    longest = [sides[:mixed_axes].max(), *sides[mixed_axes:]]
    diagonals = [np.linalg.norm(workspace_sides[:mixed_axes]), *workspace_sides[mixed_axes:]]
    return bool((np.array(longest) <= (1.0 + SLACK) * np.array(diagonals)).all())


def _sides_text(sides: Floats) -> str:
    """Format the sides of a box, metres."""
    return " x ".join(f"{side:.6g} m" for side in sides)
