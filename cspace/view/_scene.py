"""Geometry of the page as plain arrays: solids of cells, sections and robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cspace._grid import Grid
from cspace._raster.bitmaps import merge_into_rectangles
from cspace._robot import Robot
from cspace._support.arrays import Bools, Floats, Ints, Surface
from cspace.plot._artists import (
    CLASSES,
    COLLIDES,
    OBSTACLE,
    PARTLY,
    UNDECIDED,
    UNSEEN,
    Classes,
)
from cspace.plot._surface import FACE_CORNERS, SURFACES, UNKNOWN_SURFACE, exposed_cells
from cspace.view._blocks import Blocks

Color = tuple[int, int, int]


class SolidKind(NamedTuple):
    """A kind of cells that can be drawn as a solid.

    Attributes
    ----------
    label, color : str
    opacity : float
    classes : tuple of int
        Classes of the cells.
    rotates : bool
        True if the cells depend on the rotation.
    has_boundary : bool
        True if the border is drawn at the end of the map too.
    """

    label: str
    color: str
    opacity: float
    classes: tuple[int, ...]
    rotates: bool
    has_boundary: bool


KINDS: Final = {
    "obstacles": SolidKind(*SURFACES["obstacles"], 1.0, (OBSTACLE,), False, True),
    "unknown": SolidKind(*UNKNOWN_SURFACE, 1.0, (UNSEEN,), False, True),
    "border": SolidKind(
        "C-obstacle",
        CLASSES[COLLIDES][1],
        0.5,
        (UNDECIDED, COLLIDES, UNSEEN, OBSTACLE),
        True,
        False,
    ),
    "mixed": SolidKind("undecided (MIXED)", CLASSES[UNDECIDED][1], 0.7, (UNDECIDED,), True, True),
}
"""Solids by name."""
SECTION: Final = "section"
"""Name of the section: the cells cut by a height, or the ground of a plane map."""

MIN_SECTION_PIXELS: Final = 1024
"""Minimum number of pixels along the longer side of a section, so that the borders of cells are
sharp."""


class Section(NamedTuple):
    """A horizontal picture of cells.

    Attributes
    ----------
    image : ndarray of uint8, shape (rows, columns, 4)
        Red, green, blue and opacity, the top row first.
    lower, upper : ndarray of float64, shape (2,)
        Corners, metres.
    height : float
        Coordinate z, metres.
    """

    image: NDArray[np.uint8]
    lower: Floats
    upper: Floats
    height: float


class Stage:
    """Geometry of the cells of a grid in space.

    Plane cells are low walls on the ground.

    Parameters
    ----------
    grid : Grid
    wall : float
        Height of the walls, metres.

    Attributes
    ----------
    lower, upper : ndarray of float64, shape (3,)
        Corners of the scene, metres.
    """

    def __init__(self, grid: Grid, wall: float) -> None:
        """Give the cells of a grid three axes, and each class of cells a colour."""
        self.grid = grid
        self.has_height = grid.dim == 3
        self.wall = wall
        self.shape = np.ones(3, dtype=np.int64)
        self.shape[: grid.dim] = grid.shape
        self.lower = lift(grid.lower, 0.0)
        self._cell = lift([grid.spacing] * grid.dim, wall)
        self.upper = self.lower + self._cell * self.shape
        opaque = 255
        self._colors = np.array([(*rgb(color), opaque) for _, color in CLASSES], dtype=np.uint8)
        if self.has_height:
            self._colors[: PARTLY + 1, 3] = 0  # free cells of a section are transparent

    def make_solid(self, blocks: Blocks, kind: SolidKind, cut: float, lid: bool = True) -> Surface:
        """Return the border of the blocks of a kind below the height ``cut``, metres.

        Without a ``lid``, the border is open at the cut, where a section closes it.
        """
        solid = np.isin(self._classes_below(blocks, cut), kind.classes)
        # Corners of rectangles in cells; the last blocks may reach beyond the map.
        corners = blocks.side * extract_border(solid, kind.has_boundary, lid)
        lattice = np.minimum(corners, self.shape).reshape(-1, 3)
        vertices = self.lower + self._cell * lattice
        vertices[:, 2] = np.minimum(vertices[:, 2], cut)
        # Each rectangle becomes two triangles.
        rectangles = np.arange(len(vertices)).reshape(-1, 4)
        triangles = rectangles[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
        return vertices, triangles

    def make_section(self, blocks: Blocks, cut: float) -> Section:
        """Return a picture of a horizontal cut through the map.

        In space, it shows the blocks at the height ``cut``, metres; in the plane, all blocks.
        """
        highest = -1
        layer = self._classes_below(blocks, cut)[..., highest]
        lower = self.lower[:2]
        size = self.grid.spacing * blocks.side * np.array(layer.shape)
        upper = np.minimum(lower + size, self.upper[:2])
        image = self._colors[layer]  # [x, y, channel]
        # Images are indexed [row, column], and their first row is the one with the largest y.
        image = np.flipud(image.transpose(1, 0, 2))
        # Browsers blur enlarged images, so each block gets several pixels along each side.
        repeat = max(1, MIN_SECTION_PIXELS // max(layer.shape))
        image = image.repeat(repeat, axis=0).repeat(repeat, axis=1)
        return Section(image, lower, upper, cut if self.has_height else 0.0)

    def _classes_below(self, blocks: Blocks, cut: float) -> Classes:
        """Return the classes of the blocks that begin below a height, shape (nx, ny, nz)."""
        classes = np.atleast_3d(blocks.classes)
        height = min(cut, self.upper[2]) - self.lower[2]
        cell_height = self._cell[2]
        # Rounding adds no layer, and at least one is drawn.
        layers = math.ceil(height / cell_height / blocks.side - 1e-9)
        return classes[..., : max(1, layers)]


def extract_border(solid: Bools, has_boundary: bool = True, lid: bool = True) -> Ints:
    """Return the border of solid cells as few rectangles, shape (n, 4, 3), in cells.

    Corners are counterclockwise seen from outside. Squares in a row are merged into a rectangle,
    and rows of equal length into a larger one. The mesh is for display only, because corners may
    lie inside edges of other rectangles.

    Without ``has_boundary``, the border is open at the ends of the array; without ``lid``, only
    above its top layer.
    """
    rectangles = []
    for axis, up in product(range(3), (0, 1)):
        others = [other for other in range(3) if other != axis]
        # Here and below, the axis of the normal comes first.
        exposed = np.moveaxis(exposed_cells(solid, axis, up), axis, 0)
        is_lid = axis == 2 and up == 1
        if not has_boundary or (is_lid and not lid):
            exposed[-1 if up else 0] = False
        low, high = merge_into_rectangles(exposed)
        sides = high - low
        sides[:, 0] = 1
        face = np.insert(FACE_CORNERS, 0, up, axis=1)
        corners = low[:, np.newaxis] + sides[:, np.newaxis] * face
        # The other axes turn counterclockwise around +x and +z, but around -y.
        is_clockwise = (up == 1) == (axis == 1)
        if is_clockwise:
            corners = np.flip(corners, axis=1)
        to_xyz = np.argsort([axis, *others])
        rectangles.append(corners[..., to_xyz])
    return np.concatenate(rectangles)


def make_robot_surface(robot: Robot, height: float) -> Surface:
    """Return the surface of a robot in its frame.

    A plane robot becomes a slab of the given height, metres.
    """
    import shapely
    from trimesh.creation import extrude_triangulation

    if robot.dim == 3:
        return robot.shape.outer.surface
    triangulation = shapely.constrained_delaunay_triangles(robot.shape.outer.outline)
    rings = shapely.get_coordinates(shapely.get_parts(triangulation)).reshape(-1, 4, 2)
    triangles = rings[:, :3]  # a ring repeats its first corner
    corners, faces = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    mesh: Any = extrude_triangulation(corners, faces.reshape(-1, 3), height)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def lift(values: Sequence[float], third: float) -> Floats:
    """Return values along x and y with a third one along z; three values stay as they are."""
    return np.array(values if len(values) == 3 else [*values, third])


def rgb(color: str) -> Color:
    """Return red, green and blue, 0 to 255, e.g. of ``"#0072b2"``."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def to_quaternion(pose: Floats) -> Floats:
    """Return the rotations of poses, shape (..., 3, 3) or (..., 4, 4), as w, x, y, z."""
    return np.asarray(Rotation.from_matrix(pose[..., :3, :3]).as_quat(scalar_first=True))
