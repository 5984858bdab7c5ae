"""plot: a picture of a map, with a path and the robot along it. thumbnail: a small one for notebooks."""

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
from cspace.check import check_positive
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
    choose_section_point,
    collect_marks,
    find_lost_steps,
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

PICTURE_SUFFIXES: Final = (".png", ".pdf", ".svg", ".jpg")
"""Suffixes of the picture formats that can be written."""

VIEWS: Final = {
    "plane": ("rotation", "zoom", "center", "ax"),
    "sections": ("rotation", "zoom", "center"),
    "3d": ("rotation", "zoom", "center", "surface", "cut", "camera", "ax"),
    "panels": ("rotation", "zoom", "center"),
    "rotations": ("center",),
}
"""Kinds of picture, and those options of each that not all kinds take."""

_VIEWS_IN: Final = {2: ("plane",), 3: ("sections", "3d")}
"""Kinds of picture of a map, by its dimension; maps with rotations also have panels and rotations."""

_THUMBNAIL_INCHES: Final = 2.0
"""Longer side of a thumbnail, inches."""
_THUMBNAIL_DPI: Final = 100.0
"""Pixels per inch of a thumbnail."""
_MAX_DPI: Final = 2400.0
"""Maximum pixels per inch of a saved picture."""


class WorkspaceOptions(TypedDict, total=False):
    """Options of :meth:`cspace.Workspace.plot`."""

    ax: Axes
    legend: bool
    title: str
    view: str
    center: ArrayLike
    zoom: float
    cut: float
    camera: ArrayLike


class PlotOptions(WorkspaceOptions, total=False):
    """Options of :func:`plot`."""

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
    """Draw a map, and optionally a path with the robot along it.

    A pixel that covers many cells shows the most important one, so no obstacle vanishes from a picture of a large map.
    The exterior of the grid is hatched.

    - ``"plane"``: a plane map from above.
    - ``"sections"``: a map in space as three sections through a point, seen from above, the front and the right. The
      path is solid, and the robot drawn, where the robot reaches the section; elsewhere the path is faint.
    - ``"3d"``: a map in space in three dimensions, cut open above the path; hidden parts of the path are dotted.
    - ``"panels"``: the slices of a few rotations side by side. Each panel has the part of the path whose rotations are
      nearest to its own; rotations that share a slice count as one.
    - ``"rotations"``: all rotations at one position, as a ring of yaws, or as six discs, one for each heading. The
      robot is upright in the center of a disc, tilts towards the side of a point, and is upside down at the rim.

    Parameters
    ----------
    space : CSpace
        The map.
    rotation : array-like, shape (k,) or (n, k), optional
        Rotation of the slice to show, as in a configuration (yaw in radians, or quaternion), or several for panels. By
        default, colours show where the robot is free at every rotation, at some, and at none; panels show six slices.
    path : array-like, shape (n, size), or Plan, optional
        Configurations joined by straight edges, metres and radians; or an object with a ``path`` attribute. Edges of a
        certified plan that are no longer proven free, e.g. after :meth:`cspace.CSpace.add_obstacle`, are
        dashed in another colour.
    start, goal : array-like, shape (size,), optional
        Configurations to mark; by default the endpoints of the path. An arrow shows a yaw.
    ax : matplotlib.axes.Axes, optional
        Axes to draw into; by default of a new figure without a window. ``view="3d"`` needs axes in three dimensions;
        sections and panels always have a new figure.
    robot_every : float, optional
        Metres of path between two drawn robots; a rotation counts as the distance that the robot's farthest point
        moves. ``inf`` draws robots at the endpoints only. Default: about a dozen robots.
    legend : bool
        Add a legend beside or below the axes.
    title : str, optional
        Default: the robot, the side of a cell and the rotation. Pass ``""`` for no title.
    view : {"plane", "sections", "3d", "panels", "rotations"}, optional
        Kind of picture; by default ``"plane"`` or ``"sections"``. Panels and rotations need a map with rotations.
    center : array-like, shape (d,), optional
        A point of the grid, metres: the center of ``zoom``, the intersection of sections, or the position of rotations.
        Default: half the way along the path; without a path the start, the goal, or the center of the grid.
    zoom : float, optional
        Draw only a square or cube around ``center``, with sides ``zoom`` times shorter than the longest of the map. By
        default, draw the whole map.
    surface : {"obstacles", "free"}, optional
        For ``view="3d"``: draw the obstacles with the robot along the path (default), or the border of the free space
        of the robot's reference point.
    cut : float, optional
        For ``view="3d"``: omit cells above this height, metres. Default: the highest point of the robot on the path;
        without a path, nothing is omitted.
    camera : array-like, shape (2,), optional
        For ``view="3d"``: elevation and azimuth of the camera, degrees, as in matplotlib. Faces that look away from the
        camera are not drawn, so choose it here instead of rotating the axes later.

    Returns
    -------
    matplotlib.axes.Axes
        Notebooks show the axes as the picture; ``ax.figure`` is the figure. For sections, the axes seen from above, and
        ``ax.figure.axes`` are those across z, y and x; for panels and rotations, the first axes.

    Raises
    ------
    InputError
        If the path or a configuration has the wrong shape or is not finite, ``robot_every`` is not above zero,
        ``zoom`` is below 1, the map has no rotations but one is given, an option does not fit the kind of picture, or
        ``ax`` is not a matplotlib axes.
    """
    from matplotlib.axes import Axes

    given: object = ax
    if given is not None and not isinstance(given, Axes):
        problem = f"is a {type(given).__name__}"
        raise InputError("ax", problem, "it must be matplotlib axes", "pass figure.add_subplot()", value=ax)
    look = Look(rotation, ax, center, zoom, surface, cut, camera, legend, title)
    kind = choose_view(space.axes, view, {name: getattr(look, name) for name in look._fields[:7]})
    if kind != "panels":
        fixed = space.rotations.only_rotation if rotation is None else space.rotations.check_rotation(rotation)
        look = look._replace(rotation=fixed)
    route = Route.of(space, path, start, goal, robot_every, zoom)
    if zoom is not None:
        point = choose_section_point(space, center, route)
        space = Part(space, point, zoom)
        route, look = route.clip_to(space.grid), look._replace(center=point)
    drawn = _DRAW[kind](space, route, look)
    if ax is None:
        # Notebooks show only figures with a window, and axes have no HTML representation.
        vars(drawn)["_repr_html_"] = partial(_figure_html, drawn.figure)
    return drawn


