"""Pictures of a planar map; nothing here opens a window."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import InputError
from cspace.grid import positive
from cspace.io.output import replacing
from cspace.states import BLOCKED, FREE, MIXED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    from cspace.space import CSpace

SUFFIXES: Final = (".png", ".pdf", ".svg", ".jpg")
"""Kinds of picture that :func:`save_plot` writes."""

# What a cell shows, the most important last: a pixel that covers many cells shows the largest. The hues are from Okabe
# and Ito (2008), which the colour-blind tell apart, and their lightness differs, so that they part in grey print too.
_CLASSES: Final = (
    ("free", "#ffffff"),
    ("obstacle, free for the reference point", "#999999"),
    ("undecided (MIXED)", "#d55e00"),
    ("C-obstacle (BLOCKED)", "#a6d3ee"),
    ("obstacle", "#262626"),
)
_OPEN, _HOLLOW, _UNDECIDED, _COLLIDES, _OBSTACLE = range(len(_CLASSES))
_PATH = "#0072b2"
_ROBOT = "#009e73"
_LONG = 6.5
"""Length of the longer side of the axes, in inches."""
_THIN = 12.0
"""The largest ratio of the sides that is drawn to scale; beyond it the short side is stretched, as the title says."""
_MANY = 12
"""About how many robots are drawn along a path when the caller does not say."""


def plot(
    space: CSpace,
    *,
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
    path : array-like, shape (n, 2), or Plan, optional
        Configurations to join by straight edges, in metres; or anything whose ``path`` attribute holds them.
    start, goal : array-like, shape (2,), optional
        Configurations to mark; where left out and a path is given, its ends.
    ax : matplotlib.axes.Axes, optional
        Where to draw; by default a new figure, which belongs to no window.
    robot_every : float, optional
        Metres of path between two drawn robots; ``inf`` draws it at the ends only. By default about a dozen.
    legend : bool
        Whether to add a legend, beside or below the axes, where it hides nothing.
    title : str, optional
        By default the robot and the side of a cell. Pass ``""`` for none.

    Returns
    -------
    matplotlib.axes.Axes
        The axes; ``ax.figure`` is the figure. Show it in a notebook by naming ``ax.figure``.

    Raises
    ------
    InputError
        If the path or a configuration has the wrong shape or is not finite, or ``robot_every`` is not above zero.
    """
    points = _polyline(space, path)
    marks = _marks(space, points, start, goal)
    shape = space.robot.geometry
    corners = np.reshape(shape.bounds, (2, 2))
    stations = _stations(points, robot_every, math.dist(*corners))
    # The ends come last: they are drawn over the robots on the way.
    stations = np.concatenate([stations, *(mark[np.newaxis] for mark in marks.values())])
    box = _box(space, [points, *(station + corners for station in stations)])
    own = ax is None
    if ax is None:
        ax = _new_axes(box)
    handles = _draw_cells(ax, space)
    handles += _draw_path(ax, points)
    handles += _draw_robots(ax, shape, stations)
    handles += _draw_marks(ax, marks)
    _frame(ax, space, box)
    words = _title(space, box, title)
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
    target = Path(file)
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"{target} has the suffix {target.suffix!r}; a picture's must be one of {', '.join(SUFFIXES)}; "
            f"name it e.g. {target.with_suffix('.png').name}"
        )
    if "ax" in options:
        raise InputError("ax is given; save_plot draws a figure of its own; use plot and ax.figure.savefig instead")
    dots = positive(dpi, "dpi", "pixels per inch")
    with replacing(target, overwrite) as temporary:
        plot(space, **options).figure.canvas.print_figure(temporary, dpi=dots)
    return target


def _polyline(space: CSpace, path: Any) -> NDArray[np.float64]:
    """The path as an array, shape (n, 2); n is 0 where there is none."""
    values = getattr(path, "path", path)
    if values is None:
        return np.empty((0, 2))
    points = space.grid.coordinates(values, "path")
    if points.ndim != 2:
        raise InputError(f"path has shape {points.shape}; it must be (n, 2); pass one configuration in a row")
    return points


def _marks(space: CSpace, points: NDArray[np.float64], start: Any, goal: Any) -> dict[str, NDArray[np.float64]]:
    """Start and goal by name, each of shape (2,), those that there are."""
    marks = {}
    for name, given, end in (("start", start, 0), ("goal", goal, -1)):
        if given is not None:
            mark = space.grid.coordinates(given, name)
            if mark.ndim != 1:
                raise InputError(f"{name} has shape {mark.shape}; it must be (2,); pass one configuration")
            marks[name] = mark
        elif len(points):
            marks[name] = points[end]
    return marks


def _stations(points: NDArray[np.float64], every: float | None, size: float) -> NDArray[np.float64]:
    """Configurations along the path at which a robot of ``size`` metres is drawn, the ends left out, shape (n, 2)."""
    if every is not None and every != math.inf:
        every = positive(every, "robot_every")
    if len(points) < 2 or every == math.inf:
        return np.empty((0, 2))
    travelled = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    length = float(travelled[-1])
    if every is None:
        every = max(length / _MANY, 0.75 * size)
    count = math.ceil(length / every)
    at = np.arange(1, count) * length / max(count, 1)
    return np.stack([np.interp(at, travelled, axis) for axis in points.T], axis=-1)


def _rings(geometry: Any) -> list[NDArray[np.float64]]:
    """Closed outlines of a geometry, holes included, each of shape (n, 2)."""
    from shapely.geometry.polygon import orient

    # Holes run the other way round than outlines, or they would be filled.
    parts = [orient(part) for part in getattr(geometry, "geoms", [geometry])]
    return [np.asarray(ring.coords)[:, :2] for part in parts for ring in (part.exterior, *part.interiors)]


