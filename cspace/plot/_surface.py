"""Pictures in three dimensions: the faces of cells that face the camera, robots and a path."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cspace.errors import InputError
from cspace.inside import (
    Bools,
    Bytes,
    Floats,
    Ints,
    Surface,
    check_finite,
    reduce_blocks,
)
from cspace.plot import _artists as artists
from cspace.plot.scene import (
    ROBOT_FILL_COLOR,
    CellClass,
    PictureContent,
    classify_ground,
    find_faces,
    simplify_surface,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

DEFAULT_CAMERA: Final = (40.0, -62.0)
"""Default elevation and azimuth of the camera, degrees."""
MAX_FACES: Final = 20_000
"""Maximum number of faces of cells; cells are merged into blocks to reach it."""
SOLIDS: Final = (CellClass.OBSTACLE, CellClass.UNSEEN)
"""Classes of the cells that are drawn as solids."""


class Painting:
    """Three-dimensional axes with polygons that are sorted together.

    Attributes
    ----------
    axes : mpl_toolkits.mplot3d.axes3d.Axes3D
        The caller's axes, or new ones.
    camera : tuple of float
        Elevation and azimuth, degrees.
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
            )
        self.camera = check_camera(camera)
        if ax is None:
            figure = artists.new_figure(7.0, 6.0, layout=None)
            place: Any = (0.0, 0.1, 1.0, 0.85)  # above the legend, below the title
            ax = figure.add_axes(place, projection="3d", computed_zorder=False)
        self.axes: Any = ax
        self.handles: dict[str, Any] = {}
        lengths = box[1] - box[0]
        self.size = float(lengths.max())
        # Polygons that never move, (n, 4, 3), with their colour.
        self._painted: list[tuple[Floats, str]] = []
        self._collection: Any = None
        # Polygons on the border of the box may be outside by rounding, and would be hidden.
        limits = (box + 1e-9 * np.array([-lengths, lengths])).T
        ax.set(**dict(zip(("xlim", "ylim", "zlim"), limits, strict=True)))
        ax.set(**dict(zip(("xlabel", "ylabel", "zlabel"), labels, strict=True)))
        ax.tick_params(labelsize=8)
        ax.grid(visible=False)
        ax.set_box_aspect(np.maximum(lengths, self.size / artists.MAX_ASPECT_RATIO))
        ax.set_proj_type("ortho")
        ax.view_init(*self.camera)

    def add(self, polygons: Floats, color: str, label: str) -> None:
        """Add polygons of one colour, (n, 4, 3), and their legend entry."""
        self._painted.append((polygons, color))
        self.handles.setdefault(label, artists.make_patch(label, color))

    def draw_path(self, curve: Floats, is_lost: bool) -> None:
        """Draw a path (n, 3) over everything, within the box."""
        for line in artists.draw_path(self.axes, curve, is_lost, (0, 1, 2), axlim_clip=True):
            self.handles[line.get_label()] = line

    def show(self, moving: Iterable[Surface] = ()) -> None:
        """Draw polygons and a moving robot's surfaces.

        They replace the polygons of the previous call.
        """
        from matplotlib.colors import LightSource, to_rgb
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection  # type: ignore[import-untyped]

        painted = [*self._painted, (make_polygons(moving), ROBOT_FILL_COLOR)]
        polygons = np.concatenate([drawn for drawn, _ in painted])
        # Faces are lit on the side that the camera sees, so that those behind do not show through.
        first, second, third, _ = np.moveaxis(polygons, 1, 0)
        normals = np.cross(second - first, third - second)
        is_away = normals @ camera_direction(self.camera) < 0.0
        polygons[is_away] = polygons[is_away][:, [2, 1, 0, 3]]
        counts = [len(drawn) for drawn, _ in painted]
        colors = np.repeat([to_rgb(color) for _, color in painted], counts, axis=0)
        if self._collection is not None:
            self._collection.remove()
        # One collection, because matplotlib does not sort the polygons of several together.
        self._collection = Poly3DCollection(
            polygons,
            facecolors=colors,
            edgecolors=colors,
            shade=True,
            # The light turns with the camera: from the left, 58 degrees above the horizon.
            lightsource=LightSource(148.0 - self.camera[1], 58.0),
            linewidths=0.8,
            rasterized=True,
            zorder=1,
            axlim_clip=True,
        )
        self.axes.add_collection3d(self._collection, autolim=False)

    def annotate(self, is_new: bool, title: str | None, default: str, legend: bool = True) -> None:
        """Add a title and a legend; see :func:`cspace.plot._artists.annotate`."""
        entries = list(self.handles.values()) if legend else []
        artists.annotate(self.axes, is_new, title, default, entries)


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
        )
    return angles


def camera_direction(camera: Floats) -> Floats:
    """Convert elevation and azimuth, degrees, to the unit vector towards the camera."""
    elevation, azimuth = np.radians(camera)
    radius = math.cos(elevation)  # of the horizontal part
    direction = [radius * math.cos(azimuth), radius * math.sin(azimuth), math.sin(elevation)]
    return np.round(direction, 12)  # zero components are exactly zero


