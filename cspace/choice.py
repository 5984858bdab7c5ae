"""Choice: which engine makes a map, from what each is expected to take."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from numpy.typing import ArrayLike

from cspace.costs import figures
from cspace.errors import InputError
from cspace.raster.raster import Raster
from cspace.robot import Robot, check_margin
from cspace.rotations import Rotations, check_rotations
from cspace.slices import slice_rasters
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from cspace.bits import Runs

ENGINES: Final = ("fft", "direct")
METHODS: Final = (*ENGINES, "auto")

LONG: Final = 1.0
"""Seconds of expected work from which on the costs of this machine are measured first, which takes about as long."""


@dataclass(frozen=True, slots=True)
class Choice:
    """An engine, and what each was expected to take.

    Attributes
    ----------
    method : {"fft", "direct"}
        The quicker one.
    seconds : dict of str to float
        For each engine; the rasters of the robot are not in it, which both need.
    measured : bool
        Whether the costs behind it were measured on this machine; if not, they are typical ones.
    """

    method: str
    seconds: dict[str, float]
    measured: bool


def choose_method(
    workspace: Workspace,
    robot: Robot,
    *,
    rotations: int | ArrayLike | Rotations | None = None,
    inner: bool = True,
    margin: float = 0.0,
    workers: int | None = None,
) -> Choice:
    """Which engine :func:`cspace.build` takes with ``method="auto"``, and what each is expected to take.

    ``"fft"`` correlates by transforms, whose cost hardly depends on the robot. ``"direct"`` dilates 64 cells at a time,
    once for each row of the robot, and so is the quicker one unless the robot has thousands of rows.

    Parameters
    ----------
    workspace, robot, rotations, inner, margin, workers
        As for :func:`cspace.build`.

    Returns
    -------
    Choice

    Raises
    ------
    InputError
        If an argument breaks its rule.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.eye(500, dtype=bool), 0.1)
    >>> cspace.choose_method(workspace, cspace.Robot.disc(0.3)).method
    'direct'
    """
    from cspace.bits import Runs

    check_pair(workspace, robot, workers)
    shape = workspace.grid.shape
    rasters = slice_rasters(robot, workspace.grid.spacing, check_margin(margin), check_rotations(rotations))
    sides = [list(side) for side in zip(*rasters, strict=True)][: 2 if inner else 1]
    return cheapest(shape, sides, [[Runs.of(raster, shape) for raster in side] for side in sides], workers)


def cheapest(
    shape: Sequence[int], rasters: Sequence[Sequence[Raster]], runs: Sequence[Sequence[Runs]], workers: int | None
) -> Choice:
    """The choice for a grid, and a robot's outer and, where they are needed, inner rasters, with their runs."""
    choice = _estimate(shape, rasters, runs, workers)
    if choice.seconds[choice.method] >= LONG and not choice.measured:
        figures().measure()
        choice = _estimate(shape, rasters, runs, workers)
    return choice


def quicker(
    shape: Sequence[int], rasters: Sequence[Sequence[Raster]], runs: Sequence[Sequence[Runs]], workers: int | None
) -> str:
    """The engine of :func:`cheapest`, without the search for tiles where no tiles could be quick enough."""
    from cspace.bits import dilation_seconds
    from cspace.fourier import least_seconds

    direct = sum(dilation_seconds(shape, side, workers) for side in runs)
    if direct < min(LONG, sum(least_seconds(shape, side, workers) for side in rasters)):
        return "direct"
    return cheapest(shape, rasters, runs, workers).method


def check_pair(workspace: Workspace, robot: Robot, workers: int | None) -> None:
    """Refuse what is no workspace, no robot for it, or no number of threads."""
    if not isinstance(workspace, Workspace):
        raise InputError(f"workspace is a {type(workspace).__name__}; it must be a Workspace; use Workspace.from_array")
    if not isinstance(robot, Robot):
        raise InputError(f"robot is a {type(robot).__name__}; it must be a Robot; use e.g. Robot.disc(0.3)")
    if workspace.grid.dim != robot.dim:
        raise InputError(
            f"the workspace has {workspace.grid.dim} dimensions and the robot {robot.dim}; they must agree; "
            "take both in the plane or both in space"
        )
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise InputError(f"workers is {workers!r}; it must be a whole number above zero, or None for all cores")


def _estimate(
    shape: Sequence[int], rasters: Sequence[Sequence[Raster]], runs: Sequence[Sequence[Runs]], workers: int | None
) -> Choice:
    from cspace.bits import dilation_seconds
    from cspace.fourier import transform_seconds

    seconds = {
        "fft": sum(transform_seconds(shape, side, workers) for side in rasters),
        "direct": sum(dilation_seconds(shape, side, workers) for side in runs),
    }
    return Choice(min(ENGINES, key=lambda engine: seconds[engine]), seconds, figures().are_measured)
