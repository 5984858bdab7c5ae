"""``build``: from a workspace and a robot to the certified map of the robot's configurations.

``open_map`` opens a saved map; ``suggest`` tells the spacing and the rotation cells with which a
map decides passages of a width.

A cell is proven FREE if the outer raster of the robot, moved there, overlaps no outer cell of the
workspace, and BLOCKED if the inner raster overlaps an inner cell (see
``docs/explanation/certificate/index.md``).
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal, TypedDict, Unpack, overload

import numpy as np
import scipy  # loads its submodules on first use
from numpy.typing import ArrayLike

from cspace import _outside
from cspace._engines import ENGINES, METHODS
from cspace._engines.slices import (
    Progress,
    RasterPair,
    estimate_bytes,
    fill_states,
    group_rasters,
    slice_rasters,
)
from cspace._files.access import check_name, inspect_path, suggest_file
from cspace._grid import MAX_COORDINATE, SLACK, Grid
from cspace._record.contents import Contents, check_floor
from cspace._record.exterior import OUTSIDES
from cspace._robot import Robot, robot_of
from cspace._rotations import Rotations
from cspace._rotations.base import ANGLE_SLACK
from cspace._rotations.yaw import MAX_YAW_CELLS
from cspace._shapes.layers import Heights
from cspace._space import CSpace
from cspace._support.arrays import Floats, StrPath
from cspace._support.check import (
    check_count,
    check_not_negative,
    check_positive,
    check_word,
    names_options,
)
from cspace._support.kinds import make_kind_error
from cspace._support.limits import PlannedGrid, bytes_text, check_memory
from cspace._support.reporting import format_sides, tell_apart, warn_user
from cspace._support.words import Method, Outside
from cspace._workspace import Workspace, covering_shape, load_workspace
from cspace.errors import FileError, InputError, UnitWarning

if TYPE_CHECKING:
    from distributed import Client

    from cspace._shapes import ShapeLike
    from cspace._shapes.shape import Shape
    from cspace._tiles.tiled_space import TiledCSpace

MAX_OPEN_SIZE_RATIO: Final = 10.0
"""Ratio of the longest sides of a robot and a workspace without walls above which a unit is
probably wrong."""

MAX_GROUND_LAYERS: Final = 4
"""Number of a robot's lowest layers that a scan of the ground may fill in part."""

MIN_GROUND_SHARE: Final = 0.1
"""Share of occupied cells below which a layer is not the ground."""

MIN_GROUND_COLUMNS: Final = 0.4
"""Share of the places with anything above them below which the lowest things are no ground."""

GROUND_RATIO: Final = 3.0
"""Ratio of occupied cells in the highest layer of the ground and in the one above."""

MAX_ORIGIN_SIZES: Final = 10.0
"""Distance of a robot from its reference point, relative to its longest side, above which its
origin is probably wrong."""

DEFAULT_TILE: Final = 4096
"""Largest number of cells of a tile along each axis, unless another one is asked for."""

RATE: Final = 2.0 * (1.0 + 1e-4)
"""Constant of Theorem 1 in ``docs/explanation/convergence.md``, with room for rounding. A
configuration is FREE if it is farther from the C-obstacle than RATE times the sum of the diagonal
of a cell and the displacement within a rotation cell."""

_TURN_AXES: Final = {"fixed": 0, "yaw": 1, "all": 3}
"""Number of axes of rotation of a robot, by the argument ``rotations`` of :func:`suggest`."""


