"""What is drawn into axes: cells, paths, robots, marks, frame and legend. One colour has one meaning everywhere."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import BLOCKED, FREE, MIXED, Floats
from cspace.grid import Grid
from cspace.plot.route import Ground, Look, MapLike, RobotGlyph, Route
from cspace.rotations import Rotations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch
    from matplotlib.patheffects import AbstractPathEffect

    from cspace.plot.cell_image import CellImage
    from cspace.workspace import Workspace

Classes = NDArray[np.uint8]

# What a cell shows, the most important last: a pixel that covers many cells shows the largest. Most hues are from Okabe
# and Ito (2008), which the colour-blind tell apart, and their lightness differs, so that they part in grey print too.
# Unknown cells are brown, which no other class is.
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
OVER_ALL: Final = {OPEN: "free at every rotation", COLLIDES: "C-obstacle at every rotation"}
"""What classes are called where all rotations are shown at once."""

PATH: Final = "#6a1b9a"
"""A path. Purple, also where it is drawn faint, is no colour of a map."""
LOST: Final = "#ff1493"
"""Edges of a path that are no longer proven free."""
ROBOT: Final = "#009e73"
ROBOT_FILL: Final = "#3fb795"
"""A robot that is drawn filled."""
DARK: Final = "#00614a"
"""Its edge and nose."""
GOAL: Final = "#cc79a7"
OUTSIDE: Final = ("outside the grid", "#f2f2f2", "#c4c4c4")
"""Name, ground and hatching of what the map does not show."""
LOST_STYLE: Final[dict[str, Any]] = {"color": LOST, "linestyle": (0, (1.8, 1.0)), "dash_capstyle": "butt"}
"""How such edges are drawn as lines."""
NO_LONGER: Final = "path, no longer proven free"
"""What the legend calls :data:`LOST`."""
LONG: Final = 6.5
"""Length of the longer side of the axes, in inches."""
THIN: Final = 12.0
"""The largest ratio of the sides that is drawn to scale; beyond it the short side is stretched, as the title says."""


def classes_of(space: MapLike, rotation: Floats | None, layer: tuple[Any, ...] = ()) -> Classes:
    """Classes of the cells of the grid, or of a layer of them, which an index of the grid's arrays picks out.

    At a rotation, shape (size,), or over all of them where none is given.
    """
    ground = ground_of(space.workspace, layer) * np.uint8(space.robot.shape.shown)  # or all of it OPEN
    if rotation is not None:
        return classes_at(ground, space.states_at(rotation)[layer])
    stack = (space.states_at(each)[layer] for each in space.slice_rotations)
    least = most = next(stack)
    for states in stack:
        least, most = np.minimum(least, states), np.maximum(most, states)
    classes = classes_at(ground, least)
    classes[(classes <= ASSUMED) & (most != FREE)] = PARTLY
    return classes


def ground_of(workspace: Workspace | Ground, layer: tuple[Any, ...] = ()) -> Classes:
    """Classes of the cells of a workspace alone: open or obstacle, and known or not."""
    occupied = workspace.outer[layer]
    known = np.where(occupied, np.uint8(OBSTACLE), np.uint8(OPEN))
    if workspace.unknown is None:
        return known
    return np.asarray(
        np.where(workspace.unknown[layer], np.where(occupied, np.uint8(UNSEEN), np.uint8(ASSUMED)), known)
    )


def classes_at(ground: Classes, state: NDArray[np.uint8]) -> Classes:
    """Classes of cells of one slice, of any shape, from those of the workspace alone, and from their states."""
    table = np.empty((len(CLASSES), 3), np.uint8)
    table[:, FREE], table[:, MIXED], table[:, BLOCKED] = HOLLOW, UNDECIDED, COLLIDES
    for number in (UNSEEN, OBSTACLE):
        table[number, [MIXED, BLOCKED]] = number
    for number in (OPEN, ASSUMED):
        table[number, FREE] = number
    return np.asarray(table[ground, state])


def section(grid: Grid, point: Floats, pair: Sequence[int] = (0, 1)) -> tuple[Grid, tuple[Any, ...]]:
    """The grid of two axes of a grid, and the index of the layer of cells along them that holds a point."""
    shown, cell = sorted(pair), grid.cell_of(point).tolist()
    layer = tuple(slice(None) if axis in shown else cell[axis] for axis in range(grid.dim))
    axes, units = ([each[axis] for axis in shown] for each in (grid.axes, grid.units))
    lower, shape = [grid.lower[axis] for axis in shown], [grid.shape[axis] for axis in shown]
    return Grid(lower, grid.spacing, shape, axes, units), layer


def draw_cells(ax: Axes, grid: Grid, classes: Classes, *, turned: bool = False) -> CellImage:
    """Draw the cells of a grid in the plane by their class; its first axis upwards, where they are turned."""
    from matplotlib.colors import to_rgb

    from cspace.plot.cell_image import CellImage

    if turned:
        grid, classes = Grid(grid.lower[::-1], grid.spacing, grid.shape[::-1]), classes.T
    colors = np.array([to_rgb(color) for _, color in CLASSES])
    image = CellImage(ax, classes, np.rint(255.0 * colors).astype(np.uint8), grid)
    ax.add_image(image)
    return image


def cell_legend(classes: Sequence[Classes], space: MapLike, box: Floats, *, several: bool = False) -> list[Any]:
    """Legend entries of the classes that occur, obstacles first, and of what lies outside the grid, if it is in view.

    ``several`` says whether they are over several rotations.
    """
    present = sum(np.bincount(part.ravel(), minlength=len(CLASSES)) for part in classes)
    entries = [
        patch(OVER_ALL.get(number, label) if several else label, color)
        for number, (label, color) in reversed(list(enumerate(CLASSES)))
        if np.asarray(present)[number]
    ]
    label, ground, lines = OUTSIDE
    outside_patch = patch(label, ground, lines, hatch="////")
    outside = (box[0] < space.grid.lower).any() or (box[1] > space.grid.upper).any()
    return entries + [outside_patch] * bool(outside)


def patch(label: str, color: str, edge: str = "#555555", **style: Any) -> Patch:
    """An entry of a legend."""
    from matplotlib.patches import Patch

    return Patch(facecolor=color, edgecolor=edge, linewidth=0.6, label=label, **style)


def draw_path(ax: Axes, points: Floats, width: float = 1.8, lost: Floats | None = None) -> list[Any]:
    """Draw a path by its first two numbers, and its `lost` parts over it; return the legend entries.

    ``lost`` holds the edges that are no longer proven free, as :attr:`Route.lost_parts`.
    """
    lines: list[Any] = []
    if len(points):
        lines += ax.plot(*points[:, :2].T, color=PATH, linewidth=width, label="path", zorder=4)
        lines[0].set(solid_joinstyle="round", path_effects=[halo(width + 1.6)])
    if lost is not None and len(lost):
        # White below the dashes, so that the path itself does not fill their gaps.
        ax.plot(*lost[:, :2].T, color="white", linewidth=1.6 * width + 1.6, label="_", zorder=4.1)
        lines += ax.plot(*lost[:, :2].T, label=NO_LONGER, linewidth=1.6 * width, zorder=4.2, **LOST_STYLE)
    return lines


def halo(width: float, alpha: float = 1.0) -> AbstractPathEffect:
    """White on both sides of a line, so that it shows on any ground."""
    from matplotlib.patheffects import withStroke

    return withStroke(linewidth=width, foreground="white", alpha=alpha)


def draw_robots(ax: Axes, figurine: RobotGlyph, at: Floats, pair: Sequence[int] = (0, 1)) -> list[Any]:
    """Draw the robot at configurations, shape (n, size), as seen in two axes; gives its legend entry.

    In the plane its nose shows where it looks.
    """
    from matplotlib.collections import PathCollection
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    if not len(at) or not figurine.shown:
        return []
    style: dict[str, Any] = {"facecolor": (*to_rgb(ROBOT_FILL), 0.55), "edgecolor": DARK}
    robots = PathCollection([outline(figurine, q, pair) for q in at], linewidths=0.9, zorder=3.0, **style)
    robots.set_transform(ax.transData)
    robots.set_path_effects([halo(2.1, 0.8)])
    ax.add_collection(robots, autolim=False)
    noses = PathCollection([nose(figurine, q) for q in at], linewidths=0.0, zorder=3.1, facecolor=DARK)
    noses.set_transform(ax.transData)
    ax.add_collection(noses, autolim=False)
    return [Patch(linewidth=0.9, label="robot", **style)]


def outline(figurine: RobotGlyph, q: Floats, pair: Sequence[int] = (0, 1)) -> Any:
    """The robot at a configuration as seen in two axes, as a matplotlib path in metres."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(ring, closed=True) for ring in figurine.outlines(q, pair)))


