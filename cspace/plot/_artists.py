"""Parts of a picture: cells, paths, robots, marks, frame and legend.

Each colour has one meaning everywhere.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace._grid import Grid
from cspace._rotations import Rotations
from cspace._support.arrays import (
    BLOCKED,
    FREE,
    MIXED,
    Bools,
    Box,
    Floats,
    block_starts,
    reduce_blocks,
)
from cspace.plot._route import Body, MapLike, Scene, with_gaps

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage
    from matplotlib.patches import Patch
    from matplotlib.path import Path

    from cspace._workspace import Workspace

Classes = NDArray[np.uint8]

# Classes of cells with their label and colour, the most important last: a pixel that covers many
# cells shows the largest class. Most hues are from Okabe and Ito (2008), safe for the colour-blind;
# their lightness differs, so that they are distinct in grey print. Only unknown cells are brown.
CLASSES: Final = (
    ("free", "#ffffff"),
    ("free at some rotations", "#f3e79b"),
    ("unknown, taken as free", "#c8ab78"),
    ("obstacle, free for the reference point", "#999999"),
    ("undecided (MIXED)", "#d55e00"),
    ("C-obstacle (BLOCKED)", "#a6d3ee"),
    ("unknown, taken as obstacle", "#6f5320"),
    ("obstacle", "#262626"),
)
OPEN, PARTLY, ASSUMED, HOLLOW, UNDECIDED, COLLIDES, UNSEEN, OBSTACLE = range(len(CLASSES))
CLASS_COLORS: Final = np.array([[*bytes.fromhex(color[1:])] for _, color in CLASSES], np.uint8)
"""Red, green and blue of each class, 0 to 255."""
LABELS_OVER_ROTATIONS: Final = {
    OPEN: "free at every rotation",
    COLLIDES: "C-obstacle at every rotation",
}
"""Labels of classes in a picture of all rotations at once."""

PATH_COLOR: Final = "#6a1b9a"
"""Colour of a path. Purple, even when drawn faint, is not a colour of a map."""
LOST_COLOR: Final = "#ff1493"
"""Colour of the edges of a path that are no longer proven free."""
ROBOT_FILL_COLOR: Final = "#3fb795"
"""Fill colour of a robot."""
ROBOT_EDGE_COLOR: Final = "#00614a"
"""Colour of a robot's edge and nose."""
GOAL_COLOR: Final = "#cc79a7"
"""Colour of a goal."""
OUTSIDE_STYLE: Final[dict[str, Any]] = {
    "facecolor": "#f2f2f2",
    "edgecolor": "#c4c4c4",
    "hatch": "////",
    "linewidth": 0.0,
}
"""Style of what is outside the grid."""
LOST_STYLE: Final[dict[str, Any]] = {
    "color": LOST_COLOR,
    "linestyle": (0, (1.8, 1.0)),
    "linewidth": 2.6,
    "label": "path, no longer proven free",
}
"""Line style of the edges of a path that are no longer proven free."""
MARK_STYLES: Final[dict[str, dict[str, Any]]] = {
    "start": {"marker": "o", "markersize": 7.0, "markerfacecolor": "white"},
    "goal": {"marker": "*", "markersize": 12.0, "markerfacecolor": GOAL_COLOR},
}
"""Markers of start and goal."""
BARRIER_STYLE: Final[dict[str, Any]] = {
    "color": "#c2002f",
    "linestyle": "none",
    "marker": "s",
    "markersize": 4.0,
    "markeredgecolor": "white",
    "markeredgewidth": 0.4,
    "zorder": 4.5,
    "label": "cells in the way",
}
"""Markers of cells that bar a way."""
BOTTLENECK_STYLE: Final[dict[str, Any]] = {
    "color": "#c2002f",
    "linestyle": "none",
    "marker": "o",
    "markersize": 14.0,
    "fillstyle": "none",
    "zorder": 6.0,
    "label": "narrowest place",
}
"""Marker of the narrowest place of a way."""
AXES_INCHES: Final = 6.5
"""Longer side of the axes, inches."""
MAX_ASPECT_RATIO: Final = 20.0
"""Largest ratio of the sides of axes drawn to scale; beyond it, the axes are not to scale."""
NOTEBOOK_DPI: Final = 100.0
"""Pixels per inch of pictures in notebooks."""
CURVE_POINTS: Final = 400
"""Number of points on the curve of a path."""


