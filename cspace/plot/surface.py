"""Pictures in three dimensions: of a map, the faces of its cells that look at the camera, as one surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import Bools, Floats, Ints, Surface, block_starts, reduce_blocks
from cspace.check import check_word, finite
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.plot import artists
from cspace.plot.route import Look, MapLike, RobotGlyph, Route, simplified, with_gaps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SURFACES: Final = {"obstacles": ("obstacle", "#7a7a7a"), "free": ("border of the free space", "#ffffff")}
"""What may be drawn: its name in the legend and its colour."""
UNSEEN: Final = (artists.CLASSES[artists.UNSEEN][0], "#c9a468")
"""Name and colour of unknown cells that count as obstacles."""
CAMERA: Final = (40.0, -62.0)
"""Default elevation and azimuth of the camera, degrees."""
MOST: Final = 20_000
"""Largest number of faces drawn; cells are joined in blocks until there are no more."""
_THIN: Final = 24.0
"""Largest ratio of the sides of a picture that is drawn to scale."""
_WALL: Final = 0.8
"""Share of solid cells from which a layer of cells counts as a wall before the rest."""
_LIGHT: Final = (0.2, 0.32, 0.5)
"""Brightness, above 0.42, that a face gets from its normal along x, y and z."""
_DARKER: Final = 0.2
"""How much darker the lowest faces are than the highest, so that floors and table tops differ."""
_STATIONS: Final = 400
"""Points at which the curve of a path is drawn."""
_FINE: Final = 0.1
"""Longest side of a robot's triangle as a share of the robot: large ones are sorted wrongly among small ones."""
_ROOM: Final = (6.5, 5.5)
"""Largest width and height of what is drawn, inches."""
_SQUARE: Final = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
"""Corners of a face of a cell, in the plane of the face."""


