"""build: a workspace and a robot to the certified map of the robot's configurations.

With the rasters of :mod:`cspace.raster`, an overlap of zero between the workspace's outer cells and the robot's outer
offsets proves a cell FREE, and an overlap of the inner ones proves it BLOCKED (see ``docs/certificate.md``).
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.engines import ENGINES, METHODS, Engine, choose
from cspace.errors import InputError
from cspace.map.contents import Contents
from cspace.map.exterior import Exterior, check_outside
from cspace.map.slices import Pair, raster_batches
from cspace.map.storage import PackedStates, Stack
from cspace.memory import SCRATCH_BYTES, TRANSFORM_BYTES, check_memory, is_packed, map_bytes
from cspace.raster.raster import Raster
from cspace.robot import Robot, check_margin
from cspace.rotations import Rotations
from cspace.space import CSpace
from cspace.workspace import Workspace

Progress = Callable[[int, int], None]

STEP: Final = 1000
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
    """Map the configurations of a robot that translates, in the plane or in space, and turns as well if it is to.

    Parameters
    ----------
    workspace : Workspace
        The obstacles.
    robot : Robot
        The robot, of the same dimension.
    rotations : int, array-like or Rotations, optional
        For a robot that turns, in space about the z axis: a number of equal cells of yaw, the first with its middle at
        0, or the borders of the cells in radians, ascending over a whole turn. For one that turns in space as it likes:
        :meth:`cspace.Rotations.quaternions`. FREE and BLOCKED are then proven for every position and every rotation of
        a cell. Slices that a symmetry of the robot repeats are computed and stored once. Of more than 2^29 states, in 8
        slices or more and without overlap counts, each is kept in two bits instead of a byte; all that is asked of the
        map is answered alike, and what needs bytes of all of them refuses where they do not fit. If left out, the robot
        only translates.
    inner : bool
        Also prove cells BLOCKED. Without it, every cell that is not FREE is MIXED, at half the work.
    overlap : bool
        Keep the overlap counts of the outer rasters as :attr:`CSpace.overlaps`.
    method : {"auto", "fft", "direct"}
        The engine; the map is the same, cell for cell. "fft" correlates by transforms, "direct" dilates 64 cells at a
        time, and "auto" takes that unless the robot has thousands of rows, or overlap counts are asked for, which only
        the transforms give.
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
    margin, cells = check_margin(margin), Rotations.of(rotations)
    _check(workspace, robot, cells, method, overlap, outside, workers)
    grid = workspace.grid
    slice_of = cells.slice_of(robot)
    slices = int(slice_of.max()) + 1
    needed = map_bytes(grid.shape, slices, overlap)
    check_memory(needed, "the map", grid.shape, grid.spacing, fixed=TRANSFORM_BYTES, fewer=cells.fewer)
    batches = raster_batches(robot, grid.spacing, margin, cells)
    rasters, exterior, overlaps = None, None, None
    states: Stack

    def correlation_of(pairs: Sequence[Pair], tell: Progress | None) -> tuple[_Correlation, list[list[Raster]]]:
        """The engine for the rasters of slices, and these by side."""
        sides = [list(side) for side in zip(*pairs, strict=True)][: 2 if inner else 1]
        engine = ENGINES[choose(sides[0], counts=overlap) if method == "auto" else method]
        own = max(engine.bytes_needed(grid.shape, side, workers) for side in sides)
        what = "the map, with what its engine needs for this robot,"
        check_memory(needed + own - TRANSFORM_BYTES, what, grid.shape, grid.spacing, fewer=cells.fewer)
        return _Correlation(engine, outside == "blocked", workers, tell), sides

    if is_packed(grid.shape, slices, overlap):
        states, done, precision = PackedStates((slices, *grid.shape)), 0, ""
        table = np.empty((slices, 2 * grid.dim + 1), dtype=np.int64)
        scratch = np.empty((max(1, SCRATCH_BYTES // grid.size), *grid.shape), dtype=np.uint8)
        for batch in batches:
            for start in range(0, len(batch), len(scratch)):
                numbers, pairs = zip(*batch[start : start + len(scratch)], strict=True)
                correlation, sides = correlation_of(pairs, None)
                precision = max(precision, correlation.fill(workspace, sides, scratch[: len(pairs)], None))
                for number, made in zip(numbers, scratch, strict=False):
                    states.write(number, made)
                table[list(numbers)] = Exterior.of(workspace.outer, pairs, outside).table
                done += len(pairs)
                if progress is not None:
                    progress(done, slices)
        exterior = Exterior(table)
    else:
        by_number = dict(itertools.chain.from_iterable(batches))
        rasters = [by_number[number] for number in range(slices)]
        correlation, sides = correlation_of(rasters, progress)
        states = np.empty((slices, *grid.shape), dtype=np.uint8)
        overlaps = np.empty(states.shape, dtype=np.int32) if overlap else None
        precision = correlation.fill(workspace, sides, states, overlaps)
    contents = Contents(
        workspace, robot, cells, slice_of, states, outside, margin, precision, overlaps, tells_blocked=inner
    )
    return CSpace(contents, rasters, exterior)


@dataclass(frozen=True, slots=True)
class _Correlation:
    """An engine at work for one build."""

    engine: Engine
    outside: bool
    workers: int | None
    progress: Progress | None

    def fill(
        self,
        workspace: Workspace,
        sides: Sequence[Sequence[Raster]],
        state: NDArray[np.uint8],
        overlaps: NDArray[np.int32] | None,
    ) -> str:
        """Fill all slices from the outer and, where there are any, the inner rasters; the arithmetic that it took."""
        outers, inners = sides[0], [raster for side in sides[1:] for raster in side]
        collides = state.view(np.bool_)
        if inners and overlaps is None and len(outers) == 1 and workspace.inner is workspace.outer:
            # One slice and one workspace bitmap, which is read once for both rasters.
            lies_in = np.empty(workspace.grid.shape, dtype=np.bool_)
            precision = self._collide(workspace.outer, [*outers, *inners], [collides[0], lies_in], (0, 1))
            state[0] += lies_in
            return precision
        counts = collides if overlaps is None else overlaps
        precision = self._collide(workspace.outer, outers, list(counts), (0, len(sides)))
        if overlaps is not None:
            np.not_equal(overlaps, 0, out=collides)
        if inners:
            added = self._collide(workspace.inner, inners, list(state), (1, 2), add=True)
            precision = max(precision, added)
        return precision

    def _collide(
        self,
        occupied: NDArray[np.bool_],
        rasters: Sequence[Raster],
        out: Sequence[NDArray[Any]],
        step: tuple[int, int],
        add: bool = False,
    ) -> str:
        """One step of so many; each counts alike for progress, however many parts it has."""
        (number, steps), tell = step, self.progress

        def advance(done: int, total: int) -> None:
            if tell is not None:
                tell(number * STEP + STEP * done // total, steps * STEP)

        precision = self.engine.collide(
            occupied, rasters, out, outside=self.outside, add=add, workers=self.workers, progress=advance
        )
        advance(1, 1)  # also where there was nothing to do
        return precision


def _check(
    workspace: Workspace,
    robot: Robot,
    rotations: Rotations,
    method: str,
    overlap: bool,
    outside: str,
    workers: int | None,
) -> None:
    """Refuse arguments that break their rules, before any work."""
    for name, given, kind, mend in (
        ("workspace", workspace, Workspace, "use Workspace.from_array"),
        ("robot", robot, Robot, "use e.g. Robot.disc(0.3)"),
    ):
        if not isinstance(given, kind):
            raise InputError(name, f"is a {type(given).__name__}", f"it must be a {kind.__name__}", mend, value=given)
    if workspace.grid.dim != robot.dim:
        raise InputError(
            "robot",
            f"has {robot.dim} dimensions and the workspace {workspace.grid.dim}",
            "they must agree",
            "take both in the plane or both in space",
        )
    rotations.check_dimension(robot.dim)
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        rule = "it must be a whole number above zero, or None for all cores"
        raise InputError("workers", f"is {workers!r}", rule, "leave it out", value=workers)
    if method not in METHODS:
        rule = f"it must be one of {', '.join(map(repr, METHODS))}"
        raise InputError("method", f"is {method!r}", rule, "leave it out", value=method)
    if overlap and method != "auto" and not ENGINES[method].COUNTS:
        raise InputError(
            "method",
            f"is {method!r} and overlap is True",
            "this engine tells only whether there is any overlap; counts need the transforms",
            "use method='fft' or method='auto'",
            value=method,
        )
    check_outside(outside)
