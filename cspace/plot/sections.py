"""Panels: three sections of a map, slices at some rotations, or all rotations at one position."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import MIXED, Floats, Ints
from cspace.check import check_finite
from cspace.errors import InputError
from cspace.plot import artists
from cspace.plot.route import Look, MapLike, Route, choose_section_point, clip_path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SECTIONS_INCHES: Final = (8.0, 7.5)
"""Maximum width and height of three sections together, inches."""

DEFAULT_PANELS: Final = 6
"""Default number of panels, one a slice."""
_PANELS_INCHES: Final = 9.0
"""Maximum width and height of all panels together, inches."""
_MAX_PANELS: Final = 64
"""Maximum number of panels in a picture."""
_NEAREST_LABEL: Final = "path, in the panel of the nearest rotation"
_MAX_ROTATION_STEP: Final = math.radians(2.0)
"""Maximum rotation between two points of a path for which the nearest panel is computed, radians."""
_DIAL_PIXELS: Final = 360
"""Pixels across the picture of a dial, which is a ring of yaws or a disc of tilts."""
_DIAL_HALF_SIDE: Final = 1.02
"""Half the side of the picture of a dial, whose radius is 1; the margin keeps its rim whole."""
_DIALS_PER_ROW: Final = 3
"""Maximum number of dials in a row."""


def draw_sections(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw three sections, see :func:`cspace.plot.plot`.

    Return the axes of the one seen from above.
    """
    point = choose_section_point(space, look.center, route)
    box = route.box(space)
    stretch = artists.axis_stretch(box, artists.MAX_SOLID_ASPECT_RATIO)
    panels = _panels(box, stretch, space.grid.labels)
    shown: list[artists.Classes] = []
    entries: dict[str, Any] = {}
    for across, (ax, pair) in panels.items():
        shown.append(_draw_layer(ax, pair, across, space, look.rotation, point))
        for entry in _draw_route(ax, pair, across, route, float(point[across])):
            entries.setdefault(entry.get_label(), entry)
    handles = artists.make_cell_legend(shown, space, box, several=look.rotation is None) + list(entries.values())
    artists.annotate(panels[2][0], space, look, stretch, space.rotations.describe(look.rotation), handles)
    return panels[2][0]


