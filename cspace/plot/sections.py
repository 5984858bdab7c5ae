"""Three sections of a map in space, arranged as in an engineering drawing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.covering import in_metres
from cspace.errors import InputError
from cspace.grid import Grid, finite
from cspace.plot import artists
from cspace.plot.spatial import (
    AXES,
    Journey,
    busiest,
    extent,
    near_middle,
    silhouette,
    spatial_title,
    stretches,
    within,
)
from cspace.plot.view import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.space import CSpace

_PAGE: Final = (8.0, 7.5)
"""Width and height that the panels share, in inches."""
_MARGINS: Final = (0.75, 0.35, 0.65, 0.6)
"""Left, right, above and below the panels, where labels and titles stand, in inches."""
_GAP: Final = 0.32
"""Least distance of two panels, in inches."""
_HEAD: Final = 0.95
"""Width of a panel's title, in inches."""
_ENTRY: Final = 2.9
"""Width of a legend's entry, in inches."""
_UNDER: Final = 0.55
"""Height of the numbers and the name under a panel, in inches."""
_LEAST: Final = 4.2
"""Least width of the figure, in inches."""
_CUT: Final = "#8c2d2d"


def draw_sections(
    space: CSpace,
    *,
    at: Any,
    path: Any,
    start: Any,
    goal: Any,
    robot_every: float | None,
    legend: bool,
    title: str | None,
) -> Axes:
    """Draw three sections; as :func:`cspace.plot.plot` tells. Gives the axes of the one seen from above."""
    way = Journey.of(space, path, start, goal, robot_every)
    point = _point(space, at, way)
    page = _Page(way.box(space))
    shown = []
    entries: dict[str, Any] = {}
    for across in (2, 1, 0):
        shown.append(_draw_section(page, across, space, point))
        for entry in _draw_journey(page, across, space, way, point):
            entries.setdefault(entry.get_label(), entry)
    page.figure.suptitle(spatial_title(space, page.stretch, title), fontsize=10, y=1.0 - 0.1 / page.height, va="top")
    if legend:
        page.add_legend(artists.cell_legend(shown, over_yaws=False) + list(entries.values()))
    return page.panels[2]


def _point(space: CSpace, at: Any, way: Journey) -> Floats:
    """The point that the sections go through, shape (3,), in the grid."""
    grid = space.grid
    if at is None:
        samples = way.samples()
        if not len(samples):
            return near_middle(space)
        found = busiest(samples, space.robot) if len(way.points) else samples[0]
        return np.clip(found, grid.lower, grid.upper)
    point = finite(at, "at")
    if point.shape != (3,):
        raise InputError(f"at has shape {point.shape}; it must be (3,); pass one point (x, y, z) in metres")
    if not grid.contains(point):
        raise InputError(
            f"at is {in_metres(point)}; it must lie in the grid, from {in_metres(grid.lower)} to "
            f"{in_metres(grid.upper)}; pass a point in there"
        )
    return point


def _draw_section(page: _Page, across: int, space: CSpace, point: Floats) -> NDArray[np.uint8]:
    """Draw the layer of cells that a section runs through, and the traces of the other two; gives the classes."""
    ax, pair, grid = page.panels[across], page.pairs[across], space.grid
    layer = int(grid.cell_of(point)[across])
    occupied, state = (np.asarray(cells.take(layer, across)) for cells in (space.workspace.outer, space.stack[0]))
    classes = artists.classes_at(occupied, state)
    # What is left of the axes stands in the order of the coordinates; a panel may show it the other way round.
    cells = classes if pair[0] < pair[1] else classes.T
    artists.draw_cells(ax, Grid([grid.lower[axis] for axis in pair], grid.spacing, cells.shape), cells)
    trace: dict[str, Any] = {"color": _CUT, "linewidth": 0.8, "linestyle": (0, (9, 2, 1.5, 2)), "zorder": 2}
    for axis, draw in zip(pair, (ax.axvline, ax.axhline), strict=True):
        draw(point[axis], path_effects=[artists.halo(1.8, 0.5)], **trace)
    ax.set_facecolor(artists.beyond(space))
    digits = max(0, 1 + math.ceil(-math.log10(grid.spacing)))
    height = round(point[across], digits) + 0.0  # no minus sign before zero
    ax.set_title(f"{AXES[across]} = {height:.10g} m", loc="left", fontsize=9)
    return classes


