"""plot: one picture of a map, with a path and the robot along it."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from cspace.errors import InputError
from cspace.grid import positive
from cspace.io.output import replacing
from cspace.plot.plane import draw_plane
from cspace.plot.scene import draw_scene
from cspace.plot.sections import draw_sections

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from cspace.space import CSpace

SUFFIXES: Final = (".png", ".pdf", ".svg", ".jpg")
"""Kinds of picture that can be written."""

VIEWS: Final = ("sections", "3d")
"""Pictures that there are of a map in space."""
_DRAW: Final[dict[str, Callable[..., Axes]]] = {"plane": draw_plane, "sections": draw_sections, "3d": draw_scene}
_ONLY: Final = {
    "plane": ("yaw", "ax"),
    "sections": ("at",),
    "3d": ("surface", "cut", "camera", "ax"),
}
"""Options that go with some kinds of picture only."""


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
    view: str | None = None,
    at: ArrayLike | None = None,
    surface: str | None = None,
    cut: Mapping[str, float] | None = None,
    camera: ArrayLike | None = None,
) -> Axes:
    """Draw a map: obstacles, C-obstacle, undecided band, free space, and a path with the robot along it.

    Where cells are smaller than pixels, a pixel shows the most important of its cells, so that nothing that blocks the
    robot vanishes from a picture of a large map.

    A map in space is drawn as three sections through a point, which share their axes: seen from above, from the front
    and from the right. There, the path is solid, and the robot drawn, where the robot reaches the section; elsewhere
    the path is faint. Or it is drawn in three dimensions, in parallel projection: the faces of cells that look at the
    camera, so that what stands between it and a room is left out. Cells are joined in blocks where there are too many;
    a block shows the most important of its cells here too. The path is dotted, and the robot faint, where they are
    behind something.

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
        Where to draw; by default a new figure, which belongs to no window. ``view="3d"`` takes axes in three
        dimensions; sections always have a figure of their own.
    robot_every : float, optional
        Metres of path between two drawn robots, where a turn counts as the way of the robot's farthest point; ``inf``
        draws it at the ends only. By default about a dozen.
    legend : bool
        Whether to add a legend, beside or below the axes, where it hides nothing.
    title : str, optional
        By default the robot, the side of a cell and the yaw. Pass ``""`` for none.
    view : {"sections", "3d"}, optional
        For a map in space: which picture; sections by default.
    at : array-like, shape (3,), optional
        For sections: the point, in the grid, that they go through. By default each section is where the robot reaches
        it on most of the path's way; without a path, at the start, the goal, or a FREE cell near the middle.
    surface : {"obstacles", "free"}, optional
        For ``view="3d"``: draw the obstacles, with the robot along the path; or the border of the free space, in which
        the robot's reference point moves. Obstacles by default.
    cut : mapping from "x", "y" or "z" to float, optional
        For ``view="3d"``: cut away, on the camera's side, what lies beyond these planes (metres); cells that a plane
        runs through stay. What is cut has the colours of sections. By default one plane beside the path, or, without
        a path, at half the height, where that shows more of the path or of the free space; ``{}`` cuts nothing.
    camera : array-like, shape (2,), optional
        For ``view="3d"``: elevation and azimuth of the camera in degrees, as matplotlib counts them. By default the
        camera looks down, from the corner that shows most of the path or of the free space. What does not look at the
        camera is not drawn: choose it here, rather than turning the axes afterwards.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; ``ax.figure`` is the figure. Show it in a notebook by naming ``ax.figure``. Of sections, the one seen
        from above; ``ax.figure.axes`` are those across z, y and x.

    Raises
    ------
    InputError
        If the path or a configuration has the wrong shape or is not finite, ``robot_every`` is not above zero, a yaw
        is given for a map without rotations, or an option for another kind of picture.
    """
    kind = _kind_of(space, view)
    special = {"yaw": yaw, "ax": ax, "at": at, "surface": surface, "cut": cut, "camera": camera}
    given = {name: value for name, value in special.items() if value is not None}
    for name in given:
        if name not in _ONLY[kind]:
            raise InputError(f"{name} is given; {_why_not(name, kind)}; leave it out")
    options: dict[str, Any] = {name: special[name] for name in _ONLY[kind]}
    options |= {"path": path, "start": start, "goal": goal, "robot_every": robot_every}
    return _DRAW[kind](space, **options, legend=legend, title=title)


def save_plot(
    space: CSpace, file: str | os.PathLike[str], overwrite: bool = False, *, dpi: float = 150.0, **options: Any
) -> Path:
    """Draw a map into a file.

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


def _kind_of(space: CSpace, view: str | None) -> str:
    """Which kind of picture is asked for."""
    if view is not None and view not in VIEWS:
        raise InputError(f"view is {view!r}; it must be one of {', '.join(map(repr, VIEWS))}; or leave it out")
    if space.grid.dim == 3:
        return view or VIEWS[0]
    if view is not None:
        raise InputError(f"view is {view!r}; the map is one of the plane, of which there is one picture; leave it out")
    return "plane"


def _why_not(name: str, kind: str) -> str:
    """Why an option does not go with a kind of picture."""
    if kind == "plane":
        return "the map is one of the plane, and the option is for maps in space"
    if name == "yaw":
        return "the map is one of space, where the robot does not turn"
    if name == "ax":
        return "three sections need a figure of their own, which the axes that come back belong to"
    others = " or ".join(f'view="{other}"' for other in VIEWS if name in _ONLY[other])
    return f'it goes with {others}, and the picture is view="{kind}"'