def draw_panels(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw a panel for each of some rotations, see :func:`cspace.plot.plot`.

    Return the first axes.
    """
    rotations = space.rotations
    shown = _choose_rotations(space)
    if look.rotation is not None:
        shown = check_finite(look.rotation, "rotation").reshape(-1, len(rotations.names))
    if not 1 <= len(shown) <= _MAX_PANELS:
        rule = f"it must have from 1 to {_MAX_PANELS}"
        raise InputError("rotation", f"has {len(shown)} rotations", rule, "pass a few", value=look.rotation)
    box = route.box(space, robots=False)
    stretch = artists.axis_stretch(box)
    point = choose_section_point(space, look.center, route)
    grid, layer = artists.section(space.grid, point)
    panels = _grid_of_panels(len(shown), box)
    classes: list[artists.Classes] = []
    entries: dict[str, Any] = {}
    shown = np.array([rotations.check_rotation(given) for given in shown])
    for ax, rotation, part in zip(panels.flat, shown, _split_route(space, route, shown), strict=False):
        classes.append(artists.classify_cells(space, rotation, layer))
        artists.draw_cells(ax, grid, classes[-1])
        for entry in artists.draw_route(ax, part, 0.6, robots=False):
            if entry.get_label() == "path" and len(shown) > 1:
                entry.set_label(_NEAREST_LABEL)
            entries.setdefault(entry.get_label(), entry)
        artists.frame(ax, box, stretch, limits=ax is panels[0, 0])
        ax.set_title(rotations.format_rotation(rotation), loc="left", fontsize=9)
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
        first, space, look, stretch, about, artists.make_cell_legend(classes, space, box) + list(entries.values())
    )
    return first


def draw_dials(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw all rotations at one position, see :func:`cspace.plot.plot`.

    Return the first axes.
    """
    from matplotlib.colors import to_rgba_array

    point, grid = choose_section_point(space, look.center, route), space.grid
    cell = tuple(grid.cell_of(point).tolist())
    rotations = space.rotations
    states = np.array([space.states_at(each)[cell] for each in space.slice_rotations])[space.slice_of]
    ground, shown = artists.classify_ground(space.workspace, cell), []
    dials = rotations.make_dials(*_dial_pixels())
    rows = -(-len(dials) // _DIALS_PER_ROW)
    columns = -(-len(dials) // rows)
    panels = artists.new_figure(2.6 * columns + 0.8, 2.9 * rows + 1.0).subplots(rows, columns, squeeze=False)
    colors = to_rgba_array([color for _, color in artists.CLASSES])
    for ax, dial in zip(panels.flat, dials, strict=True):
        first_states, second_states = states[rotations.find_cells(dial.rotations)]
        shown.append(artists.merge_classes(ground, np.where(first_states == MIXED, second_states, first_states)))
        picture = np.zeros((*dial.inside.shape, 4))
        picture[dial.inside] = colors[shown[-1]]
        extent = (-_DIAL_HALF_SIDE, _DIAL_HALF_SIDE, -_DIAL_HALF_SIDE, _DIAL_HALF_SIDE)
        ax.imshow(picture, extent=extent, origin="lower", interpolation="nearest")
        ax.set_title(dial.title, fontsize=9)
        ax.set_axis_off()
        ax.contour(*_dial_pixels(), dial.inside, [0.5], colors="black", linewidths=0.7)
        for label, x, y in dial.marks:
            ax.text(x, y, label, fontsize=8, ha="center", va="center", path_effects=[artists.halo(1.6)])
    first: Axes = panels.flat[0]
    position = ", ".join(f"{value + 0.0:.4g}" for value in point)
    handles = artists.make_cell_legend(shown, space, np.array([grid.lower, grid.upper]))
    artists.annotate(first, space, look, np.ones(grid.dim), f"all rotations at ({position}) m", handles)
    return first


def _panels(box: Floats, stretch: Floats, labels: Sequence[str]) -> dict[int, tuple[Axes, tuple[int, int]]]:
    """Return panels and their pairs of axes, by viewing axis.

    The plan, along z, is at the lower left; the elevation along y is above it. The elevation along x is beside that
    elevation, or, turned, beside the plan, if the panels can then be larger.
    """
    x, y, z = (box[1] - box[0]) * stretch
    scales = [min(_SECTIONS_INCHES[0] / width, _SECTIONS_INCHES[1] / (y + z)) for width in (x + y, x + z)]
    is_turned = bool(scales[1] > 1.1 * scales[0])
    scale, beside = scales[is_turned], z if is_turned else y
    size = max(scale * (x + beside) + 1.5, 5.0), scale * (y + z) + 2.5
    figure = artists.new_figure(*size, layout="compressed")
    cells = figure.add_gridspec(2, 2, width_ratios=(x, beside), height_ratios=(z, y))
    plan = figure.add_subplot(cells[1, 0])
    front = figure.add_subplot(cells[0, 0], sharex=plan)
    side = figure.add_subplot(cells[1, 1], sharey=plan) if is_turned else figure.add_subplot(cells[0, 1], sharey=front)
    panels = {2: (plan, (0, 1)), 1: (front, (0, 2)), 0: (side, (2, 1) if is_turned else (1, 2))}
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
    """Draw the cells of a section and traces of the others.

    Return the classes.
    """
    grid, layer = artists.section(space.grid, point, pair)
    classes = artists.classify_cells(space, rotation, layer)
    artists.draw_cells(ax, grid, classes, turned=pair[0] > pair[1])
    trace: dict[str, Any] = {"color": "black", "linewidth": 0.7, "linestyle": (0, (9, 2, 1.5, 2)), "zorder": 2}
    for axis, draw in zip(pair, (ax.axvline, ax.axhline), strict=True):
        draw(point[axis], path_effects=[artists.halo(1.8, 0.5)], **trace)
    digits = max(0, 1 + math.ceil(-math.log10(grid.spacing)))
    height = round(float(point[across]), digits) + 0.0  # no minus sign before zero
    # Narrow panels need space in the layout for the text; a title would not reserve it.
    style: dict[str, Any] = {"xycoords": "axes fraction", "textcoords": "offset points", "fontsize": 9}
    name, unit = space.grid.axes[across], space.grid.units[across]
    ax.annotate(f"{name} = {height:.10g} {unit}", (0.0, 1.0), (0.0, 5.0), **style)
    return classes


def _draw_route(ax: Axes, pair: tuple[int, int], across: int, route: Route, level: float) -> list[Any]:
    """Draw path, robots and marks in the section at ``level``.

    Return their legend entries.
    """
    handles = []
    if len(route.points) > 1:
        look: dict[str, Any] = {"color": artists.PATH_COLOR, "alpha": 0.45, "linewidth": 1.0, "zorder": 3.5}
        far = ax.plot(*route.points[:, pair].T, label="path, away from the section", **look)
        low, high = level - _robot_reach(route)[::-1, across]
        near = clip_path(route.points, across, low, high)
        handles += artists.draw_path(ax, near[:, pair], lost=route.lost_parts[:, pair]) + far
    extents = [route.glyph.extent(q)[:, across] for q in route.stations]
    reaching = [q for q, (low, high) in zip(route.stations, extents, strict=True) if low <= level <= high]
    handles += artists.draw_robots(ax, route.glyph, np.array(reaching), pair)
    rotations = route.glyph.rotations if across == 2 else None
    return handles + artists.draw_marks(ax, route.marks, pair=pair, rotations=rotations)


def _robot_reach(route: Route) -> Floats:
    """Return the robot's reach along each axis, over the path.

    The result has shape (2, 3).
    """
    reaches = [route.glyph.extent(q) - q[:3] for q in route.interpolate(np.linspace(0.0, 1.0, 65))]
    return np.stack([np.min(reaches, axis=0)[0], np.max(reaches, axis=0)[1]])


def _split_route(space: MapLike, route: Route, shown: Floats) -> list[Route]:
    """Split a route by the nearest rotation of the panels.

    All rotations of a slice count as its panel's rotation. ``shown`` are the rotations of the panels, shape (n, k).
    """
    rotations, slices, dim = space.rotations, space.rotations.assign_slices(space.robot.shape), space.grid.dim
    panel_rotations = [rotations.centers[slices == slices[rotations.find_cells(rotation)]] for rotation in shown]

    def nearest_panel(q: Floats) -> Ints:
        """Return the nearest panel of each configuration.

        The result has shape (n,). Ties go to the first.
        """
        if len(shown) == 1:
            return np.zeros(len(q), dtype=np.int64)
        angles = np.full((len(shown), len(q)), np.inf)
        for nearest, centers in zip(angles, panel_rotations, strict=True):
            for center in centers:
                rotated = np.concatenate([q[:, :dim], np.broadcast_to(center, (len(q), len(center)))], axis=1)
                np.minimum(nearest, np.linalg.norm(rotations.steps_between(q, rotated)[:, dim:], axis=1), out=nearest)
        return np.asarray(angles.argmin(axis=0))

    points, lost = route.points, route.lost
    if len(points) > 1:
        # The robot rotates evenly between two rows, so small steps find where another panel becomes the nearest.
        steps = rotations.steps_between(points[:-1], points[1:])
        counts = np.ceil(np.linalg.norm(steps[:, dim:], axis=1) / _MAX_ROTATION_STEP).astype(np.int64).clip(1)
        step = np.repeat(np.arange(len(counts)), counts)
        share = (np.arange(len(step)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[step]
        rows = rotations.add_steps(points[step], share[:, np.newaxis] * steps[step])
        centers = rotations.add_steps(rows, 0.5 * steps[step] / counts[step, np.newaxis])
        points, lost = np.concatenate([rows, points[-1:]]), lost[step] if len(lost) else lost
        step_panels = nearest_panel(centers)
    mark_panels = {name: int(nearest_panel(q[np.newaxis])[0]) for name, q in route.marks.items()}
    parts = []
    for panel in range(len(shown)):
        marks = {name: q for name, q in route.marks.items() if mark_panels[name] == panel}
        in_panel = step_panels == panel if len(points) > 1 else np.zeros(0, dtype=np.bool_)
        is_lost = lost & in_panel if len(lost) else lost
        parts.append(replace(route, points=points, marks=marks, shown=in_panel, lost=is_lost))
    return parts


def _choose_rotations(space: MapLike) -> Floats:
    """Return at most :data:`DEFAULT_PANELS` rotations with different slices.

    The result has shape (n, k).
    """
    rotations = space.slice_rotations
    count = min(DEFAULT_PANELS, len(rotations))
    return rotations[np.arange(count) * len(rotations) // count]


def _grid_of_panels(count: int, box: Floats) -> Any:
    """Return axes in rows and columns, about twice as wide as high."""
    width, height = artists.axes_size(box, 1.0)

    def misfit(columns: int) -> float:
        rows = math.ceil(count / columns)
        empty = rows * columns - count
        return abs(math.log(columns * (width + 0.1) / (2.0 * rows * (height + 0.15)))) + 0.3 * empty

    columns = min(range(1, min(count, 16) + 1), key=misfit)
    rows = math.ceil(count / columns)
    scale = min(_PANELS_INCHES / (columns * width), _PANELS_INCHES / (rows * height), 3.5)
    size = columns * (max(scale * width, 0.8) + 0.3) + 0.9, rows * (scale * height + 0.4) + 1.3
    return artists.new_figure(max(size[0], 4.2), size[1]).subplots(
        rows, columns, sharex=True, sharey=True, squeeze=False
    )


def _dial_pixels() -> Floats:
    """Return x and y of the pixel centers of a dial.

    The result has shape (2, n, n).
    """
    across = _DIAL_HALF_SIDE * ((np.arange(_DIAL_PIXELS) + 0.5) * 2.0 / _DIAL_PIXELS - 1.0)
    return np.array(np.meshgrid(across, across))
