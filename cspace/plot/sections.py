"""Panels side by side: three sections of a map, layers at some rotations, or all rotations at one position."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import MIXED, Floats, Ints
from cspace.check import finite
from cspace.errors import InputError
from cspace.plot import artists
from cspace.plot.route import Look, MapLike, Route, section_point, within

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_PAGE: Final = (8.0, 7.5)
"""Width and height that the panels share, in inches."""
_THIN: Final = 24.0
"""The largest ratio of the sides of sections that is drawn to scale."""

PANELS: Final = 6
"""How many slices are shown when the caller does not say."""
_WIDE: Final = 9.0
"""Width and height that panels share at most, in inches."""
_MOST: Final = 64
"""Panels that a picture can hold."""
_NEAREST: Final = "path, in the panel of the nearest rotation"
_FINE_TURN: Final = math.radians(2.0)
"""Radians between two points of a path for each of which its panel is looked up."""
_PIXELS: Final = 360
"""Pixels across a dial: a ring of yaws, or a disc of tilts."""
_REACH: Final = 1.02
"""Half the side of their square; a dial has the radius 1, and its rim is drawn whole."""
_COLUMNS: Final = 3
"""Discs in a row."""


def draw_sections(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw three sections; as :func:`cspace.plot.plot`. Gives the axes of the one seen from above."""
    point = section_point(space, look.center, route)
    box = route.box(space)
    stretch = artists.stretches(box, _THIN)
    panels = _panels(box, stretch, space.grid.labels)
    shown: list[artists.Classes] = []
    entries: dict[str, Any] = {}
    for across, (ax, pair) in panels.items():
        shown.append(_draw_layer(ax, pair, across, space, look.rotation, point))
        for entry in _draw_route(ax, pair, across, route, float(point[across])):
            entries.setdefault(entry.get_label(), entry)
    handles = artists.cell_legend(shown, space, box, several=look.rotation is None) + list(entries.values())
    artists.annotate(panels[2][0], space, look, stretch, space.rotations.describe(look.rotation), handles)
    return panels[2][0]


