"""A map in space, drawn in three dimensions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import InputError
from cspace.plot import artists, view
from cspace.plot.aim import Aim, Camera, Subject, check_camera, check_cut
from cspace.plot.blocks import Faces
from cspace.plot.spatial import AXES, Journey, extent, spatial_title, stretches, triangles_of
from cspace.plot.view import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from cspace.space import CSpace

SURFACES: Final = {"obstacles": ("obstacle", "#c8c8c8"), "free": ("border of the free space", "#b9dff5")}
"""What may be drawn, its name in the legend and its colour."""
_ROOM: Final = (8.0, 6.5)
"""Width and height of the map in the picture at most, in inches."""
_EDGES: Final = (0.75, 0.45, 0.1)
"""Beside, below and above the map, for numbers and names, in inches."""
_SHARES: Final = (0.74, 0.85, 1.0)
"""Brightness of faces normal to x, y and z."""
_DARKER: Final = 0.14
"""How much darker the lowest faces are than the highest."""
_APART: Final = 5.0
"""Points by which the numbers along z stand farther off for each width that the map is taller than wide."""
_LIGHT: Final = np.array([0.3, -0.5, 0.81])
_SAMPLES: Final = 513
"""Points of a path that are asked whether they are seen."""


def draw_scene(
    space: CSpace,
    *,
    surface: str | None,
    cut: Mapping[str, float] | None,
    camera: Any,
    ax: Any,
    path: Any,
    start: Any,
    goal: Any,
    robot_every: float | None,
    legend: bool,
    title: str | None,
) -> Axes:
    """Draw in three dimensions; as :func:`cspace.plot.plot` tells."""
    surface = next(iter(SURFACES)) if surface is None else surface
    if surface not in SURFACES:
        raise InputError(f"surface is {surface!r}; it must be one of {', '.join(map(repr, SURFACES))}")
    if ax is not None and getattr(ax, "name", None) != "3d":
        raise InputError('ax has two dimensions; view="3d" needs three; use figure.add_subplot(projection="3d")')
    way = Journey.of(space, path, start, goal, robot_every)
    box = way.box(space)
    stretch = stretches(box)
    aim = Aim(space, _subject(space, surface), way, stretch, check_camera(camera), check_cut(space, cut))
    own = ax is None
    if ax is None:
        ax = artists.new_figure(1.0, 1.0, arranged=False).add_subplot(projection="3d", computed_zorder=False)
    _frame(ax, box, stretch, aim.camera)
    handles = _draw_faces(ax, aim.solid.faces(), surface, box)
    handles += _draw_way(ax, aim, way)
    if surface == "obstacles":
        handles += _draw_robots(ax, aim, space, way)
    handles += artists.draw_marks(ax, way.marks)
    words = spatial_title(space, stretch, title)
    if own:
        _fit(ax, box, stretch, aim.camera, words, handles if legend else [])
    else:
        ax.set_title(words, fontsize=10)
        if legend:
            ax.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=9, frameon=False)
    axes: Axes = ax
    return axes


def _subject(space: CSpace, surface: str) -> Subject:
    """What is drawn of a surface."""
    occupied = space.workspace.outer
    if surface == "obstacles":
        classes = np.where(occupied, np.uint8(artists.OBSTACLE), np.uint8(artists.OPEN))
        return Subject(classes, artists.OBSTACLE, extent(space.robot))
    # Around the reference point, the cell that it is in.
    grown = space.grid.spacing * np.array([[-1.0] * 3, [1.0] * 3])
    return Subject(artists.classes_at(occupied, space.stack[0]), artists.UNDECIDED, grown)


def _draw_faces(ax: Any, faces: Faces, surface: str, box: Floats) -> list[Any]:
    """Draw what is solid: cut faces in the colours of their classes; gives the legend entries."""
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

    label, color = SURFACES[surface]
    if not len(faces.corners):
        return []
    kinds = np.array([to_rgb(kind) for _, kind in artists.CLASSES])
    # The lower, the darker: floors and table tops part.
    height = (faces.corners[..., 2].mean(axis=1) - box[0, 2]) / (box[1, 2] - box[0, 2])
    bright = np.array(_SHARES)[faces.axes] * (1.0 - _DARKER + _DARKER * height)
    colors = np.where(faces.cut[:, np.newaxis], kinds[faces.classes], bright[:, np.newaxis] * to_rgb(color))
    # Edges of the same colour close the seams between faces.
    look: dict[str, Any] = {"facecolors": colors, "edgecolors": colors, "linewidths": 0.3, "rasterized": True}
    ax.add_collection3d(Poly3DCollection(faces.corners, zorder=1, **look), autolim=False)
    whole = [] if faces.cut.all() else [Patch(facecolor=color, edgecolor="#555555", linewidth=0.6, label=label)]
    entries = artists.cell_legend([faces.classes[faces.cut]], over_yaws=False)
    for entry in entries:
        entry.set_label(f"{entry.get_label()}, cut")
    return whole + entries


def _draw_way(ax: Any, aim: Aim, way: Journey) -> list[Any]:
    """Draw the path: solid where it is seen, dotted where it is behind something; gives the legend entries."""
    if len(way.points) < 2:
        return []
    travelled = view.travelled(way.points, None)
    shares = np.union1d(np.linspace(0.0, 1.0, _SAMPLES), travelled / max(travelled[-1], np.finfo(float).tiny))
    points = view.along(way.points, shares, None)
    hidden = aim.solid.hides(points)
    dotted = ax.plot(*points.T, color=artists.PATH, linewidth=1.3, linestyle=(0, (1, 1.2)), zorder=3.8)
    dotted[0].set_path_effects([artists.halo(2.4, 0.6)])
    seen = artists.draw_path(ax, np.where(hidden[:, np.newaxis], np.nan, points))
    if not hidden.any():
        return seen
    dotted[0].set_label("path, behind something")
    return seen + list(dotted)


def _draw_robots(ax: Any, aim: Aim, space: CSpace, way: Journey) -> list[Any]:
    """Draw the robot at the stations, faint where it is behind something; gives its legend entry."""
    from matplotlib.colors import to_rgb
    from matplotlib.patches import Patch
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if not len(way.stations):
        return []
    corners = way.stations[:, np.newaxis, np.newaxis] + triangles_of(space.robot)
    corners = corners.reshape(-1, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    # A mesh may be inside out: each face is lit as if it looked at the camera.
    normals *= np.where(normals @ aim.camera.towards < 0.0, -1.0, 1.0)[:, np.newaxis]
    bright = 0.55 + 0.45 * np.clip(normals @ _LIGHT, 0.0, 1.0)
    colors = np.ones((len(corners), 4))
    colors[:, :3] = bright[:, np.newaxis] * to_rgb(artists.BODY)
    colors[aim.solid.hides(corners.mean(axis=1)), 3] = 0.15
    robots = Poly3DCollection(corners, facecolors=colors, edgecolors=colors, linewidths=0.2, zorder=3, rasterized=True)
    ax.add_collection3d(robots, autolim=False)
    return [Patch(facecolor=artists.BODY, linewidth=0.0, label="robot")]


def _frame(ax: Any, box: Floats, stretch: Floats, camera: Camera) -> None:
    """Limits, scale, labels and the camera."""
    from matplotlib.ticker import MaxNLocator

    lengths = (box[1] - box[0]) * stretch
    for axis, name in enumerate(AXES):
        share = lengths[axis] / lengths.max()
        getattr(ax, f"set_{name}lim")(*box[:, axis])
        getattr(ax, f"set_{name}label")(f"{name} (m)", fontsize=9)
        one = getattr(ax, f"{name}axis")
        one.set_major_locator(MaxNLocator(max(1, min(8, int(10 * share))), steps=[1, 2, 2.5, 5, 10]))
        one.set_pane_color("#f7f7f7")
    ax.tick_params(labelsize=8, pad=2)
    # Numbers and names stand off by shares of the other sides, which are short where the box is tall.
    tall = max(0.0, lengths[2] / lengths[:2].max() - 1.0)
    ax.zaxis.set_tick_params(pad=2 + _APART * tall)
    ax.zaxis.labelpad += 2.0 * _APART * tall
    ax.grid(False)
    ax.set_box_aspect(lengths)
    ax.set_proj_type("ortho")
    ax.view_init(camera.elevation, camera.azimuth)


def _fit(ax: Any, box: Floats, stretch: Floats, camera: Camera, words: str, handles: Sequence[Any]) -> None:
    """Give the figure the size of what is drawn, with its title above and its legend below."""
    lengths = (box[1] - box[0]) * stretch
    spans = np.abs(camera.screen) @ lengths
    width, height = spans * min(_ROOM[0] / spans[0], _ROOM[1] / spans[1])
    figure = ax.figure
    beside, under, over = _EDGES
    whole = max(width + 2 * beside, 4.2)
    middle = 0.15 + artists.ROW * artists.legend_rows(handles, whole) + under + height / 2
    tall = middle + height / 2 + over + 0.3 + 0.17 * len(words.splitlines())
    figure.set_size_inches(whole, tall)
    # Axes in three dimensions are square, and what is drawn lies around their middle.
    square = max(whole, tall)
    ax.set_position((0.5 - square / whole / 2, (middle - square / 2) / tall, square / whole, square / tall))
    ax.set_box_aspect(lengths, zoom=_zoom(ax, box, width))
    figure.suptitle(words, fontsize=10, y=1.0 - 0.1 / tall, va="top")
    artists.legend_at_foot(figure, handles)


def _zoom(ax: Any, box: Floats, width: float) -> float:
    """Factor that makes the box as wide as it should be, in inches."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]

    ax.apply_aspect()
    corners = np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3)
    across = ax.transData.transform(np.transpose(proj_transform(*corners.T, ax.get_proj())[:2]))[:, 0]
    return float(width * ax.figure.dpi / np.ptp(across))