def choose_view(axes: Sequence[str], view: str | None, options: Mapping[str, Any]) -> str:
    """Return the kind of picture for a map with the given axes.

    Raises InputError if the map has no such view, or if an option other than None does not fit the view.
    """
    rotation_axes = len(set(axes) & set(Rotations.all_names()))
    views = [*_VIEWS_IN[len(axes) - rotation_axes], *["panels", "rotations"][: 2 * bool(rotation_axes)]]
    if view is not None and view not in views:
        rule = f"it must be {' or '.join(views)}, because configurations are ({', '.join(axes)})"
        raise InputError("view", f"is {view!r}", rule, "or omit it", value=view)
    rotation = options.get("rotation")
    if rotation is not None and not rotation_axes:
        hint = "omit it, or build the map with rotations"
        raise InputError("rotation", f"is {rotation!r}", "the map has no rotations", hint, value=rotation)
    several = rotation is not None and np.ndim(rotation) > (rotation_axes > 1)
    kind = view or ("panels" if several else views[0])
    for name, value in options.items():
        if value is not None and name not in VIEWS[kind]:
            others = " or ".join(other for other, names in VIEWS.items() if name in names)
            raise InputError(name, f"is given with view {kind}", f"it needs view {others}", "omit it", value=value)
    zoom, center = options.get("zoom"), options.get("center")
    if zoom is not None and check_positive(zoom, "zoom", "the map's longest side over that of the picture") < 1.0:
        raise InputError("zoom", f"is {zoom!r}", "it must be at least 1 (the whole map)", "pass e.g. 8", value=zoom)
    if kind in ("plane", "3d") and center is not None and zoom is None:
        hint = "add e.g. zoom=8, or omit it"
        raise InputError("center", "is given without zoom", "the whole map is drawn", hint, value=center)
    return kind


def save_plot(
    space: ConfigurationMap,
    file: str | os.PathLike[str],
    overwrite: bool = False,
    *,
    dpi: float = 150.0,
    **options: Unpack[PlotOptions],
) -> Path:
    """Save a picture of a map.

    Parameters
    ----------
    space : CSpace or TiledCSpace
        The map.
    file : path-like
        A name that ends in .png, .pdf, .svg or .jpg.
    overwrite : bool
        Replace an existing file.
    dpi : float
        Pixels per inch, at most 2400; pictures are about eight inches wide.
    **options
        Options of :func:`plot`, except ``ax``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If the suffix is another one, or for the reasons of :func:`plot`.
    FileError
        If the file exists and ``overwrite`` is not set, or if it cannot be written.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> space = cspace.build(cspace.Workspace.from_array(np.eye(30, dtype=bool), 0.1), cspace.Robot.disc(0.2))
    >>> save_plot(space, "map.png", overwrite=True).name
    'map.png'
    """
    if "ax" in options:
        hint = "use plot and ax.figure.savefig instead"
        raise InputError("ax", "is given", "save_plot draws a new figure", hint, value=options["ax"])
    return save_figure(lambda: space.plot(**options).figure, file, overwrite, dpi)