def draw_panels(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw a panel for each of some rotations; as :func:`cspace.plot.plot`. Gives the axes of the first."""
    rotations = space.rotations
    shown = _distinct(space)
    if look.rotation is not None:
        shown = finite(look.rotation, "rotation").reshape(-1, len(rotations.names))
    if not 1 <= len(shown) <= _MOST:
        rule = f"from 1 to {_MOST} panels can be shown"
        raise InputError("rotation", f"gives {len(shown)} rotations", rule, "pass a few", value=look.rotation)
    box = route.box(space, robots=False)
    stretch = artists.stretches(box)
    point = section_point(space, look.center, route)
    grid, layer = artists.section(space.grid, point)
    panels = _grid_of_panels(len(shown), box)
    classes: list[artists.Classes] = []
    entries: dict[str, Any] = {}
    shown = np.array([rotations.checked(given) for given in shown])
    for ax, rotation, part in zip(panels.flat, shown, _parts_of(space, route, shown), strict=False):
        classes.append(artists.classes_of(space, rotation, layer))
        artists.draw_cells(ax, grid, classes[-1])
        for entry in artists.draw_route(ax, part, 0.6, robots=False):
            if entry.get_label() == "path" and len(shown) > 1:
                entry.set_label(_NEAREST)
            entries.setdefault(entry.get_label(), entry)
        artists.frame(ax, box, stretch, limits=ax is panels[0, 0])
        ax.set_title(rotations.text(rotation), loc="left", fontsize=9)
        ax.tick_params(labelsize=8)
    for ax in panels.flat[len(shown) :]:
        ax.remove()
    for column in panels.T:
        last = [ax for ax in column if ax.figure is not None][-1]
        last.set_xlabel(grid.labels[0], fontsize=9)
        last.tick_params(labelbottom=True)
    for ax in panels[:, 0]:
        ax.set_ylabel(grid.labels[1], fontsize=9)
    first: Axes = panels.flat[0]
    about = rotations.describe(None).replace("over all rotations, ", "")
    names = zip(space.grid.axes[2:], point[2:], space.grid.units[2:], strict=True)
    about = ", ".join([about, *(f"{name} = {height:.4g} {unit}" for name, height, unit in names)])
    artists.annotate(
        first, space, look, stretch, about, artists.cell_legend(classes, space, box) + list(entries.values())
    )
    return first


def draw_dials(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw the rotations at one position; as :func:`cspace.plot.plot`. Gives the axes of the first dial."""
    from matplotlib.colors import to_rgba_array

    point, grid = section_point(space, look.center, route), space.grid
    cell = tuple(grid.cell_of(point).tolist())
    rotations = space.rotations
    states = np.array([space.states_at(each)[cell] for each in space.slice_rotations])[space.slice_of]
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


def _panels(box: Floats, stretch: Floats, labels: Sequence[str]) -> dict[int, tuple[Axes, tuple[int, int]]]:
    """Panels and the axes that they show, by the axis that they look along.

    The plan lies at the lower left, seen along z, and the elevation along y stands above it. The one along x stands
    beside that elevation, or, where that draws a flat map larger, lies beside the plan.
    """
    x, y, z = (box[1] - box[0]) * stretch
    scales = [min(_PAGE[0] / width, _PAGE[1] / (y + z)) for width in (x + y, x + z)]
    lies = bool(scales[1] > 1.1 * scales[0])
    scale, beside = scales[lies], z if lies else y
    size = max(scale * (x + beside) + 1.5, 5.0), scale * (y + z) + 2.5
    figure = artists.new_figure(*size, layout="compressed")
    cells = figure.add_gridspec(2, 2, width_ratios=(x, beside), height_ratios=(z, y))
    plan = figure.add_subplot(cells[1, 0])
    front = figure.add_subplot(cells[0, 0], sharex=plan)
    side = figure.add_subplot(cells[1, 1], sharey=plan) if lies else figure.add_subplot(cells[0, 1], sharey=front)
    panels = {2: (plan, (0, 1)), 1: (front, (0, 2)), 0: (side, (2, 1) if lies else (1, 2))}
    for ax, pair in panels.values():
        artists.frame(ax, box, stretch, pair, labels=labels)
        ax.tick_params(labelsize=8)
    front.tick_params(labelbottom=False)
    side.tick_params(labelleft=False)
    front.set_xlabel("")
    side.set_ylabel("")
    return panels


def _draw_layer(
    ax: Axes, pair: tuple[int, int], across: int, space: MapLike, rotation: Floats | None, point: Floats
) -> artists.Classes:
    """Draw the layer of cells that a section runs through, and the traces of the other two; gives the classes."""
    grid, layer = artists.section(space.grid, point, pair)
    classes = artists.classes_of(space, rotation, layer)
    artists.draw_cells(ax, grid, classes, turned=pair[0] > pair[1])
    trace: dict[str, Any] = {"color": "black", "linewidth": 0.7, "linestyle": (0, (9, 2, 1.5, 2)), "zorder": 2}
    for axis, draw in zip(pair, (ax.axvline, ax.axhline), strict=True):
        draw(point[axis], path_effects=[artists.halo(1.8, 0.5)], **trace)
    digits = max(0, 1 + math.ceil(-math.log10(grid.spacing)))
    height = round(float(point[across]), digits) + 0.0  # no minus sign before zero
    # Unlike a title, a text takes room in the layout, which narrow panels need.
    style: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "fontsize": 9}
    name, unit = space.grid.axes[across], space.grid.units[across]
    ax.annotate(f"{name} = {height:.10g} {unit}", (0.0, 1.0), (0.0, 5.0), **style)
    return classes