class BuildOptions(TypedDict, total=False):
    """Options of :func:`build` for maps in memory and in stores."""

    rotations: int | ArrayLike | Rotations | None
    inner: bool
    counts: bool
    method: Method
    outside: Outside
    margin: float
    floor: float | None
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
    tile: int | Sequence[int] = DEFAULT_TILE,
    client: Client | None = None,
    **options: Unpack[BuildOptions],
) -> TiledCSpace: ...
@names_options
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
    floor: float | None = None,
    workers: int | None = None,
    progress: Progress | None = None,
    store: str | os.PathLike[str] | None = None,
    tile: int | Sequence[int] = DEFAULT_TILE,
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
        shorthand of :meth:`Robot.parse`, or any other argument of :meth:`CSpace.add_obstacle`)
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
        Growth of the robot for FREE, metres; BLOCKED is proven for the robot without the
        margin. On a floor, the robot grows sideways.
    floor : float, optional
        Height of the reference point of a robot in space that drives on a floor, metres, in a
        workspace in space. The map is one in the plane: the robot keeps its heights, and passes
        under and over obstacles; see ``docs/howto/floor.md``.
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
    UserWarning
        If no cell is FREE; the message says why, as far as it is known.

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
    margin = check_not_negative(margin, "margin")
    cells = Rotations.of(rotations)
    _check_types(workspace, progress)
    robot = robot_of(robot)
    _check_options(workspace, robot, cells, method, counts, outside, workers)
    if floor is not None:
        floor = check_floor(floor, workspace.grid, robot, outside)
        _refuse_on_floor(cells, store)
    explained = _warn_of_units(workspace.grid, robot, cells, margin, outside, floor)
    if store is not None:  # build tile by tile, into a folder
        store = check_name(store)
        if counts:
            raise InputError("counts", "is True with a store", "a store has no counts")
        tiled = _outside.build_tiles(
            workspace,
            robot,
            store,
            tile,
            build=build_contents,
            estimate=estimate_bytes,
            method=method,
            inner=inner,
            client=client,
            workers=workers,
            progress=progress,
            rotations=cells,
            outside=outside,
            margin=margin,
        )
        if not (explained or tiled.count()[0]):
            _warn_of_nothing_free(tiled, margin)
        return tiled
    if client is not None or not np.array_equal(tile, DEFAULT_TILE):
        name = "tile" if client is None else "client"
        raise InputError(name, "is given without a store", "only a store has tiles")
    contents, rasters = build_contents(
        load_workspace(workspace),
        robot,
        cells,
        inner=inner,
        counts=counts,
        method=method,
        outside=outside,
        margin=margin,
        floor=floor,
        workers=workers,
        progress=progress,
    )
    space = CSpace(contents, rasters)
    is_free_nowhere = contents.states.view(np.bool_).all()  # FREE is 0
    if not explained and is_free_nowhere:
        _warn_of_nothing_free(space, margin)
    elif floor is not None and not is_free_nowhere:
        ground = _find_ground(space, floor, is_free_nowhere=False)
        if ground:
            warn_user(f"{ground}, if they are the ground")
    return space


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
    floor: float | None = None,
    workers: int | None,
    progress: Progress | None = None,
    rasters: list[RasterPair] | None = None,
) -> tuple[Contents, list[RasterPair]]:
    """Compute a map's contents and the robot's rasters.

    Arguments are those of :func:`build`, which has checked them, and the rasters if they are there.
    Raises InputError if the map does not fit into memory.
    """
    grid = workspace.grid
    shape = grid.shape if floor is None else grid.shape[:2]
    slice_of = rotations._assign_slices(robot.shape)
    n_slices = int(slice_of.max()) + 1
    check_memory(
        estimate_bytes(shape, grid.spacing, robot, rotations, margin, n_slices, counts),
        "the map",
        PlannedGrid(shape, grid.spacing),
        slices=n_slices,
    )
    if rasters is None:
        rasters = slice_rasters(robot, grid.spacing, margin, rotations, Heights.of(grid, floor))
    groups = group_rasters(rasters, inner)
    states = np.empty((n_slices, *shape), dtype=np.uint8)
    overlaps = np.empty(states.shape, dtype=np.int32) if counts else None
    cells = workspace.outer, workspace.inner
    fill_states(method, outside, cells, groups, states, overlaps, workers, progress)
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
        floor=floor,
    )
    return contents, rasters


