"""Geometry of the page as plain arrays: solids of cells, sections and robots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cspace import CSpace, Grid, Robot
from cspace.inside import (
    Bools,
    Bytes,
    Floats,
    Ints,
    Surface,
    reduce_blocks,
)
from cspace.plot.scene import CellClass, classify_cells, classify_ground, find_faces

if TYPE_CHECKING:
    from cspace import TiledCSpace

MAX_BLOCKS: Final = 2**21
"""Maximum number of blocks of a map, roughly."""


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
        True if the solid is closed at the ends of the map.
    """

    label: str
    color: str
    opacity: float
    classes: tuple[int, ...]
    rotates: bool
    has_boundary: bool


def _make_kind(shown: CellClass, opacity: float, rotates: bool) -> SolidKind:
    """Make the closed solid of one class."""
    return SolidKind(shown.label, shown.solid_color, opacity, (shown,), rotates, True)


_IN_THE_WAY: Final = (
    *(CellClass.UNDECIDED, CellClass.COLLIDES),
    *(CellClass.UNSEEN, CellClass.OBSTACLE),
)

KINDS: Final = {
    "obstacles": _make_kind(CellClass.OBSTACLE, 1.0, rotates=False),
    "unknown": _make_kind(CellClass.UNSEEN, 1.0, rotates=False),
    "border": SolidKind("C-obstacle", CellClass.COLLIDES.color, 0.5, _IN_THE_WAY, True, False),
    "mixed": _make_kind(CellClass.UNDECIDED, 0.7, rotates=True),
}
"""Solids by name."""
SECTION: Final = "section"
"""Name of the section: the cells cut by a height, or the ground of a plane map."""


class MapSection(NamedTuple):
    """A horizontal picture of cells.

    Attributes
    ----------
    image : ndarray of uint8, shape (rows, columns, 4)
        Red, green, blue and opacity, the top row first.
    lower, upper : ndarray of float64, shape (2,)
        Corners, metres.
    """

    image: NDArray[np.uint8]
    lower: Floats
    upper: Floats


class BlockGrid(NamedTuple):
    """Blocks of the cells of a grid.

    Attributes
    ----------
    side : int
        Cells along each axis of a block; blocks at the upper border of the grid may be smaller.
    shape : ndarray of int64, shape (3,)
        Number of cells.
    cell : ndarray of float64, shape (3,)
        Sides of a cell, metres.
    lower, upper : ndarray of float64, shape (3,)
        Corners, metres.
    """

    side: int
    shape: Ints
    cell: Floats
    lower: Floats
    upper: Floats

    @classmethod
    def of(cls, grid: Grid, wall: float, floor: float) -> BlockGrid:
        """Make blocks of a grid; cells of a plane grid are walls on a floor, metres."""
        side = math.ceil((grid.size / MAX_BLOCKS) ** (1.0 / grid.dim))
        shape = np.ones(3, dtype=np.int64)
        shape[: grid.dim] = grid.shape
        cell = lift([grid.spacing] * grid.dim, wall)
        lower = lift(grid.lower, floor)
        return cls(side, shape, cell, lower, lower + cell * shape)


