"""Pictures in three dimensions, and of a map the faces of its cells that look at the camera, as one surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats, Ints, block_starts, in_blocks
from cspace.check import check_word, finite
from cspace.errors import InputError
from cspace.grid import Grid
from cspace.plot import artists
from cspace.plot.route import Figurine, Look, MapLike, Route, within

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SURFACES: Final = {"obstacles": ("obstacle", "#7a7a7a"), "free": ("border of the free space", "#ffffff")}
"""What may be drawn, its name in the legend and its colour in full light: dark as obstacles, white as free space."""
UNSEEN: Final = (artists.CLASSES[artists.UNSEEN][0], "#c9a468")
"""The same of obstacles that nothing is known of."""
CAMERA: Final = (40.0, -62.0)
"""Elevation and azimuth in degrees where the caller does not say."""
MOST: Final = 20_000
"""Faces that are drawn at most; cells are joined in blocks until there are no more."""
_THIN: Final = 24.0
_WALL: Final = 0.8
"""The part of a layer of cells from which on it is a wall before the rest."""
_SHARES: Final = (0.68, 0.82, 1.0)
"""Brightness of faces normal to x, y and z."""
_DARKER: Final = 0.2
"""How much darker the lowest faces are than the highest: floors and table tops part."""
_ROOM: Final = (6.5, 5.5)
"""Width and height of the map in the picture at most, in inches."""


class Faces(NamedTuple):
    """Faces of blocks of cells.

    Attributes
    ----------
    corners : ndarray of float64, shape (n, 4, 3)
        Metres.
    axes : ndarray of int64, shape (n,)
        The axis that each is normal to.
    marked : ndarray of bool, shape (n,)
        Whether all solid cells of its block are marked.
    """

    corners: Floats
    axes: Ints
    marked: Bools


class Painting:
    """Polygons of four corners in three dimensions, sorted together by their distance from the camera.

    ``polygons``, each of shape (n, 4, 3), have colours, each of shape (n, 3). Those that :meth:`move` adds are replaced
    by its next call.
    """

    def __init__(self, ax: Any, polygons: Sequence[Floats], colors: Sequence[Floats], towards: Floats) -> None:
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

        self._polygons, self._colors, self._towards = np.concatenate(polygons), np.concatenate(colors), towards
        paint = self._colors
        style: dict[str, Any] = {"facecolors": paint, "edgecolors": paint, "linewidths": 0.5, "rasterized": True}
        # One collection, because matplotlib sorts the polygons of a collection, and not those of several.
        self._collection = Poly3DCollection(self._polygons, zorder=1, **style)
        ax.add_collection3d(self._collection, autolim=False)

    def move(self, polygons: Floats) -> None:
        """Show a robot by its polygons, shape (n, 4, 3), instead of where it was."""
        paint = np.concatenate([self._colors, lit(polygons, self._towards, artists.ROBOT_FILL)])
        self._collection.set_verts(np.concatenate([self._polygons, polygons]))
        self._collection.set_facecolor(paint)
        self._collection.set_edgecolor(paint)
        self._collection.set_linewidth(1.0)  # at the few pixels of an animation, thinner edges leave gaps between faces


def draw_surface(space: MapLike, route: Route, look: Look) -> Axes:
    """Draw in three dimensions; as :func:`cspace.plot.plot`."""
    return paint_surface(space, route, look)[0]


def paint_surface(space: MapLike, route: Route, look: Look, *, moving: bool = False) -> tuple[Axes, Painting]:
    """Draw in three dimensions, and return what was painted; the robots themselves are left out if ``moving``."""
    surface = look.surface or next(iter(SURFACES))
    check_word(surface, "surface", tuple(SURFACES), "or leave it out")
    ax, angles = axes_in_space(look)
    box = route.box(space)
    stretch = artists.stretches(box, _THIN)
    towards = direction_of(angles) / stretch
    top = _top(space, route, look.cut)
    solid = _solid(space, surface, look.rotation)
    faces = border_faces(space.grid, solid, towards, top, space.workspace.unknown if surface == "obstacles" else None)
    looks = (SURFACES[surface], UNSEEN)
    polygons, colors = [faces.corners], [_shaded(faces, [color for _, color in looks], box)]
    handles = [artists.patch(*looks[number]) for number in np.unique(faces.marked).tolist()]
    if surface == "obstacles" and len(route.stations):
        handles.append(artists.patch("robot", artists.ROBOT_FILL))
        if not moving:
            polygons.append(robot_polygons(route.figurine, route.stations))
            colors.append(lit(polygons[-1], towards, artists.ROBOT_FILL))
    if len(route.points) > 1:
        lengths = route.figurine.travelled(route.points)
        shares = np.union1d(np.linspace(0.0, 1.0, 400), lengths / max(lengths[-1], np.finfo(float).tiny))
        strips = ribbon(route.along(shares)[:, :3], towards, box)
        inside = ((strips >= box[0]) & (strips <= box[1])).all(
            axis=(1, 2)
        )  # pictures in space are not cut by matplotlib
        polygons.append(strips[inside])
        colors.append(path_colors(shares, lengths, route.lost)[inside])
        line = route.points[:, :3]
        for axis in range(3) if route.cut else ():
            line = within(line, axis, box[0, axis], box[1, axis])
        handles += dotted(ax, line, "path, dotted behind something")
        lost = route.lost_parts[:, :3]
        if route.cut:
            lost = np.where(((lost >= box[0]) & (lost <= box[1])).all(axis=1, keepdims=True), lost, np.nan)
        handles += dashed(ax, lost)
    painting = Painting(ax, polygons, colors, towards)
    handles += artists.draw_marks(ax, route.marks, pair=(0, 1, 2))
    frame_in_space(ax, box, angles, labels=space.grid.labels, fit=look.ax is None)
    about = [f"cut at {space.grid.axes[2]} = {top:.4g} {space.grid.units[2]}"] * (top < space.grid.upper[2]) + [
        space.rotations.describe(look.rotation)
    ]
    artists.annotate(ax, space, look, stretch, ", ".join(filter(None, about)), handles)
    axes: Axes = ax
    return axes, painting


def axes_in_space(look: Look) -> tuple[Any, Floats]:
    """The axes to draw into, the caller's or new ones, and elevation and azimuth of the camera, degrees, shape (2,).

    Raises InputError if the caller's are none in space, or the camera is not two such angles.
    """
    if look.ax is not None and getattr(look.ax, "name", None) != "3d":
        mend = 'use figure.add_subplot(projection="3d")'
        raise InputError("ax", "has two dimensions", "a picture in space needs three", mend, value=look.ax)
    angles = _angles(look.camera)
    made = look.ax or artists.new_figure(1.0, 1.0, layout=None).add_subplot(projection="3d", computed_zorder=False)
    return made, angles


def dashed(ax: Any, lost: Floats) -> list[Any]:
    """Draw lines with gaps, shape (n, 3), where a path is no longer proven free, over all else; return their entry."""
    if not len(lost):
        return []
    return list(ax.plot(*lost.T, label=artists.NO_LONGER, linewidth=2.2, zorder=4.5, **artists.LOST_STYLE))


def dotted(ax: Any, line: Floats, label: str) -> list[Any]:
    """Draw a line, shape (n, 3), dotted over all else; gives its entry of the legend."""
    style: dict[str, Any] = {"color": artists.PATH, "linewidth": 1.0, "linestyle": (0, (1, 1.5)), "zorder": 4}
    return list(ax.plot(*line.T, label=label, **style))


def border_faces(
    grid: Grid,
    solid: Bools,
    towards: Floats,
    top: float = math.inf,
    marked: Bools | None = None,
) -> Faces:
    """The faces of solid cells that look at a camera far away, of blocks that are no larger than they must be.

    A block is solid where one of its cells is. Layers at an end of the grid that are mostly solid, walls before the
    rest, are taken away, and so are cells wholly above ``top``, metres. ``towards``, shape (3,), is the direction to
    the camera, in metres. Cells that are ``marked`` are told apart.
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
        blocks = in_blocks(cells, starts)
        seen = [_seen(blocks, axis, towards[axis]) for axis in range(3)]
        count = sum(int(np.count_nonzero(part)) for part in seen)
        if count <= MOST:
            break
        side = max(side + 1, math.floor(side * math.sqrt(count / MOST)))
    plain = in_blocks(plain, starts)
    corners, axes = [], []
    for axis, part in enumerate(seen):
        rim = np.zeros((4, 3), dtype=np.int64)
        rim[:, axis] = towards[axis] > 0.0
        rim[[1, 2], (axis + 1) % 3] = 1
        rim[[2, 3], (axis + 2) % 3] = 1
        lattice = np.minimum((np.argwhere(part)[:, np.newaxis] + rim) * side, cells.shape)
        corners.append(grid.lower + grid.spacing * (first + lattice))
        axes.append(np.full(len(lattice), axis))
    return Faces(np.concatenate(corners), np.concatenate(axes), ~np.concatenate([plain[part] for part in seen]))