def _check_types(workspace: object, progress: object = None) -> None:
    """Raise InputError unless arguments of :func:`build` have their types."""
    if progress is not None and not callable(progress):
        rule = "it is called with the steps done and all steps"
        raise InputError("progress", f"is {progress!r}", rule)
    if not isinstance(workspace, Workspace):
        raise make_kind_error(workspace, "workspace", "it must be a Workspace")


def _check_options(
    workspace: Workspace,
    robot: Robot,
    rotations: Rotations,
    method: Method,
    counts: bool,
    outside: Outside,
    workers: int | None,
) -> None:
    """Raise InputError for invalid options or dimensions that disagree."""
    if workspace.grid.dim != robot.dim:
        problem = f"has {robot.dim} dimensions but the workspace has {workspace.grid.dim}"
        hint = "use robot.footprint()" if robot.dim == 3 else ""
        ways = "; workspace.between(bottom, top) cuts it, or floor= takes a robot in space"
        raise InputError("robot", problem, "they must agree" + ("" if hint else ways), hint)
    rotations._check_dimension(robot.dim)
    if workers is not None:
        check_count(workers, "workers", 1)
    check_word(method, "method", METHODS)
    if counts and method != "auto" and not ENGINES[method].COUNTS:
        problem = f"is {method!r} and counts is True"
        raise InputError("method", problem, "only transforms give counts")
    check_word(outside, "outside", OUTSIDES)


def _refuse_on_floor(rotations: Rotations, store: object) -> None:
    """Raise InputError for options that maps with a floor lack."""
    if "qw" in rotations.names:
        rule = "a robot on a floor turns by its yaw alone"
        raise InputError("rotations", "are those of space", rule)
    if store is not None:
        raise InputError("store", "is given with a floor", "such a map has no tiles yet")


def _warn_of_units(
    grid: Grid,
    robot: Robot,
    rotations: Rotations,
    margin: float,
    outside: Outside,
    floor: float | None,
) -> bool:
    """Warn if a robot's size or position suggests a wrong unit.

    On a floor, its sides along the floor count. Returns True if the robot fits nowhere, so that the
    warning explains why no cell is FREE.
    """
    axes = slice(robot.dim if floor is None else 2)
    lower, upper = (corner[axes] for corner in robot.shape.outer.bounds)
    sides = upper - lower
    workspace_sides = grid.spacing * np.array(grid.shape[axes])
    size = float(sides.max())
    distance = float(np.linalg.norm(np.maximum(np.maximum(lower, -upper), 0.0)))
    fits = _may_fit(sides + 2.0 * margin, workspace_sides, rotations)
    hint = ""
    # Longest side of a robot, in cells, below which its unit, or that of a plan, is probably wrong.
    min_robot_cells = 0.5 if grid.spacing > 1.0 and grid.dim == 2 else 0.02
    if outside == "blocked" and not fits:
        grown = f"with a margin of {margin:g} m, " if margin > 0.0 else ""
        workspace_text = format_sides(workspace_sides)
        problem = (
            f"{grown}the workspace is {workspace_text}, so it fits nowhere and no cell is FREE"
        )
    elif outside == "free" and size > MAX_OPEN_SIZE_RATIO * workspace_sides.max():
        problem = f"the workspace is only {format_sides(workspace_sides)}"
    elif 0.0 < size < min_robot_cells * grid.spacing:
        share = f"1/{1.0 / min_robot_cells:g}"
        problem = f"less than {share} of a cell of {grid.spacing:g} m, so it counts as a point"
    elif distance > MAX_ORIGIN_SIZES * size > 0.0:
        center = (lower + upper) / 2.0
        move = ", ".join(f"{0.0 - coordinate:g}" for coordinate in center)  # no "-0"
        problem = f"it lies {distance:g} m from its origin, the reference point of configurations"
        hint = f"move its center there, by ({move}) m"
    else:
        return False
    parts = f"the robot is {format_sides(sides)} large", problem, "units are metres", hint
    warn_user("; ".join(filter(None, parts)), UnitWarning)
    return outside == "blocked" and not fits


