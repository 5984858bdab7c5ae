"""Slices of a map with rotations, side by side: one panel for each yaw, shared axes, one legend."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import InputError
from cspace.grid import Grid, finite
from cspace.plot import artists
from cspace.plot.protocols import Floats, MapLike
from cspace.plot.route import Look, Route
from cspace.plot.sections import section_point

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PANELS: Final = 6
"""How many slices are shown when the caller does not say."""
_WIDE: Final = 9.0
"""Width and height that the panels share at most, in inches."""
_MOST: Final = 64
"""Panels that a picture can hold."""


def draw_yaw_panels(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw panels; as :func:`cspace.plot.plot` tells. Gives the axes of the first."""
    angles = _distinct(space) if look.yaw is None else np.atleast_1d(finite(look.yaw, "yaw"))
    if angles.ndim != 1 or not 1 <= len(angles) <= _MOST:
        rule = f"it must be one number or (n,) with n from 1 to {_MOST}, in radians"
        raise InputError("yaw", f"has shape {angles.shape}", rule, "pass a few yaws", value=look.yaw)
    box = route.box(space, robots=False)
    stretch = artists.stretches(box)
    about = artists.about_yaw(space, None).replace("over all yaws, ", "")
    grid = space.grid
    layer: tuple[Any, ...] = ()
    if grid.dim == 3:
        point = section_point(space, look.at, route)
        grid, layer = Grid(grid.lower[:2], grid.spacing, grid.shape[:2]), (..., int(grid.cell_of(point)[2]))
        about += f", z = {point[2]:.4g} m"
    panels = _panels(len(angles), box)
    shown: list[artists.Classes] = []
    handles: list[Any] = []
    for ax, angle in zip(panels.flat, angles.tolist(), strict=False):
        shown.append(artists.classes_of(space, artists.check_yaw(space, angle), layer))
        artists.draw_cells(ax, grid, shown[-1])
        handles = artists.draw_route(ax, space, route, 0.6, robots=False)
        artists.frame(ax, box, stretch, labels=False)
        ax.set_title(f"yaw {artists.degrees(angle)}", loc="left", fontsize=9)
        ax.tick_params(labelsize=8)
    for ax in panels.flat[len(angles) :]:
        ax.remove()
    for column in panels.T:
        last = [ax for ax in column if ax.figure is not None][-1]
        last.set_xlabel("x (m)", fontsize=9)
        last.tick_params(labelbottom=True)
    for ax in panels[:, 0]:
        ax.set_ylabel("y (m)", fontsize=9)
    first: Axes = panels.flat[0]
    handles = artists.cell_legend(shown, False, artists.reaches_out(space, box)) + handles
    artists.add_words(first, look, artists.title(space, stretch, look.title, about), handles)
    return first


def _distinct(space: Any) -> Floats:
    """Middle yaws of at most so many rotation cells whose slices differ, spread evenly, shape (n,)."""
    first = np.sort(np.unique(space._map.slice_of, return_index=True)[1])
    count = min(PANELS, len(first))
    chosen: Floats = space.rotations.centers[first[np.arange(count) * len(first) // count], 0]
    return chosen


def _panels(count: int, box: Floats) -> Any:
    """Axes in rows and columns, in the arrangement nearest to twice as wide as high."""
    width, height = artists.drawn_size(box, 1.0)

    def off(columns: int) -> float:
        rows = math.ceil(count / columns)
        empty = rows * columns - count
        return abs(math.log(columns * (width + 0.1) / (2.0 * rows * (height + 0.15)))) + 0.3 * empty

    columns = min(range(1, min(count, 16) + 1), key=off)
    rows = math.ceil(count / columns)
    scale = min(_WIDE / (columns * width), _WIDE / (rows * height), 3.5)
    size = columns * (max(scale * width, 0.8) + 0.3) + 0.9, rows * (scale * height + 0.4) + 1.3
    return artists.new_figure(max(size[0], 4.2), size[1]).subplots(
        rows, columns, sharex=True, sharey=True, squeeze=False
    )