def classify_cells(space: MapLike, rotation: Floats | None, layer: tuple[Any, ...] = ()) -> Classes:
    """Classify cells at one or all rotations, by obstacles and states.

    ``rotation`` has shape (k,), or is None for all rotations; ``layer`` is an index into the
    arrays of the grid.
    """
    ground = classify_ground(space.workspace, layer)
    if not space.robot.shape.shown:
        ground = np.zeros_like(ground)  # a map of joints has no obstacles of its own
    if rotation is not None:
        return _merge_classes(ground, space.states_at(rotation)[layer])
    # Over all rotations, the lowest and the highest state of each cell.
    slices = (space.states_at(center)[layer] for center in space.slice_rotations)
    lowest = highest = next(slices)
    for states in slices:
        lowest = np.minimum(lowest, states)
        highest = np.maximum(highest, states)
    classes = _merge_classes(ground, lowest)
    classes[(classes <= ASSUMED) & (highest != FREE)] = PARTLY
    return classes


def classify_ground(workspace: Workspace, layer: tuple[Any, ...] = ()) -> Classes:
    """Classify cells of a workspace without a robot: obstacles, unknown and open cells."""
    occupied = workspace.outer[layer]
    classes = np.where(occupied, np.uint8(OBSTACLE), np.uint8(OPEN))
    if workspace.unknown is not None:
        unknown = np.where(occupied, np.uint8(UNSEEN), np.uint8(ASSUMED))
        classes = np.where(workspace.unknown[layer], unknown, classes)
    return classes


def _merge_classes(ground: Classes, states: NDArray[np.uint8]) -> Classes:
    """Combine classes in the workspace with states of a slice, both of the same shape."""
    # The class by ground (row) and state (column). Obstacles show through unless the robot is free
    # there, and open ground shows through where it is free.
    table = np.empty((len(CLASSES), 3), np.uint8)
    table[:, FREE] = HOLLOW
    table[:, MIXED] = UNDECIDED
    table[:, BLOCKED] = COLLIDES
    for index in (UNSEEN, OBSTACLE):
        table[index, [MIXED, BLOCKED]] = index
    for index in (OPEN, ASSUMED):
        table[index, FREE] = index
    return np.asarray(table[ground, states])


def draw_cells(
    ax: Axes, grid: Grid, classes: Classes, window: Box, pair: Sequence[int] = (0, 1)
) -> AxesImage:
    """Draw the cells of a window by class, on two axes of the grid.

    If cells are smaller than pixels, blocks of cells show their largest class, so that no obstacle
    vanishes.
    """
    side = block_side(ax, classes.shape)
    colors = color_blocks(classes, side)
    left, bottom = (grid.lower[axis] + grid.spacing * window[axis].start for axis in pair)
    # The last blocks may reach beyond the window; the limits of the axes hide that.
    rows, columns, _ = colors.shape
    right = left + grid.spacing * side * columns
    top = bottom + grid.spacing * side * rows
    return ax.imshow(
        colors,
        extent=(left, right, bottom, top),
        origin="lower",
        interpolation="nearest",
        aspect=ax.get_aspect(),
    )


def block_side(ax: Axes, shape: Sequence[int]) -> int:
    """Return the side of blocks of cells, in cells, that are no smaller than pixels."""
    pixels = 0.8 * np.array(ax.bbox.size)  # texts may shrink the axes
    return max(1, math.ceil(float(np.max(shape / pixels))))


def color_blocks(classes: Classes, side: int) -> NDArray[np.uint8]:
    """Return an image of blocks of cells, shape (rows, columns, 3), the first row lowest."""
    blocks = reduce_blocks(classes, block_starts(classes.shape, side))
    return np.asarray(CLASS_COLORS[blocks.T])


def make_cell_legend(scene: Scene, classes: Sequence[Classes]) -> list[Any]:
    """Create legend entries of classes, obstacles first, and of the exterior."""
    entries = []
    present = np.unique(np.concatenate([np.unique(section) for section in classes]))
    for index in np.flip(present).tolist():
        label, color = CLASSES[index]
        if scene.rotation is None:
            label = LABELS_OVER_ROTATIONS.get(index, label)
        entries.append(patch(label, color))
    if not scene.space.grid.contains(scene.box).all():
        entries.append(patch("outside the grid", "#f2f2f2", "#c4c4c4", hatch="////"))
    return entries


def patch(label: str, color: str, edge: str = "#555555", **style: Any) -> Patch:
    """Create a legend entry: a box filled with a colour."""
    from matplotlib.patches import Patch

    return Patch(facecolor=color, edgecolor=edge, linewidth=0.6, label=label, **style)


def draw_path(
    ax: Any, points: Floats, lost: Bools, pair: Sequence[int] = (0, 1), **style: Any
) -> list[Any]:
    """Draw a path, its ``lost`` steps dashed; return the legend entries.

    ``pair`` are the columns of ``points`` to draw, three in space.
    """
    if len(points) < 2:
        return []
    points = points[:, list(pair)]
    proven = with_gaps(points, ~lost) if lost.any() else points
    line: dict[str, Any] = {"color": PATH_COLOR, "linewidth": 1.8, "zorder": 4, **style}
    lines: list[Any] = ax.plot(*proven.T, label="path", **line)
    if lost.any():
        lines += ax.plot(*with_gaps(points, lost).T, zorder=4.1, **LOST_STYLE)
    return lines