def _warn_of_nothing_free(space: CSpace | TiledCSpace, margin: float) -> None:
    """Warn of a map without FREE cells, and why."""
    _, mixed, blocked = space.count()
    reason = "the robot, with its margin, fits nowhere between the obstacles, in metres"
    if mixed:
        reason = f"{mixed:,} of {mixed + blocked:,} cells are MIXED, undecided at this spacing"
    # Maximum number of cells of a workspace that is examined to explain why no cell is FREE.
    if isinstance(space, CSpace) and space.grid.size <= 10_000_000:
        reason = _find_obstruction(space, margin) or reason
    warn_user(f"no cell of the map is FREE: {reason}")


def _find_obstruction(space: CSpace, margin: float) -> str:
    """Find the reason why no cell of a map can be FREE, or an empty text."""
    workspace = space.workspace
    if space.floor is not None:
        return _find_ground(space, space.floor, is_free_nowhere=True)
    if workspace.outer.all():
        if workspace.unknown is None:
            return "every cell of the workspace is occupied"
        unknown = np.count_nonzero(workspace.unknown)
        count = f"{unknown:,} of {space.grid.size:,}"
        return f"{count} cells are unknown, and count as occupied, as the others are"
    distances = scipy.ndimage.distance_transform_edt(~workspace.outer)
    widest = space.grid.spacing * float(distances.max())
    needed = margin
    if space.grid.dim == 2:
        needed += space.robot.shape.inner.inscribed_radius
    if needed <= widest:
        return ""
    widest_text, needed_text = tell_apart(widest, needed, 3)
    return (
        f"the widest free disc has a radius of {widest_text} m, and the robot with its margin "
        f"needs {needed_text} m"
    )


def _find_ground(space: CSpace, floor: float, *, is_free_nowhere: bool) -> str:
    """Find the layers of a scene that hold its ground, or return an empty text.

    They are the robot's lowest layers that hold far more cells than the layers above, as in a scan
    of rooms, or, if nothing is free, while half of the cells of each are occupied.
    """
    grid = space.workspace.grid
    bottom = float(space.robot.shape.outer.bounds[0][2])
    room = SLACK * grid.spacing
    first = max(math.floor((floor + bottom - room - grid.lower[2]) / grid.spacing), 0)
    outer = space.workspace.outer
    shares = outer.mean(axis=(0, 1))
    stop = first
    while is_free_nowhere and stop < grid.shape[2] and shares[stop] >= 0.5:
        stop += 1
    near = shares[first : first + MAX_GROUND_LAYERS + 1]
    is_last = (near[:-1] >= MIN_GROUND_SHARE) & (near[:-1] >= GROUND_RATIO * near[1:])
    if stop == first and is_last.any():
        last = first + int(np.flatnonzero(is_last)[-1])
        # Low things stand at few of the places that hold anything.
        columns = outer.any(axis=2)
        if outer[:, :, first : last + 1].any(axis=2).sum() >= MIN_GROUND_COLUMNS * columns.sum():
            stop = last + 1
    if stop == first:
        return ""
    low, high = (grid.lower[2] + grid.spacing * layer for layer in (first, stop))
    # Touching counts as a collision, so the robot has to stand a little above.
    clear_floor = math.floor(1000.0 * (high - bottom) + 1.0) / 1000.0
    percent = 100.0 * shares[first:stop].max()
    return (
        f"the robot stands in layers of the workspace from {low:g} m to {high:g} m, of which up "
        f"to {percent:.3g} % is occupied; floor={clear_floor:g} clears them"
    )


def _may_fit(sides: Floats, workspace_sides: Floats, rotations: Rotations) -> bool:
    """Return True unless a box fits nowhere in a workspace, however rotated.

    Compares the longest side with the diagonal of the workspace, along the axes that rotations
    mix: x and y for a yaw, all axes in space. Other axes are compared one by one.
    """
    mixed_axes = 1
    if rotations.names:
        mixed_axes = 3 if "qw" in rotations.names else 2
    longest = [sides[:mixed_axes].max(), *sides[mixed_axes:]]
    diagonals = [np.linalg.norm(workspace_sides[:mixed_axes]), *workspace_sides[mixed_axes:]]
    return bool((np.array(longest) <= (1.0 + SLACK) * np.array(diagonals)).all())


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
    from cspace._record.save import MapFolder

    path = check_name(path)
    _check_folder(path)
    if MapFolder(path, tiles=True).exists():
        return _outside.open_tiles(path, cache_bytes)
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