def _draw_journey(page: _Page, across: int, space: CSpace, way: Journey, point: Floats) -> list[Any]:
    """Draw path, robots and marks as seen in a section; gives their legend entries."""
    ax, pair = page.panels[across], page.pairs[across]
    low, high = point[across] - extent(space.robot)[::-1, across]
    reaching = way.stations[(low <= way.stations[:, across]) & (way.stations[:, across] <= high)]
    handles = []
    if len(way.points) > 1:
        look: dict[str, Any] = {"color": artists.FAINT, "linewidth": 1.0, "zorder": 3.5}
        far = ax.plot(*way.points[:, pair].T, label="path, away from the section", **look)
        far[0].set_path_effects([artists.halo(2.0, 0.5)])
        near = within(way.points, across, low, high)
        handles += artists.draw_path(ax, near[:, pair]) + far
    handles += artists.draw_robots(ax, silhouette(space.robot, pair), reaching[:, pair])
    return handles + artists.draw_marks(ax, {name: mark[pair] for name, mark in way.marks.items()})


class _Page:
    """A figure with three panels, by the axis that they look along.

    The plan lies at the lower left, seen along z, and the elevation along y stands above it. The one along x stands
    beside that elevation, or, where that draws a flat map larger, lies beside the plan.
    """

    def __init__(self, box: Floats) -> None:
        self.stretch = stretches(box)
        x, y, z = lengths = (box[1] - box[0]) * self.stretch
        scales = [min(_PAGE[0] / width, _PAGE[1] / (y + z)) for width in (x + y, x + z)]
        lies = bool(scales[1] > 1.1 * scales[0])
        x, y, z = (scales[lies] * lengths).tolist()
        self.pairs = {2: [0, 1], 1: [0, 2], 0: [2, 1] if lies else [1, 2]}
        left, right, top, bottom = _MARGINS
        second, above = left + x + max(_GAP, _HEAD - x), bottom + y + _GAP
        self._rectangles = {
            2: (left, bottom, x, y),
            1: (left, above, x, z),
            0: (second, bottom, z, y) if lies else (second, above, y, z),
        }
        self.width = max(second + max(z if lies else y, _HEAD) + right, _LEAST)
        self.height = above + z + top
        # Below the panel that stands, and the numbers under it, there is room.
        self._corner = (second, self.width - second, 0.0 if lies else above - _UNDER)
        self.figure = artists.new_figure(self.width, self.height, arranged=False)
        self.panels: dict[int, Axes] = {}
        shared: dict[int, dict[str, int]] = {2: {}, 1: {"sharex": 2}, 0: {"sharey": 2 if lies else 1}}
        for across, others in shared.items():
            options: dict[str, Any] = {name: self.panels[other] for name, other in others.items()}
            self.panels[across] = self.figure.add_axes((0.0, 0.0, 1.0, 1.0), **options)
            self._label(across, box[:, self.pairs[across]])
        self.panels[1].tick_params(labelbottom=False)
        self.panels[0].tick_params(labelleft=False)
        self.panels[1].set_xlabel("")
        self.panels[0].set_ylabel("")
        self._place(0.0)

    def add_legend(self, handles: list[Any]) -> None:
        """Add a legend in the free corner, or below all panels where it does not fit."""
        style: dict[str, Any] = {"handles": handles, "fontsize": 9, "frameon": False, "borderaxespad": 0.0}
        left, wide, high = self._corner
        if wide >= _ENTRY and high >= artists.ROW * len(handles):
            place = (left / self.width, high / self.height)
            self.figure.legend(loc="upper left", bbox_to_anchor=place, **style)
            return
        self._place(artists.ROW * artists.legend_rows(handles, self.width))
        artists.legend_at_foot(self.figure, handles)

    def _label(self, across: int, view: Floats) -> None:
        """Limits, numbers and names of a panel's axes."""
        from matplotlib.ticker import MaxNLocator

        ax, pair, size = self.panels[across], self.pairs[across], self._rectangles[across][2:]
        ax.set_xlim(*view[:, 0])
        ax.set_ylim(*view[:, 1])
        for axis, length, number in zip((ax.xaxis, ax.yaxis), size, pair, strict=True):
            axis.set_major_locator(MaxNLocator(min(max(1, int(2.0 * length)), 8), steps=[1, 2, 2.5, 5, 10]))
            axis.set_label_text(f"{AXES[number]} (m)", fontsize=9)
        ax.tick_params(labelsize=8)

    def _place(self, below: float) -> None:
        """Put the panels where they belong, with room below them, in inches."""
        self.height = self._rectangles[1][1] + self._rectangles[1][3] + _MARGINS[2] + below
        self.figure.set_size_inches(self.width, self.height)
        for across, (left, bottom, width, height) in self._rectangles.items():
            self.panels[across].set_position(
                (left / self.width, (bottom + below) / self.height, width / self.width, height / self.height)
            )
