"""The picture of a map in the plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cspace.errors import InputError
from cspace.grid import finite
from cspace.plot import artists, view

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.space import CSpace


def draw_plane(
    space: CSpace,
    *,
    yaw: float | None,
    path: Any,
    start: Any,
    goal: Any,
    ax: Axes | None,
    robot_every: float | None,
    legend: bool,
    title: str | None,
) -> Axes:
    """Draw a map in the plane; as :func:`cspace.plot.plot` tells."""
    angle = check_yaw(space, yaw)
    points = view.polyline(space, path)
    marks = view.marks(space, points, start, goal)
    footprint = view.Footprint(space.robot)
    stations = view.stations(points, robot_every, footprint.size, footprint.reach)
    # The ends come last: they are drawn over the robots on the way.
    stations = np.concatenate([stations, *(q[np.newaxis] for q in marks.values())])
    box = view.box(space, [points, *(ring for q in stations for ring in footprint.at(q))])
    own = ax is None
    if ax is None:
        ax = _new_axes(box)
    classes = artists.classes_of(space, angle)
    artists.draw_cells(ax, space.grid, classes)
    handles = artists.cell_legend([classes], space.rotations is not None and angle is None)
    handles += artists.draw_path(ax, points)
    handles += artists.draw_robots(ax, footprint, stations)
    handles += artists.draw_marks(ax, marks)
    artists.frame(ax, space, box)
    words = view.title(space, box, title, angle)
    # A title above narrow axes would leave the figure; above the whole figure it has room.
    if own:
        ax.figure.suptitle(words, fontsize=10)
    else:
        ax.set_title(words, fontsize=10)
    if legend:
        _legend(ax, handles, own, box)
    return ax


def check_yaw(space: CSpace, yaw: float | None) -> float | None:
    """A yaw to show, as a float.

    Raises
    ------
    InputError
        If it is not one finite number, or the map has no rotations.
    """
    if yaw is None:
        return None
    angle = finite(yaw, "yaw")
    if angle.ndim:
        raise InputError(f"yaw has shape {angle.shape}; it must be one number, in radians; use plot_strip for several")
    if space.rotations is None:
        raise InputError(
            f"yaw is {yaw!r}; the map has no rotations, so the robot does not turn; leave the yaw out, or build the "
            "map with rotations"
        )
    space.rotations.cell_of(angle)  # raises where it is too large to be wrapped
    return float(angle)


def refuse_space(space: CSpace, what: str) -> None:
    """Refuse a map in space for a kind of picture that only the plane has.

    Raises
    ------
    InputError
        If the map is one of space; ``what`` says what the picture shows.
    """
    if space.grid.dim == 3:
        cells = " x ".join(map(str, space.grid.shape))
        raise InputError(
            f"the map has {cells} cells in space; {what}, and here the robot does not turn; use plot, with "
            'view="3d" for the robot on its way'
        )


def _new_axes(box: view.Floats) -> Axes:
    """Axes in a figure of their own, with room around them for labels and a legend."""
    width, height = box[1] - box[0]
    drawn = artists.drawn_size(box)
    room = (0.9, 1.5) if width >= height else (2.9, 0.9)
    return artists.new_figure(max(drawn[0] + room[0], 4.2), drawn[1] + room[1]).add_subplot()


def _legend(ax: Any, handles: list[Any], own: bool, box: view.Floats) -> None:
    """A legend below a wide map and beside a tall one; beside the axes where the figure is the caller's."""
    width, height = box[1] - box[0]
    style: dict[str, Any] = {"handles": handles, "fontsize": 9, "frameon": False}
    if not own:
        ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), borderaxespad=0.0, **style)
    elif width >= height:
        artists.legend_below(ax.figure, handles)
    else:
        ax.figure.legend(loc="outside right center", **style)