def _peeled(layers: Bools, towards: float) -> int:
    """How many layers at the camera's end are mostly solid; none where that is half of all or more."""
    shares = layers[:: -1 if towards > 0.0 else 1].mean(axis=(1, 2))
    count = int(np.argmin(shares >= _WALL)) if (shares < _WALL).any() else len(shares)
    return count if towards != 0.0 and 2 * count < len(shares) else 0


def _seen(solid: Bools, axis: int, towards: float) -> Bools:
    """Blocks whose face along an axis looks at the camera, with no solid block before it."""
    if towards == 0.0:
        return np.zeros_like(solid)
    ahead = np.zeros_like(solid)
    behind, before = (slice(None, -1), slice(1, None)) if towards > 0.0 else (slice(1, None), slice(None, -1))
    np.moveaxis(ahead, axis, 0)[behind] = np.moveaxis(solid, axis, 0)[before]
    return solid & ~ahead


def _solid(space: MapLike, surface: str, rotation: Floats | None) -> Bools:
    """The cells whose border is drawn."""
    if surface == "obstacles":
        return space.workspace.outer
    return np.asarray(artists.classes_of(space, rotation) >= artists.UNDECIDED)


def _top(space: MapLike, route: Route, cut: float | None) -> float:
    """Height above which nothing is drawn."""
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


