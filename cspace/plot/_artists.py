"""Parts of a picture: cells, paths, robots, markers, frame and legend."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np

from cspace import Grid
from cspace.errors import CspaceError, InputError
from cspace.inside import Bytes, Floats, reduce_blocks
from cspace.plot.scene import (
    ENDPOINT_COLORS,
    PATH_COLOR,
    ROBOT_FILL_COLOR,
    CellClass,
    DrawnRobot,
    PictureContent,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from matplotlib.patches import Patch

LABELS_OVER_ROTATIONS: Final = {
    CellClass.OPEN: "free at every rotation",
    CellClass.COLLIDES: "C-obstacle at every rotation",
}
"""Labels of classes in a picture of all rotations at once."""

ROBOT_EDGE_COLOR: Final = "#00614a"
"""Colour of a robot's edge and heading."""
OUTSIDE_STYLE: Final[dict[str, Any]] = {
    "facecolor": "#f2f2f2",
    "edgecolor": "#c4c4c4",
    "hatch": "////",
}
"""Style of what is outside the grid."""
PATH_STYLE: Final[dict[str, Any]] = {
    "color": PATH_COLOR,
    "linewidth": 1.8,
    "zorder": 4,
    "label": "path",
}
"""Line style of a path."""
FAINT_COLOR: Final = "#c3a1d6"
"""Colour of a path away from a section, which is visible on white and on black."""
LOST_STYLE: Final[dict[str, Any]] = PATH_STYLE | {
    "color": "#ff1493",
    "linestyle": (0, (1.8, 1.0)),
    "label": "path, no longer proven free",
}
"""Line style of a path that is no longer proven free."""
ENDPOINT_STYLES: Final[dict[str, dict[str, Any]]] = {
    "start": {"marker": "o", "markersize": 7.0},
    "goal": {"marker": "*", "markersize": 12.0},
}
"""Styles of the markers of start and goal."""
MAX_ASPECT_RATIO: Final = 20.0
"""Largest ratio of the sides of axes drawn to scale; beyond it, the axes are not to scale."""


def label_axes(grid: Grid) -> list[str]:
    """Return names and units of the axes, as labels of a picture."""
    return [f"{axis} ({unit})" for axis, unit in zip(grid.axes, grid.units, strict=True)]


def draw_cells(
    ax: Axes,
    grid: Grid,
    classes: Bytes,
    pair: Sequence[int] = (0, 1),
    first: Sequence[int] = (0, 0),
) -> AxesImage:
    """Draw cells by class, on two axes; ``first`` is the index of the first cell on each."""
    from matplotlib.colors import ListedColormap

    blocks, side = merge_cells(ax, classes)
    corner = np.array(grid.lower)[list(pair)] + grid.spacing * np.asarray(first)
    # The last blocks may reach beyond the grid; the limits of the axes hide that.
    rows, columns = grid.spacing * side * np.array(blocks.shape)
    return ax.imshow(
        blocks,
        ListedColormap([each.color for each in CellClass]),
        vmin=0,
        vmax=len(CellClass) - 1,
        extent=(corner[0], corner[0] + columns, corner[1], corner[1] + rows),
        origin="lower",
        interpolation="nearest",
        aspect=ax.get_aspect(),
    )


def merge_cells(ax: Axes, classes: Bytes) -> tuple[Bytes, int]:
    """Merge cells into blocks no smaller than pixels.

    Returns the blocks as an image, its lowest row first, and the side of a block in cells. A block
    shows its largest class, so that no obstacle vanishes.
    """
    pixels = 0.8 * np.array(ax.bbox.size)  # labels and titles may shrink the axes
    side = max(1, math.ceil(float(np.max(classes.shape / pixels))))
    return reduce_blocks(classes, side).T, side


