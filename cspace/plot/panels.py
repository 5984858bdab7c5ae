"""Slices of a map with rotations, side by side: a panel for each of some rotations, shared axes, one legend."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import InputError
from cspace.grid import finite
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


def draw_panels(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw panels; as :func:`cspace.plot.plot` tells. Gives the axes of the first."""
    rotations = space.rotations
    shown = _distinct(space)
    if look.rotation is not None:
        shown = finite(look.rotation, "rotation").reshape(-1, rotations.dof)
    if not 1 <= len(shown) <= _MOST:
        rule = f"from 1 to {_MOST} panels can be shown"
        raise InputError("rotation", f"tells {len(shown)} rotations", rule, "pass a few", value=look.rotation)
    box = route.box(space, robots=False)
    stretch = artists.stretches(box)
    point = section_point(space, look.at, route)
    grid, layer = artists.seen_from_above(space.grid, point)
    about = artists.about(space, None).replace("over all rotations, ", "")
    about = ", ".join([about, *(f"z = {height:.4g} m" for height in point[2:])])
    panels = _panels(len(shown), box)
    classes: list[artists.Classes] = []
    handles: list[Any] = []
    for ax, given in zip(panels.flat, shown, strict=False):
        rotation = rotations.checked(given)
        classes.append(artists.classes_of(space, rotation, layer))
        artists.draw_cells(ax, grid, classes[-1])
        handles = artists.draw_route(ax, space, route, 0.6, robots=False)
        artists.frame(ax, box, stretch, labels=False)
        ax.set_title(rotations.text(rotation), loc="left", fontsize=9)
        ax.tick_params(labelsize=8)
    for ax in panels.flat[len(shown) :]:
        ax.remove()
    for column in panels.T:
        last = [ax for ax in column if ax.figure is not None][-1]
        last.set_xlabel("x (m)", fontsize=9)
        last.tick_params(labelbottom=True)
    for ax in panels[:, 0]:
        ax.set_ylabel("y (m)", fontsize=9)
    first: Axes = panels.flat[0]
    handles = artists.cell_legend(classes, False, artists.reaches_out(space, box)) + handles
    artists.add_words(first, look, artists.title(space, stretch, look.title, about), handles)
    return first


def _distinct(space: MapLike) -> Floats:
    """Representatives of at most so many rotation cells whose slices differ, spread evenly, shape (n, dof)."""
    first = np.sort(np.unique(space._map.slice_of, return_index=True)[1])
    count = min(PANELS, len(first))
    return np.asarray(space.rotations.centers[first[np.arange(count) * len(first) // count]])


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
