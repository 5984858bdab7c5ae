"""What a picture shows, in metres and radians: configurations, outlines, the part of the plane or of space in view."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import finite, positive
from cspace.rotations import TURN

if TYPE_CHECKING:
    from cspace.robot import Robot
    from cspace.rotations import Rotations
    from cspace.space import CSpace

Floats = NDArray[np.float64]

MANY: Final = 12
"""About how many robots are drawn along a path when the caller does not say."""
THIN: Final = 12.0
"""The largest ratio of the sides that is drawn to scale; beyond it the short side is stretched, as the title says."""


class Outline:
    """The outline of a shape in the plane, to be placed at configurations."""

    def __init__(self, geometry: Any) -> None:
        self.rings = rings(geometry)

    def at(self, q: Floats) -> list[Floats]:
        """Outlines at a configuration, shape (2,) or (3,), each of shape (n, 2)."""
        return [placed(ring, q) for ring in self.rings]


class Footprint(Outline):
    """The outline of a robot in the plane."""

    def __init__(self, robot: Robot) -> None:
        geometry = robot.geometry
        super().__init__(geometry)
        left, bottom, right, top = geometry.bounds
        self.size = math.hypot(right - left, top - bottom)
        self.reach = float(max(np.hypot(*ring.T).max() for ring in self.rings))
        # A triangle at the front that tells which way the robot looks, closed as the rings are.
        middle, half = (bottom + top) / 2, (top - bottom) / 5
        back = right - 0.25 * (right - left)
        self.nose: Floats = np.array([(right, middle), (back, middle + half), (back, middle - half), (right, middle)])


def placed(points: Floats, q: Floats) -> Floats:
    """Points of the robot's frame, shape (n, 2), where a configuration, shape (2,) or (3,), brings them."""
    if len(q) == 3:
        cos, sin = math.cos(q[2]), math.sin(q[2])
        points = points @ np.array([[cos, sin], [-sin, cos]])
    return np.asarray(points + q[:2])


def rings(geometry: Any) -> list[Floats]:
    """Closed outlines of a geometry, holes included, each of shape (n, 2)."""
    from shapely.geometry.polygon import orient

    # Holes run the other way round than outlines, or they would be filled.
    parts = [orient(part) for part in getattr(geometry, "geoms", [geometry])]
    return [np.asarray(ring.coords)[:, :2] for part in parts for ring in (part.exterior, *part.interiors)]


def polyline(space: CSpace, path: Any) -> Floats:
    """A path, or that of a plan, as an array, shape (n, dof); n is 0 where there is none.

    Raises
    ------
    InputError
        If it has the wrong shape or is not finite.
    """
    values = getattr(path, "path", path)
    if values is None:
        return np.empty((0, space.dof))
    points = finite(values, "path")
    if points.shape == (0,):
        return np.empty((0, space.dof))
    if points.ndim != 2 or points.shape[1] != space.dof:
        raise InputError(
            f"path has shape {points.shape}; it must be (n, {space.dof}); pass one configuration {_names(space)} in a "
            "row"
        )
    return points


def marks(space: CSpace, points: Floats, start: Any, goal: Any) -> dict[str, Floats]:
    """Start and goal by name, each of shape (dof,), those that there are; the ends of the path where not given.

    Raises
    ------
    InputError
        If one has the wrong shape or is not finite.
    """
    found = {}
    for name, given, end in (("start", start, 0), ("goal", goal, -1)):
        if given is not None:
            mark = finite(given, name)
            if mark.shape != (space.dof,):
                raise InputError(
                    f"{name} has shape {mark.shape}; it must be ({space.dof},); pass one configuration {_names(space)}"
                )
            found[name] = mark
        elif len(points):
            found[name] = points[end]
    return found