def make_cell_legend(scene: PictureContent, classes: Sequence[Bytes]) -> list[Any]:
    """Create the legend entries of classes, obstacles first, and of the exterior."""
    entries = []
    present = set().union(*(np.unique(section).tolist() for section in classes))
    for shown in reversed(CellClass):
        if shown not in present:
            continue
        label = shown.label
        if scene.rotation is None:
            label = LABELS_OVER_ROTATIONS.get(shown, label)
        entries.append(make_patch(label, shown.color))
    if not scene.space.grid.contains(scene.box).all():
        entries.append(make_patch("outside the grid", **OUTSIDE_STYLE))
    return entries


def make_patch(label: str, facecolor: Any, edgecolor: str = "#555555", hatch: str = "") -> Patch:
    """Create a legend entry: a coloured box."""
    from matplotlib.patches import Patch

    return Patch(facecolor=facecolor, edgecolor=edgecolor, linewidth=0.6, label=label, hatch=hatch)


def draw_path(
    ax: Any, points: Floats, is_lost: bool, columns: Sequence[int] = (0, 1), **style: Any
) -> list[Any]:
    """Draw a path; return its legend entry.

    ``columns`` are the two or three columns of ``points`` to draw.
    """
    if len(points) < 2:
        return []
    line = (LOST_STYLE if is_lost else PATH_STYLE) | style
    return list(ax.plot(*points[:, list(columns)].T, **line))


def draw_robots(
    ax: Any, body: DrawnRobot, robots: Floats, pair: Sequence[int] = (0, 1), opacity: float = 0.55
) -> list[Any]:
    """Draw projected robots at configurations; return the legend entry.

    Seen from above, an arrow from its reference point shows its yaw, if it has one.
    """
    from matplotlib.collections import PathCollection
    from matplotlib.colors import to_rgba
    from matplotlib.path import Path

    if not len(robots):
        return []
    entry = make_patch("robot", to_rgba(ROBOT_FILL_COLOR, opacity), ROBOT_EDGE_COLOR)
    outlines = []
    for q in robots:
        rings = [Path(ring, closed=True) for ring in body.outlines(q, pair)]
        outlines.append(Path.make_compound_path(*rings))
    colors = {"facecolor": entry.get_facecolor(), "edgecolor": ROBOT_EDGE_COLOR}
    drawn = PathCollection(outlines, **colors, linewidth=0.9, transform=ax.transData, zorder=3)
    ax.add_collection(drawn, autolim=False)
    if body.levels:
        rings = [Path(body.transform(ring, q), closed=True) for q in robots for ring in body.levels]
        levels = PathCollection(rings, linewidth=0.4, transform=ax.transData, zorder=3)
        levels.set(facecolor="none", edgecolor=ROBOT_EDGE_COLOR)
        ax.add_collection(levels, autolim=False)
    if "yaw" in body.rotations.names and tuple(pair) == (0, 1):
        x, y, yaws = robots[:, 0], robots[:, 1], robots[:, -1]
        length = 0.6 * body.reach
        arrows = length * np.cos(yaws), length * np.sin(yaws)
        in_metres = {"angles": "xy", "scale_units": "xy", "scale": 1.0}
        ax.quiver(x, y, *arrows, color=ROBOT_EDGE_COLOR, zorder=3, **in_metres)
    return [entry]


def draw_endpoints(
    ax: Any, endpoints: dict[str, Floats], columns: Sequence[int] = (0, 1)
) -> list[Any]:
    """Draw start and goal; return their legend entries.

    ``columns`` are the two or three coordinates to draw.
    """
    handles = []
    for name, q in endpoints.items():
        handles += ax.plot(
            *q[list(columns)],
            label=name,
            linestyle="none",
            markerfacecolor=ENDPOINT_COLORS[name],
            markeredgecolor="black",
            clip_on=False,
            zorder=5,
            **ENDPOINT_STYLES[name],
        )
    return handles


def set_up_axes(ax: Axes, box: Floats, pair: Sequence[int], labels: Sequence[str]) -> None:
    """Set limits, scale, labels and background of two axes."""
    right, up = pair
    ax.set(xlim=box[:, right], ylim=box[:, up], xlabel=labels[right], ylabel=labels[up])
    lengths = np.ptp(box[:, [right, up]], axis=0)
    is_to_scale = lengths.max() <= MAX_ASPECT_RATIO * lengths.min()
    ax.set_aspect("equal" if is_to_scale else "auto")
    ax.patch.set(**OUTSIDE_STYLE, linewidth=0.0)