def nose(figurine: RobotGlyph, q: Floats) -> Any:
    """The triangle at the front of a robot that has one, as a matplotlib path in metres."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(ring, closed=True) for ring in figurine.noses(q)))


def draw_marks(
    ax: Axes,
    marks: dict[str, Floats],
    scale: float = 1.0,
    *,
    pair: Sequence[int] = (0, 1),
    rotations: Rotations | None = None,
) -> list[Any]:
    """Draw start and goal as seen in two axes, or three; gives their legend entries.

    An arrow shows the heading, where ``rotations`` says how a configuration holds one.
    """
    looks: dict[str, dict[str, Any]] = {
        "start": {"marker": "o", "markersize": 7.0 * scale, "markerfacecolor": "white"},
        "goal": {"marker": "*", "markersize": 12.0 * scale, "markerfacecolor": GOAL},
    }
    point: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black", "clip_on": False, "zorder": 5}
    handles = []
    for name, q in marks.items():
        place = [[number] for number in q[list(pair)]]
        yaw = None if rotations is None else rotations.heading(q)
        if yaw is not None:
            _draw_heading(ax, place, yaw, looks[name]["markerfacecolor"], scale)
        handles += ax.plot(*place, label=name, **point, **looks[name])
    return handles


def _draw_heading(ax: Axes, place: list[list[float]], yaw: float, color: str, scale: float) -> None:
    """An arrow of fixed size on the paper from a position along a yaw."""
    from matplotlib.markers import MarkerStyle
    from matplotlib.path import Path
    from matplotlib.transforms import Affine2D

    corners = [
        (0.0, 0.09),
        (0.62, 0.09),
        (0.62, 0.28),
        (1.0, 0.0),
        (0.62, -0.28),
        (0.62, -0.09),
        (0.0, -0.09),
        (0.0, 0.09),
    ]
    # A path marker is scaled so that its farthest point lies half a marker's size from its origin.
    arrow = MarkerStyle(Path(corners, closed=True), transform=Affine2D().rotate(yaw))
    look: dict[str, Any] = {"markerfacecolor": color, "markeredgecolor": "black", "markeredgewidth": 0.8}
    ax.plot(*place, marker=arrow, markersize=46.0 * scale, linestyle="none", clip_on=False, zorder=4.9, **look)


def stretches(box: Floats, thin: float = THIN) -> Floats:
    """How much longer a metre along each axis is drawn, shape (d,): 1, but along the short sides of long, thin maps."""
    lengths = box[1] - box[0]
    return np.asarray(np.maximum(1.0, lengths.max() / thin / lengths))


def title(space: MapLike, stretch: Floats, heading: str | None, about: str = "") -> str:
    """The given title, or the robot, the side of a cell and what is shown; where an axis is stretched, it says so."""
    notes = [f"{space.grid.axes[axis]} stretched {stretch[axis]:.3g} times" for axis in np.flatnonzero(stretch != 1.0)]
    if heading is None:
        heading = f"{space.robot.name}, cells of {space.grid.spacing:g} {space.grid.unit}" + (
            f"\n{about}" if about else ""
        )
    return f"{heading}\n({', '.join(notes)})".strip() if notes else heading


def frame(
    ax: Axes,
    box: Floats,
    stretch: Floats,
    pair: Sequence[int] = (0, 1),
    *,
    labels: Sequence[str] | None = None,
    limits: bool = True,
) -> None:
    """Limits, scale and labels of axes that show two axes of a box, and hatching where the map ends.

    Axes that share theirs with others, which have them, need no ``limits``.
    """
    from matplotlib.ticker import MaxNLocator

    if limits:
        ax.set_xlim(*box[:, pair[0]])
        ax.set_ylim(*box[:, pair[1]])
    ax.set_aspect(float(stretch[pair[1]] / stretch[pair[0]]))
    _, ground, lines = OUTSIDE
    ax.patch.set(facecolor=ground, edgecolor=lines, hatch="////", linewidth=0.0)
    drawn = (box[1] - box[0]) * stretch
    for axis, number in zip((ax.xaxis, ax.yaxis), pair, strict=True):
        share = drawn[number] / drawn.max()
        axis.set_major_locator(MaxNLocator(max(1, min(8, math.ceil(12 * share))), steps=[1, 2, 2.5, 5, 10]))
        if labels is not None:
            axis.set_label_text(labels[number])


def new_figure(width: float, height: float, dpi: float = 150.0, *, layout: str | None = "constrained") -> Figure:
    """A figure that belongs to no window, in inches, arranged by matplotlib where a layout is named."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = ConstrainedLayoutEngine(h_pad=0.1, compress=layout == "compressed") if layout else None
    figure = Figure(figsize=(width, height), dpi=dpi, layout=engine)
    FigureCanvasAgg(figure)
    return figure