def _draw_route(ax: Axes, pair: tuple[int, int], across: int, route: Route, place: float) -> list[Any]:
    """Draw path, robots and marks as seen in a section; gives their legend entries."""
    handles = []
    if len(route.points) > 1:
        look: dict[str, Any] = {"color": artists.PATH, "alpha": 0.45, "linewidth": 1.0, "zorder": 3.5}
        far = ax.plot(*route.points[:, pair].T, label="path, away from the section", **look)
        low, high = place - _spread(route)[::-1, across]
        near = within(route.points, across, low, high)
        handles += artists.draw_path(ax, near[:, pair], lost=route.lost_parts[:, pair]) + far
    extents = [route.figurine.extent(q)[:, across] for q in route.stations]
    reaching = [q for q, (low, high) in zip(route.stations, extents, strict=True) if low <= place <= high]
    handles += artists.draw_robots(ax, route.figurine, np.array(reaching), pair)
    rotations = route.figurine.rotations if across == 2 else None
    return handles + artists.draw_marks(ax, route.marks, pair=pair, rotations=rotations)


def _spread(route: Route) -> Floats:
    """How far the robot reaches from its reference point along each axis, anywhere on the path, shape (2, 3)."""
    reaches = [route.figurine.extent(q) - q[:3] for q in route.along(np.linspace(0.0, 1.0, 65))]
    return np.stack([np.min(reaches, axis=0)[0], np.max(reaches, axis=0)[1]])


def _parts_of(space: MapLike, route: Route, shown: Floats) -> list[Route]:
    """Return the part of a route in each panel: where the robot is turned most nearly as the panel shows it.

    Rotations that share a slice are alike. ``shown`` are the rotations of the panels, shape (k, size).
    """
    rotations, slices, dim = space.rotations, space.rotations.slices_for(space.robot.shape), space.grid.dim
    alike = [rotations.centers[slices == slices[rotations.cells_of(rotation)]] for rotation in shown]

    def panel_of(q: Floats) -> Ints:
        """The panels of configurations, shape (n,); of two that are as near, the first."""
        if len(shown) == 1:
            return np.zeros(len(q), dtype=np.int64)
        angles = np.full((len(shown), len(q)), np.inf)
        for nearest, centers in zip(angles, alike, strict=True):
            for center in centers:
                turned = np.concatenate([q[:, :dim], np.broadcast_to(center, (len(q), len(center)))], axis=1)
                np.minimum(nearest, np.linalg.norm(rotations.steps(q, turned)[:, dim:], axis=1), out=nearest)
        return np.asarray(angles.argmin(axis=0))

    points, lost = route.points, route.lost
    if len(points) > 1:
        # Between two rows the robot turns evenly; the path is cut where another panel becomes the nearest.
        steps = rotations.steps(points[:-1], points[1:])
        counts = np.ceil(np.linalg.norm(steps[:, dim:], axis=1) / _FINE_TURN).astype(np.int64).clip(1)
        step = np.repeat(np.arange(len(counts)), counts)
        share = (np.arange(len(step)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[step]
        rows = rotations.moved(points[step], share[:, np.newaxis] * steps[step])
        middles = rotations.moved(rows, 0.5 * steps[step] / counts[step, np.newaxis])
        points, lost = np.concatenate([rows, points[-1:]]), lost[step] if len(lost) else lost
        owners = panel_of(middles)
    ends = {name: int(panel_of(q[np.newaxis])[0]) for name, q in route.marks.items()}
    parts = []
    for number in range(len(shown)):
        marks = {name: q for name, q in route.marks.items() if ends[name] == number}
        own = owners == number if len(points) > 1 else np.zeros(0, dtype=np.bool_)
        is_lost = lost & own if len(lost) else lost
        parts.append(replace(route, points=points, marks=marks, shown=own, lost=is_lost))
    return parts


def _distinct(space: MapLike) -> Floats:
    """Representatives of at most so many rotation cells whose slices differ, spread evenly, shape (n, size)."""
    every = space.slice_rotations
    count = min(PANELS, len(every))
    return every[np.arange(count) * len(every) // count]


def _grid_of_panels(count: int, box: Floats) -> Any:
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


def _places() -> Floats:
    """x and y of the middles of the pixels of a dial, shape (2, n, n)."""
    across = _REACH * ((np.arange(_PIXELS) + 0.5) * 2.0 / _PIXELS - 1.0)
    return np.array(np.meshgrid(across, across))
