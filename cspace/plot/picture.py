"""plot: one picture of a map, with a path and the robot along it; and thumbnail, a small one for notebooks."""

from __future__ import annotations

import base64
import io
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypedDict, Unpack

import numpy as np

from cspace.arrays import Floats
from cspace.check import positive
from cspace.errors import InputError
from cspace.files.access import check_suffix, replacing
from cspace.plot import artists
from cspace.plot.route import (
    HasPath,
    Look,
    MapLike,
    Part,
    RobotGlyph,
    Route,
    lost_steps,
    marked,
    section_point,
    with_gaps,
)
from cspace.plot.sections import draw_dials, draw_panels, draw_sections
from cspace.plot.surface import draw_surface
from cspace.rotations import OneRotation, Rotations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from cspace.configuration_map import ConfigurationMap

SUFFIXES: Final = (".png", ".pdf", ".svg", ".jpg")
"""Kinds of picture that can be written."""

VIEWS: Final = {
    "plane": ("rotation", "zoom", "center", "ax"),
    "sections": ("rotation", "zoom", "center"),
    "3d": ("rotation", "zoom", "center", "surface", "cut", "camera", "ax"),
    "panels": ("rotation", "zoom", "center"),
    "rotations": ("center",),
}
"""Kinds of picture, and the options that go with some of them only."""

_VIEWS_IN: Final = {2: ("plane",), 3: ("sections", "3d")}
"""Those of a map with so many axes; where the robot turns, panels and rotations too."""

_INCHES: Final = 2.0
"""Longer side of a thumbnail."""
_DPI: Final = 100.0
"""And its pixels per inch."""
_MOST_DPI: Final = 2400.0


class WorkspaceOptions(TypedDict, total=False):
    """What :meth:`cspace.Workspace.plot` takes: those options that need no robot."""

    ax: Axes
    legend: bool
    title: str
    view: str
    center: ArrayLike
    zoom: float
    cut: float
    camera: ArrayLike


class PlotOptions(WorkspaceOptions, total=False):
    """What :func:`plot` takes beside the map."""

    rotation: ArrayLike
    path: ArrayLike | HasPath | None
    start: ArrayLike
    goal: ArrayLike
    robot_every: float | None
    surface: str


