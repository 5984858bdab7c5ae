"""Pictures in three dimensions: the faces of a map's cells that face the camera, as one surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.arrays import Bools, Floats, Ints, Surface, block_starts, reduce_blocks
from cspace.check import check_finite, check_word
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.plot import artists
from cspace.plot.route import Look, MapLike, RobotGlyph, Route, simplify_surface, with_gaps

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SURFACES: Final = {"obstacles": ("obstacle", "#7a7a7a"), "free": ("border of the free space", "#ffffff")}
"""Legend label and colour of each surface that can be drawn."""
UNKNOWN_SURFACE: Final = (artists.CLASSES[artists.UNSEEN][0], "#c9a468")
"""Legend label and colour of unknown cells that count as obstacles."""
DEFAULT_CAMERA: Final = (40.0, -62.0)
"""Default elevation and azimuth of the camera, degrees."""
MAX_FACES: Final = 20_000
"""Maximum number of faces drawn; cells are merged into blocks to reach it."""
_MIN_WALL_SHARE: Final = 0.8
"""Minimum share of solid cells in a layer of cells that counts as a wall in front of the map."""
_NORMAL_BRIGHTNESS: Final = (0.2, 0.32, 0.5)
"""Brightness added to 0.42 for the components of a face's normal along x, y and z."""
_FLOOR_DARKENING: Final = 0.2
"""Share by which the lowest faces are darker than the highest, so that floors and table tops differ."""
_CURVE_POINTS: Final = 400
"""Number of points on the curve of a path."""
_MAX_ROBOT_EDGE_SHARE: Final = 0.1
"""Longest edge of a triangle as a share of the robot's size; matplotlib sorts large triangles wrongly."""
_MAX_PICTURE_INCHES: Final = (6.5, 5.5)
"""Maximum width and height of the picture without text, inches."""
_FACE_CORNERS: Final = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
"""Corners of a cell's face, in the plane of the face."""


