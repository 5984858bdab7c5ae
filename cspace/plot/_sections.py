"""Pictures of cells in the plane: a map from above, and three sections of a map in space."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace._support.arrays import Bools, Floats
from cspace.plot import _artists as artists
from cspace.plot._route import Scene, interpolate_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SECTIONS_INCHES: Final = (7.0, 6.5)
"""Maximum width and height of three sections together, inches."""


def draw_plane(scene: Scene, ax: Axes | None) -> tuple[Axes, list[Any]]:
    """Draw a plane map; return the axes and the legend entries."""
    grid = scene.space.grid
    box = scene.box
    if ax is None:
        width, height = artists.axes_size(box)
        ax = artists.new_figure(max(width + 0.9, 4.2), height + 1.6).add_subplot()
    classes = artists.classify_cells(scene.space, scene.rotation, scene.window)
    artists.frame(ax, box, (0, 1), grid.labels)
    artists.draw_cells(ax, grid, classes, scene.window)
    handles = artists.make_cell_legend(scene, [classes])
    handles += artists.draw_path(ax, scene.points, scene.lost)
    handles += artists.draw_robots(ax, scene.body, scene.stations)
    return ax, handles + artists.draw_marks(ax, scene.marks, rotations=scene.space.rotations)


def draw_sections(scene: Scene) -> tuple[Axes, list[Any]]:
    """Draw three sections of a map in space, seen from above, the front and the right.

    Returns the axes seen from above, and the legend entries.
    """
    # All are drawn to one scale: the plan below the front, and the side to the right of that.
    lengths = scene.box[1] - scene.box[0]
    x, y, z = np.maximum(lengths, lengths.max() / artists.MAX_ASPECT_RATIO)
    max_width, max_height = _SECTIONS_INCHES
    scale = min(max_width / (x + y), max_height / (y + z))
    width = scale * (x + y) + 1.5
    height = scale * (y + z) + 2.5
    figure = artists.new_figure(max(width, 5.0), height)
    cells = figure.add_gridspec(2, 2, width_ratios=(x, y), height_ratios=(z, y))
    plan = figure.add_subplot(cells[1, 0])
    front = figure.add_subplot(cells[0, 0], sharex=plan)
    side = figure.add_subplot(cells[0, 1], sharey=front)
    classes: list[artists.Classes] = []
    entries: dict[str, Any] = {}
    for ax, pair, across in ((plan, (0, 1), 2), (front, (0, 2), 1), (side, (1, 2), 0)):
        classes.append(_draw_section(ax, scene, pair, across))
        for handle in _draw_route(ax, scene, pair, across):
            entries.setdefault(handle.get_label(), handle)
    front.tick_params(labelbottom=False)
    side.tick_params(labelleft=False)
    front.set_xlabel("")
    side.set_ylabel("")
    return plan, artists.make_cell_legend(scene, classes) + list(entries.values())


def _draw_section(ax: Axes, scene: Scene, pair: tuple[int, int], across: int) -> artists.Classes:
    """Draw the cells of a section and lines where the others cut it; return the classes.

    ``pair`` are the axes of the section, and ``across`` is the third axis.
    """
    grid = scene.space.grid
    # Of the window, take the one layer of cells that contains the center.
    layer: list[Any] = list(scene.window)
    layer[across] = int(grid.cell_of(scene.center)[across])
    classes = artists.classify_cells(scene.space, scene.rotation, tuple(layer))
    artists.frame(ax, scene.box, pair, grid.labels)
    artists.draw_cells(ax, grid, classes, scene.window, pair)
    trace: dict[str, Any] = {"color": "black", "linewidth": 0.7, "linestyle": "-.", "zorder": 2}
    ax.axvline(scene.center[pair[0]], **trace)
    ax.axhline(scene.center[pair[1]], **trace)
    # The title gives the place of the section, to a tenth of a cell.
    digits = max(0, 1 + math.ceil(-math.log10(grid.spacing)))
    height = round(float(scene.center[across]), digits) + 0.0  # no minus sign before zero
    name = grid.axes[across]
    unit = grid.units[across]
    ax.set_title(f"{name} = {height:.10g} {unit}", loc="left", fontsize=9)
    ax.tick_params(labelsize=8)
    return classes


def _draw_route(ax: Axes, scene: Scene, pair: tuple[int, int], across: int) -> list[Any]:
    """Draw path, robots and marks in a section; return their legend entries.

    ``pair`` are the axes of the section, and ``across`` is the third axis. The path is faint, and
    the robot is not drawn, where the robot does not reach the section.
    """
    level = scene.center[across]
    body = scene.body

    def meets(points: Floats) -> Bools:
        """Return a mask of the configurations whose robot reaches the section."""
        low, high = body.extents(points)[..., across].T
        return np.asarray((low <= level) & (level <= high))

    handles = artists.draw_path(ax, scene.points, scene.lost, pair, alpha=0.4)
    if len(scene.points) > 1:
        # Draw the path once more, solid, where the robot meets the section.
        handles[0].set_label("path, away from the section")
        shares = np.linspace(0.0, 1.0, artists.CURVE_POINTS)
        points = interpolate_path(body.rotations, scene.points, shares, body.reach)
        near = np.where(meets(points)[:, np.newaxis], points, np.nan)  # NaN makes gaps
        is_lost = np.zeros(len(near) - 1, np.bool_)
        handles = artists.draw_path(ax, near, is_lost, pair) + handles
    handles += artists.draw_robots(ax, body, scene.stations[meets(scene.stations)], pair)
    rotations = scene.space.rotations if across == 2 else None
    return handles + artists.draw_marks(ax, scene.marks, pair, rotations)
