"""Artists of a picture: cells, paths, robots, marks, frame and legend. Each colour has one meaning everywhere."""

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

# Classes of cells with their label and colour, the most important last: a pixel that covers many cells shows the
# largest class. Most hues are from Okabe and Ito (2008), safe for the colour-blind; their lightness differs, so that
# they are distinct in grey print too. Only unknown cells are brown.
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
LABELS_OVER_ROTATIONS: Final = {OPEN: "free at every rotation", COLLIDES: "C-obstacle at every rotation"}
"""Labels of classes in a picture of all rotations at once."""

PATH_COLOR: Final = "#6a1b9a"
"""Colour of a path. Purple, even when drawn faint, is not a colour of a map."""
LOST_COLOR: Final = "#ff1493"
"""Colour of the edges of a path that are no longer proven free."""
ROBOT_COLOR: Final = "#009e73"
"""Colour of the trail of a robot."""
ROBOT_FILL_COLOR: Final = "#3fb795"
"""Fill colour of a robot."""
ROBOT_EDGE_COLOR: Final = "#00614a"
"""Colour of a robot's edge and nose."""
GOAL_COLOR: Final = "#cc79a7"
"""Colour of a goal."""
OUTSIDE_STYLE: Final = ("outside the grid", "#f2f2f2", "#c4c4c4")
"""Label, background colour and hatching colour outside the grid."""
LOST_STYLE: Final[dict[str, Any]] = {"color": LOST_COLOR, "linestyle": (0, (1.8, 1.0)), "dash_capstyle": "butt"}
"""Line style of the edges of a path that are no longer proven free."""
LOST_LABEL: Final = "path, no longer proven free"
"""Legend label of the edges of a path that are no longer proven free."""
AXES_INCHES: Final = 6.5
"""Longer side of the axes, inches."""
MAX_ASPECT_RATIO: Final = 12.0
"""Largest ratio of the sides of a plane picture drawn to scale; beyond it, the short side is stretched."""
MAX_SOLID_ASPECT_RATIO: Final = 24.0
"""Largest ratio of the sides of sections and of pictures in three dimensions drawn to scale."""


def classify_cells(space: MapLike, rotation: Floats | None, layer: tuple[Any, ...] = ()) -> Classes:
    """Return the class of each cell at one or all rotations.

    ``rotation`` has shape (k,), or is None for all rotations; ``layer`` is an index into the arrays of the grid.
    """
    ground = classify_ground(space.workspace, layer) * np.uint8(
        space.robot.shape.shown
    )  # all OPEN if the robot is not shown
    if rotation is not None:
        return merge_classes(ground, space.states_at(rotation)[layer])
    slices = (space.states_at(each)[layer] for each in space.slice_rotations)
    lowest = highest = next(slices)
    for states in slices:
        lowest, highest = np.minimum(lowest, states), np.maximum(highest, states)
    classes = merge_classes(ground, lowest)
    classes[(classes <= ASSUMED) & (highest != FREE)] = PARTLY
    return classes


def classify_ground(workspace: Workspace | Ground, layer: tuple[Any, ...] = ()) -> Classes:
    """Return the class of each cell of a workspace without a robot."""
    occupied = workspace.outer[layer]
    known = np.where(occupied, np.uint8(OBSTACLE), np.uint8(OPEN))
    if workspace.unknown is None:
        return known
    return np.asarray(
        np.where(workspace.unknown[layer], np.where(occupied, np.uint8(UNSEEN), np.uint8(ASSUMED)), known)
    )


def merge_classes(ground: Classes, state: NDArray[np.uint8]) -> Classes:
    """Combine classes in the workspace with states of a slice.

    Both arrays have the same shape.
    """
    table = np.empty((len(CLASSES), 3), np.uint8)
    table[:, FREE], table[:, MIXED], table[:, BLOCKED] = HOLLOW, UNDECIDED, COLLIDES
    for index in (UNSEEN, OBSTACLE):
        table[index, [MIXED, BLOCKED]] = index
    for index in (OPEN, ASSUMED):
        table[index, FREE] = index
    return np.asarray(table[ground, state])


def section(grid: Grid, point: Floats, pair: Sequence[int] = (0, 1)) -> tuple[Grid, tuple[Any, ...]]:
    """Return the grid of two axes and the index of a point's layer."""
    shown, cell = sorted(pair), grid.cell_of(point).tolist()
    layer = tuple(slice(None) if axis in shown else cell[axis] for axis in range(grid.dim))
    axes, units = ([each[axis] for axis in shown] for each in (grid.axes, grid.units))
    lower, shape = [grid.lower[axis] for axis in shown], [grid.shape[axis] for axis in shown]
    return Grid(lower, grid.spacing, shape, axes, units), layer


def draw_cells(ax: Axes, grid: Grid, classes: Classes, *, turned: bool = False) -> CellImage:
    """Draw the cells of a plane grid by class.

    The first axis points up if ``turned`` is set.
    """
    from matplotlib.colors import to_rgb

    from cspace.plot.cell_image import CellImage

    if turned:
        grid, classes = Grid(grid.lower[::-1], grid.spacing, grid.shape[::-1]), classes.T
    colors = np.array([to_rgb(color) for _, color in CLASSES])
    image = CellImage(ax, classes, np.rint(255.0 * colors).astype(np.uint8), grid)
    ax.add_image(image)
    return image