# ---- suggestions ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Suggestion:
    """Settings of a map that decides passages of a width; see :func:`suggest`.

    Attributes
    ----------
    spacing : float
        Side of a cell, metres.
    rotations : Rotations or None
        Rotation cells for :func:`build`; None if the robot need not turn.
    memory : int
        Bytes of the map's states. :func:`build` needs some hundred megabytes more.
    """

    spacing: float
    rotations: Rotations | None
    memory: int

    def __str__(self) -> str:
        """Return the settings as text."""
        turns = "no rotations" if self.rotations is None else str(self.rotations)
        return f"spacing {self.spacing:g} m, {turns}, {bytes_text(self.memory)} of states"


@names_options
def suggest(
    workspace: Workspace,
    robot: Robot | ShapeLike,
    *,
    gap: float,
    rotations: Literal["fixed", "yaw", "all"] = "yaw",
) -> Suggestion:
    """Suggest the spacing and rotations that decide passages of a width.

    A map with these settings connects the ends of every straight passage between parallel walls at
    least `gap` apart, if the robot can turn to its narrowest direction before it. Let d be `gap`
    less the width of the robot in that direction. A gap between walls thicker than
    ``2 * sqrt(dim) * spacing`` is proven shut if it is narrower by d than the diameter of a ball in
    the robot. An exception is a robot that may pass it with its reference point beyond the map.

    Parameters
    ----------
    workspace : Workspace
        Its extents count. Its spacing does not, so make it again with the one suggested.
    robot : Robot, or shape
        As for :func:`build`.
    gap : float
        Width of the narrowest passage to find, metres, above the width of the robot.
    rotations : {"yaw", "all", "fixed"}
        How the robot turns: by its yaw, through passages with vertical walls in space; by all
        rotations of space; or not at all, so that its widest direction counts.

    Returns
    -------
    Suggestion
        With attributes `spacing`, `rotations` and `memory`.

    Raises
    ------
    InputError
        If an argument is invalid, the gap is no wider than the robot, or it is so narrow that the
        map has too many cells or rotations.

    References
    ----------
    ``docs/explanation/convergence.md`` has the theorem.

    Examples
    --------
    >>> import cspace, shapely
    >>> bounds = (0, 0, 10, 8)
    >>> wall = shapely.box(4, 0, 5, 6)
    >>> workspace = cspace.Workspace.from_polygons([wall], spacing=0.1, bounds=bounds)
    >>> print(cspace.suggest(workspace, "rect:0.9x0.6", gap=0.8))
    spacing 0.0238 m, 104 rotations, 7.38 MB of states
    """
    gap = check_positive(gap, "gap")
    check_word(rotations, "rotations", tuple(_TURN_AXES))
    _check_types(workspace)
    robot = robot_of(robot)
    # The options are the defaults of ``build``, because only the dimensions need a check.
    _check_options(workspace, robot, Rotations.of(None), "auto", False, "blocked", None)
    turn_axes = _TURN_AXES[rotations]
    if turn_axes == 3:
        Rotations.quaternions(1)._check_dimension(robot.dim)
    if robot.shape.is_round or (turn_axes == 1 and robot.shape.is_round_about_z):
        turn_axes = 0
    width, reach = _measure_robot(robot.shape, rotations)
    if gap <= width:
        problem = "is {} m and the robot is {} m wide".format(*tell_apart(gap, width))
        raise InputError("gap", problem, "it must be wider than the robot")
    # The sum of the diagonal of a cell and of the displacement within a rotation cell may be at
    # most this budget, metres.
    budget = (gap - width) / 2.0 / RATE
    cells = None
    if turn_axes:
        # The map has the fewest states if each axis of rotation and of position has an equal share.
        displacement = budget * turn_axes / (robot.dim + turn_axes)
        cells = _choose_rotations(turn_axes, displacement / reach)
        # The rest is for the cells: subtract the chord of the farthest point.
        budget -= 2.0 * reach * math.sin(float(cells.covering_angles.max()) / 2.0)
    spacing = budget / math.sqrt(robot.dim)
    extents = workspace.grid.spacing * np.array(workspace.grid.shape)
    if extents.max() >= MAX_COORDINATE * spacing:
        problem = f"needs cells of {spacing:.3g} m"
        rule = f"a map may have {MAX_COORDINATE:.0f} cells along an axis"
        raise InputError("gap", problem, rule)
    # Round the spacing down to three significant digits.
    digits = 2 - math.floor(math.log10(spacing))
    spacing = math.floor(spacing * 10.0**digits) / 10.0**digits
    slices = 1 if cells is None else int(cells._assign_slices(robot.shape).max()) + 1
    shape = covering_shape(np.stack([np.zeros_like(extents), extents]), spacing)
    return Suggestion(spacing, cells, slices * math.prod(shape))


