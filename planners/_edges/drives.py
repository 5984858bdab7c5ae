"""Choice of the edges of a drive, and checks of its options."""

from __future__ import annotations

from typing import Final

from cspace import Space
from cspace.errors import InputError
from cspace.inside import Car as Car
from cspace.inside import ConfigurationMap, check_drive, tell_apart
from cspace.inside import Differential as Differential
from planners._edges.local_planner import Drive, LocalPlanner
from planners._edges.own_space import check_space

MIN_RADIUS_CELLS: Final = 1e-3
MAX_RADIUS_CELLS: Final = 1e3
"""Smallest and largest turning radius, in cells, for which rounding errors stay small."""


def local_planner(
    space: Space,
    drive: Drive | None = None,
    bidirectional: bool = False,
) -> LocalPlanner:
    """Make the local planner of a space from :class:`LocalPlanner` options.

    Raises InputError if ``space`` is no :class:`cspace.Space`; ``drive`` is no drive, or given for
    a space other than a map of x, y, yaw; or its turning radius is out of range.
    """
    check_space(space)
    if check_drive(drive) is None:
        return LocalPlanner(space, drive, bidirectional)
    if not has_drives(space):
        raise InputError(
            "drive",
            f"is {drive!r} and the axes are ({', '.join(space.axes)})",
            "it is for the axes (x, y, yaw) of a map",
        )
    if not isinstance(drive, Car):
        from planners._edges.differential import TurnDriveTurn

        return TurnDriveTurn(space, drive, bidirectional)
    _check_radius(space, drive.turning_radius)
    from planners._edges.cars import CarCurves

    return CarCurves(space, drive, bidirectional)


def check_axes(space: Space, axes: tuple[str, ...], owner: str) -> None:
    """Raise InputError if a map has other axes than a plan."""
    if space.axes != axes:
        raise InputError(
            "space",
            f"has the axes {', '.join(space.axes)}",
            f"the {owner} has {', '.join(axes)}",
        )


def has_drives(space: Space) -> bool:
    """Return True if drives are for the space."""
    return isinstance(space, ConfigurationMap) and space.axes == ("x", "y", "yaw")


def _check_radius(space: Space, radius: float) -> None:
    """Raise InputError if a turning radius is too small or large for the cells of a map."""
    # Rounding errors of curves grow with the radius in cells, and with its inverse.
    spacing = 2.0 * space.resolution
    lowest = MIN_RADIUS_CELLS * spacing
    highest = MAX_RADIUS_CELLS * spacing
    if not lowest <= radius <= highest:
        least, most = tell_apart(radius, lowest)[1], tell_apart(radius, highest)[1]
        raise InputError(
            "turning_radius",
            f"is {radius!r}",
            f"it must be {least} to {most} m, to keep rounding errors small",
        )
