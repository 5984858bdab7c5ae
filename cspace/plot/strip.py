"""plot_strip: slices of a map with rotations, side by side."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import InputError
from cspace.grid import finite
from cspace.plot import artists, view
from cspace.plot.picture import save_figure
from cspace.plot.plane import check_yaw, refuse_space

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

    from cspace.rotations import Rotations
    from cspace.space import CSpace

PANELS: Final = 6
"""How many slices are shown when the caller does not say."""
_WIDE: Final = 9.0
"""Width that the panels share, in inches."""
_COLUMNS: Final = 16
_MOST: Final = 64
"""Panels that a picture can hold."""


def plot_strip(
    space: CSpace,
    yaws: ArrayLike | None = None,
    *,
    path: ArrayLike | None = None,
    start: ArrayLike | None = None,
    goal: ArrayLike | None = None,
    legend: bool = True,
    title: str | None = None,
) -> Figure:
    """Draw slices of a map with rotations as small multiples: one panel for each yaw, shared axes, one legend.

    Parameters
    ----------
    space : CSpace
        The map, with rotations.
    yaws : array-like, shape (n,), optional
        Yaws to show, in radians; by default six, spread evenly over those that differ.
    path : array-like, shape (n, 3), or Plan, optional
        A path to draw into every panel.
    start, goal : array-like, shape (3,), optional
        Configurations to mark; where left out and a path is given, its ends.
    legend : bool
        Whether to add a legend below the panels.
    title : str, optional
        By default the robot, the side of a cell and the rotation cells. Pass ``""`` for none.

    Returns
    -------
    matplotlib.figure.Figure
        It belongs to no window; ``figure.axes`` are the panels, in the order of the yaws.

    Raises
    ------
    InputError
        If the map has no rotations, or a yaw, the path or a configuration has the wrong shape or is not finite.
    """
    refuse_space(space, "a strip shows slices at several yaws")
    if space.rotations is None:
        raise InputError(
            "the map has no rotations, so there is one slice; a strip shows slices at several yaws; use plot, or build "
            "the map with rotations"
        )
    angles = distinct_yaws(space, space.rotations) if yaws is None else finite(yaws, "yaws")
    if angles.ndim != 1 or not 1 <= len(angles) <= _MOST:
        raise InputError(f"yaws has shape {angles.shape}; it must be (n,) with n from 1 to {_MOST}; pass a few yaws")
    points = view.polyline(space, path)
    marks = view.marks(space, points, start, goal)
    footprint = view.Footprint(space.robot)
    box = view.box(space, [points, *(q[np.newaxis] for q in marks.values())])
    rows, columns, drawn = _layout(len(angles), box)
    width = columns * (max(drawn[0], 0.5) + 0.3) + 0.9  # with room for the numbers below a narrow panel
    figure = artists.new_figure(max(width, 4.2), rows * (drawn[1] + 0.45) + 1.3)
    panels: Any = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    shown = []
    for ax, angle in zip(panels.flat, angles.tolist(), strict=False):
        shown.append(artists.classes_of(space, check_yaw(space, angle)))
        artists.draw_cells(ax, space.grid, shown[-1])
        handles = artists.draw_path(ax, points, 1.2) + artists.draw_marks(ax, marks, 0.6)
        artists.frame(ax, space, box, labels=False)
        _head(ax, footprint, angle)
    for ax in panels.flat[len(angles) :]:
        ax.remove()
    artists.label_outer(panels)
    figure.suptitle(view.title(space, box, title, None).replace("over all yaws, ", ""), fontsize=10)
    if legend:
        artists.legend_below(figure, artists.cell_legend(shown, over_yaws=False) + handles)
    return figure


def save_strip(
    space: CSpace,
    file: str | os.PathLike[str],
    overwrite: bool = False,
    *,
    yaws: ArrayLike | None = None,
    dpi: float = 150.0,
    **options: Any,
) -> Path:
    """Draw slices of a map with rotations into a file.

    Parameters
    ----------
    space : CSpace
        The map, with rotations.
    file : path-like
        A name that ends in .png, .pdf, .svg or .jpg.
    overwrite : bool
        Whether an existing file may be replaced.
    yaws : array-like, shape (n,), optional
        As for :func:`plot_strip`.
    dpi : float
        Pixels per inch; pictures are about nine inches wide.
    **options
        As for :func:`plot_strip`.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    InputError
        If the suffix is none of these, or as for :func:`plot_strip`.
    FileError
        If the file exists and ``overwrite`` is not set, or cannot be written.
    """
    return save_figure(lambda: plot_strip(space, yaws, **options), file, overwrite, dpi)


def distinct_yaws(space: CSpace, rotations: Rotations, most: int = PANELS) -> view.Floats:
    """Middle yaws of at most ``most`` rotation cells whose slices differ, spread evenly, shape (n,)."""
    first = np.unique(space.slice_of, return_index=True)[1]
    first.sort()
    count = min(most, len(first))
    chosen: view.Floats = rotations.representatives[first[np.arange(count) * len(first) // count]]
    return chosen


def _layout(count: int, box: view.Floats) -> tuple[int, int, tuple[float, float]]:
    """Rows, columns, and the size of a panel in inches: the arrangement nearest to twice as wide as high."""
    shape = artists.drawn_size(box, 1.0)

    def off(columns: int) -> float:
        rows = math.ceil(count / columns)
        empty = rows * columns - count
        return abs(math.log(columns * (shape[0] + 0.1) / (2.0 * rows * (shape[1] + 0.15)))) + 0.3 * empty

    columns = min(range(1, min(count, _COLUMNS) + 1), key=off)
    rows = math.ceil(count / columns)
    scale = min(_WIDE / (columns * shape[0]), _WIDE / (rows * shape[1]), 3.5)
    return rows, columns, (scale * shape[0], scale * shape[1])


def _head(ax: Axes, footprint: view.Footprint, yaw: float) -> None:
    """The yaw above a panel, with the robot so turned, in one size whatever the map's scale."""
    from matplotlib.offsetbox import AnnotationBbox, DrawingArea, HPacker, TextArea
    from matplotlib.patches import PathPatch
    from matplotlib.transforms import Affine2D

    side = 15.0
    turned = Affine2D().scale(0.5 * side / footprint.reach).translate(0.5 * side, 0.5 * side)
    sign = DrawingArea(side, side)
    pose = np.array([0.0, 0.0, yaw])
    body, front = artists.outline(footprint, pose), artists.nose(footprint, pose)
    sign.add_artist(PathPatch(turned.transform_path(body), facecolor="#d9efe8", edgecolor=artists.ROBOT, linewidth=0.9))
    sign.add_artist(PathPatch(turned.transform_path(front), facecolor=artists.ROBOT, linewidth=0.0))
    head = HPacker(
        children=[sign, TextArea(view.degrees(yaw), textprops={"fontsize": 9})], pad=0, sep=4, align="center"
    )
    ax.add_artist(
        AnnotationBbox(
            head,
            (0.0, 1.0),
            xycoords="axes fraction",
            box_alignment=(0.0, -0.15),
            frameon=False,
            pad=0,
            annotation_clip=False,
        )
    )
