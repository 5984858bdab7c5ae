"""Pictures in three dimensions: the faces of cells that face the camera, robots and a path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace._support.arrays import Bools, Bytes, Floats, Ints, block_starts, reduce_blocks
from cspace._support.check import check_finite, check_word
from cspace.errors import InputError
from cspace.plot import _artists as artists
from cspace.plot._route import Scene

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

SURFACES: Final = {
    "obstacles": ("obstacle", "#7a7a7a"),
    "free": ("border of the free space", "#ffffff"),
}
"""Legend label and colour of each surface that can be drawn."""
UNKNOWN_SURFACE: Final = (artists.CLASSES[artists.UNSEEN][0], "#c9a468")
"""Legend label and colour of unknown cells that count as obstacles."""
DEFAULT_CAMERA: Final = (40.0, -62.0)
"""Default elevation and azimuth of the camera, degrees."""
MAX_FACES: Final = 20_000
"""Maximum number of faces of cells; cells are merged into blocks to reach it."""
_WALL_SHARE: Final = 0.8
"""Minimum share of solid cells in a layer of a wall in front of the map."""
_DARKEST: Final = 0.42
"""Smallest brightness of a face, as a share of its colour."""
_NORMAL_BRIGHTNESS: Final = (0.2, 0.32, 0.5)
"""Brightness added to the darkest for the components of a face's normal along x, y and z."""
_FIGURE_INCHES: Final = (7.0, 6.0)
"""Width and height of a new figure."""
_PIECES: Final = 64
"""Number of pieces of each step of a path."""
FACE_CORNERS: Final = np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
"""Corners of a cell's face, in the plane of the face."""


class Painting:
    """Three-dimensional axes with polygons that are sorted together.

    Attributes
    ----------
    axes : mpl_toolkits.mplot3d.axes3d.Axes3D
        The caller's axes, or new ones.
    towards : ndarray of float64, shape (3,)
        Direction to the camera.
    handles : dict of str to matplotlib.artist.Artist
        Legend entries by label.
    size : float
        Longest side of the picture, metres.

    Raises
    ------
    InputError
        If the caller's axes have two dimensions, or if the camera is not a valid pair of angles.
    """

    def __init__(
        self,
        box: Floats,
        ax: Any = None,
        camera: ArrayLike | None = None,
        labels: Sequence[str] = ("x (m)", "y (m)", "z (m)"),
    ) -> None:
        """Prepare axes that show a box, shape (2, 3), from a camera."""
        if getattr(ax, "name", "3d") != "3d":
            raise InputError(
                "ax",
                "has two dimensions",
                "it must have three",
                'use figure.add_subplot(projection="3d")',
            )
        angles = check_camera(camera)
        if ax is None:
            figure = artists.new_figure(*_FIGURE_INCHES, layout=None)
            place: Any = (0.0, 0.1, 1.0, 0.85)  # above the legend, below the title
            ax = figure.add_axes(place, projection="3d", computed_zorder=False)
        self.axes: Any = ax
        self.towards = camera_direction(angles)
        self.handles: dict[str, Any] = {}
        lengths = box[1] - box[0]
        self.size = float(lengths.max())
        self._box = box
        # Polygons that never move, (n, 4, 3), with their colours, (n, 3).
        self._painted: list[tuple[Floats, Floats]] = [(np.empty((0, 4, 3)), np.empty((0, 3)))]
        self._collection: Any = None
        ax.set(xlim=box[:, 0], ylim=box[:, 1], zlim=box[:, 2])
        ax.set(xlabel=labels[0], ylabel=labels[1], zlabel=labels[2])
        ax.tick_params(labelsize=8)
        ax.grid(visible=False)
        ax.set_box_aspect(np.maximum(lengths, self.size / artists.MAX_ASPECT_RATIO))
        ax.set_proj_type("ortho")
        ax.view_init(*angles)

    def add(self, polygons: Floats, color: str, label: str) -> None:
        """Add polygons of one colour, (n, 4, 3), and their legend entry; skip those outside."""
        # Polygons on the border of the box may be outside by rounding.
        slack = 1e-9 * np.ptp(self._box, axis=0)
        low, high = self._box
        is_inside = (polygons >= low - slack) & (polygons <= high + slack)
        polygons = polygons[is_inside.all(axis=(1, 2))]
        self._painted.append((polygons, shade(polygons, color)))
        self.handles.setdefault(label, artists.patch(label, color))

    def add_path(self, curve: Floats, lost: Bools) -> None:
        """Draw a path, shape (n, 3), over everything; omit what is outside the box."""
        low, high = self._box
        is_inside = ((curve >= low) & (curve <= high)).all(axis=1)
        with_gaps = np.where(is_inside[:, np.newaxis], curve, np.nan)  # NaN makes gaps
        for line in artists.draw_path(self.axes, with_gaps, lost, (0, 1, 2)):
            self.handles[line.get_label()] = line

    def show(self, moving: Floats | None = None) -> None:
        """Draw all polygons, and those of a moving robot in place of the last ones."""
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

        painted = list(self._painted)
        if moving is not None:
            painted.append((moving, shade(moving, artists.ROBOT_FILL_COLOR)))
        polygons, colors = map(np.concatenate, zip(*painted, strict=True))
        if self._collection is not None:
            self._collection.remove()
        # One collection, because matplotlib does not sort the polygons of several together.
        self._collection = Poly3DCollection(
            polygons,
            facecolors=colors,
            edgecolors=colors,
            linewidths=0.8,
            rasterized=True,
            zorder=1,
        )
        self.axes.add_collection3d(self._collection, autolim=False)