class Painting:
    """Axes in three dimensions, and polygons of four corners in them, sorted together by their distance.

    Parameters
    ----------
    look : Look
    camera : tuple of float
        Elevation and azimuth in degrees, unless ``look`` has them.
    box : ndarray of float64, shape (2, 3)
        Lower and upper corner of what is drawn, metres.
    labels : sequence of str
        Of the axes.

    Attributes
    ----------
    axes : mpl_toolkits.mplot3d.axes3d.Axes3D
        The caller's, or new ones in a figure that fits the picture.
    towards : ndarray of float64, shape (3,)
        Direction to the camera.
    stretch : ndarray of float64, shape (3,)
        Factors by which the axes are stretched.
    handles : dict of str to matplotlib.artist.Artist
        Entries of the legend by their text.

    Raises
    ------
    InputError
        If the caller's axes have two dimensions, or the camera is not two such angles.
    """

    def __init__(
        self, look: Look, camera: tuple[float, float], box: Floats, labels: Sequence[str] = ("x (m)", "y (m)", "z (m)")
    ) -> None:
        if look.ax is not None and getattr(look.ax, "name", None) != "3d":
            advice = 'use figure.add_subplot(projection="3d")'
            raise InputError("ax", "has two dimensions", "a picture in space needs three", advice, value=look.ax)
        angles = np.array(camera) if look.camera is None else finite(look.camera, "camera")
        if angles.shape != (2,) or abs(angles[0]) > 90.0:
            rule = "it must be (elevation, azimuth) in degrees, the elevation from -90 to 90"
            raise InputError("camera", f"is {look.camera!r}", rule, f"pass e.g. {CAMERA}", value=look.camera)
        figure = artists.new_figure(1.0, 1.0, layout=None) if look.ax is None else None
        self.axes: Any = figure.add_subplot(projection="3d", computed_zorder=False) if figure else look.ax
        self.stretch = artists.stretches(box, _THIN)
        self.towards = direction_of(angles) / self.stretch
        self.handles: dict[str, Any] = {}
        self._box = box
        self._parts: list[tuple[Floats, Floats]] = [(np.empty((0, 4, 3)), np.empty((0, 3)))]
        self._collection: Any = None
        self._frame(angles, labels)
        if figure:
            self._fit(angles)

    def add(self, polygons: Floats, color: str, label: str) -> None:
        """Add polygons of one colour, shape (n, 4, 3), and their entry of the legend."""
        self._parts.append((polygons, self._lit(polygons, color)))
        self.handles.setdefault(label, artists.patch(label, color))

    def add_path(self, curve: Floats, lost: Bools, label: str) -> None:
        """Add a path through points, shape (n, 3), as a ribbon, dotted where something hides it.

        Steps no longer proven free, ``lost``, shape (n - 1,), have their own colour and are dashed over everything.
        What leaves the box is not drawn.
        """
        strips = self._ribbon(curve)
        seen = self._contains(strips).all(axis=1)
        curve = np.where(self._contains(curve)[:, np.newaxis], curve, np.nan)
        colors = np.where(lost[:, np.newaxis], _rgb(artists.LOST), _rgb(artists.PATH))
        self._parts.append((strips[seen], colors[seen]))
        style: dict[str, Any] = {"color": artists.PATH, "linewidth": 1.0, "linestyle": (0, (1, 1.5)), "zorder": 4}
        self._plot(curve, label, **style)
        if lost.any():
            self._plot(with_gaps(curve, lost), artists.NO_LONGER, linewidth=2.2, zorder=4.5, **artists.LOST_STYLE)

    def show(self, moving: Floats | None = None) -> None:
        """Draw all polygons, and a robot's, shape (n, 4, 3), in place of those of the call before."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

        parts = self._parts if moving is None else [*self._parts, (moving, self._lit(moving, artists.ROBOT_FILL))]
        polygons, colors = (np.concatenate(each) for each in zip(*parts, strict=True))
        # At the few pixels of an animation, thin edges leave gaps between faces.
        style: dict[str, Any] = {"linewidths": 0.5 if moving is None else 1.0, "rasterized": True, "zorder": 1}
        if self._collection is not None:
            self._collection.remove()
        # One collection, because matplotlib sorts the polygons of a collection, and not those of several.
        self._collection = Poly3DCollection(polygons, facecolors=colors, edgecolors=colors, **style)
        self.axes.add_collection3d(self._collection, autolim=False)

    def _plot(self, line: Floats, label: str, **style: Any) -> None:
        self.handles[label] = self.axes.plot(*line.T, label=label, **style)[0]

    def _contains(self, points: Floats) -> Bools:
        """Return which points, shape (..., 3), lie in the box, but for rounding."""
        slack = 1e-9 * np.ptp(self._box, axis=0)
        return np.asarray(((points >= self._box[0] - slack) & (points <= self._box[1] + slack)).all(axis=-1))

    def _lit(self, polygons: Floats, color: str) -> Floats:
        """Return the colours of faces of one colour, shape (n, 3): by their normals, either way, and their height."""
        normals = np.abs(np.cross(polygons[:, 1] - polygons[:, 0], polygons[:, 2] - polygons[:, 0]))
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
        low, high = self._box[:, 2]
        share = np.clip((polygons[..., 2].mean(axis=1) - low) / (high - low), 0.0, 1.0)
        bright = np.minimum(0.42 + normals @ _LIGHT, 1.0) * (1.0 - _DARKER + _DARKER * share)
        return np.asarray(bright[:, np.newaxis] * _rgb(color))

    def _ribbon(self, points: Floats) -> Floats:
        """Return a line through points, shape (n, 3), as short strips facing the camera, shape (n - 1, 4, 3)."""
        steps, half = np.diff(points, axis=0), 0.004 * float(np.ptp(self._box, axis=0).max())
        aside = np.cross(steps, self.towards)
        aside *= half / np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), np.finfo(float).tiny)
        return np.stack([points[:-1] - aside, points[:-1] + aside, points[1:] + aside, points[1:] - aside], axis=1)

    def _frame(self, angles: Floats, labels: Sequence[str]) -> None:
        """Set limits, scale, labels and the camera."""
        from matplotlib.ticker import MaxNLocator

        ax, box = self.axes, self._box
        lengths = (box[1] - box[0]) * self.stretch
        for axis, name in enumerate("xyz"):
            share = lengths[axis] / lengths.max()
            getattr(ax, f"set_{name}lim")(*box[:, axis])
            getattr(ax, f"set_{name}label")(labels[axis], fontsize=9)
            one = getattr(ax, f"{name}axis")
            one.set_major_locator(MaxNLocator(max(1, min(8, int(10 * share))), steps=[1, 2, 2.5, 5, 10]))
            one.set_pane_color("#f7f7f7")
        ax.tick_params(labelsize=8, pad=2)
        ax.grid(False)
        ax.set_box_aspect(lengths)
        ax.set_proj_type("ortho")
        ax.view_init(*angles)

    def _fit(self, angles: Floats) -> None:
        """Give the figure the size of what is drawn, with room for words above and below."""
        from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]

        ax, lengths, (rise, turn) = self.axes, np.ptp(self._box, axis=0) * self.stretch, np.radians(angles)
        up = [-math.sin(rise) * math.cos(turn), -math.sin(rise) * math.sin(turn), math.cos(rise)]
        spans = np.abs([[-math.sin(turn), math.cos(turn), 0.0], up]) @ lengths
        width, height = spans * min(_ROOM[0] / spans[0], _ROOM[1] / spans[1])
        size = max(width + 1.6, 4.2), height + 2.1
        ax.figure.set_size_inches(*size)
        # Axes in three dimensions are square, and what is drawn lies around their middle.
        square, middle = max(size), 1.15 + height / 2
        corner = 0.5 - square / size[0] / 2, (middle - square / 2) / size[1]
        ax.set_position((*corner, square / size[0], square / size[1]))
        ax.apply_aspect()
        corners = np.stack(np.meshgrid(*self._box.T), axis=-1).reshape(-1, 3)
        across = ax.transData.transform(np.transpose(proj_transform(*corners.T, ax.get_proj())[:2]))[:, 0]
        ax.set_box_aspect(lengths, zoom=float(width * ax.figure.dpi / np.ptp(across)))


def draw_surface(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw in three dimensions; as :func:`cspace.plot.plot`."""
    painting = paint_surface(space, route, look)
    painting.show()
    axes: Axes = painting.axes
    return axes