def _angles(camera: Any) -> Floats:
    """Elevation and azimuth of the camera, degrees, shape (2,)."""
    if camera is None:
        return np.array(CAMERA)
    angles = finite(camera, "camera")
    if angles.shape != (2,) or abs(angles[0]) > 90.0:
        rule = "it must be (elevation, azimuth) in degrees, the elevation from -90 to 90"
        raise InputError("camera", f"is {camera!r}", rule, f"pass e.g. {CAMERA}", value=camera)
    return angles


def direction_of(angles: Floats) -> Floats:
    """Direction to the camera, shape (3,), where every axis is drawn to the same scale."""
    rise, turn = np.radians(angles)
    direction = np.array([math.cos(rise) * math.cos(turn), math.cos(rise) * math.sin(turn), math.sin(rise)])
    return np.asarray(np.round(direction, 12))  # what is zero but for rounding is zero


def _shaded(faces: Faces, colors: Sequence[str], box: Floats) -> Floats:
    """Colours of faces, shape (n, 3), from those of faces that are not marked and that are."""
    height = (faces.corners[..., 2].mean(axis=1) - box[0, 2]) / (box[1, 2] - box[0, 2])
    bright = np.array(_SHARES)[faces.axes] * (1.0 - _DARKER + _DARKER * height)
    return np.asarray(bright[:, np.newaxis] * np.array([_rgb(color) for color in colors])[faces.marked.astype(int)])


def robot_polygons(figurine: Figurine, stations: Floats) -> Floats:
    """Return the robot's triangles at configurations, each with its last corner twice, shape (n, 4, 3)."""
    triangles = figurine.triangles
    while 0 < len(triangles) < 200:  # large ones are sorted wrongly among small faces
        a, b, c = np.moveaxis(triangles, 1, 0)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        parts = ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
    corners = np.concatenate([figurine.placed(triangles, q) for q in stations])
    return np.concatenate([corners, corners[:, 2:]], axis=1)