class Painting:
    """Three-dimensional axes with polygons that are sorted together.

    Parameters
    ----------
    look : Look
    camera : tuple of float
        Default elevation and azimuth, degrees.
    box : ndarray of float64, shape (2, 3)
        Lower and upper corner of the picture, metres.
    labels : sequence of str
        Labels of the axes.

    Attributes
    ----------
    axes : mpl_toolkits.mplot3d.axes3d.Axes3D
        The caller's axes, or new ones in a figure of the right size.
    towards : ndarray of float64, shape (3,)
        Direction to the camera.
    stretch : ndarray of float64, shape (3,)
        Factors by which the axes are stretched.
    handles : dict of str to matplotlib.artist.Artist
        Legend entries by label.

    Raises
    ------
    InputError
        If the caller's axes have two dimensions, or if the camera is not a valid pair of angles.
    """

    def __init__(
        self, look: Look, camera: tuple[float, float], box: Floats, labels: Sequence[str] = ("x (m)", "y (m)", "z (m)")
    ) -> None:
        if look.ax is not None and getattr(look.ax, "name", None) != "3d":
            hint = 'use figure.add_subplot(projection="3d")'
            raise InputError("ax", "has two dimensions", "it must have three", hint, value=look.ax)
        angles = np.array(camera) if look.camera is None else check_finite(look.camera, "camera")
        if angles.shape != (2,) or abs(angles[0]) > 90.0:
            rule = "it must be (elevation, azimuth), degrees, with an elevation from -90 to 90"
            raise InputError("camera", f"is {look.camera!r}", rule, f"pass e.g. {DEFAULT_CAMERA}", value=look.camera)
        figure = artists.new_figure(1.0, 1.0, layout=None) if look.ax is None else None
        self.axes: Any = figure.add_subplot(projection="3d", computed_zorder=False) if figure else look.ax
        self.stretch = artists.axis_stretch(box, artists.MAX_SOLID_ASPECT_RATIO)
        self.towards = camera_direction(angles) / self.stretch
        self.handles: dict[str, Any] = {}
        self._box = box
        self._parts: list[tuple[Floats, Floats]] = [(np.empty((0, 4, 3)), np.empty((0, 3)))]
        self._collection: Any = None
        self._frame(angles, labels)
        if figure:
            self._fit(angles)

    def add(self, polygons: Floats, color: str, label: str) -> None:
        """Add polygons of one colour, (n, 4, 3), and their legend entry."""
        self._parts.append((polygons, self._shade(polygons, color)))
        self.handles.setdefault(label, artists.patch(label, color))

    def add_path(self, curve: Floats, lost: Bools, label: str) -> None:
        """Add a path, shape (n, 3), whose hidden parts are dotted.

        ``lost``, shape (n - 1,), marks the steps that are no longer proven free: their dashes are never hidden. Parts
        outside the box are omitted.
        """
        strips = self._make_ribbon(curve)
        inside = self._contains(strips).all(axis=1)
        curve = np.where(self._contains(curve)[:, np.newaxis], curve, np.nan)
        colors = np.where(lost[:, np.newaxis], _parse_color(artists.LOST_COLOR), _parse_color(artists.PATH_COLOR))
        self._parts.append((strips[inside], colors[inside]))
        style: dict[str, Any] = {"color": artists.PATH_COLOR, "linewidth": 1.0, "linestyle": (0, (1, 1.5)), "zorder": 4}
        self._plot(curve, label, **style)
        if lost.any():
            self._plot(with_gaps(curve, lost), artists.LOST_LABEL, linewidth=2.2, zorder=4.5, **artists.LOST_STYLE)

    def show(self, moving: Floats | None = None) -> None:
        """Draw all polygons.

        Those of a robot are drawn too, if given. Polygons of the last call are replaced.
        """
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

        parts = (
            self._parts if moving is None else [*self._parts, (moving, self._shade(moving, artists.ROBOT_FILL_COLOR))]
        )
        polygons, colors = (np.concatenate(each) for each in zip(*parts, strict=True))
        # Thin edges would leave gaps between faces at the low resolution of an animation.
        style: dict[str, Any] = {"linewidths": 0.5 if moving is None else 1.0, "rasterized": True, "zorder": 1}
        if self._collection is not None:
            self._collection.remove()
        # One collection only, because matplotlib does not sort the polygons of several collections together.
        self._collection = Poly3DCollection(polygons, facecolors=colors, edgecolors=colors, **style)
        self.axes.add_collection3d(self._collection, autolim=False)

    def _plot(self, line: Floats, label: str, **style: Any) -> None:
        self.handles[label] = self.axes.plot(*line.T, label=label, **style)[0]

    def _contains(self, points: Floats) -> Bools:
        """Return a mask of the points, shape (..., 3), in the box, up to rounding."""
        slack = 1e-9 * np.ptp(self._box, axis=0)
        return np.asarray(((points >= self._box[0] - slack) & (points <= self._box[1] + slack)).all(axis=-1))

    def _shade(self, polygons: Floats, color: str) -> Floats:
        """Return shades of faces, shape (n, 3), by normal and height."""
        normals = np.abs(np.cross(polygons[:, 1] - polygons[:, 0], polygons[:, 2] - polygons[:, 0]))
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
        low, high = self._box[:, 2]
        share = np.clip((polygons[..., 2].mean(axis=1) - low) / (high - low), 0.0, 1.0)
        bright = np.minimum(0.42 + normals @ _NORMAL_BRIGHTNESS, 1.0) * (
            1.0 - _FLOOR_DARKENING + _FLOOR_DARKENING * share
        )
        return np.asarray(bright[:, np.newaxis] * _parse_color(color))

    def _make_ribbon(self, points: Floats) -> Floats:
        """Return a line, shape (n, 3), as strips facing the camera.

        The result has shape (n - 1, 4, 3).
        """
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
            axis_artist = getattr(ax, f"{name}axis")
            axis_artist.set_major_locator(MaxNLocator(max(1, min(8, int(10 * share))), steps=[1, 2, 2.5, 5, 10]))
            axis_artist.set_pane_color("#f7f7f7")
        ax.tick_params(labelsize=8, pad=2)
        ax.grid(False)
        ax.set_box_aspect(lengths)
        ax.set_proj_type("ortho")
        ax.view_init(*angles)

    def _fit(self, angles: Floats) -> None:
        """Fit the size of the figure to picture and text."""
        from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]

        ax, lengths, (elevation, azimuth) = self.axes, np.ptp(self._box, axis=0) * self.stretch, np.radians(angles)
        up = [-math.sin(elevation) * math.cos(azimuth), -math.sin(elevation) * math.sin(azimuth), math.cos(elevation)]
        spans = np.abs([[-math.sin(azimuth), math.cos(azimuth), 0.0], up]) @ lengths
        width, height = spans * min(_MAX_PICTURE_INCHES[0] / spans[0], _MAX_PICTURE_INCHES[1] / spans[1])
        size = max(width + 1.6, 4.2), height + 2.1
        ax.figure.set_size_inches(*size)
        # Axes in three dimensions are square, and the picture is around their center.
        square, center = max(size), 1.15 + height / 2
        corner = 0.5 - square / size[0] / 2, (center - square / 2) / size[1]
        ax.set_position((*corner, square / size[0], square / size[1]))
        ax.apply_aspect()
        corners = np.stack(np.meshgrid(*self._box.T), axis=-1).reshape(-1, 3)
        across = ax.transData.transform(np.transpose(proj_transform(*corners.T, ax.get_proj())[:2]))[:, 0]
        ax.set_box_aspect(lengths, zoom=float(width * ax.figure.dpi / np.ptp(across)))