def stations(points: Floats, every: float | None, size: float, reach: float | None) -> Floats:
    """Configurations along the path at which a robot of a size is drawn, the ends left out, shape (n, dof)."""
    if every is not None and every != math.inf:
        every = positive(every, "robot_every")
    if len(points) < 2 or every == math.inf:
        return points[:0]
    length = float(travelled(points, reach)[-1])
    if every is None:
        every = max(length / MANY, 0.75 * size)
    count = math.ceil(length / every)
    return along(points, np.arange(1, count) / max(count, 1), reach)


def travelled(points: Floats, reach: float | None) -> Floats:
    """Way from the first to each configuration of a path, metres, shape (n,).

    A third number is a yaw, and a radian counts for ``reach`` metres; where that is None, it is the height.
    """
    ways = np.diff(points, axis=0)
    if reach is None:
        return np.concatenate([[0.0], np.cumsum(np.linalg.norm(ways, axis=1))])
    lengths = np.hypot(ways[:, 0], ways[:, 1])
    if points.shape[1] == 3:
        lengths += reach * np.abs(shorter(ways[:, 2]))
    return np.concatenate([[0.0], np.cumsum(lengths)])


def along(points: Floats, shares: Floats, reach: float | None) -> Floats:
    """Configurations at shares, from 0 to 1, of the way along a path, shape (n, dof); yaw runs the shorter way.

    ``reach`` is that of :func:`travelled`.
    """
    way = travelled(points, reach)
    columns = list(points.T)
    if points.shape[1] == 3 and reach is not None:
        columns[2] = points[0, 2] + np.concatenate([[0.0], np.cumsum(shorter(np.diff(points[:, 2])))])
    return np.stack([np.interp(shares * way[-1], way, column) for column in columns], axis=-1)


def shorter(angles: Floats) -> Floats:
    """Turns as those of the shorter way round, from -pi to pi."""
    return np.asarray((angles + math.pi) % TURN - math.pi)


def box(space: CSpace, shown: Sequence[Floats]) -> Floats:
    """Lower and upper corner of what is in view, shape (2, dim): the grid, and what is drawn beyond it."""
    dim = space.grid.dim
    points = np.concatenate([[space.grid.lower, space.grid.upper], *(each[:, :dim] for each in shown)])
    return np.stack([points.min(axis=0), points.max(axis=0)])


def stretch(view: Floats) -> float:
    """Drawn height of a metre in y over the drawn width of a metre in x: 1, but for long and thin maps."""
    width, height = view[1] - view[0]
    return float(max(1.0, width / height / THIN) * min(1.0, THIN * width / height))


def title(space: CSpace, view: Floats, words: str | None, yaw: float | None) -> str:
    """The given title, or what is shown; where an axis is stretched, it says so."""
    if words is None:
        words = about(space)
        if space.rotations is not None:
            words += f"\n{_turns(space.rotations, yaw)}"
    ratio = stretch(view)
    if ratio != 1.0:
        axis, times = ("y", ratio) if ratio > 1.0 else ("x", 1.0 / ratio)
        words = f"{words} ({axis} stretched {times:.3g} times)".strip()
    return words


def about(space: CSpace) -> str:
    """The robot and the side of a cell."""
    return f"{space.robot.name}, cells of {space.grid.spacing:g} m"


def degrees(yaw: float) -> str:
    """A yaw in degrees, wrapped to (-180, 180], with its unit."""
    angle = round(180.0 - (180.0 - math.degrees(yaw)) % 360.0, 1)
    return f"{angle + 0.0:g}°"  # no minus sign before zero


def _turns(rotations: Rotations, yaw: float | None) -> str:
    """What is shown of a map with rotations."""
    widths = np.degrees(np.diff(rotations.borders))
    if yaw is not None:
        return f"yaw {degrees(yaw)}, in a rotation cell {widths[rotations.cell_of(yaw)]:.3g}° wide"
    width = f"{widths.min():.3g}°" + ("" if rotations.is_uniform() else f" to {widths.max():.3g}°")
    return f"over all yaws, {rotations.count} rotation cells of {width}"


def _names(space: CSpace) -> str:
    third = "z" if space.grid.dim == 3 else "yaw"
    return "(x, y)" if space.dof == 2 else f"(x, y, {third})"
