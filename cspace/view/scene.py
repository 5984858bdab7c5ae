"""Geometry of the page as plain arrays: solids of cells, sections and robots."""

from __future__ import annotations

import math
from itertools import product
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cspace.grid import Grid
from cspace.plot.artists import (
    CLASSES,
    COLLIDES,
    OBSTACLE,
    PARTLY,
    UNDECIDED,
    UNSEEN,
    Classes,
)
from cspace.plot.surface import FACE_CORNERS, SURFACES, UNKNOWN_SURFACE, exposed_cells
from cspace.raster.bitmaps import merge_into_rectangles
from cspace.robot import Robot
from cspace.support.arrays import Bools, Floats, Ints, Surface
from cspace.view.blocks import Blocks

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
        self.grid = grid
        self.has_height = grid.dim == 3
        self.shape = np.array([*grid.shape, 1][:3])
        self.wall = wall
        self._cell = np.array(
            [grid.spacing, grid.spacing, grid.spacing if self.has_height else wall]
        )
        self.lower = np.array([*grid.lower, 0.0][:3])
        self.upper = self.lower + self._cell * self.shape
        # In space, free cells of a section are transparent.
        self._colors = np.array([(*rgb(color), 255) for _, color in CLASSES], dtype=np.uint8)
        self._colors[: PARTLY + 1, 3] = 0 if self.has_height else 255

    def solid(self, blocks: Blocks, kind: SolidKind, cut: float, lid: bool = True) -> Surface:
        """Return the border of the blocks of a kind below the height ``cut``, metres.

        Without a ``lid``, the border is open at the cut, where a section closes it.
        """
        classes = self._below(blocks, cut)
        wanted = np.zeros(len(CLASSES), dtype=np.bool_)
        wanted[list(kind.classes)] = True
        solid = wanted[classes]
        corners = blocks.side * extract_border(solid, kind.has_boundary, lid)
        lattice = np.minimum(corners, self.shape).reshape(-1, 3)
        vertices = self.lower + self._cell * lattice
        vertices[:, 2] = np.minimum(vertices[:, 2], cut)
        squares = np.arange(len(vertices)).reshape(-1, 4)
        return vertices, squares[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)

    def section(self, blocks: Blocks, cut: float) -> Section:
        """Return a picture of a horizontal cut through the map.

        In space, it shows the blocks at the height ``cut``, metres; in the plane, all blocks.
        """
        layer = self._below(blocks, cut)[..., -1]  # the highest one that begins below the cut
        lower = self.lower[:2]
        size = self.grid.spacing * blocks.side * np.array(layer.shape)
        upper = np.minimum(lower + size, self.upper[:2])
        image = self._colors[layer]  # [x, y, channel]
        # Images are indexed [row, column], and their first row is the one with the largest y.
        image = image.transpose(1, 0, 2)[::-1]
        # Browsers blur enlarged images, so each block gets several pixels along each side.
        repeat = max(1, MIN_SECTION_PIXELS // max(layer.shape))
        image = image.repeat(repeat, axis=0).repeat(repeat, axis=1)
        return Section(image, lower, upper, cut if self.has_height else 0.0)

    def _below(self, blocks: Blocks, cut: float) -> Classes:
        """Return the classes of the blocks below a height."""
        classes = np.atleast_3d(blocks.classes)
        count = (min(cut, self.upper[2]) - self.lower[2]) / self._cell[2]
        return classes[..., : max(1, math.ceil(count / blocks.side - 1e-9))]


def extract_border(solid: Bools, has_boundary: bool = True, lid: bool = True) -> Ints:
    """Return the border of solid cells as rectangles.

    There are few of them, shape (n, 4, 3), in cells. Corners are counterclockwise seen from
    outside. Squares in a row are merged into a rectangle, and rows of equal length into a larger
    one. The mesh is for display only, because corners may lie inside edges of other rectangles.

    Without ``has_boundary``, the border is open at the ends of the array; without ``lid``, only
    above its top layer.
    """
    rectangles = []
    for axis, up in product(range(3), (0, 1)):
        exposed = np.moveaxis(exposed_cells(solid, axis, up), axis, 0)
        exposed[-up] &= has_boundary and (lid or (axis, up) != (2, 1))
        low, high = merge_into_rectangles(exposed)  # in the order of axes of ``exposed``
        sides = np.maximum(high - low, (1, 0, 0))
        corners = low[:, np.newaxis] + sides[:, np.newaxis] * np.insert(FACE_CORNERS, 0, up, axis=1)
        # The normal of x and z is -y.
        corners = corners if up != (axis == 1) else corners[:, ::-1]
        rectangles.append(corners[..., np.argsort([axis, *np.delete(np.arange(3), axis)])])
    return np.concatenate(rectangles)


def make_robot_surface(robot: Robot, height: float) -> Surface:
    """Return the surface of a robot in its frame.

    A plane robot becomes a slab of the given height, metres.
    """
    import shapely
    from trimesh.creation import extrude_triangulation

    if robot.dim == 3:
        return robot.shape.outer.surface
    parts = shapely.constrained_delaunay_triangles(robot.shape.outer.outline)
    triangles = shapely.get_coordinates(shapely.get_parts(parts)).reshape(-1, 4, 2)[:, :3]
    corners, faces = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
    mesh: Any = extrude_triangulation(corners, faces.reshape(-1, 3), height)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def rgb(color: str) -> Color:
    """Return red, green and blue, 0 to 255, e.g. of ``"#0072b2"``."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def to_quaternion(pose: Floats) -> Floats:
    """Return the rotations of poses, shape (..., 3, 3) or (..., 4, 4), as w, x, y, z."""
    return np.asarray(Rotation.from_matrix(pose[..., :3, :3]).as_quat(scalar_first=True))