def _measure_robot(shape: Shape, rotations: str) -> tuple[float, float]:
    """Return the robot's width in a passage and its reach, metres.

    A robot that rotates passes in its narrowest direction, of those that are tried; any other one
    may have to pass in its widest. The reach is the largest distance of its points from the axis of
    rotation: the z axis, or for all rotations the reference point.
    """
    from scipy.spatial import ConvexHull

    lower, upper = shape.outer.bounds
    if shape.is_round:
        return float(upper[0] - lower[0]), float(upper[0])
    if rotations == "fixed":
        return float(np.linalg.norm(upper - lower)), 0.0
    simplices, simplex_radii = shape.outer.boundary()
    axes = 2 if rotations == "yaw" else 3
    points = simplices[..., :axes].reshape(-1, axes)
    radii = np.repeat(simplex_radii, simplices.shape[1])
    reach = float((np.linalg.norm(points, axis=1) + radii).max())
    # The width in any direction is an upper bound of the smallest one, which a normal of a face of
    # the convex hull has. Points are grown by their radii along the axes, and a little more than
    # zero, so that a flat robot has a hull.
    steps = np.concatenate([np.eye(axes), -np.eye(axes)])
    tips = points[:, None] + np.maximum(radii, 1e-6 * reach)[:, None, None] * steps
    normals = ConvexHull(tips.reshape(-1, axes)).equations[:, :axes]
    # Maximum number of directions in which a robot's width is measured.
    tried = normals[:: 1 + len(normals) // 4096]
    widths = [np.ptp([points @ n - radii, points @ n + radii]) for n in tried]
    return float(min(widths)), reach


def _choose_rotations(turn_axes: int, chord: float) -> Rotations:
    """Choose the fewest rotation cells that limit displacements.

    Within a cell, a point at distance 1 from the axis of rotation moves by at most ``chord``.
    """
    angle = 2.0 * math.asin(min(chord / 2.0, 1.0)) - 2.0 * ANGLE_SLACK
    most = MAX_YAW_CELLS
    parts = math.pi
    if turn_axes == 3:
        from cspace._rotations.quaternion import MAX_ANGLE_TIMES_PARTS, MAX_PARTS_PER_AXIS

        most = MAX_PARTS_PER_AXIS
        parts = MAX_ANGLE_TIMES_PARTS
    if parts > most * angle:
        problem = f"needs rotation cells smaller than {math.degrees(parts / most):.2g} degrees"
        raise InputError("gap", problem, "these are the smallest")
    if turn_axes == 3:
        return Rotations.quaternions(math.ceil(parts / angle))
    # With a multiple of 4 cells, robots with symmetries share slices.
    return Rotations.of(4 * math.ceil(parts / angle / 4.0))