def make_cell_legend(classes: Sequence[Classes], space: MapLike, box: Floats, *, several: bool = False) -> list[Any]:
    """Return legend entries of classes, obstacles first, and of the exterior.

    Set ``several`` if the classes are over several rotations.
    """
    present = sum(np.bincount(part.ravel(), minlength=len(CLASSES)) for part in classes)
    entries = [
        patch(LABELS_OVER_ROTATIONS.get(index, label) if several else label, color)
        for index, (label, color) in reversed(list(enumerate(CLASSES)))
        if np.asarray(present)[index]
    ]
    label, ground, lines = OUTSIDE_STYLE
    outside_patch = patch(label, ground, lines, hatch="////")
    outside = (box[0] < space.grid.lower).any() or (box[1] > space.grid.upper).any()
    return entries + [outside_patch] * bool(outside)


def patch(label: str, color: str, edge: str = "#555555", **style: Any) -> Patch:
    """Return a legend entry."""
    from matplotlib.patches import Patch

    return Patch(facecolor=color, edgecolor=edge, linewidth=0.6, label=label, **style)


def draw_path(ax: Axes, points: Floats, width: float = 1.8, lost: Floats | None = None) -> list[Any]:
    """Draw a path from above, with its ``lost`` parts over it.

    Return the legend entries. ``lost`` holds the edges that are no longer proven free, like :attr:`Route.lost_parts`.
    """
    lines: list[Any] = []
    if len(points):
        lines += ax.plot(*points[:, :2].T, color=PATH_COLOR, linewidth=width, label="path", zorder=4)
        lines[0].set(solid_joinstyle="round", path_effects=[halo(width + 1.6)])
    if lost is not None and len(lost):
        # A white line below the dashes keeps the path from filling their gaps.
        ax.plot(*lost[:, :2].T, color="white", linewidth=1.6 * width + 1.6, label="_", zorder=4.1)
        lines += ax.plot(*lost[:, :2].T, label=LOST_LABEL, linewidth=1.6 * width, zorder=4.2, **LOST_STYLE)
    return lines


def halo(width: float, alpha: float = 1.0) -> AbstractPathEffect:
    """Return an effect that adds white on both sides of a line."""
    from matplotlib.patheffects import withStroke

    return withStroke(linewidth=width, foreground="white", alpha=alpha)


def draw_robots(ax: Axes, glyph: RobotGlyph, at: Floats, pair: Sequence[int] = (0, 1)) -> list[Any]:
    """Draw the robot at configurations, projected on two axes.

    ``at`` has shape (n, size). Returns the legend entry. In the plane, a nose shows its heading.
    """
    from matplotlib.collections import PathCollection
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch

    if not len(at) or not glyph.shown:
        return []
    style: dict[str, Any] = {"facecolor": (*to_rgb(ROBOT_FILL_COLOR), 0.55), "edgecolor": ROBOT_EDGE_COLOR}
    robots = PathCollection([outline(glyph, q, pair) for q in at], linewidths=0.9, zorder=3.0, **style)
    robots.set_transform(ax.transData)
    robots.set_path_effects([halo(2.1, 0.8)])
    ax.add_collection(robots, autolim=False)
    noses = PathCollection([nose(glyph, q) for q in at], linewidths=0.0, zorder=3.1, facecolor=ROBOT_EDGE_COLOR)
    noses.set_transform(ax.transData)
    ax.add_collection(noses, autolim=False)
    return [Patch(linewidth=0.9, label="robot", **style)]