def paint_surface(space: MapLike, route: Route, look: Look, *, moving: bool = False) -> Painting:
    """Return a picture in three dimensions that is yet to be shown, without the robots if they are ``moving``."""
    surface = look.surface or next(iter(SURFACES))
    check_word(surface, "surface", tuple(SURFACES), "or leave it out")
    box = route.box(space)
    painting = Painting(look, CAMERA, box, space.grid.labels)
    top = _top(space, route, look.cut)
    shows_obstacles = surface == "obstacles"
    solid = space.workspace.outer if shows_obstacles else artists.classes_of(space, look.rotation) >= artists.UNDECIDED
    unknown = space.workspace.unknown if shows_obstacles else None
    faces, is_unknown = border_faces(space.grid, solid, painting.towards, top, unknown)
    for chosen, (label, color) in ((~is_unknown, SURFACES[surface]), (is_unknown, UNSEEN)):
        if chosen.any():
            painting.add(faces[chosen], color, label)
    if shows_obstacles and len(route.stations):
        polygons = robot_polygons(route.figurine)
        placed = [route.figurine.placed(polygons, q) for q in route.stations[: 0 if moving else None]]
        painting.add(np.concatenate([polygons[:0], *placed]), artists.ROBOT_FILL, "robot")
    if len(route.points) > 1:
        lengths = route.figurine.travelled(route.points)
        shares = np.union1d(np.linspace(0.0, 1.0, _STATIONS), lengths / max(lengths[-1], np.finfo(float).tiny))
        lost = steps_at(shares, lengths, route.lost)
        painting.add_path(route.along(shares)[:, :3], lost, "path, dotted behind something")
    handles = [*painting.handles.values(), *artists.draw_marks(painting.axes, route.marks, pair=(0, 1, 2))]
    about = [f"cut at {space.grid.axes[2]} = {top:.4g} {space.grid.units[2]}"] * (top < space.grid.upper[2])
    about += filter(None, [space.rotations.describe(look.rotation)])
    artists.annotate(painting.axes, space, look, painting.stretch, ", ".join(about), handles)
    return painting


def border_faces(
    grid: Grid, solid: Bools, towards: Floats, top: float = math.inf, marked: Bools | None = None
) -> tuple[Floats, Bools]:
    """Return the faces of solid cells that look at a camera far away, and which belong to marked cells.

    Cells are joined in blocks until there are at most :data:`MOST` faces; a block is solid if one of its cells is, and
    marked if all of its solid cells are. Layers at an end of the grid that are mostly solid, walls before the rest, are
    left out, and so are cells wholly above ``top``, metres. ``towards``, shape (3,), is the direction to the camera.

    Returns
    -------
    corners : ndarray of float64, shape (n, 4, 3)
        Metres.
    is_marked : ndarray of bool, shape (n,)
    """
    first, stop = np.zeros(3, dtype=np.int64), np.array(grid.shape)
    if top < grid.upper[2]:
        stop[2] = np.clip(math.ceil((top - grid.lower[2]) / grid.spacing - 1e-9), 1, stop[2])
    for axis in range(3):
        if axis < 2 or stop[2] == grid.shape[2]:  # what the cut lays open is drawn
            peeled = _peeled(np.moveaxis(solid[tuple(map(slice, first, stop))], axis, 0), towards[axis])
            first[axis] += peeled * (towards[axis] < 0.0)
            stop[axis] -= peeled * (towards[axis] > 0.0)
    window = tuple(map(slice, first, stop))
    cells = solid[window]
    plain = cells if marked is None else cells & ~marked[window]
    side = math.ceil(max(cells.shape) / 200)  # more blocks would be smaller than a picture shows
    while True:
        starts = block_starts(cells.shape, side)
        blocks, lattice = _visible(reduce_blocks(cells, starts), towards)
        if len(blocks) <= MOST:
            break
        side = max(side + 1, math.floor(side * math.sqrt(len(blocks) / MOST)))
    corners = grid.lower + grid.spacing * (first + np.minimum(side * lattice, cells.shape))
    return corners, ~reduce_blocks(plain, starts)[tuple(blocks.T)]


