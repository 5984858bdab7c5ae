"""build: a workspace and a robot to the certified map of the robot's configurations.

With the rasters of :mod:`cspace.raster`, an overlap of zero between the workspace's outer cells and the robot's outer
offsets proves a cell FREE, and an overlap of the inner ones proves it BLOCKED (see ``docs/certificate.md``).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from cspace.errors import InputError
from cspace.robot import Robot, check_margin
from cspace.workspace import Workspace

if TYPE_CHECKING:
    from cspace.space import CSpace

Progress = Callable[[int, int], None]


def build(
    workspace: Workspace,
    robot: Robot,
    *,
    rotations: None = None,
    inner: bool = True,
    overlap: bool = False,
    method: str = "fft",
    outside: str = "blocked",
    margin: float = 0.0,
    workers: int | None = None,
    progress: Progress | None = None,
) -> CSpace:
    """Map the configurations of a robot that translates among obstacles.

    Parameters
    ----------
    workspace : Workspace
        The obstacles, in the plane.
    robot : Robot
        The robot, in the plane.
    rotations : None
        Only robots that translate are mapped; any other value is refused.
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
    from cspace.fourier import correlate
    from cspace.space import CSpace

    _check(workspace, robot, rotations, method, outside, workers)
    margin = check_margin(margin)
    outer_robot, inner_robot = robot.rasters(workspace.grid.spacing, margin)
    blocked_outside = outside == "blocked"
    options: dict[str, Any] = {"outside": blocked_outside, "workers": workers}
    shared = inner and not overlap and workspace.inner is workspace.outer
    runs = 1 if shared or not inner else 2

    def advance(run: int) -> Progress | None:
        return None if progress is None else lambda done, total: progress(run * total + done, runs * total)

    outer_rasters = [outer_robot, inner_robot] if shared else [outer_robot]
    outer = correlate(workspace.outer, outer_rasters, counts=overlap, progress=advance(0), **options)
    precision = outer.precision
    overlaps = outer.results[0] if overlap else None
    state = (outer.results[0] != 0).view(np.uint8)
    if shared:
        state += outer.results[1].view(np.uint8)
    elif inner:
        collides = correlate(workspace.inner, [inner_robot], progress=advance(1), **options)
        state += collides.results[0].view(np.uint8)
        precision = max(precision, collides.precision)
    return CSpace(workspace, robot, state, outside=outside, margin=margin, precision=precision, overlaps=overlaps)


def _check(
    workspace: Workspace, robot: Robot, rotations: object, method: str, outside: str, workers: int | None
) -> None:
    if not isinstance(workspace, Workspace):
        raise InputError(f"workspace is a {type(workspace).__name__}; it must be a Workspace; use Workspace.from_array")
    if not isinstance(robot, Robot):
        raise InputError(f"robot is a {type(robot).__name__}; it must be a Robot; use e.g. Robot.disc(0.3)")
    if workspace.grid.dim != robot.dim:
        raise InputError(
            f"the workspace has {workspace.grid.dim} dimensions and the robot {robot.dim}; they must agree; "
            "take both in the plane"
        )
    if rotations is not None:
        raise InputError(f"rotations is {rotations!r}; robots that turn are not supported; leave it None")
    if method != "fft":
        raise InputError(f"method is {method!r}; the engines are: 'fft'")
    if outside not in ("blocked", "free"):
        raise InputError(f"outside is {outside!r}; it must be 'blocked' or 'free'")
    if workers is not None and (not isinstance(workers, int) or workers < 1):
        raise InputError(f"workers is {workers!r}; it must be a whole number above zero, or None for all cores")