def outline(glyph: RobotGlyph, q: Floats, pair: Sequence[int] = (0, 1)) -> Any:
    """Return the projected outline of the robot as a matplotlib path, metres."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(ring, closed=True) for ring in glyph.outlines(q, pair)))


def nose(glyph: RobotGlyph, q: Floats) -> Any:
    """Return the nose of the robot, if any, as a matplotlib path, metres."""
    from matplotlib.path import Path

    return Path.make_compound_path(*(Path(ring, closed=True) for ring in glyph.noses(q)))


def draw_marks(
    ax: Axes,
    marks: dict[str, Floats],
    scale: float = 1.0,
    *,
    pair: Sequence[int] = (0, 1),
    rotations: Rotations | None = None,
) -> list[Any]:
    """Draw start and goal projected on two or three axes.

    Return their legend entries. An arrow shows the heading, if ``rotations`` are given and define one.
    """
    styles: dict[str, dict[str, Any]] = {
        "start": {"marker": "o", "markersize": 7.0 * scale, "markerfacecolor": "white"},
        "goal": {"marker": "*", "markersize": 12.0 * scale, "markerfacecolor": GOAL_COLOR},
    }
    point: dict[str, Any] = {"linestyle": "none", "markeredgecolor": "black", "clip_on": False, "zorder": 5}
    handles = []
    for name, q in marks.items():
        position = [[coordinate] for coordinate in q[list(pair)]]
        yaw = None if rotations is None else rotations.find_yaw(q)
        if yaw is not None:
            _draw_heading(ax, position, yaw, styles[name]["markerfacecolor"], scale)
        handles += ax.plot(*position, label=name, **point, **styles[name])
    return handles


def _draw_heading(ax: Axes, position: list[list[float]], yaw: float, color: str, scale: float) -> None:
    """Draw an arrow from a position along a yaw.

    Its size on paper is fixed.
    """
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
    # Matplotlib scales a path marker so that its farthest point is half the marker size from its origin.
    arrow = MarkerStyle(Path(corners, closed=True), transform=Affine2D().rotate(yaw))
    style: dict[str, Any] = {"markerfacecolor": color, "markeredgecolor": "black", "markeredgewidth": 0.8}
    ax.plot(*position, marker=arrow, markersize=46.0 * scale, linestyle="none", clip_on=False, zorder=4.9, **style)


def axis_stretch(box: Floats, max_ratio: float = MAX_ASPECT_RATIO) -> Floats:
    """Return the scale of each axis, above 1 along short sides only.

    The result has shape (d,). Short sides are stretched until the ratio of the longest to the shortest is at most
    ``max_ratio``.
    """
    lengths = box[1] - box[0]
    return np.asarray(np.maximum(1.0, lengths.max() / max_ratio / lengths))


def title(space: MapLike, stretch: Floats, heading: str | None, about: str = "") -> str:
    """Return the title: the given heading or a default, and the stretched axes.

    The default names the robot and the side of a cell.
    """
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
    """Set limits, scale, labels and hatching of axes for two axes of a box.

    Omit ``limits`` for axes that share limits with other axes.
    """
    from matplotlib.ticker import MaxNLocator

    if limits:
        ax.set_xlim(*box[:, pair[0]])
        ax.set_ylim(*box[:, pair[1]])
    ax.set_aspect(float(stretch[pair[1]] / stretch[pair[0]]))
    _, ground, lines = OUTSIDE_STYLE
    ax.patch.set(facecolor=ground, edgecolor=lines, hatch="////", linewidth=0.0)
    drawn = (box[1] - box[0]) * stretch
    for axis, index in zip((ax.xaxis, ax.yaxis), pair, strict=True):
        share = drawn[index] / drawn.max()
        axis.set_major_locator(MaxNLocator(max(1, min(8, math.ceil(12 * share))), steps=[1, 2, 2.5, 5, 10]))
        if labels is not None:
            axis.set_label_text(labels[index])


def new_figure(width: float, height: float, dpi: float = 150.0, *, layout: str | None = "constrained") -> Figure:
    """Return a figure without a window.

    Sizes are in inches. Matplotlib arranges it if it has a layout.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    engine = ConstrainedLayoutEngine(h_pad=0.1, compress=layout == "compressed") if layout else None
    figure = Figure(figsize=(width, height), dpi=dpi, layout=engine)
    FigureCanvasAgg(figure)
    return figure


def axes_size(box: Floats, longer_side: float = AXES_INCHES) -> tuple[float, float]:
    """Return width and height of axes for the first two axes of a box.

    ``longer_side`` is in inches.
    """
    drawn = ((box[1] - box[0]) * axis_stretch(box))[:2]
    drawn = drawn * longer_side / drawn.max()
    return float(drawn[0]), float(drawn[1])


def draw_route(ax: Axes, route: Route, scale: float = 1.0, *, robots: bool = True) -> list[Any]:
    """Draw path, robots and marks from above; return their legend entries."""
    handles = draw_path(ax, route.drawn, 1.8 if robots else 1.2, route.lost_parts)
    if robots:
        handles += draw_robots(ax, route.glyph, route.stations)
    return handles + draw_marks(ax, route.marks, scale, rotations=route.glyph.rotations)


def annotate(
    ax: Axes, space: MapLike, look: Look, stretch: Floats, about: str, handles: Sequence[Any], *, tall: bool = False
) -> None:
    """Add a title above, and a legend below or beside the axes."""
    figure: Any = ax.figure
    heading = title(space, stretch, look.title, about)
    style: dict[str, Any] = {"handles": handles, "fontsize": 9, "frameon": False}
    # A title may be wider than narrow axes, so new figures have it above all axes.
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
    """Add a legend below a figure, in as many columns as fit."""
    # Letters are about half as wide as the font size; a symbol and its gaps are about five font sizes wide.
    widths = [size / 72.0 * (0.55 * len(handle.get_label()) + 5.0) for handle in handles]

    def fits(columns: int) -> bool:
        return bool(sum(map(max, np.array_split(widths, columns))) < 0.95 * figure.get_figwidth())

    columns = next((count for count in range(len(handles), 1, -1) if fits(count)), 1)
    # Use only the columns that the rows need, so that the last row is not short.
    columns = math.ceil(len(handles) / math.ceil(len(handles) / columns)) if handles else 1
    location: Any = "lower center" if figure.get_layout_engine() is None else "outside lower center"
    figure.legend(handles=handles, loc=location, ncols=columns, fontsize=size, frameon=False)
