"""What is drawn into axes: cells, paths, robots, marks, frame and legend."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.plot.view import Floats, Footprint, Outline, placed, stretch
from cspace.states import BLOCKED, FREE, MIXED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patheffects import AbstractPathEffect

    from cspace.grid import Grid
    from cspace.plot.cell_image import CellImage
    from cspace.space import CSpace

# What a cell shows, the most important last: a pixel that covers many cells shows the largest. The hues are from Okabe
# and Ito (2008), which the colour-blind tell apart, and their lightness differs, so that they part in grey print too.
CLASSES: Final = (
    ("free", "#ffffff"),
    ("free at some yaws", "#f3e79b"),
    ("obstacle, free for the reference point", "#999999"),
    ("undecided (MIXED)", "#d55e00"),
    ("C-obstacle (BLOCKED)", "#a6d3ee"),
    ("obstacle", "#262626"),
)
OPEN, SOME, HOLLOW, UNDECIDED, COLLIDES, OBSTACLE = range(len(CLASSES))
OVER_YAWS: Final = {
    OPEN: "free at every yaw",
    COLLIDES: "C-obstacle at every yaw",
}
"""What classes are called where all yaws are shown at once."""

PATH: Final = "#0072b2"
FAINT: Final = "#62a8d0"
"""A path that is not where the picture is cut, or behind something."""
ROBOT: Final = "#009e73"
BODY: Final = "#3fb795"
"""A robot that is drawn filled."""
LONG: Final = 6.5
"""Length of the longer side of the axes, in inches."""
ROW: Final = 0.21
"""Height of a row of a legend, in inches."""


def classes_of(space: CSpace, yaw: float | None) -> NDArray[np.uint8]:
    """Classes of cells, shape (nx, ny): at a yaw (radians), or over all yaws where none is given and the map turns."""
    occupied = space.workspace.outer
    if space.rotations is None or yaw is not None:
        return classes_at(occupied, space.slice_at(0.0 if yaw is None else yaw))
    best, worst = space.stack.min(axis=0), space.stack.max(axis=0)
    classes = classes_at(occupied, best)
    classes[(classes == OPEN) & (worst != FREE)] = SOME
    return classes


def classes_at(occupied: NDArray[np.bool_], state: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Classes of cells of one slice, of any shape, from whether they meet an obstacle, and from their states."""
    table = np.empty((2, 3), np.uint8)
    table[0, [FREE, MIXED, BLOCKED]] = OPEN, UNDECIDED, COLLIDES
    table[1, [FREE, MIXED, BLOCKED]] = HOLLOW, OBSTACLE, OBSTACLE
    return np.asarray(np.where(occupied, table[1][state], table[0][state]))


def draw_cells(ax: Axes, grid: Grid, classes: NDArray[np.uint8]) -> CellImage:
    """Draw the cells of a grid in the plane by their class."""
    from matplotlib.colors import to_rgb

    from cspace.plot.cell_image import CellImage

    colors = np.array([to_rgb(color) for _, color in CLASSES])
    image = CellImage(ax, classes, np.rint(255.0 * colors).astype(np.uint8), grid)
    ax.add_image(image)
    return image


def cell_legend(classes: Sequence[NDArray[np.uint8]], over_yaws: bool) -> list[Any]:
    """Legend entries of the classes that occur, obstacles first."""
    from matplotlib.patches import Patch

    present = sum(np.bincount(part.ravel(), minlength=len(CLASSES)) for part in classes)
    return [
        Patch(
            facecolor=color,
            edgecolor="#555555",
            linewidth=0.6,
            label=OVER_YAWS.get(number, label) if over_yaws else label,
        )
        for number, (label, color) in reversed(list(enumerate(CLASSES)))
        if np.asarray(present)[number]
    ]


def draw_path(ax: Axes, points: Floats, width: float = 1.8) -> list[Any]:
    """Draw a path; gives its legend entry."""
    if not len(points):
        return []
    dim = 3 if ax.name == "3d" else 2
    line = ax.plot(*points[:, :dim].T, color=PATH, linewidth=width, label="path", zorder=4)
    line[0].set(solid_joinstyle="round", path_effects=[halo(width + 1.6)])
    return list(line)


def halo(width: float, alpha: float = 1.0) -> AbstractPathEffect:
    """White on both sides of a line, so that it shows on any ground."""
    from matplotlib.patheffects import withStroke

    return withStroke(linewidth=width, foreground="white", alpha=alpha)


def draw_robots(ax: Axes, footprint: Outline, at: Floats) -> list[Any]:
    """Draw the robot at configurations, shape (n, dof), with its nose where it turns; gives its legend entry."""
    from matplotlib.collections import PathCollection
    from matplotlib.patches import Patch

    if not len(at):
        return []
    style: dict[str, Any] = {"facecolor": (0.0, 0.62, 0.45, 0.12), "edgecolor": ROBOT, "linestyle": (0, (4, 1.2))}
    robots = PathCollection([outline(footprint, q) for q in at], linewidths=0.9, zorder=3, **style)
    robots.set_transform(ax.transData)
    ax.add_collection(robots, autolim=False)
    if isinstance(footprint, Footprint) and at.shape[1] == 3:
        noses = PathCollection(
            [nose(footprint, q) for q in at], linewidths=0.0, zorder=3.1, facecolor=(0.0, 0.62, 0.45, 0.6)
        )
        noses.set_transform(ax.transData)
        ax.add_collection(noses, autolim=False)
    return [Patch(linewidth=0.9, label="robot", **style)]


def outline(footprint: Outline, q: Floats) -> Any:
    """The robot at a configuration, as a matplotlib path in metres."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(ring, closed=True) for ring in footprint.at(q)))


def nose(footprint: Footprint, q: Floats) -> Any:
    """The triangle at the robot's front, as a matplotlib path in metres."""
    from matplotlib.path import Path

    return Path(placed(footprint.nose, q), closed=True)


