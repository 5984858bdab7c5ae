"""Pictures of cells in the plane: a map from above, and three sections of a map in space."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cspace import Grid
from cspace.inside import Bools, Bytes, Floats
from cspace.plot import _artists as artists
from cspace.plot.scene import PictureContent, classify_cells

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw_plane(scene: PictureContent, ax: Axes | None) -> tuple[Axes, list[Any]]:
    """Draw a plane map; return the axes and the legend entries."""
    grid = scene.space.grid
    box = scene.box
    if ax is None:
        width, height = artists.choose_axes_size(box)
        ax = artists.new_figure(max(width + 0.9, 4.2), height + 1.6).add_subplot()
    layer = find_cells(grid, box)
    classes = classify_cells(scene.space, scene.rotation, layer)
    artists.set_up_axes(ax, box, (0, 1), artists.label_axes(grid))
    artists.draw_cells(ax, grid, classes, first=[cells.start for cells in layer])
    handles = artists.make_cell_legend(scene, [classes])
    handles += artists.draw_path(ax, scene.route.points, scene.route.is_lost)
    handles += artists.draw_robots(ax, scene.body, scene.robots)
    return ax, handles + artists.draw_endpoints(ax, scene.route.endpoints)


def find_cells(grid: Grid, box: Floats) -> tuple[slice, ...]:
    """Return the slice of cells, on each axis, that a box in the plane shows."""
    first, last = (box - grid.lower) / grid.spacing
    low = np.clip(np.floor(first), 0, np.array(grid.shape) - 1).astype(int)
    high = np.clip(np.ceil(last), low + 1, grid.shape).astype(int)
    return tuple(map(slice, low.tolist(), high.tolist()))


def draw_sections(scene: PictureContent) -> tuple[Axes, list[Any]]:
    """Draw three sections of a map in space through a point.

    They are seen from above, the front and the right.

    Returns the axes seen from above, and the legend entries.
    """
    # All are drawn to one scale: the plan below the front, and the side to the right of the front.
    lengths = scene.box[1] - scene.box[0]
    x, y, z = np.maximum(lengths, lengths.max() / artists.MAX_ASPECT_RATIO)
    scale = min(7.0 / (x + y), 6.5 / (y + z))  # inches of all three together
    width = scale * (x + y) + 1.5
    height = scale * (y + z) + 2.5
    figure = artists.new_figure(max(width, 5.0), height)
    cells = figure.add_gridspec(2, 2, width_ratios=(x, y), height_ratios=(z, y))
    plan = figure.add_subplot(cells[1, 0])
    front = figure.add_subplot(cells[0, 0], sharex=plan)
    side = figure.add_subplot(cells[0, 1], sharey=front)
    classes: list[Bytes] = []
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


def _draw_section(ax: Axes, scene: PictureContent, pair: tuple[int, int], across: int) -> Bytes:
    """Draw the cells of a section; return their classes.

    Lines show where the other sections cut it. ``pair`` are the axes of the section, and ``across``
    is the third axis.
    """
    grid = scene.space.grid
    # The section is the layer of cells that contains the center.
    layer: list[Any] = [slice(None)] * grid.dim
    layer[across] = int(grid.cell_of(scene.center)[across])
    classes = classify_cells(scene.space, scene.rotation, tuple(layer))
    artists.set_up_axes(ax, scene.box, pair, artists.label_axes(grid))
    artists.draw_cells(ax, grid, classes, pair)
    trace: dict[str, Any] = {"color": "black", "linewidth": 0.7, "linestyle": "-.", "zorder": 2}
    ax.axvline(scene.center[pair[0]], **trace)
    ax.axhline(scene.center[pair[1]], **trace)
    height = round(float(scene.center[across]), 3) + 0.0  # no minus sign before zero
    name = grid.axes[across]
    unit = grid.units[across]
    ax.set_title(f"{name} = {height:.10g} {unit}", loc="left", fontsize=9)
    ax.tick_params(labelsize=8)
    return classes


def _draw_route(ax: Axes, scene: PictureContent, pair: tuple[int, int], across: int) -> list[Any]:
    """Draw path, robots, start and goal; return legend entries.

    ``pair`` are the axes of the section, and ``across`` is the third axis. The path is faint, and
    the robot is not drawn, where the robot does not reach the section.
    """
    level = scene.center[across]
    body = scene.body
    route = scene.route

    def meets(points: Floats) -> Bools:
        """Return a mask of the configurations whose robot reaches the section."""
        low, high = body.extents(points)[..., across].T
        return np.asarray((low <= level) & (level <= high))

    faint = {"color": artists.FAINT_COLOR, "linestyle": "-", "zorder": 3}
    handles = artists.draw_path(ax, route.points, route.is_lost, pair, **faint)
    if handles:
        # Draw the path once more, solid, where the robot meets the section.
        handles[0].set_label("path, away from the section")
        curve = route.split()
        near = np.where(meets(curve)[:, np.newaxis], curve, np.nan)  # NaN makes gaps
        handles = artists.draw_path(ax, near, route.is_lost, pair) + handles
    handles += artists.draw_robots(ax, body, scene.robots[meets(scene.robots)], pair)
    return handles + artists.draw_endpoints(ax, route.endpoints, pair)