def check_camera(camera: ArrayLike | None) -> Floats:
    """Return elevation and azimuth of a camera, degrees, or raise InputError."""
    if camera is None:
        return np.array(DEFAULT_CAMERA)
    angles = check_finite(camera, "camera")
    if angles.shape != (2,) or abs(angles[0]) > 90.0:
        raise InputError(
            "camera",
            f"is {camera!r}",
            "it must be (elevation, azimuth), degrees, with an elevation from -90 to 90",
            f"pass e.g. {DEFAULT_CAMERA}",
        )
    return angles


def camera_direction(angles: Floats) -> Floats:
    """Return the direction to a camera, shape (3,); angles are in degrees."""
    elevation, azimuth = np.radians(angles)
    radius = math.cos(elevation)  # of the horizontal part
    direction = [radius * math.cos(azimuth), radius * math.sin(azimuth), math.sin(elevation)]
    return np.round(direction, 12)  # zero components are exactly zero


def shade(polygons: Floats, color: str) -> Floats:
    """Compute the colours of faces, shape (n, 3), by their normals.

    ``polygons`` has shape (n, 4, 3). A face is brighter the more it looks upwards.
    """
    from matplotlib.colors import to_rgb

    sides = np.diff(polygons[:, :3], axis=1)
    normals = np.abs(np.cross(sides[:, 0], sides[:, 1]))
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals /= np.maximum(lengths, np.finfo(float).tiny)
    brightness = np.minimum(_DARKEST + normals @ _NORMAL_BRIGHTNESS, 1.0)
    return np.asarray(brightness[:, np.newaxis] * to_rgb(color))


def draw_surface(
    scene: Scene,
    ax: Any = None,
    surface: str | None = None,
    cut: float | None = None,
    camera: ArrayLike | None = None,
) -> Painting:
    """Draw a map in three dimensions, but do not show it yet."""
    surface = surface or "obstacles"
    check_word(surface, "surface", tuple(SURFACES), "or leave it out")
    grid = scene.space.grid
    painting = Painting(scene.box, ax, camera, grid.labels)
    top = _choose_top(scene, cut)
    # Solid are the obstacles, or all cells that are not free for the reference point.
    shows_obstacles = surface == "obstacles"
    if shows_obstacles:
        classes = artists.classify_ground(scene.space.workspace, scene.window)
        lowest = artists.UNSEEN
    else:
        classes = artists.classify_cells(scene.space, scene.rotation, scene.window)
        lowest = artists.UNDECIDED
    levels = np.where(classes >= lowest, classes, np.uint8(0))
    first_cell = np.array([cells.start for cells in scene.window])
    corner = np.array(grid.lower) + grid.spacing * first_cell
    # Leave out the layers above the cut.
    is_cut = top < grid.upper[2]
    if is_cut:
        layers = math.ceil((top - corner[2]) / grid.spacing - 1e-9)
        levels = levels[..., : max(1, layers)]
    faces, face_levels = border_faces(levels, painting.towards, is_cut=is_cut)
    polygons = corner + grid.spacing * faces
    # Unknown cells that count as obstacles have a colour of their own.
    is_unknown = (face_levels == artists.UNSEEN) & shows_obstacles
    for chosen, (label, color) in ((~is_unknown, SURFACES[surface]), (is_unknown, UNKNOWN_SURFACE)):
        if chosen.any():
            painting.add(polygons[chosen], color, label)
    if shows_obstacles and len(scene.stations):
        corners = split_triangles(scene.body.triangles, scene.body.size).reshape(-1, 3)
        robots = scene.body.transform(corners, scene.stations).reshape(-1, 4, 3)
        painting.add(robots, artists.ROBOT_FILL_COLOR, "robot")
    painting.add_path(*split_steps(scene.points[:, :3], scene.lost))
    for handle in artists.draw_marks(painting.axes, scene.marks, (0, 1, 2)):
        painting.handles[handle.get_label()] = handle
    return painting


def split_steps(points: Floats, lost: Bools) -> tuple[Floats, Bools]:
    """Split each step of a path into short pieces.

    A path that is cut at a box then ends close to its border. Returns the ends of the pieces, and a
    mask of the pieces of ``lost`` steps.
    """
    count = len(points)
    if count < 2:
        return points, lost
    places = np.arange((count - 1) * _PIECES + 1) / _PIECES  # as rows of the path
    columns = [np.interp(places, np.arange(count), column) for column in points.T]
    return np.column_stack(columns), np.repeat(lost, _PIECES)