def draw_surface(
    scene: PictureContent, ax: Any = None, camera: ArrayLike | None = None
) -> Painting:
    """Prepare a picture of a map in three dimensions, for :meth:`Painting.show`.

    Cells above the robot on its path are omitted.
    """
    grid = scene.space.grid
    body = scene.body
    route = scene.route
    painting = Painting(scene.box, ax, camera, artists.label_axes(grid))
    top = np.inf
    if len(route.points):
        top = body.extents(np.concatenate([scene.robots, route.points]))[:, 1, 2].max()
    corner = np.array(grid.lower)
    classes = classify_ground(scene.space.workspace)
    solids = np.where(np.isin(classes, SOLIDS), classes, np.uint8(0))
    # At least one layer is drawn; subtracting 1e-9 keeps rounding from adding one.
    layers = np.clip(np.ceil((top - corner[2]) / grid.spacing - 1e-9), 1, solids.shape[2])
    is_cut = layers < solids.shape[2]
    towards = camera_direction(painting.camera)
    faces, face_classes = find_border_faces(solids[..., : int(layers)], towards, is_cut)
    for solid in SOLIDS:
        chosen = faces[face_classes == solid]
        if len(chosen):
            painting.add(corner + grid.spacing * chosen, solid.solid_color, solid.label)
    if len(scene.robots) and body.surface is not None:
        vertices, triangles = split_surface(body.surface, body.size)
        robots = [(body.transform(vertices, q), triangles) for q in scene.robots]
        painting.add(make_polygons(robots), ROBOT_FILL_COLOR, "robot")
    painting.draw_path(route.split()[:, :3], route.is_lost)
    for marker in artists.draw_endpoints(painting.axes, route.endpoints, (0, 1, 2)):
        painting.handles[marker.get_label()] = marker
    return painting


def find_border_faces(solids: Bytes, towards: Floats, is_cut: bool) -> tuple[Ints, Bytes]:
    """Find solid cells' faces towards a camera, with classes.

    Cells are solid if their class is above zero. They are merged into blocks, with the largest
    class in each, until there are at most :data:`MAX_FACES` faces. Walls in front of the map are
    omitted, so that the camera sees into it; the top of a map that ``is_cut`` is no wall.

    Returns
    -------
    corners : ndarray of int64, shape (n, 4, 3)
        In cells.
    classes : ndarray of uint8, shape (n,)
    """
    inside = _find_inside(solids > 0, towards, is_cut)
    solids = solids[inside]
    side = math.ceil(max(solids.shape) / 200)  # smaller blocks would be invisible in a picture
    while True:
        blocks = reduce_blocks(solids, side)
        corners = []
        classes = []
        for axis in np.flatnonzero(towards).tolist():
            up = int(towards[axis] > 0.0)
            faces, cells = find_faces(blocks > 0, axis, up)
            corners.append(faces)
            classes.append(blocks[tuple(cells.T)])
        if sum(map(len, classes)) <= MAX_FACES:
            break
        side += max(1, side // 4)  # a quarter more, so that few rounds are needed
    # The last blocks along an axis may reach beyond the cells.
    cell_corners = np.minimum(side * np.concatenate(corners), solids.shape)
    return cell_corners + [cells.start for cells in inside], np.concatenate(classes)


def _find_inside(solid: Bools, towards: Floats, is_cut: bool) -> tuple[slice, ...]:
    """Return the map behind the walls that face the camera.

    A wall consists of layers whose cells are at least 80 % solid, fewer than half of all layers.
    """
    inside = []
    for axis, side in enumerate(towards.tolist()):
        shares = np.moveaxis(solid, axis, 0).mean(axis=(1, 2))  # of solid cells, by layer
        from_camera = shares[::-1] if side > 0.0 else shares
        layers = int(np.argmin(from_camera >= 0.8))  # index of the first layer that is no wall
        if not side or 2 * layers >= len(shares) or (is_cut and axis == 2):
            layers = 0
        inside.append(slice(0, len(shares) - layers) if side > 0.0 else slice(layers, len(shares)))
    return tuple(inside)


def make_polygons(surfaces: Iterable[Surface]) -> Floats:
    """Return surfaces' triangles as polygons of four corners (n, 4, 3).

    The last corner is repeated, so that triangles and faces of cells are in one array.
    """
    polygons = [vertices[faces][:, [0, 1, 2, 2]] for vertices, faces in surfaces]
    return np.concatenate([np.empty((0, 4, 3)), *polygons])


def split_surface(surface: Surface, size: float) -> Surface:
    """Simplify a surface, then split edges longer than a tenth of ``size``.

    Large triangles would hide parts in front of them, because matplotlib sorts by their centers.
    """
    from trimesh.remesh import subdivide_to_size

    subdivide: Any = subdivide_to_size
    vertices, faces = subdivide(*simplify_surface(surface), size / 10.0)
    return vertices, faces
