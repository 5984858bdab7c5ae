"""build: a workspace and a robot to the certified map of the robot's configurations.

With the rasters of :mod:`cspace.raster`, an overlap of zero between the workspace's outer cells and the robot's outer
offsets proves a cell FREE, and an overlap of the inner ones proves it BLOCKED (see ``docs/certificate.md``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.choice import METHODS, check_pair, quicker
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.memory import TRANSFORM_BYTES, check_memory, map_bytes
from cspace.raster.raster import Raster
from cspace.robot import Robot, check_margin
from cspace.rotations import Rotations, check_rotations
from cspace.slices import slice_of_rotation, slice_rasters
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from cspace.space import CSpace

Progress = Callable[[int, int], None]

STEP = 1000
"""Steps of progress that a correlation counts for."""


def build(
    workspace: Workspace,
    robot: Robot,
    *,
    rotations: int | ArrayLike | Rotations | None = None,
    inner: bool = True,
    overlap: bool = False,
    method: str = "auto",
    outside: str = "blocked",
    margin: float = 0.0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> CSpace:
    """Map the configurations of a robot that translates, in the plane or in space, or turns as well, in the plane.

    Parameters
    ----------
    workspace : Workspace
        The obstacles.
    robot : Robot
        The robot, of the same dimension.
    rotations : int or array-like, optional
        For a robot in the plane that turns: a number of equal cells of yaw, the first with its middle at 0, or the
        borders of the cells in radians, ascending over a whole turn. FREE and BLOCKED are then proven for every
        position and every yaw of a cell. Slices that a symmetry of the robot repeats are computed and stored once. If
        left out, the robot only translates.
    inner : bool
        Also prove cells BLOCKED. Without it, every cell that is not FREE is MIXED, at half the work.
    overlap : bool
        Keep the overlap counts of the outer rasters as :attr:`CSpace.overlaps`.
    method : {"auto", "fft", "direct"}
        The engine; the map is the same, cell for cell. "fft" correlates by transforms, "direct" dilates 64 cells at a
        time, and "auto" takes the one that is expected to be quicker (see :func:`cspace.choose_method`), or "fft" where
        overlap counts are asked for, which only the transforms give.
    outside : {"blocked", "free"}
        Whether what lies beyond the workspace's bounds is obstacle or free.
    margin : float
        Metres by which the robot is grown for FREE; BLOCKED keeps to the robot as it is.
    workers : int, optional
        Threads; by default one for each core that the process may use.
    progress : callable, optional
        Called with (steps done, steps in all).

    Returns
    -------
    CSpace

    Raises
    ------
    InputError
        If an argument breaks its rule, the robot is absurdly large at the workspace's spacing, or the map does not fit
        into the memory that is free; the message tells what would.

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
    from cspace.space import CSpace

    _check(workspace, robot, method, overlap, outside, workers)
    margin = check_margin(margin)
    cells = check_rotations(rotations)
    if cells is not None and robot.dim == 3:
        raise InputError(
            f"rotations is {rotations!r} for a robot in space, which only translates so far; leave rotations out, or "
            "take robot and workspace in the plane"
        )
    grid = workspace.grid
    slices = int(slice_of_rotation(robot, cells).max()) + 1
    needed = map_bytes(grid.shape, slices, overlap)
    check_memory(needed, "the map", grid.shape, grid.spacing, fixed=TRANSFORM_BYTES)
    rasters = slice_rasters(robot, grid.spacing, margin, cells)
    method, robots = _chosen(method, rasters, grid, inner, overlap, workers)
    _check_room(method, grid, robots, len(rasters), overlap, workers)
    state = np.empty((len(rasters), *grid.shape), dtype=np.uint8)
    overlaps = np.empty(state.shape, dtype=np.int32) if overlap else None
    engine = _Engine(workspace, method, outside == "blocked", workers, progress)
    precision = engine.run(robots, state, overlaps)
    flat = cells is None
    return CSpace(
        workspace,
        robot,
        state[0] if flat else state,
        outside=outside,
        margin=margin,
        precision=precision,
        overlaps=overlaps[0] if flat and overlaps is not None else overlaps,
        rotations=cells,
        rasters=rasters,
        trusted=True,
        tells_blocked=inner,
    )