class Cells:
    """Solids and sections of the cells of a map.

    Cells are merged into blocks, few enough for a browser; a block has the most important class of
    its cells. Cells of a plane map become low walls on the ground, a tiled map an overview. With a
    floor, obstacles are those in space.

    Parameters
    ----------
    space : CSpace or TiledCSpace
    wall : float
        Height of the walls, metres.

    Attributes
    ----------
    drawn : CSpace
        The map that is drawn.
    floor : float
        Height of the ground of a plane map, metres.
    scene : BlockGrid
        Blocks of the obstacles.
    make_blocks : callable
        Return the classes of the blocks at a rotation cell, or those of the workspace if it is
        None, shape (nx, ny, nz).
    """

    def __init__(self, space: CSpace | TiledCSpace, wall: float) -> None:
        """Choose the map to draw and the size of its blocks."""
        self._space = space
        self.make_blocks = lru_cache(24)(self._merge_cells)
        self.invalidate()
        self.floor = self.drawn.floor or 0.0
        self.scene = BlockGrid.of(self.drawn.workspace.grid, wall, self.floor)
        self._states = BlockGrid.of(self.drawn.grid, wall, self.floor)

    def invalidate(self) -> None:
        """Clear the cache, because the map has changed."""
        self.make_blocks.cache_clear()
        if isinstance(self._space, CSpace):
            self.drawn = self._space
        else:
            # An overview has at most about as many cells as the page has blocks.
            grid = self._space.grid
            share = (MAX_BLOCKS / grid.size) ** (1.0 / grid.dim)
            self.drawn = self._space.overview(max(1, math.floor(share * max(grid.shape))))

    def _merge_cells(self, cell: int | None) -> Bytes:
        """Merge cells, at a rotation or of the workspace, into blocks."""
        space = self.drawn
        if cell is None:
            classes = classify_ground(space.workspace)
        else:
            classes = classify_cells(space, space.rotations.centers[cell])
        return np.atleast_3d(reduce_blocks(classes, self._block_grid(cell).side))

    def _block_grid(self, cell: int | None) -> BlockGrid:
        """Return the blocks at a rotation, or those of the workspace."""
        return self.scene if cell is None else self._states

    def make_solid(self, cell: int | None, kind: SolidKind, cut: float) -> Surface:
        """Return the surface of a kind's blocks below the height ``cut``, metres."""
        solid = np.isin(self._blocks_below(cell, cut), kind.classes)
        # Corners of rectangles in cells; the last blocks may reach beyond the map.
        blocks = self._block_grid(cell)
        corners = blocks.side * extract_border(solid, kind.has_boundary)
        nodes = np.minimum(corners, blocks.shape).reshape(-1, 3)
        vertices = blocks.lower + blocks.cell * nodes
        vertices[:, 2] = np.minimum(vertices[:, 2], cut)
        # Each rectangle becomes two triangles.
        rectangles = np.arange(len(vertices)).reshape(-1, 4)
        return vertices, rectangles[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)

    def make_section(self, cell: int, cut: float) -> MapSection:
        """Return a picture of a map's horizontal cut.

        In space, it shows the blocks at the height ``cut``, metres; in the plane, all blocks.
        """
        layer = self._blocks_below(cell, cut)[:, :, -1]
        blocks = self._states
        lower = blocks.lower[:2]
        size = blocks.cell[:2] * blocks.side * layer.shape
        colors = np.array([(*hex_to_rgb(each.color), 255) for each in CellClass], dtype=np.uint8)
        if self.drawn.grid.dim == 3:
            colors[: CellClass.PARTLY + 1, 3] = 0  # free cells of a section are transparent
        # Images are indexed [row, column], and their first row is the one with the largest y.
        image = np.flipud(colors[layer].transpose(1, 0, 2))
        # Browsers blur enlarged images, so each block gets several pixels along each side.
        repeat = max(1, 1024 // max(layer.shape))
        image = image.repeat(repeat, axis=0).repeat(repeat, axis=1)
        return MapSection(image, lower, np.minimum(lower + size, blocks.upper[:2]))

    def _blocks_below(self, cell: int | None, cut: float) -> Bytes:
        """Return the classes of the blocks that begin below a height."""
        blocks = self._block_grid(cell)
        height = min(cut, blocks.upper[2]) - blocks.lower[2]
        # Subtracting 1e-9 keeps rounding from adding a layer; at least one layer is drawn.
        layers = math.ceil(height / blocks.cell[2] / blocks.side - 1e-9)
        return self.make_blocks(cell)[..., : max(1, layers)]


def extract_border(solid: Bools, has_boundary: bool = True) -> Ints:
    """Return solid cells' surface as few rectangles, shape (n, 4, 3).

    Corners are in cells, counterclockwise seen from outside. Squares in a row are merged into a
    rectangle, and rows of equal length into a larger one. The mesh is for display only, because
    corners may lie inside edges of other rectangles.

    Without ``has_boundary``, the surface is open at the ends of the array.
    """
    rectangles = []
    for axis, up in product(range(3), (0, 1)):
        faces, _ = find_faces(solid, axis, up, is_closed=has_boundary, is_merged=True)
        rectangles.append(faces)
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
    """Return a vector in space: a plane one gets ``third`` as z."""
    return np.array([*values, third][:3])


def hex_to_rgb(color: str) -> tuple[int, int, int]:
    """Convert a colour such as ``"#0072b2"`` to bytes red, green, blue."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


def to_quaternion(pose: Floats) -> Floats:
    """Convert rotation matrices or poses to quaternions w, x, y, z.

    Matrices have shape (..., 3, 3), poses (..., 4, 4).
    """
    return np.asarray(Rotation.from_matrix(pose[..., :3, :3]).as_quat(scalar_first=True))