def save_figure(draw: Callable[[], Any], file: str | os.PathLike[str], overwrite: bool, dpi: float) -> Path:
    """Save the figure that ``draw`` returns, after checking the other arguments.

    Raises InputError if the suffix is not in :data:`PICTURE_SUFFIXES`, or if ``dpi`` is not above zero or too large;
    FileError if the file exists and ``overwrite`` is not set, or if it cannot be written.
    """
    target = Path(file)
    check_suffix(target, PICTURE_SUFFIXES, "the suffix says what to write", "file")
    dots = check_positive(dpi, "dpi", "pixels per inch")
    if dots > _MAX_DPI:
        rule = f"it must be at most {_MAX_DPI:,.0f} pixels per inch"  # some 20,000 pixels across
        raise InputError("dpi", f"is {dpi!r}", rule, "pass e.g. 300", value=dpi)
    with replacing(target, overwrite) as temporary:
        figure: Figure = draw()
        figure.canvas.print_figure(temporary, dpi=dots)
    return target


def thumbnail(subject: object) -> bytes:
    r"""Return a small PNG of a map, workspace, robot or plan.

    It has no axes and no text, and its longer side is about 200 pixels. In space, maps and workspaces show the layer
    of cells at half their height, and robots their outline from above.

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
    b'\x89PNG'
    """
    if hasattr(subject, "waypoints"):
        box, draw = _prepare_plan(subject)
    elif hasattr(subject, "grid"):
        box, draw = _prepare_cells(subject)
    else:
        box, draw = _prepare_robot(subject)
    figure = artists.new_figure(*artists.axes_size(box, _THUMBNAIL_INCHES), _THUMBNAIL_DPI, layout=None)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.set_xlim(*box[:, 0])
    ax.set_ylim(*box[:, 1])
    draw(ax)
    return _render_png(figure)


def as_html(subject: object, lines: Iterable[str]) -> str:
    """Return HTML for notebooks: a thumbnail with lines of text below."""
    return f"{_image_html(thumbnail(subject))}<p>{'<br>'.join(map(escape, lines))}</p>"


def _figure_html(figure: Any) -> str:
    return _image_html(_render_png(figure))


def _render_png(figure: Any) -> bytes:
    file = io.BytesIO()
    figure.canvas.print_figure(file, format="png", dpi=_THUMBNAIL_DPI)
    return file.getvalue()


def _image_html(png: bytes) -> str:
    return f'<img src="data:image/png;base64,{base64.b64encode(png).decode("ascii")}" alt="">'


def _draw_plane(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw a plane map."""
    box = route.box(space)
    stretch, size = artists.axis_stretch(box), artists.axes_size(box)
    tall = size[0] < 0.9 * size[1]
    margins = (2.9, 0.9) if tall else (0.9, 1.5)
    ax: Axes = look.ax or artists.new_figure(max(size[0] + margins[0], 4.2), size[1] + margins[1]).add_subplot()
    classes = artists.classify_cells(space, look.rotation)
    artists.draw_cells(ax, space.grid, classes)
    handles = artists.make_cell_legend([classes], space, box, several=look.rotation is None)
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


def _prepare_cells(subject: Any) -> tuple[Floats, Any]:
    """Return the box of cells and a function that draws them."""
    grid = subject.grid
    plane, layer = artists.section(grid, np.add(grid.lower, grid.upper) / 2)
    if hasattr(subject, "outer"):
        classes = artists.classify_ground(subject, layer)
    else:
        classes = artists.classify_cells(subject, None, layer)
    return np.array([plane.lower, plane.upper]), lambda ax: artists.draw_cells(ax, plane, classes)


def _prepare_robot(robot: Any) -> tuple[Floats, Any]:
    """Return the box of a robot and a function that draws it."""
    glyph, origin = RobotGlyph(robot, OneRotation()), np.zeros((1, robot.dim))

    def draw(ax: Any) -> None:
        artists.draw_robots(ax, glyph, origin)
        ax.plot(0.0, 0.0, marker="+", markersize=10.0, markeredgewidth=1.5, color="black")

    return _padded_box(glyph.extent(origin[0])[:, :2]), draw


def _prepare_plan(plan: Any) -> tuple[Floats, Any]:
    """Return the box of a path and a function that draws it."""
    points = np.asarray(plan.path)[:, :2]
    lost = with_gaps(points, find_lost_steps(plan, plan))
    marks = {name: q[:2] for name, q in collect_marks(plan, plan, points, None, None).items()}

    def draw(ax: Any) -> None:
        artists.draw_path(ax, points, lost=lost)
        artists.draw_marks(ax, marks, 0.8)

    return _padded_box(np.vstack([points, *marks.values()])), draw


def _padded_box(points: Floats) -> Floats:
    """Return a box around points with a margin, shape (2, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.12 * max(float((high - low).max()), 1e-9)
    center, half = (low + high) / 2, np.maximum((high - low) / 2, margin) + margin
    return np.stack([center - half, center + half])