def border_faces(levels: Bytes, towards: Floats, is_cut: bool) -> tuple[Ints, Bytes]:
    """Return the faces of solid cells towards a camera, and their levels.

    Cells are solid if their level is above zero. They are merged into blocks, with the largest
    level in each, until there are at most :data:`MAX_FACES` faces. Walls in front of the map are
    omitted, so that the camera sees into it; the top of a map that ``is_cut`` is no wall.

    Returns
    -------
    corners : ndarray of int64, shape (n, 4, 3)
        In cells.
    levels : ndarray of uint8, shape (n,)
    """
    first, stop = _trim_walls(levels > 0, towards, is_cut)
    levels = levels[tuple(map(slice, first, stop))]
    side = math.ceil(max(levels.shape) / 200)  # smaller blocks would be invisible in a picture
    while True:
        blocks = reduce_blocks(levels, block_starts(levels.shape, side))
        solid_blocks, corners = _list_visible_faces(blocks > 0, towards)
        if len(solid_blocks) <= MAX_FACES:
            break
        side += max(1, side // 4)  # a quarter more, so that few rounds are needed
    # The last blocks may reach beyond the cells.
    cell_corners = np.minimum(side * corners, levels.shape)
    return first + cell_corners, blocks[tuple(solid_blocks.T)]


def _trim_walls(solid: Bools, towards: Floats, is_cut: bool) -> tuple[Ints, Ints]:
    """Find the part of a map without the walls at the camera's side.

    A wall is mostly solid layers, fewer than half of all. Returns the first cell and the end of
    that part along each axis, shapes (3,).
    """
    first = np.zeros(3, np.int64)
    stop = np.array(solid.shape)
    for axis in range(2 if is_cut else 3):
        layers_first = np.moveaxis(solid, axis, 0)
        shares = layers_first.mean(axis=(1, 2))  # of solid cells, by layer
        is_seen_from_above = towards[axis] > 0.0
        if is_seen_from_above:
            shares = shares[::-1]
        layers = int(np.argmin(shares >= _WALL_SHARE))
        if not towards[axis] or 2 * layers >= len(shares):
            continue
        if is_seen_from_above:
            stop[axis] -= layers
        else:
            first[axis] += layers
    return first, stop


def _list_visible_faces(solid: Bools, towards: Floats) -> tuple[Ints, Ints]:
    """List the faces of solid cells towards the camera.

    Returns their cells (n, 3), and their corners (n, 4, 3).
    """
    cells = [np.empty((0, 3), np.int64)]
    corners = [np.empty((0, 4, 3), np.int64)]
    for axis in np.flatnonzero(towards).tolist():
        up = int(towards[axis] > 0.0)
        exposed = np.argwhere(exposed_cells(solid, axis, up))
        face = np.insert(FACE_CORNERS, axis, up, axis=1)
        cells.append(exposed)
        corners.append(exposed[:, np.newaxis] + face)
    return np.concatenate(cells), np.concatenate(corners)


def exposed_cells(solid: Bools, axis: int, up: int) -> Bools:
    """Return a mask of the solid cells with no solid cell below (0) or above (1) on an axis."""
    # Padding with empty cells keeps the ends of the array from being neighbours.
    shift = -1 if up else 1
    neighbors = np.roll(np.pad(solid, 1), shift, axis)[1:-1, 1:-1, 1:-1]
    return solid & ~neighbors


def _choose_top(scene: Scene, cut: float | None) -> float:
    """Choose the height above which no cells are drawn, metres.

    By default it is the highest point of the robot on the path, but at least one layer is drawn.
    """
    grid = scene.space.grid
    top = grid.upper[2]
    if cut is not None:
        top = check_finite(cut, "cut").max()
    elif len(scene.points):
        extents = scene.body.extents(np.concatenate([scene.stations, scene.points]))
        top = extents[:, 1, 2].max()
    return float(np.clip(top, grid.lower[2] + grid.spacing, grid.upper[2]))


def split_triangles(triangles: Floats, size: float) -> Floats:
    """Split long triangles, shape (n, 3, 3); return polygons, shape (m, 4, 3).

    Edges longer than a tenth of ``size`` are split, because matplotlib sorts large triangles
    wrongly. Each polygon repeats its last corner.
    """
    from trimesh.remesh import subdivide_to_size

    # Each triangle has three vertices of its own.
    corners = triangles.reshape(-1, 3)
    faces = np.arange(len(corners)).reshape(-1, 3)
    subdivide: Any = subdivide_to_size
    vertices, faces = subdivide(corners, faces, size / 10.0)
    faces_of_four = faces[:, [0, 1, 2, 2]]
    return np.asarray(vertices[faces_of_four])
