"""plot: one picture of a map, with a path and the robot along it."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import InputError
from cspace.grid import finite, positive
from cspace.io.output import replacing
from cspace.plot import artists, view

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from cspace.space import CSpace

SUFFIXES: Final = (".png", ".pdf", ".svg", ".jpg")
"""Kinds of picture that can be written."""


def plot(
    space: CSpace,
    *,
    yaw: float | None = None,
    path: ArrayLike | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    ax: Axes | None = None,
    robot_every: float | None = None,
    legend: bool = True,
    title: str | None = None,
) -> Axes:
    """Draw a planar map: obstacles, C-obstacle, undecided band, free space, and a path with the robot along it.

    Where cells are smaller than pixels, a pixel shows the most important of its cells, so that nothing that blocks the
    robot vanishes from a picture of a large map.

    Parameters
    ----------
    space : CSpace
        The map.
    yaw : float, optional
        For a map with rotations: show the slice at this yaw (radians). By default all yaws are shown at once: where the
        robot is free at every yaw, at some, and at none.
    path : array-like, shape (n, dof), or Plan, optional
        Configurations to join by straight edges, in metres and radians; or anything whose ``path`` attribute holds
        them.
    start, goal : array-like, shape (dof,), optional
        Configurations to mark; where left out and a path is given, its ends. An arrow shows a yaw.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure, which belongs to no window.
    robot_every : float, optional
        Metres of path between two drawn robots, where a turn counts as the way of the robot's farthest point; ``inf``
        draws it at the ends only. By default about a dozen.
    legend : bool
        Whether to add a legend, beside or below the axes, where it hides nothing.
    title : str, optional
        By default the robot, the side of a cell and the yaw. Pass ``""`` for none.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; ``ax.figure`` is the figure. Show it in a notebook by naming ``ax.figure``.

    Raises
    ------
    InputError
        If the path or a configuration has the wrong shape or is not finite, ``robot_every`` is not above zero, or a yaw
        is given for a map without rotations.
    """
    angle = check_yaw(space, yaw)
    points = view.polyline(space, path)
    marks = view.marks(space, points, start, goal)
    footprint = view.Footprint(space.robot)
    # The ends come last: they are drawn over the robots on the way.
    stations = np.concatenate([view.stations(points, robot_every, footprint), *(q[np.newaxis] for q in marks.values())])
    box = view.box(space, [points, *(ring for q in stations for ring in footprint.at(q))])
    own = ax is None
    if ax is None:
        ax = _new_axes(box)
    classes = artists.classes_of(space, angle)
    artists.draw_cells(ax, space, classes)
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


def save_plot(
    space: CSpace, file: str | os.PathLike[str], overwrite: bool = False, *, dpi: float = 150.0, **options: Any
) -> Path:
    """Draw a planar map into a file.

    Parameters
    ----------
    space : CSpace
        The map.
    file : path-like
        A name that ends in .png, .pdf, .svg or .jpg.
    overwrite : bool
        Whether an existing file may be replaced.
    dpi : float
        Pixels per inch; pictures are about eight inches wide.
    **options
        As for :func:`plot`, but for ``ax``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If the suffix is none of these, or as for :func:`plot`.
    FileError
        If the file exists and ``overwrite`` is not set, or cannot be written.
    """
    if "ax" in options:
        raise InputError("ax is given; save_plot draws a figure of its own; use plot and ax.figure.savefig instead")
    return save_figure(lambda: plot(space, **options).figure, file, overwrite, dpi)


def save_figure(draw: Callable[[], Any], file: str | os.PathLike[str], overwrite: bool, dpi: float) -> Path:
    """Write the figure that ``draw`` makes; the name and the numbers are checked before it is made.

    Raises
    ------
    InputError
        If the suffix is not one of :data:`SUFFIXES`, or ``dpi`` is not above zero.
    FileError
        If the file exists and ``overwrite`` is not set, or cannot be written.
    """
    target = Path(file)
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{target} has the suffix {target.suffix!r}; a picture's must be one of {', '.join(SUFFIXES)}; "
            f"name it e.g. {target.with_suffix('.png').name}"
        )
    dots = positive(dpi, "dpi", "pixels per inch")
    with replacing(target, overwrite) as temporary:
        figure: Figure = draw()
        figure.canvas.print_figure(temporary, dpi=dots)
    return target


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