def choose_axes_size(box: Floats) -> tuple[float, float]:
    """Choose width and height, inches, to show a box from above."""
    lengths = (box[1] - box[0])[:2]
    width, height = 6.5 * np.maximum(lengths / lengths.max(), 1.0 / MAX_ASPECT_RATIO)
    return float(width), float(height)


def new_figure(width: float, height: float, layout: Any = "compressed") -> Figure:
    """Create a figure without a window; sizes in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150.0, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def add_legend_below(figure: Figure, handles: Sequence[Any]) -> None:
    """Add a legend below a figure, in as many columns as fit."""
    # Inches of an entry: its letters at 9 points, its symbol, and the gap to the next column.
    widest = 0.075 * max(len(handle.get_label()) for handle in handles) + 0.6
    columns = max(1, min(len(handles), int(figure.get_figwidth() / widest)))
    style: dict[str, Any] = {"fontsize": 9, "frameon": False}
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, **style)


def extend_legend(axes: Axes, handles: Sequence[Any]) -> None:
    """Make a picture's legend anew, with more handles."""
    figure: Any = axes.figure
    (legend,) = figure.legends
    legend.remove()
    add_legend_below(figure, [*legend.legend_handles, *handles])


def check_axes(ax: object) -> None:
    """Raise InputError unless pictures can be drawn into axes; None stands for a new figure."""
    if ax is None:
        return
    from matplotlib.axes import Axes

    if not isinstance(ax, Axes):
        raise InputError("ax", f"is a {type(ax).__name__}", "it must be matplotlib axes")


def plot_rates(
    times: Floats, curves: Sequence[tuple[str, str, Floats]], ax: Axes | None = None
) -> Axes:
    """Draw curves over time, each with its name and the label of its axis, on at most two axes."""
    check_axes(ax)
    left = new_figure(7.5, 3.2).add_subplot() if ax is None else ax
    left.set_xlabel("time (s)")
    axes_by_label: dict[str, Axes] = {}
    handles: list[Any] = []
    for k, (name, label, curve) in enumerate(curves):
        if label not in axes_by_label:
            axes_by_label[label] = left.twinx() if axes_by_label else left
            axes_by_label[label].set_ylabel(label)
        handles += axes_by_label[label].plot(times, curve, color=f"C{k}", label=name)
    if ax is None:
        add_legend_below(cast("Figure", left.figure), handles)
        show_in_notebooks(left)
    return left


def annotate(
    ax: Any, is_new: bool, title: str | None, default: str, handles: Sequence[Any]
) -> None:
    """Add a title, and a legend if needed.

    The legend is below a new figure, or beside the caller's axes.
    """
    heading = default if title is None else title
    if is_new:
        # A title may be wider than narrow axes, so new figures have it above all axes, and it
        # continues in another line if the figure is narrow, too.
        ax.figure.suptitle(heading, fontsize=10, wrap=True)
        if handles:
            add_legend_below(ax.figure, handles)
        show_in_notebooks(ax)
        return
    ax.set_title(heading, fontsize=10)
    if handles:
        ax.legend(
            handles=handles,
            loc="upper left",
            bbox_to_anchor=(1.02, 1.0),
            fontsize=9,
            frameon=False,
            borderaxespad=0.0,
        )


def show_in_notebooks(ax: Any) -> None:
    """Let a notebook show the figure of axes, which has no window."""
    vars(ax)["_repr_png_"] = lambda: figure_png(ax.figure)


def figure_png(figure: Any) -> bytes:
    """Encode a figure as PNG."""
    file = io.BytesIO()
    figure.canvas.print_figure(file, format="png", dpi=100.0)
    return file.getvalue()


def show_png(shown: Any) -> bytes | None:
    """Return the picture that an object's ``plot`` draws, for notebooks; None if it draws none."""
    try:
        axes = shown.plot()
    except CspaceError:
        return None
    return figure_png(axes.figure)
