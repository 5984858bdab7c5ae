"""Choice of the edges of a drive, and checks of its options."""

from __future__ import annotations

from typing import Final

from cspace import Space
from cspace.errors import InputError
from cspace.inside import Drive, check_positive, check_word, tell_apart
from planners._local_planner import (
    CURVES,
    DRIVES,
    HOLONOMIC,
    ON_THE_SPOT,
    LocalPlanner,
    TurnDriveTurn,
)
from planners._ompl_states import check_space

MIN_RADIUS_CELLS: Final = 1e-3
MAX_RADIUS_CELLS: Final = 1e3
"""Smallest and largest turning radius, in cells, for which rounding errors stay small."""


def local_planner(
    space: Space,
    exact: bool = False,
    drive: Drive = HOLONOMIC,
    turning_radius: float | None = None,
    bidirectional: bool = False,
) -> LocalPlanner:
    """Make the local planner of a space from :class:`LocalPlanner` options.

    Raises InputError if ``space`` is no :class:`cspace.Space`; the drive is unknown, or given for a
    space other than a map of x, y, yaw; or the turning radius is missing, given without a curve, or
    out of range.
    """
    check_space(space)
    exact = bool(exact) or not space.has_cells
    radius = _check_drive(space, drive, turning_radius)
    kind = LocalPlanner
    if drive in ON_THE_SPOT:
        kind = TurnDriveTurn
    elif drive in CURVES:
        from planners._cars import CarCurves

        kind = CarCurves
    return kind(space, exact, drive, radius, bidirectional)


def check_axes(space: Space, axes: tuple[str, ...], owner: str) -> None:
    """Raise InputError if a map has other axes than a plan."""
    if space.axes != axes:
        raise InputError(
            "space",
            f"has the axes {', '.join(space.axes)}",
            f"the {owner} has {', '.join(axes)}",
        )


def has_drives(space: Space) -> bool:
    """Return True if drives other than the holonomic one are for the space."""
    # Axes of the maps for drives other than the holonomic one.
    return space.has_cells and space.axes == ("x", "y", "yaw")


def _check_drive(space: Space, drive: Drive, turning_radius: float | None) -> float | None:
    """Check a drive; return its turning radius, metres, or None.

    Raises InputError if the drive is not for the space, or the radius does not fit the drive.
    """
    check_word(drive, "drive", DRIVES)
    if drive != HOLONOMIC and not has_drives(space):
        raise InputError(
            "drive",
            f"is {drive!r} and the axes are ({', '.join(space.axes)})",
            "it is for the axes (x, y, yaw) of a map",
        )
    if drive not in CURVES:
        if turning_radius is not None:
            raise InputError(
                "turning_radius",
                f"is {turning_radius!r} and drive is {drive!r}",
                "a radius is for curves, of drive='dubins' or 'reeds-shepp'",
            )
        return None
    if turning_radius is None:
        raise InputError(
            "turning_radius",
            "is missing",
            f"drive={drive!r} needs the radius of its tightest curve",
        )
    radius = check_positive(turning_radius, "turning_radius")
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
    return radius