def lit(polygons: Floats, towards: Floats, color: str) -> Floats:
    """Colours of faces of one colour, lit as if each looked at the camera, shape (n, 3)."""
    normals = np.cross(polygons[:, 1] - polygons[:, 0], polygons[:, 2] - polygons[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    normals *= np.where(normals @ towards < 0.0, -1.0, 1.0)[:, np.newaxis]
    bright = 0.55 + 0.45 * np.clip(normals @ [0.3, -0.5, 0.81], 0.0, 1.0)
    return np.asarray(bright[:, np.newaxis] * _rgb(color))


def ribbon(points: Floats, towards: Floats, box: Floats) -> Floats:
    """A line through points, shape (n, 3), as short strips that face the camera, shape (n - 1, 4, 3)."""
    steps, half = np.diff(points, axis=0), 0.004 * float(np.ptp(box, axis=0).max())
    aside = np.cross(steps, towards)
    aside *= half / np.maximum(np.linalg.norm(aside, axis=1, keepdims=True), np.finfo(float).tiny)
    return np.stack([points[:-1] - aside, points[:-1] + aside, points[1:] + aside, points[1:] - aside], axis=1)


def steps_at(shares: Floats, lengths: Floats, lost: Bools) -> Bools:
    """Return whether each stretch between shares of a path's length is no longer proven free, shape (n - 1,).

    ``lengths``, shape (m,), are those up to each row, and ``lost``, shape (m - 1,), the steps no longer proven free.
    """
    middles = (shares[:-1] + shares[1:]) / 2.0 * lengths[-1]
    steps = np.clip(np.searchsorted(lengths, middles, side="right") - 1, 0, len(lengths) - 2)
    return lost[steps] if len(lost) else np.zeros(len(steps), dtype=np.bool_)


def path_colors(shares: Floats, lengths: Floats, lost: Bools) -> Floats:
    """Return the colours of the strips between shares of a path's length, shape (n - 1, 3); as :func:`steps_at`."""
    is_lost = steps_at(shares, lengths, lost)[:, np.newaxis]
    return np.where(is_lost, _rgb(artists.LOST), _rgb(artists.PATH))


def _rgb(color: str) -> Floats:
    from matplotlib.colors import to_rgb

    return np.array(to_rgb(color))


def frame_in_space(
    ax: Any, box: Floats, angles: Floats, *, labels: Sequence[str] = ("x (m)", "y (m)", "z (m)"), fit: bool
) -> None:
    """Limits, scale, labels and the camera; the figure gets the size of what is drawn, if it is to fit."""
    from matplotlib.ticker import MaxNLocator

    stretch = artists.stretches(box, _THIN)
    lengths = (box[1] - box[0]) * stretch
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
    if fit:
        _fit(ax, box, stretch, angles)


def _fit(ax: Any, box: Floats, stretch: Floats, angles: Floats) -> None:
    """Give the figure the size of what is drawn, with room for words above and below."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform  # type: ignore[import-untyped]

    lengths, (rise, turn) = (box[1] - box[0]) * stretch, np.radians(angles)
    up = [-math.sin(rise) * math.cos(turn), -math.sin(rise) * math.sin(turn), math.cos(rise)]
    spans = np.abs([[-math.sin(turn), math.cos(turn), 0.0], up]) @ lengths
    width, height = spans * min(_ROOM[0] / spans[0], _ROOM[1] / spans[1])
    size = max(width + 1.6, 4.2), height + 2.1
    ax.figure.set_size_inches(*size)
    # Axes in three dimensions are square, and what is drawn lies around their middle.
    square, middle = max(size), 1.15 + height / 2
    ax.set_position((0.5 - square / size[0] / 2, (middle - square / 2) / size[1], square / size[0], square / size[1]))
    ax.apply_aspect()
    corners = np.stack(np.meshgrid(*box.T), axis=-1).reshape(-1, 3)
    across = ax.transData.transform(np.transpose(proj_transform(*corners.T, ax.get_proj())[:2]))[:, 0]
    ax.set_box_aspect(lengths, zoom=float(width * ax.figure.dpi / np.ptp(across)))