def draw_surface(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw a map in three dimensions; see :func:`cspace.plot.plot`."""
    painting = paint_surface(space, route, look)
    painting.show()
    axes: Axes = painting.axes
    return axes


def paint_surface(space: MapLike, route: Route, look: Look, *, moving: bool = False) -> Painting:
    """Return a three-dimensional picture that is not shown yet.

    Omit the robots if they are ``moving``.
    """
    surface = look.surface or next(iter(SURFACES))
    check_word(surface, "surface", tuple(SURFACES), "or leave it out")
    box = route.box(space)
    painting = Painting(look, DEFAULT_CAMERA, box, space.grid.labels)
    top = _choose_top(space, route, look.cut)
    shows_obstacles = surface == "obstacles"
    solid = (
        space.workspace.outer if shows_obstacles else artists.classify_cells(space, look.rotation) >= artists.UNDECIDED
    )
    unknown = space.workspace.unknown if shows_obstacles else None
    faces, is_unknown = border_faces(space.grid, solid, painting.towards, top, unknown)
    for chosen, (label, color) in ((~is_unknown, SURFACES[surface]), (is_unknown, UNKNOWN_SURFACE)):
        if chosen.any():
            painting.add(faces[chosen], color, label)
    if shows_obstacles and len(route.stations):
        polygons = robot_polygons(route.glyph)
        placed = [route.glyph.transform(polygons, q) for q in route.stations[: 0 if moving else None]]
        painting.add(np.concatenate([polygons[:0], *placed]), artists.ROBOT_FILL_COLOR, "robot")
    if len(route.points) > 1:
        lengths = route.glyph.path_lengths(route.points)
        shares = np.union1d(np.linspace(0.0, 1.0, _CURVE_POINTS), lengths / max(lengths[-1], np.finfo(float).tiny))
        lost = find_lost_stretches(shares, lengths, route.lost)
        painting.add_path(route.interpolate(shares)[:, :3], lost, "path, dotted behind something")
    handles = [*painting.handles.values(), *artists.draw_marks(painting.axes, route.marks, pair=(0, 1, 2))]
    about = [f"cut at {space.grid.axes[2]} = {top:.4g} {space.grid.units[2]}"] * (top < space.grid.upper[2])
    about += filter(None, [space.rotations.describe(look.rotation)])
    artists.annotate(painting.axes, space, look, painting.stretch, ", ".join(about), handles)
    return painting


def border_faces(
    grid: Grid, solid: Bools, towards: Floats, top: float = math.inf, marked: Bools | None = None
) -> tuple[Floats, Bools]:
    """Return the faces towards a camera and a mask of marked ones.

    Cells are merged into blocks until there are at most :data:`MAX_FACES` faces. A block is solid if any of its cells
    is, and marked if all of its solid cells are. Walls (mostly solid layers at an end of the grid) in front of the map
    are omitted, and so are cells above ``top``, metres. ``towards``, shape (3,), is the direction to the camera.

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
        if axis < 2 or stop[2] == grid.shape[2]:  # a layer opened by the cut is not a wall
            layers = _count_wall_layers(np.moveaxis(solid[tuple(map(slice, first, stop))], axis, 0), towards[axis])
            first[axis] += layers * (towards[axis] < 0.0)
            stop[axis] -= layers * (towards[axis] > 0.0)
    window = tuple(map(slice, first, stop))
    cells = solid[window]
    plain = cells if marked is None else cells & ~marked[window]
    side = math.ceil(max(cells.shape) / 200)  # smaller blocks would be invisible in a picture
    while True:
        starts = block_starts(cells.shape, side)
        blocks, lattice = _visible_faces(reduce_blocks(cells, starts), towards)
        if len(blocks) <= MAX_FACES:
            break
        side = max(side + 1, math.floor(side * math.sqrt(len(blocks) / MAX_FACES)))
    corners = grid.lower + grid.spacing * (first + np.minimum(side * lattice, cells.shape))
    return corners, ~reduce_blocks(plain, starts)[tuple(blocks.T)]


def _visible_faces(solid: Bools, towards: Floats) -> tuple[Ints, Ints]:
    """Return cells, (n, 3), and corners, (n, 4, 3), of faces towards the camera."""
    padded, cells, corners = np.pad(solid, 1), [np.empty((0, 3), np.int64)], [np.empty((0, 4, 3), np.int64)]
    for axis in np.flatnonzero(towards):
        side = int(towards[axis] > 0.0)
        ahead = np.roll(padded, 1 - 2 * side, axis)[1:-1, 1:-1, 1:-1]
        cells.append(np.argwhere(solid & ~ahead))
        corners.append(cells[-1][:, np.newaxis] + np.insert(_FACE_CORNERS, axis, side, axis=1))
    return np.concatenate(cells), np.concatenate(corners)


def _count_wall_layers(layers: Bools, towards: float) -> int:
    """Count the mostly solid layers at the camera's end.

    Return 0 if they are half of all layers or more.
    """
    shares = layers[:: -1 if towards > 0.0 else 1].mean(axis=(1, 2))
    count = int(np.argmin(shares >= _MIN_WALL_SHARE)) if (shares < _MIN_WALL_SHARE).any() else len(shares)
    return count if towards != 0.0 and 2 * count < len(shares) else 0


def _choose_top(space: MapLike, route: Route, cut: float | None) -> float:
    """Return the height above which nothing is drawn, metres."""
    low, high = space.grid.lower[2], space.grid.upper[2]
    if cut is not None:
        height = check_finite(cut, "cut")
        if height.ndim or not low < height <= high:
            rule = f"it must be one height above {low:g} and up to {high:g}"
            raise InputError("cut", f"is {cut!r}", rule, "pass metres", value=cut)
        return float(height)
    if not len(route.points):
        return float(high)
    points = route.points[space.grid.contains(route.points[:, :3])] if route.cut else route.points
    tops = [route.glyph.extent(q)[1, 2] for q in (*route.stations, *points)]
    return float(np.clip(max(tops, default=high), low + space.grid.spacing, high))


def camera_direction(angles: Floats) -> Floats:
    """Return the direction to a camera; angles are in degrees.

    The result has shape (3,).
    """
    elevation, azimuth = np.radians(angles)
    flat = math.cos(elevation)
    direction = np.array([flat * math.cos(azimuth), flat * math.sin(azimuth), math.sin(elevation)])
    return np.asarray(np.round(direction, 12))  # zero components are exactly zero


def robot_polygons(glyph: RobotGlyph) -> Floats:
    """Return the polygons of a robot in its own frame.

    The result has shape (n, 4, 3).
    """
    corners = glyph.triangles.reshape(-1, 3)
    return split_into_polygons((corners, np.arange(len(corners)).reshape(-1, 3)), _MAX_ROBOT_EDGE_SHARE * glyph.size)


def split_into_polygons(surface: Surface, longest: float, max_faces: int = MAX_FACES) -> Floats:
    """Return the triangles of a surface as polygons of four corners.

    The result has shape (n, 4, 3). The surface is first simplified to at most ``max_faces`` triangles; edges above
    ``longest`` are then subdivided.
    """
    from trimesh.remesh import subdivide_to_size

    vertices, faces = subdivide_to_size(*simplify_surface(*surface, max_faces), longest)  # type: ignore[no-untyped-call]
    return np.asarray(vertices[faces][:, [0, 1, 2, 2]])


def find_lost_stretches(shares: Floats, lengths: Floats, lost: Bools) -> Bools:
    """Return a mask of stretches of a path no longer proven free.

    The result has shape (n - 1,). ``lengths``, shape (m,), is the path length up to each row. ``lost``, shape (m - 1,),
    marks the steps of the path that are no longer proven free.
    """
    centers = (shares[:-1] + shares[1:]) / 2.0 * lengths[-1]
    steps = np.clip(np.searchsorted(lengths, centers, side="right") - 1, 0, len(lengths) - 2)
    return lost[steps] if len(lost) else np.zeros(len(steps), dtype=np.bool_)


def _parse_color(color: str) -> Floats:
    """Return red, green and blue from 0 to 1."""
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(color))
