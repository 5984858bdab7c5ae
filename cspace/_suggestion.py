"""``suggest``: the spacing and the rotation cells with which a map decides passages of a width."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from cspace._builder import check_options, check_types
from cspace._grid import MAX_COORDINATE
from cspace._robot import Robot, robot_of
from cspace._rotations import Rotations
from cspace._rotations.base import ANGLE_SLACK
from cspace._rotations.yaw import MAX_YAW_CELLS
from cspace._support.check import check_positive, check_word, names_options
from cspace._support.limits import bytes_text
from cspace._support.reporting import tell_apart
from cspace._workspace import Workspace, covering_shape
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace._shapes import ShapeLike
    from cspace._shapes.shape import Shape

RATE: Final = 2.0 * (1.0 + 1e-4)
"""Constant of Theorem 1 in ``docs/explanation/convergence.md``, with room for rounding. A
configuration is FREE if it is farther from the C-obstacle than RATE times the sum of the diagonal
of a cell and the displacement within a rotation cell."""

_TURN_AXES: Final = {"fixed": 0, "yaw": 1, "all": 3}
"""Number of axes of rotation of a robot, by the argument ``rotations`` of :func:`suggest`."""


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
    check_types(workspace)
    robot = robot_of(robot)
    # The options are the defaults of ``build``, because only the dimensions need a check.
    check_options(workspace, robot, Rotations.of(None), "auto", False, "blocked", None)
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
