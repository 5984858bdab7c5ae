"""A small floor plan, drawn here, that shows what a map can tell."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

    from cspace.robot import Robot
    from cspace.workspace import Workspace

START: Final = (1.4, 8.6)
"""In the room at the upper left."""

GOAL: Final = (14.6, 1.2)
"""In the room at the lower right."""

STORE: Final = (13.5, 8.4)
"""In the store room, whose door is narrower than the robot."""

SPACING: Final = 0.02
"""Side of a cell, in metres."""


def demo_robot() -> Robot:
    """A cart of 0.7 m by 0.5 m; its reference point is its middle."""
    from cspace.robot import Robot

    return Robot.rectangle(0.7, 0.5)


def demo_workspace(spacing: float = SPACING) -> Workspace:
    """The floor plan on a grid.

    Parameters
    ----------
    spacing : float
        Side of a cell, in metres.

    Returns
    -------
    Workspace
        16 m by 10 m.

    Raises
    ------
    InputError
        If the spacing is not above zero.
    """
    from cspace.workspace import Workspace

    return Workspace.from_polygons(floor_plan(), spacing)


def floor_plan() -> list[BaseGeometry]:
    """Walls and furniture of a flat, in metres: straight, slanted and round.

    Returns
    -------
    list of shapely geometries
    """
    from shapely import LineString, Point, box

    outside = box(0.0, 0.0, 16.0, 10.0) - box(0.2, 0.2, 15.8, 9.8)
    walls = [
        # x, y, width, height; what is left out between two walls is a door
        (0.2, 5.0, 3.0, 0.15),
        (4.3, 5.0, 0.9, 0.15),
        (5.05, 0.2, 0.15, 1.4),
        (5.05, 2.8, 0.15, 7.0),
        (11.0, 0.2, 0.15, 4.4),
        (11.0, 5.7, 0.15, 4.1),
        (11.15, 6.5, 1.6, 0.15),
        (13.2, 6.5, 2.6, 0.15),
    ]
    chairs = [(7.1, 7.8), (8.5, 7.8), (7.1, 5.0), (8.5, 5.0)]
    furniture = [
        Point(8.0, 6.6).buffer(0.9),
        *(box(x, y, x + 0.4, y + 0.4) for x, y in chairs),
        LineString([(6.4, 1.2), (9.6, 3.6)]).buffer(0.08, cap_style="flat"),
        box(0.2, 0.2, 2.4, 1.8),
        Point(13.2, 3.4).buffer(0.7),
        box(14.2, 4.6, 15.8, 5.4),
    ]
    return [outside, *(box(x, y, x + width, y + height) for x, y, width, height in walls), *furniture]
