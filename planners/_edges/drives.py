"""The drives, and the choice of edges by a drive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, cast

from cspace import Space
from cspace.errors import InputError
from cspace.inside import Car as Car
from cspace.inside import ConfigurationMap, Drive, Upright, check_drive
from cspace.inside import Differential as Differential
from planners._edges.local_planner import EdgesWithoutCells, LocalPlanner
from planners._edges.own_space import check_space


def _load_differential() -> type[LocalPlanner]:
    from planners._edges.differential import TurnDriveTurn

    return TurnDriveTurn


def _load_car() -> type[LocalPlanner]:
    from planners._edges.cars import CarCurves

    return CarCurves


DRIVES: Final[dict[type[Drive], Callable[[], type[LocalPlanner]]]] = {
    Differential: _load_differential,
    Car: _load_car,
}
"""Loader of the class of edges of each drive."""


def local_planner(
    space: Space,
    drive: Drive | None = None,
    bidirectional: bool = False,
    *,
    exact: bool = False,
    keep: Sequence[Upright] = (),
) -> LocalPlanner:
    """Make the local planner of a space and a drive.

    With ``exact``, the geometry decides MIXED cells, and links of an arm ``keep`` directions.

    Raises InputError if ``space`` is no :class:`cspace.Space`; ``drive`` is no drive, or given for
    a space other than a map of x, y, yaw; or its turning radius is out of range.
    """
    check_space(space)
    space = space.keep(keep)
    if exact:
        space = space.exact
    kind = edges_of(check_drive(drive))
    if kind.has_heading and not has_drives(space):
        raise InputError(
            "drive",
            f"is {drive!r} and the axes are ({', '.join(space.axes)})",
            "it is for the axes (x, y, yaw) of a map",
        )
    if not isinstance(space, ConfigurationMap):
        return EdgesWithoutCells(space, drive, bidirectional)
    edges = kind(space, drive, bidirectional)
    edges.check_drive()
    return edges


def edges_of(drive: Drive | None) -> type[LocalPlanner]:
    """Return the class of a drive's edges, or of no drive's.

    Raises InputError for a drive outside :data:`DRIVES`.
    """
    if drive is None:
        return LocalPlanner
    for kind, load in DRIVES.items():
        if isinstance(drive, kind):
            return load()
    known = ", ".join(kind.__name__ for kind in DRIVES)
    raise InputError("drive", f"is {drive!r}", f"plans know the drives {known}")


def list_examples() -> list[LocalPlanner]:
    """List edges of example drives, without a space, for messages and pages."""
    kinds: list[type[LocalPlanner]] = [LocalPlanner, *(load() for load in DRIVES.values())]
    return [kind(cast(Space, None), drive) for kind in kinds for drive in kind.examples]


def check_axes(space: Space, axes: tuple[str, ...], owner: str) -> None:
    """Raise InputError if a map has other axes than a plan."""
    if space.axes != axes:
        raise InputError(
            "space",
            f"has the axes {', '.join(space.axes)}",
            f"the {owner} has {', '.join(axes)}",
        )


def has_drives(space: Space) -> bool:
    """Return True if the space takes drives."""
    return isinstance(space, ConfigurationMap) and space.axes == ("x", "y", "yaw")