def _visible(solid: Bools, towards: Floats) -> tuple[Ints, Ints]:
    """Return the cells, shape (n, 3), and corners, shape (n, 4, 3), of faces that look at the camera."""
    padded, cells, corners = np.pad(solid, 1), [np.empty((0, 3), np.int64)], [np.empty((0, 4, 3), np.int64)]
    for axis in np.flatnonzero(towards):
        side = int(towards[axis] > 0.0)
        ahead = np.roll(padded, 1 - 2 * side, axis)[1:-1, 1:-1, 1:-1]
        cells.append(np.argwhere(solid & ~ahead))
        corners.append(cells[-1][:, np.newaxis] + np.insert(_SQUARE, axis, side, axis=1))
    return np.concatenate(cells), np.concatenate(corners)


def _peeled(layers: Bools, towards: float) -> int:
    """Count the layers at the camera's end that are mostly solid; 0 if they are half of all or more."""
    shares = layers[:: -1 if towards > 0.0 else 1].mean(axis=(1, 2))
    count = int(np.argmin(shares >= _WALL)) if (shares < _WALL).any() else len(shares)
    return count if towards != 0.0 and 2 * count < len(shares) else 0


def _top(space: MapLike, route: Route, cut: float | None) -> float:
    """Return the height above which nothing is drawn."""
    low, high = space.grid.lower[2], space.grid.upper[2]
    if cut is not None:
        height = finite(cut, "cut")
        if height.ndim or not low < height <= high:
            rule = f"it must be one height in the grid, above {low:g} and up to {high:g}"
            raise InputError("cut", f"is {cut!r}", rule, "pass metres", value=cut)
        return float(height)
    if not len(route.points):
        return float(high)
    points = route.points[space.grid.contains(route.points[:, :3])] if route.cut else route.points
    tops = [route.figurine.extent(q)[1, 2] for q in (*route.stations, *points)]
    return float(np.clip(max(tops, default=high), low + space.grid.spacing, high))


def direction_of(angles: Floats) -> Floats:
    """Return the direction to a camera at an elevation and an azimuth in degrees, shape (3,)."""
    rise, turn = np.radians(angles)
    direction = np.array([math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise)])
    return np.asarray(np.round(direction, 12))  # what is zero but for rounding is zero


def robot_polygons(figurine: RobotGlyph) -> Floats:
    """Return the polygons of a robot in its own frame, shape (n, 4, 3)."""
    corners = figurine.triangles.reshape(-1, 3)
    return polygons_of((corners, np.arange(len(corners)).reshape(-1, 3)), _FINE * figurine.size)


def polygons_of(surface: Surface, longest: float, most: int = MOST) -> Floats:
    """Return the triangles of a surface, each with its last corner twice, shape (n, 4, 3).

    A surface of more than ``most`` triangles is simplified first; triangles with sides above ``longest`` are divided.
    """
    from trimesh.remesh import subdivide_to_size

    vertices, faces = subdivide_to_size(*simplified(*surface, most), longest)  # type: ignore[no-untyped-call]
    return np.asarray(vertices[faces][:, [0, 1, 2, 2]])


def steps_at(shares: Floats, lengths: Floats, lost: Bools) -> Bools:
    """Return whether each stretch between shares of a path's length is no longer proven free, shape (n - 1,).

    ``lengths``, shape (m,), are those up to each row, and ``lost``, shape (m - 1,), the steps no longer proven free.
    """
    middles = (shares[:-1] + shares[1:]) / 2.0 * lengths[-1]
    steps = np.clip(np.searchsorted(lengths, middles, side="right") - 1, 0, len(lengths) - 2)
    return lost[steps] if len(lost) else np.zeros(len(steps), dtype=np.bool_)


def _rgb(color: str) -> Floats:
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(color))