def plot(
    space: MapLike,
    *,
    rotation: ArrayLike | None = None,
    path: ArrayLike | HasPath | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    ax: Axes | None = None,
    robot_every: float | None = None,
    legend: bool = True,
    title: str | None = None,
    view: str | None = None,
    center: ArrayLike | None = None,
    zoom: float | None = None,
    surface: str | None = None,
    cut: float | None = None,
    camera: ArrayLike | None = None,
) -> Axes:
    """Draw a map: obstacles, C-obstacle, undecided band, free space, and a path with the robot along it.

    Where cells are smaller than pixels, a pixel shows the most important of its cells, so that nothing that blocks the
    robot vanishes from a picture of a large map. What lies outside the grid is hatched: the picture says nothing of it.

    A map in space is drawn as three sections through a point: seen from above, from the front and from the right.
    There, the path is solid, and the robot drawn, where the robot reaches the section; elsewhere the path is faint. Or
    it is drawn in three dimensions, cut open above the path, which is dotted where something is in front of it.

    A map with rotations may also be drawn as panels side by side, one for each of a few rotations, with the part of the
    path on which the robot is turned most nearly so (rotations that share a slice count as one); or as its rotations
    at one position: a ring of yaws, or discs of all rotations, one for each of six headings, in whose middle the robot
    is upright, and tipped over towards a side outwards, until at the rim it is upside down.

    Parameters
    ----------
    space : CSpace
        The map.
    rotation : array-like, shape (k,) or (n, k), optional
        For a map with rotations: show the slice at this one, as in a configuration (a yaw in radians, or a quaternion),
        or a panel for each of several. By default all are shown at once: where the robot is free at every rotation, at
        some, and at none; panels show six of them.
    path : array-like, shape (n, size), or Plan, optional
        Configurations to join by straight edges, in metres and radians; or anything whose ``path`` attribute holds
        them. Edges of a certified plan that are no longer proven free, e.g. after :meth:`cspace.CSpace.add_obstacle`,
        are dashed in another colour.
    start, goal : array-like, shape (size,), optional
        Configurations to mark; if left out, the endpoints of the path. An arrow shows a yaw.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure, which belongs to no window. ``view="3d"`` takes axes in three
        dimensions; sections and panels always have a figure of their own.
    robot_every : float, optional
        Metres of path between two drawn robots, where a turn counts as the distance that the robot's farthest point
        moves; ``inf`` draws it at the endpoints only. By default about a dozen.
    legend : bool
        Whether to add a legend, beside or below the axes, where it hides nothing.
    title : str, optional
        By default the robot, the side of a cell and the rotation. Pass ``""`` for none.
    view : {"plane", "sections", "3d", "panels", "rotations"}, optional
        Which picture; by default the only one that shows all rotations of a plane, and of space sections. Panels and
        rotations need a map with rotations.
    center : array-like, shape (d,), optional
        The point, in the grid, that ``zoom`` goes to, or whose rotations are drawn; in space also that sections go
        through, and panels at its height. By default half the way along the path; without a path the start, the goal,
        or the middle of the grid.
    zoom : float, optional
        Draw only a square, or a cube, around the point, whose sides are so many times shorter than the longest of the
        map. By default all of the map is drawn.
    surface : {"obstacles", "free"}, optional
        For ``view="3d"``: draw the obstacles, with the robot along the path; or the border of the free space, in which
        the robot's reference point moves. Obstacles by default.
    cut : float, optional
        For ``view="3d"``: the height, in metres, above which cells are left out. By default the highest that the robot
        reaches on the path; without a path, nothing is left out.
    camera : array-like, shape (2,), optional
        For ``view="3d"``: elevation and azimuth of the camera in degrees, as matplotlib counts them; by default it
        looks down from the front. What does not look at the camera is not drawn: choose it here, rather than turning
        the axes afterwards.

    Returns
    -------
    matplotlib.axes.Axes
        The axes, which a notebook shows as the picture; ``ax.figure`` is the figure. Of sections, the one seen
        from above, and ``ax.figure.axes`` are those across z, y and x; of panels and of rotations, the first.

    Raises
    ------
    InputError
        If the path or a configuration has the wrong shape or is not finite, ``robot_every`` is not above zero, ``zoom``
        below 1, a rotation is given for a map without them, an option for another kind of picture, or ``ax`` is no
        axes.
    """
    from matplotlib.axes import Axes

    given: object = ax
    if given is not None and not isinstance(given, Axes):
        kind = type(given).__name__
        raise InputError("ax", f"is a {kind}", "it must be axes of matplotlib", "pass figure.add_subplot()", value=ax)
    look = Look(rotation, ax, center, zoom, surface, cut, camera, legend, title)
    kind = view_of(space.axes, view, {name: getattr(look, name) for name in look._fields[:7]})
    if kind != "panels":
        one = space.rotations.fixed if rotation is None else space.rotations.checked(rotation)
        look = look._replace(rotation=one)
    route = Route.of(space, path, start, goal, robot_every, zoom)
    if zoom is not None:
        point = section_point(space, center, route)
        space = Part(space, point, zoom)
        route, look = route.within(space.grid), look._replace(center=point)
    drawn = _DRAW[kind](space, route, look)
    if ax is None:
        # The figure belongs to no window that a notebook would show, and axes have no picture of their own there.
        vars(drawn)["_repr_html_"] = partial(_html_of, drawn.figure)
    return drawn