def draw_marks(ax: Axes, marks: dict[str, Floats], scale: float = 1.0) -> list[Any]:
    """Draw start and goal, with an arrow where there is a yaw; gives their legend entries.

    Axes in three dimensions take marks with a height.
    """
    looks: dict[str, dict[str, Any]] = {
        "start": {"marker": "o", "markersize": 7.0 * scale, "markerfacecolor": "white"},
        "goal": {"marker": "*", "markersize": 12.0 * scale, "markerfacecolor": "#f0e442"},
    }
    dim = 3 if ax.name == "3d" else 2
    handles = []
    for name, mark in marks.items():
        if len(mark) > dim:
            _draw_heading(ax, mark, looks[name]["markerfacecolor"], scale)
        point: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black", "clip_on": False, "zorder": 5}
        handles += ax.plot(*([number] for number in mark[:dim]), label=name, **point, **looks[name])
    return handles


def _draw_heading(ax: Axes, q: Floats, color: str, scale: float) -> None:
    """An arrow of fixed size on the paper from a configuration along its yaw."""
    from matplotlib.markers import MarkerStyle
    from matplotlib.path import Path
    from matplotlib.transforms import Affine2D

    arrow = Path(
        [(0.0, 0.09), (0.62, 0.09), (0.62, 0.28), (1.0, 0.0), (0.62, -0.28), (0.62, -0.09), (0.0, -0.09), (0.0, 0.09)],
        closed=True,
    )
    # A path marker is scaled so that its farthest point lies half a marker's size from its origin.
    ax.plot(
        *q[:2],
        marker=MarkerStyle(arrow, transform=Affine2D().rotate(q[2])),
        markersize=46.0 * scale,
        markerfacecolor=color,
        markeredgecolor="black",
        markeredgewidth=0.8,
        linestyle="none",
        clip_on=False,
        zorder=4.9,
    )


def frame(ax: Axes, space: CSpace, view: Floats, *, labels: bool = True) -> None:
    """Limits, scale and labels."""
    from matplotlib.ticker import MaxNLocator

    ratio = stretch(view)
    ax.set_xlim(*view[:, 0])
    ax.set_ylim(*view[:, 1])
    ax.set_aspect(ratio)
    ax.set_facecolor(beyond(space))
    if labels:
        ax.set_xlabel("x (m)")
        ax.set_ylabel("y (m)")
    if ratio > 1.0:
        ax.yaxis.set_major_locator(MaxNLocator(2))
    if ratio < 1.0:
        ax.xaxis.set_major_locator(MaxNLocator(1))


def beyond(space: CSpace) -> str:
    """Colour of what lies outside the grid."""
    return CLASSES[OPEN if space.outside == "free" else COLLIDES][1]


def new_figure(width: float, height: float, dpi: float = 150.0, *, arranged: bool = True) -> Figure:
    """A figure that belongs to no window, in inches, with room between what it holds, or left to be arranged."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = ConstrainedLayoutEngine(h_pad=0.1) if arranged else None
    figure = Figure(figsize=(width, height), dpi=dpi, layout=engine)
    FigureCanvasAgg(figure)
    return figure


def drawn_size(view: Floats, long: float = LONG) -> tuple[float, float]:
    """Width and height, in inches, of axes whose longer side is ``long``."""
    width, height = view[1] - view[0]
    drawn = np.array([width, height * stretch(view)])
    drawn *= long / drawn.max()
    return float(drawn[0]), float(drawn[1])


def legend_below(figure: Figure, handles: Sequence[Any], size: float = 9.0) -> None:
    """A legend below all axes of a figure, in as many columns as fit."""
    columns = legend_columns(handles, size, figure.get_figwidth())
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, fontsize=size, frameon=False)


def legend_columns(handles: Sequence[Any], size: float, width: float) -> int:
    """How many columns of a legend fit side by side in a width, in inches."""
    # Letters are about half the font's size wide, and a sign and its gaps about five sizes.
    widths = [size / 72.0 * (0.55 * len(handle.get_label()) + 5.0) for handle in handles]

    def fits(columns: int) -> bool:
        return bool(sum(map(max, np.array_split(widths, columns))) < 0.95 * width)

    columns = next((count for count in range(len(handles), 1, -1) if fits(count)), 1)
    # No more columns than the rows need, so that the last row is not short.
    return math.ceil(len(handles) / math.ceil(len(handles) / columns))


def legend_rows(handles: Sequence[Any], width: float) -> int:
    """How many rows a legend has at the foot of a figure of a width, in inches."""
    return math.ceil(len(handles) / legend_columns(handles, 9.0, width)) if handles else 0


def legend_at_foot(figure: Figure, handles: Sequence[Any]) -> None:
    """A legend at the foot of a figure whose parts were put in their places, with room left for its rows."""
    if handles:
        figure.legend(
            handles=handles,
            loc="lower center",
            bbox_to_anchor=(0.5, 0.08 / figure.get_figheight()),
            ncols=legend_columns(handles, 9.0, figure.get_figwidth()),
            fontsize=9.0,
            frameon=False,
            borderaxespad=0.0,
        )


def label_outer(panels: Any, size: float = 9.0) -> None:
    """Name the axes of panels that share them, below the lowest and beside the leftmost."""
    for column in panels.T:
        last = [ax for ax in column if ax.figure is not None][-1]
        last.set_xlabel("x (m)", fontsize=size)
        last.tick_params(labelbottom=True)
    for ax in panels[:, 0]:
        ax.set_ylabel("y (m)", fontsize=size)
    for ax in panels.flat:
        ax.tick_params(labelsize=size - 1.0)