@dataclass(frozen=True, slots=True)
class _Engine:
    """The correlations of one build."""

    workspace: Workspace
    method: str
    outside: bool
    workers: int | None
    progress: Progress | None

    def run(self, robots: Sequence[Sequence[Any]], state: NDArray[np.uint8], overlaps: NDArray[np.int32] | None) -> str:
        """Fill all slices, from the outer and, where there are any, the inner offsets; the arithmetic that it took."""
        free = state.view(np.bool_)
        outers, inners = robots[0], [side for sides in robots[1:] for side in sides]
        if inners and overlaps is None and len(outers) == 1 and self.workspace.inner is self.workspace.outer:
            # One slice and one workspace bitmap, which is read once for both rasters.
            collides = np.empty(free[0].shape, dtype=np.bool_)
            precision = self._settle(self.workspace.outer, [*outers, *inners], [free[0], collides], 0, 1)
            state[0] += collides
            return precision
        steps = len(robots)
        counts = free if overlaps is None else overlaps
        precision = self._settle(self.workspace.outer, outers, list(counts), 0, steps)
        if overlaps is not None:
            np.not_equal(overlaps, 0, out=free)
        if inners:
            added = self._settle(self.workspace.inner, inners, list(state), 1, steps, add=True)
            precision = max(precision, added)
        return precision

    def _settle(
        self,
        occupied: NDArray[np.bool_],
        robots: Sequence[Any],
        out: Sequence[NDArray[Any]],
        step: int,
        steps: int,
        add: bool = False,
    ) -> str:
        """Write whether robots overlap obstacles, or how much, for all cells; the arithmetic that it took."""
        from cspace.bits import dilate
        from cspace.fourier import correlate

        tell = self.progress
        # Each step counts alike, however many parts it has.
        advance = None if tell is None else lambda done, total: tell(step * STEP + STEP * done // total, steps * STEP)
        options: dict[str, Any] = {"outside": self.outside, "workers": self.workers, "progress": advance}
        precision = "integer"
        if self.method == "direct":
            dilate(occupied, robots, out=out, add=add, **options)
        else:
            precision = correlate(occupied, robots, out=out, add=add, **options).precision
        if tell is not None:
            tell((step + 1) * STEP, steps * STEP)  # also where there was nothing to do
        return precision


def _chosen(
    method: str,
    rasters: Sequence[tuple[Raster, Raster]],
    grid: Grid,
    inner: bool,
    overlap: bool,
    workers: int | None,
) -> tuple[str, Sequence[Sequence[Any]]]:
    """The engine, and the outer and, where they are needed, inner offsets as it takes them."""
    from cspace.bits import Runs

    sides = [list(side) for side in zip(*rasters, strict=True)][: 2 if inner else 1]
    if method == "fft" or (method == "auto" and overlap):
        return "fft", sides
    runs = [[Runs.of(raster, grid.shape) for raster in side] for side in sides]
    if method == "auto":
        method = quicker(grid.shape, sides, runs, workers)
    return method, runs if method == "direct" else sides


def _check_room(
    method: str, grid: Grid, robots: Sequence[Sequence[Any]], slices: int, overlap: bool, workers: int | None
) -> None:
    """Refuse a map for which there is no memory with what the engine needs for a robot of this size."""
    from cspace.bits import dilation_bytes
    from cspace.fourier import transform_bytes

    if method == "direct":
        needed, what = max(dilation_bytes(grid.shape, side) for side in robots), "the bits that are dilated"
    else:
        needed, what = max(transform_bytes(grid.shape, side, workers) for side in robots), "the transforms"
    needed += map_bytes(grid.shape, slices, overlap) - TRANSFORM_BYTES
    check_memory(needed, f"the map, with {what} for this robot,", grid.shape, grid.spacing)


def _check(workspace: Workspace, robot: Robot, method: str, overlap: bool, outside: str, workers: int | None) -> None:
    check_pair(workspace, robot, workers)
    if method not in METHODS:
        raise InputError(f"method is {method!r}; the engines are: {', '.join(map(repr, METHODS))}")
    if method == "direct" and overlap:
        raise InputError(
            "overlap is True and method 'direct', which tells only whether there is any overlap; overlap counts need "
            "the transforms; use method='fft' or method='auto'"
        )
    if outside not in ("blocked", "free"):
        raise InputError(f"outside is {outside!r}; it must be 'blocked' or 'free'")
