"""thumbnail: a small picture of a map, a workspace, a robot or a plan, for notebooks."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable
from html import escape
from typing import Any, Final

import numpy as np

from cspace.orientation import Unturned
from cspace.plot import artists
from cspace.plot.protocols import Floats
from cspace.plot.route import Figurine

_INCHES: Final = 2.0
"""Longer side of the picture."""
_DPI: Final = 100.0


def thumbnail(subject: Any) -> bytes:
    """A small PNG of a map, a workspace, a robot or a plan, about 200 pixels wide or high, without axes or words.

    In space, maps and workspaces show the layer of cells at half their height, robots their outline from above.

    Parameters
    ----------
    subject : CSpace, Workspace, Robot or Plan

    Returns
    -------
    bytes
        The PNG file.

    Examples
    --------
    >>> import cspace
    >>> thumbnail(cspace.Robot.disc(0.3))[:4]
    b'\\x89PNG'
    """
    if hasattr(subject, "waypoints"):
        box, draw = _plan(subject)
    elif hasattr(subject, "grid"):
        box, draw = _cells(subject)
    else:
        box, draw = _robot(subject)
    figure = artists.new_figure(*artists.drawn_size(box, _INCHES), _DPI, layout=None)
    ax = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_axis_off()
    ax.set_xlim(*box[:, 0])
    ax.set_ylim(*box[:, 1])
    draw(ax)
    file = io.BytesIO()
    figure.canvas.print_figure(file, dpi=_DPI, format="png")
    return file.getvalue()


def as_html(subject: Any, lines: Iterable[str]) -> str:
    """The thumbnail of a map, a workspace, a robot or a plan and some lines of text below it, for notebooks."""
    picture = base64.b64encode(thumbnail(subject)).decode("ascii")
    words = "<br>".join(map(escape, lines))
    return f'<img src="data:image/png;base64,{picture}" alt=""><p>{words}</p>'


def _cells(subject: Any) -> tuple[Floats, Any]:
    """Box and painter of the cells of a map or a workspace."""
    grid = subject.grid
    plane, layer = artists.seen_from_above(grid, np.add(grid.lower, grid.upper) / 2)
    if hasattr(subject, "outer"):
        classes = np.where(subject.outer[layer], np.uint8(artists.OBSTACLE), np.uint8(artists.OPEN))
    else:
        classes = artists.classes_of(subject, None, layer)
    return np.array([plane.lower, plane.upper]), lambda ax: artists.draw_cells(ax, plane, classes)


def _robot(robot: Any) -> tuple[Floats, Any]:
    """Box and painter of a robot's outline, with its reference point."""
    figurine, origin = Figurine(robot, Unturned()), np.zeros((1, robot.dim))

    def draw(ax: Any) -> None:
        artists.draw_robots(ax, figurine, origin)
        ax.plot(0.0, 0.0, marker="+", markersize=10.0, markeredgewidth=1.5, color="black")

    return _around(figurine.extent(origin[0])[:, :2]), draw


def _plan(plan: Any) -> tuple[Floats, Any]:
    """Box and painter of a path, from above."""
    points = np.asarray(plan.path)[:, :2]
    marks = {} if not len(points) else {"start": points[0], "goal": points[-1]}

    def draw(ax: Any) -> None:
        artists.draw_path(ax, points)
        artists.draw_marks(ax, marks, 0.8)

    return _around(points if len(points) else np.zeros((1, 2))), draw


def _around(points: Floats) -> Floats:
    """A box around points with some room, shape (2, 2)."""
    low, high = points.min(axis=0), points.max(axis=0)
    room = 0.12 * max(float((high - low).max()), 1e-9)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, room) + room
    return np.stack([middle - half, middle + half])