def draw_robots(
    ax: Axes,
    body: Body,
    stations: Floats,
    pair: Sequence[int] = (0, 1),
    opacity: float = 0.55,
    zorder: float = 3.0,
) -> list[Any]:
    """Draw the robot at configurations, projected on two axes; return the legend entry.

    In the plane, a nose shows its heading.
    """
    from matplotlib.collections import PathCollection
    from matplotlib.colors import to_rgba

    if not len(stations):
        return []
    # One collection of all outlines, and one of all noses.
    fill: Any = to_rgba(ROBOT_FILL_COLOR, opacity)
    outlines = [join_rings(body.outlines(q, pair)) for q in stations]
    noses = [join_rings(body.noses(q)) for q in stations]
    for paths, color, width in ((outlines, fill, 0.9), (noses, ROBOT_EDGE_COLOR, 0.0)):
        robots = PathCollection(
            paths,
            facecolor=color,
            edgecolor=ROBOT_EDGE_COLOR,
            linewidth=width,
            transform=ax.transData,
            zorder=zorder,
        )
        ax.add_collection(robots, autolim=False)
    return [patch("robot", fill, ROBOT_EDGE_COLOR)]


def join_rings(rings: Sequence[Floats]) -> Path:
    """Join closed outlines into one path of matplotlib."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(ring, closed=True) for ring in rings))


def draw_marks(
    ax: Any,
    marks: dict[str, Floats],
    pair: Sequence[int] = (0, 1),
    rotations: Rotations | None = None,
) -> list[Any]:
    """Draw start and goal projected on two or three axes; return their legend entries.

    An arrow shows the heading, if ``rotations`` are given and define one.
    """
    handles = []
    for name, q in marks.items():
        position = [[coordinate] for coordinate in q[list(pair)]]
        # An arrow has the length of a marker, whatever the scale of the axes.
        yaw = rotations._find_yaw(q) if rotations is not None else None
        if yaw is not None:
            arrow = (math.cos(yaw), math.sin(yaw))
            ax.quiver(*position, *arrow, scale=16.0, width=0.006, pivot="tail", zorder=4.9)
        handles += ax.plot(
            *position,
            label=name,
            linestyle="none",
            markeredgecolor="black",
            clip_on=False,
            zorder=5,
            **MARK_STYLES[name],
        )
    return handles


def frame(ax: Axes, box: Floats, pair: Sequence[int], labels: Sequence[str]) -> None:
    """Set limits, scale, labels and hatching of axes for two axes of a box."""
    right, up = pair
    ax.set(xlim=box[:, right], ylim=box[:, up], xlabel=labels[right], ylabel=labels[up])
    lengths = np.ptp(box[:, [right, up]], axis=0)
    is_to_scale = lengths.max() <= MAX_ASPECT_RATIO * lengths.min()
    ax.set_aspect("equal" if is_to_scale else "auto")
    ax.patch.set(**OUTSIDE_STYLE)


def axes_size(box: Floats) -> tuple[float, float]:
    """Choose width and height, inches, of axes for the first two axes of a box."""
    lengths = (box[1] - box[0])[:2]
    width, height = AXES_INCHES * np.maximum(lengths / lengths.max(), 1.0 / MAX_ASPECT_RATIO)
    return float(width), float(height)


def new_figure(width: float, height: float, layout: Any = "compressed") -> Figure:
    """Create a figure without a window; sizes are in inches."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=150.0, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def legend_below(figure: Figure, handles: Sequence[Any]) -> None:
    """Add a legend below a figure, in as many columns as fit."""
    most = int(figure.get_figwidth() / 2.4)  # inches of the widest entry
    columns = max(1, min(len(handles), most))
    style: dict[str, Any] = {"fontsize": 9, "frameon": False}
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, **style)


def annotate(
    ax: Any, is_new: bool, title: str | None, default: str, handles: Sequence[Any]
) -> None:
    """Add a title, and a legend if there are handles: below a new figure, or beside the axes."""
    heading = default if title is None else title
    if is_new:
        # A title may be wider than narrow axes, so new figures have it above all axes.
        ax.figure.suptitle(heading, fontsize=10)
        if handles:
            legend_below(ax.figure, handles)
        # Notebooks show only figures with a window, and axes have no picture.
        vars(ax)["_repr_png_"] = lambda: figure_png(ax.figure)
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


def figure_png(figure: Any) -> bytes:
    """Encode a figure as PNG, in the resolution for notebooks."""
    file = io.BytesIO()
    figure.canvas.print_figure(file, format="png", dpi=NOTEBOOK_DPI)
    return file.getvalue()
