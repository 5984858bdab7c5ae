"""Dials: the rotations at one position, as a ring of yaws, or as discs of tilts, one for each of some headings."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from cspace.arrays import MIXED, Floats
from cspace.plot import artists
from cspace.plot.route import Look, MapLike, Route, section_point

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PIXELS: Final = 360
"""Pixels across a dial."""

_REACH: Final = 1.02
"""Half the side of their square; a dial has the radius 1, and its rim is drawn whole."""

_COLUMNS: Final = 3
"""Discs in a row."""


def draw_dials(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw the rotations at one position; as :func:`cspace.plot.plot`. Gives the axes of the first dial."""
    from matplotlib.colors import to_rgba_array

    point, grid = section_point(space, look.at, route), space.grid
    cell = tuple(grid.cell_of(point).tolist())
    rotations = space.rotations
    states = np.array([space.slice_at(each)[cell] for each in space.slice_rotations])[space.slice_of]
    ground, shown = artists.ground_of(space.workspace, cell), []
    dials = rotations.dials(*_places())
    rows = -(-len(dials) // _COLUMNS)
    columns = -(-len(dials) // rows)
    panels = artists.new_figure(2.6 * columns + 0.8, 2.9 * rows + 1.0).subplots(rows, columns, squeeze=False)
    colors = to_rgba_array([color for _, color in artists.CLASSES])
    for ax, dial in zip(panels.flat, dials, strict=True):
        one, other = states[rotations.cells_of(dial.rotations)]
        shown.append(artists.classes_at(ground, np.where(one == MIXED, other, one)))
        picture = np.zeros((*dial.inside.shape, 4))
        picture[dial.inside] = colors[shown[-1]]
        extent = (-_REACH, _REACH, -_REACH, _REACH)
        ax.imshow(picture, extent=extent, origin="lower", interpolation="nearest")
        ax.set_title(dial.title, fontsize=9)
        ax.set_axis_off()
        ax.contour(*_places(), dial.inside, [0.5], colors="black", linewidths=0.7)
        for label, x, y in dial.marks:
            ax.text(x, y, label, fontsize=8, ha="center", va="center", path_effects=[artists.halo(1.6)])
    first: Axes = panels.flat[0]
    place = ", ".join(f"{value + 0.0:.4g}" for value in point)
    handles = artists.cell_legend(shown, space, np.array([grid.lower, grid.upper]))
    artists.annotate(first, space, look, np.ones(grid.dim), f"all rotations at ({place}) m", handles)
    return first


def _places() -> Floats:
    """x and y of the middles of the pixels of a dial, shape (2, n, n)."""
    across = _REACH * ((np.arange(_PIXELS) + 0.5) * 2.0 / _PIXELS - 1.0)
    return np.array(np.meshgrid(across, across))