def _box(space: CSpace, shown: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Lower and upper corner of what is in view, shape (2, 2): the grid, and what is drawn beyond it."""
    points = np.concatenate([[space.grid.lower, space.grid.upper], *shown])
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _stretch(box: NDArray[np.float64]) -> float:
    """Drawn height of a metre in y over the drawn width of a metre in x: 1, but for long and thin maps."""
    width, height = box[1] - box[0]
    return float(max(1.0, width / height / _THIN) * min(1.0, _THIN * width / height))


def _new_axes(box: NDArray[np.float64]) -> Axes:
    """Axes in a figure that belongs to no window, with room around them for labels and a legend."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    width, height = box[1] - box[0]
    drawn = np.array([width, height * _stretch(box)])
    drawn *= _LONG / drawn.max()
    room = (0.9, 1.5) if width >= height else (2.9, 0.9)
    size = (max(float(drawn[0] + room[0]), 4.2), float(drawn[1] + room[1]))
    figure = Figure(figsize=size, dpi=150.0, layout=ConstrainedLayoutEngine(h_pad=0.1))
    FigureCanvasAgg(figure)
    return figure.add_subplot()


def _draw_cells(ax: Axes, space: CSpace) -> list[Any]:
    """Draw the cells and return legend entries for the classes that occur."""
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    from cspace._cell_image import CellImage

    table = np.empty((2, 3), np.uint8)
    table[0, [FREE, MIXED, BLOCKED]] = _OPEN, _UNDECIDED, _COLLIDES
    table[1, [FREE, MIXED, BLOCKED]] = _HOLLOW, _OBSTACLE, _OBSTACLE
    classes = np.where(space.workspace.outer, table[1][space.state], table[0][space.state])
    colors = np.array([to_rgb(color) for _, color in _CLASSES])
    ax.add_image(CellImage(ax, classes, np.rint(255.0 * colors).astype(np.uint8), space.grid))
    present = np.bincount(classes.ravel(), minlength=len(_CLASSES)) > 0
    return [
        Patch(facecolor=color, edgecolor="#555555", linewidth=0.6, label=label)
        for (label, color), seen in reversed(list(zip(_CLASSES, present, strict=True)))
        if seen
    ]


def _draw_path(ax: Axes, points: NDArray[np.float64]) -> list[Any]:
    from matplotlib.patheffects import withStroke

    if not len(points):
        return []
    line = ax.plot(*points.T, color=_PATH, linewidth=1.8, solid_joinstyle="round", label="path", zorder=4)
    line[0].set_path_effects([withStroke(linewidth=3.4, foreground="white")])
    return list(line)


def _draw_robots(ax: Axes, shape: Any, stations: NDArray[np.float64]) -> list[Any]:
    from matplotlib.collections import PathCollection
    from matplotlib.patches import Patch
    from matplotlib.path import Path as Outline

    if not len(stations):
        return []
    rings = _rings(shape)
    paths: list[Outline] = [
        Outline.make_compound_path(*(Outline(ring + station, closed=True) for ring in rings)) for station in stations
    ]
    style: dict[str, Any] = {"facecolor": (0.0, 0.62, 0.45, 0.12), "edgecolor": _ROBOT, "linestyle": (0, (4, 1.2))}
    robots = PathCollection(paths, linewidths=0.9, zorder=3, **style)
    robots.set_transform(ax.transData)
    ax.add_collection(robots, autolim=False)
    return [Patch(linewidth=0.9, label="robot", **style)]


def _draw_marks(ax: Axes, marks: dict[str, NDArray[np.float64]]) -> list[Any]:
    looks: dict[str, dict[str, Any]] = {
        "start": {"marker": "o", "markersize": 7.0, "markerfacecolor": "white"},
        "goal": {"marker": "*", "markersize": 12.0, "markerfacecolor": "#f0e442"},
    }
    return [
        ax.plot(*mark, linestyle="none", markeredgecolor="black", label=name, zorder=5, clip_on=False, **looks[name])[0]
        for name, mark in marks.items()
    ]


def _frame(ax: Axes, space: CSpace, box: NDArray[np.float64]) -> None:
    """Limits, scale and labels."""
    from matplotlib.ticker import MaxNLocator

    stretch = _stretch(box)
    ax.set_xlim(*box[:, 0])
    ax.set_ylim(*box[:, 1])
    ax.set_aspect(stretch)
    ax.set_facecolor(_CLASSES[_OPEN if space.outside == "free" else _COLLIDES][1])
    ax.set_xlabel("x (m)")
    ax.set_ylabel("y (m)")
    if stretch > 1.0:
        ax.yaxis.set_major_locator(MaxNLocator(2))
    if stretch < 1.0:
        ax.xaxis.set_major_locator(MaxNLocator(1))


def _title(space: CSpace, box: NDArray[np.float64], title: str | None) -> str:
    """The given title, or what is shown; where an axis is stretched, it says so."""
    words = f"{space.robot.name}, cells of {space.grid.spacing:g} m" if title is None else title
    stretch = _stretch(box)
    if stretch != 1.0:
        axis, times = ("y", stretch) if stretch > 1.0 else ("x", 1.0 / stretch)
        words = f"{words} ({axis} stretched {times:.3g} times)".strip()
    return words


def _legend(ax: Axes, handles: list[Any], own: bool, box: NDArray[np.float64]) -> None:
    """A legend below a wide map and beside a tall one; beside the axes where the figure is the caller's."""
    width, height = box[1] - box[0]
    style: dict[str, Any] = {"handles": handles, "fontsize": 9, "frameon": False}
    if not own:
        ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), borderaxespad=0.0, **style)
    elif width >= height:
        ax.figure.legend(loc="outside lower center", ncols=4, **style)
    else:
        ax.figure.legend(loc="outside right center", **style)