def view_of(axes: Sequence[str], view: str | None, options: Mapping[str, Any]) -> str:
    """Which picture to draw of a map whose configurations have the given axes; the map itself is not needed.

    Raises InputError if there is none such of the map, or an option, where it is not None, goes with other ones.
    """
    numbers = len(set(axes) & set(Rotations.all_names()))
    views = [*_VIEWS_IN[len(axes) - numbers], *["panels", "rotations"][: 2 * bool(numbers)]]
    if view is not None and view not in views:
        rule = f"the map's configurations are ({', '.join(axes)}), so it must be {' or '.join(views)}"
        raise InputError("view", f"is {view!r}", rule, "or leave it out", value=view)
    rotation = options.get("rotation")
    if rotation is not None and not numbers:
        advice = "leave it out, or build the map with rotations"
        raise InputError("rotation", f"is {rotation!r}", "the map has no rotations", advice, value=rotation)
    several = rotation is not None and np.ndim(rotation) > (numbers > 1)
    kind = view or ("panels" if several else views[0])
    for name, value in options.items():
        if value is None:
            continue
        if name not in VIEWS[kind]:
            others = " or ".join(other for other, names in VIEWS.items() if name in names)
            rule = f"it goes with the view {others}, and this one is {kind}"
            raise InputError(name, "is given", rule, "leave it out", value=value)
    zoom, center = options.get("zoom"), options.get("center")
    if zoom is not None and positive(zoom, "zoom", "the map's longest side over that of the picture") < 1.0:
        raise InputError("zoom", f"is {zoom!r}", "it must be at least 1, all of the map", "pass e.g. 8", value=zoom)
    if kind in ("plane", "3d") and center is not None and zoom is None:
        rule = "all of the map is drawn"
        raise InputError("center", "is given without zoom", rule, "add e.g. zoom=8, or leave it out", value=center)
    return kind


def save_plot(
    space: ConfigurationMap,
    file: str | os.PathLike[str],
    overwrite: bool = False,
    *,
    dpi: float = 150.0,
    **options: Unpack[PlotOptions],
) -> Path:
    """Draw a map into a file.

    Parameters
    ----------
    space : CSpace or TiledCSpace
        The map.
    file : path-like
        A name that ends in .png, .pdf, .svg or .jpg.
    overwrite : bool
        Whether an existing file may be replaced.
    dpi : float
        Pixels per inch, at most 2400; pictures are about eight inches wide.
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

    Examples
    --------
    >>> import numpy as np, cspace
    >>> space = cspace.build(cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1), cspace.Robot.disc(0.2))
    >>> save_plot(space, "map.png", overwrite=True).name
    'map.png'
    """
    if "ax" in options:
        rule = "save_plot draws a figure of its own"
        raise InputError("ax", "is given", rule, "use plot and ax.figure.savefig instead", value=options["ax"])
    return save_figure(lambda: space.plot(**options).figure, file, overwrite, dpi)


def save_figure(draw: Callable[[], Any], file: str | os.PathLike[str], overwrite: bool, dpi: float) -> Path:
    """Write the figure that ``draw`` makes; the name and the numbers are checked before it is made.

    Raises InputError if the suffix is not one of :data:`SUFFIXES`, or ``dpi`` is not above zero or too large, and
    FileError if the file exists and ``overwrite`` is not set, or cannot be written.
    """
    target = Path(file)
    check_suffix(target, SUFFIXES, "the suffix says what to write", "file")
    dots = positive(dpi, "dpi", "pixels per inch")
    if dots > _MOST_DPI:
        rule = f"it must be at most {_MOST_DPI:,.0f} pixels per inch, which is some 20,000 pixels across"
        raise InputError("dpi", f"is {dpi!r}", rule, "pass e.g. 300", value=dpi)
    with replacing(target, overwrite) as temporary:
        figure: Figure = draw()
        figure.canvas.print_figure(temporary, dpi=dots)
    return target