def drawn_size(box: Floats, long: float = LONG) -> tuple[float, float]:
    """Width and height, in inches, of axes whose longer side is ``long``, of a box's first two axes."""
    drawn = ((box[1] - box[0]) * stretches(box))[:2]
    drawn = drawn * long / drawn.max()
    return float(drawn[0]), float(drawn[1])


def draw_route(ax: Axes, route: Route, scale: float = 1.0, *, robots: bool = True) -> list[Any]:
    """Draw path, robots and marks from above; gives their legend entries."""
    handles = draw_path(ax, route.drawn, 1.8 if robots else 1.2, route.lost_parts)
    if robots:
        handles += draw_robots(ax, route.figurine, route.stations)
    return handles + draw_marks(ax, route.marks, scale, rotations=route.figurine.rotations)


def annotate(
    ax: Axes, space: MapLike, look: Look, stretch: Floats, about: str, handles: Sequence[Any], *, tall: bool = False
) -> None:
    """A title above and a legend below, or beside a tall map; beside the axes where they are the caller's."""
    figure: Any = ax.figure
    heading = title(space, stretch, look.title, about)
    style: dict[str, Any] = {"handles": handles, "fontsize": 9, "frameon": False}
    # A title above narrow axes would leave the figure; above the whole figure it has room.
    if look.ax is None:
        figure.suptitle(heading, fontsize=10)
    else:
        ax.set_title(heading, fontsize=10)
    if not look.legend:
        return
    if look.ax is not None:
        ax.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), borderaxespad=0.0, **style)
    elif tall:
        figure.legend(loc="outside right center", **style)
    else:
        legend_below(figure, handles)


def legend_below(figure: Figure, handles: Sequence[Any], size: float = 9.0) -> None:
    """A legend below all axes of a figure, in as many columns as fit."""
    # Letters are about half the font's size wide, and a sign and its gaps about five sizes.
    widths = [size / 72.0 * (0.55 * len(handle.get_label()) + 5.0) for handle in handles]

    def fits(columns: int) -> bool:
        return bool(sum(map(max, np.array_split(widths, columns))) < 0.95 * figure.get_figwidth())

    columns = next((count for count in range(len(handles), 1, -1) if fits(count)), 1)
    # No more columns than the rows need, so that the last row is not short.
    columns = math.ceil(len(handles) / math.ceil(len(handles) / columns)) if handles else 1
    place: Any = "lower center" if figure.get_layout_engine() is None else "outside lower center"
    figure.legend(handles=handles, loc=place, ncols=columns, fontsize=size, frameon=False)
