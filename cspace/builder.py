"""build: a workspace and a robot to the certified map of the robot's configurations.

With the rasters of :mod:`cspace.raster`, an overlap of zero between the workspace's outer cells and the robot's outer
offsets proves a cell FREE, and an overlap of the inner ones proves it BLOCKED (see ``docs/certificate.md``).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.raster.raster import Raster
from cspace.robot import Robot, check_margin
from cspace.rotations import Rotations, check_rotations
from cspace.slices import slice_rasters
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from cspace.space import CSpace

Progress = Callable[[int, int], None]

BATCH = 8
"""Slices that are worked on together: they share the transforms of the workspace, and memory grows with them."""


def build(
    workspace: Workspace,
    robot: Robot,
    *,
    rotations: int | ArrayLike | Rotations | None = None,
    inner: bool = True,
    overlap: bool = False,
    method: str = "fft",
    outside: str = "blocked",
    margin: float = 0.0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> CSpace:
    """Map the configurations of a robot that translates, or translates and turns, among obstacles.

    Parameters
    ----------
    workspace : Workspace
        The obstacles, in the plane.
    robot : Robot
        The robot, in the plane.
    rotations : int or array-like, optional
        For a robot that turns: a number of equal cells of yaw, the first with its middle at 0, or the borders of the
        cells in radians, ascending over a whole turn. FREE and BLOCKED are then proven for every position and every yaw
        of a cell. Slices that a symmetry of the robot repeats are computed and stored once. If left out, the robot only
        translates.
    inner : bool
        Also prove cells BLOCKED. Without it, every cell that is not FREE is MIXED, at half the work.
    overlap : bool
        Keep the overlap counts of the outer rasters as :attr:`CSpace.overlaps`.
    method : {"fft"}
        The engine.
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
        If an argument breaks its rule, or the robot is absurdly large at the workspace's spacing.

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

    _check(workspace, robot, method, outside, workers)
    margin = check_margin(margin)
    cells = check_rotations(rotations)
    rasters = slice_rasters(robot, workspace.grid.spacing, margin, cells)
    engine = _Engine(workspace, rasters, inner, outside == "blocked", workers, progress)
    state = np.empty((len(rasters), *workspace.grid.shape), dtype=np.uint8)
    overlaps = np.empty(state.shape, dtype=np.int32) if overlap else None
    precisions = {engine.run(slice(first, first + BATCH), state, overlaps) for first in range(0, len(rasters), BATCH)}
    flat = cells is None
    return CSpace(
        workspace,
        robot,
        state[0] if flat else state,
        outside=outside,
        margin=margin,
        precision=max(precisions),
        overlaps=overlaps[0] if flat and overlaps is not None else overlaps,
        rotations=cells,
        rasters=rasters,
    )


@dataclass(frozen=True, slots=True)
class _Engine:
    """The correlations of one build, a batch of slices at a time."""

    workspace: Workspace
    rasters: Sequence[tuple[Raster, Raster]]
    inner: bool
    outside: bool
    workers: int | None
    progress: Progress | None

    def run(self, batch: slice, state: NDArray[np.uint8], overlaps: NDArray[np.int32] | None) -> str:
        """Fill a batch of slices; the precision that it took."""
        outer_robots = [outer for outer, _ in self.rasters[batch]]
        inner_robots = [inner for _, inner in self.rasters[batch]]
        free = list(state[batch].view(np.bool_))
        part = batch.start // BATCH, math.ceil(len(self.rasters) / BATCH)
        if self.inner and overlaps is None and self.workspace.inner is self.workspace.outer:
            # One workspace bitmap: its spectra serve both rasters.
            collides = [np.empty(state.shape[1:], dtype=np.bool_) for _ in inner_robots]
            rasters, out = [*outer_robots, *inner_robots], [*free, *collides]
            precision = self._correlate(self.workspace.outer, rasters, out, *part)
        else:
            steps = 2 if self.inner else 1
            first, second = (part[0] * steps, part[1] * steps), (part[0] * steps + 1, part[1] * steps)
            counts = free if overlaps is None else list(overlaps[batch])
            precision = self._correlate(self.workspace.outer, outer_robots, counts, *first)
            if overlaps is not None:
                np.not_equal(overlaps[batch], 0, out=state[batch].view(np.bool_))
            if not self.inner:
                return precision
            collides = [np.empty(state.shape[1:], dtype=np.bool_) for _ in inner_robots]
            precision = max(precision, self._correlate(self.workspace.inner, inner_robots, collides, *second))
        for one, hit in zip(state[batch], collides, strict=True):
            one += hit.view(np.uint8)
        return precision

    def _correlate(
        self, occupied: NDArray[np.bool_], rasters: Sequence[Raster], out: Sequence[NDArray[Any]], step: int, steps: int
    ) -> str:
        from cspace.fourier import correlate

        tell = self.progress
        advance = None if tell is None else lambda done, total: tell(step * total + done, steps * total)
        options: dict[str, Any] = {"outside": self.outside, "workers": self.workers, "progress": advance}
        return correlate(occupied, rasters, out=out, **options).precision


def _check(workspace: Workspace, robot: Robot, method: str, outside: str, workers: int | None) -> None:
    if not isinstance(workspace, Workspace):
        raise InputError(f"workspace is a {type(workspace).__name__}; it must be a Workspace; use Workspace.from_array")
    if not isinstance(robot, Robot):
        raise InputError(f"robot is a {type(robot).__name__}; it must be a Robot; use e.g. Robot.disc(0.3)")
    if workspace.grid.dim != robot.dim:
        raise InputError(
            f"the workspace has {workspace.grid.dim} dimensions and the robot {robot.dim}; they must agree; "
            "take both in the plane"
        )
    if method != "fft":
        raise InputError(f"method is {method!r}; the engines are: 'fft'")
    if outside not in ("blocked", "free"):
        raise InputError(f"outside is {outside!r}; it must be 'blocked' or 'free'")
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise InputError(f"workers is {workers!r}; it must be a whole number above zero, or None for all cores")