def thumbnail(subject: object) -> bytes:
    """A small PNG of a map, a workspace, a robot or a plan, about 200 pixels wide or high, without axes or words.

    In space, maps and workspaces show the layer of cells at half their height, robots their outline from above.

    Parameters
    ----------
    subject : CSpace, Workspace, Robot or Plan

    Returns
    -------
    bytes
        The PNG file.

    Examples
    --------
    >>> import cspace
    >>> thumbnail(cspace.Robot.disc(0.3))[:4]
    b'\\x89PNG'
    """
    if hasattr(subject, "waypoints"):
        box, draw = _plan(subject)
    elif hasattr(subject, "grid"):
        box, draw = _cells(subject)
    else:
        box, draw = _robot(subject)
    figure = artists.new_figure(*artists.drawn_size(box, _INCHES), _DPI, layout=None)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.set_xlim(*box[:, 0])
    ax.set_ylim(*box[:, 1])
    draw(ax)
    return _png(figure)


def as_html(subject: object, lines: Iterable[str]) -> str:
    """The thumbnail of a map, a workspace, a robot or a plan and some lines of text below it, for notebooks."""
    return f"{_image(thumbnail(subject))}<p>{'<br>'.join(map(escape, lines))}</p>"


def _html_of(figure: Any) -> str:
    return _image(_png(figure))


def _png(figure: Any) -> bytes:
    file = io.BytesIO()
    figure.canvas.print_figure(file, format="png", dpi=_DPI)
    return file.getvalue()


def _image(png: bytes) -> str:
    return f'<img src="data:image/png;base64,{base64.b64encode(png).decode("ascii")}" alt="">'


def _draw_plane(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw a map in the plane."""
    box = route.box(space)
    stretch, size = artists.stretches(box), artists.drawn_size(box)
    tall = size[0] < 0.9 * size[1]
    room = (2.9, 0.9) if tall else (0.9, 1.5)
    ax: Axes = look.ax or artists.new_figure(max(size[0] + room[0], 4.2), size[1] + room[1]).add_subplot()
    classes = artists.classes_of(space, look.rotation)
    artists.draw_cells(ax, space.grid, classes)
    handles = artists.cell_legend([classes], space, box, several=look.rotation is None)
    handles += artists.draw_route(ax, route)
    artists.frame(ax, box, stretch, labels=space.grid.labels)
    artists.annotate(ax, space, look, stretch, space.rotations.describe(look.rotation), handles, tall=tall)
    return ax


_DRAW: Final[dict[str, Callable[[MapLike, Route, Look], Axes]]] = {
    "plane": _draw_plane,
    "sections": draw_sections,
    "3d": draw_surface,
    "panels": draw_panels,
    "rotations": draw_dials,
}


def _cells(subject: Any) -> tuple[Floats, Any]:
    """Box and painter of the cells of a map or a workspace."""
    grid = subject.grid
    plane, layer = artists.section(grid, np.add(grid.lower, grid.upper) / 2)
    if hasattr(subject, "outer"):
        classes = artists.ground_of(subject, layer)
    else:
        classes = artists.classes_of(subject, None, layer)
    return np.array([plane.lower, plane.upper]), lambda ax: artists.draw_cells(ax, plane, classes)


def _robot(robot: Any) -> tuple[Floats, Any]:
    """Box and painter of a robot's outline, with its reference point."""
    figurine, origin = RobotGlyph(robot, OneRotation()), np.zeros((1, robot.dim))

    def draw(ax: Any) -> None:
        artists.draw_robots(ax, figurine, origin)
        ax.plot(0.0, 0.0, marker="+", markersize=10.0, markeredgewidth=1.5, color="black")

    return _around(figurine.extent(origin[0])[:, :2]), draw


def _plan(plan: Any) -> tuple[Floats, Any]:
    """Box and painter of a path, from above."""
    points = np.asarray(plan.path)[:, :2]
    lost = with_gaps(points, lost_steps(plan, plan))
    marks = {name: q[:2] for name, q in marked(plan, plan, points, None, None).items()}

    def draw(ax: Any) -> None:
        artists.draw_path(ax, points, lost=lost)
        artists.draw_marks(ax, marks, 0.8)

    return _around(np.vstack([points, *marks.values()])), draw


def _around(points: Floats) -> Floats:
    """A box around points with some room, shape (2, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.12 * max(float((high - low).max()), 1e-9)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, room) + room
    return np.stack([middle - half, middle + half])
