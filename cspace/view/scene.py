"""What the page draws, as plain arrays: solids of cells, a section through them, the robot and its path."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import Bools, Floats, Ints, Surface
from cspace.grid import Grid
from cspace.plot.artists import (
    CLASSES,
    COLLIDES,
    LOST,
    OBSTACLE,
    PARTLY,
    PATH,
    ROBOT_FILL,
    UNDECIDED,
    UNSEEN,
    Classes,
)
from cspace.plot.route import rings
from cspace.plot.surface import SURFACES
from cspace.plot.surface import UNSEEN as DIM
from cspace.raster.bitmaps import merge_into_rectangles
from cspace.robot import Robot
from cspace.view.level_of_detail import Blocks, Part

Color = tuple[int, int, int]


class Kind(NamedTuple):
    """Cells that may be drawn as a solid.

    Attributes
    ----------
    label, color : str
    opacity : float
    classes : tuple of int
        Of the cells.
    turns : bool
        Whether they change with the rotation.
    rim : bool
        Whether their border is drawn also where the map ends.
    """

    label: str
    color: str
    opacity: float
    classes: tuple[int, ...]
    turns: bool
    rim: bool


KINDS: Final = {
    "obstacles": Kind(*SURFACES["obstacles"], 1.0, (OBSTACLE,), False, True),
    "unknown": Kind(*DIM, 1.0, (UNSEEN,), False, True),
    "border": Kind("C-obstacle", CLASSES[COLLIDES][1], 0.5, (UNDECIDED, COLLIDES, UNSEEN, OBSTACLE), True, False),
    "mixed": Kind("undecided (MIXED)", CLASSES[UNDECIDED][1], 0.7, (UNDECIDED,), True, True),
}
"""Solids that may be shown, by name."""
SECTION: Final = "section"
"""What is called so among them: the cells that a height cuts, or, of a map in the plane, the ground."""

LOW: Final = LOST
HIGH: Final = PATH
"""Colours of a path where its clearance is zero, and where it is largest."""
PIXELS: Final = 1024
"""A section of fewer cells is drawn in so many pixels at least, so that their borders are sharp."""


class Section(NamedTuple):
    """A picture in the plane: red, green, blue and opacity, shape (rows, columns, 4), the top row first.

    Attributes
    ----------
    image : ndarray of uint8
    lower, upper : ndarray of float64, shape (2,)
        Corners, metres.
    height : float
        Along z, metres.
    """

    image: NDArray[np.uint8]
    lower: Floats
    upper: Floats
    height: float


class Stage:
    """Where the cells of a grid stand in space: those of a plane are low walls on the ground.

    ``wall`` is the height of the walls, metres.

    Attributes
    ----------
    lower, upper : ndarray of float64, shape (3,)
        Corners of all that is drawn, metres.
    """

    def __init__(self, grid: Grid, wall: float) -> None:
        self.grid, self.has_height = grid, grid.dim == 3
        self.shape = np.array([*grid.shape, 1][:3])
        self.wall = wall
        self._cell = np.array([grid.spacing, grid.spacing, grid.spacing if self.has_height else wall])
        self.lower = np.array([*grid.lower, 0.0][:3])
        self.upper = self.lower + self._cell * self.shape
        # In space, one looks down through what is free.
        self._colors = np.array([(*rgb(color), 255) for _, color in CLASSES], dtype=np.uint8)
        self._colors[: PARTLY + 1, 3] = 0 if self.has_height else 255

    def point(self, q: Floats) -> Floats:
        """Where configurations lie, shape (..., 3)."""
        place = q[..., : self.grid.dim]
        return np.concatenate([place, np.zeros((*place.shape[:-1], 3 - self.grid.dim))], axis=-1)

    def solid(self, blocks: Blocks, kind: Kind, cut: float, hole: Part | None = None, lid: bool = True) -> Surface:
        """The border of the blocks of a kind that lie below a height, and not in a part that is drawn apart.

        Without a ``lid``, what the height cuts open stays open: a section closes it.
        """
        classes, first = self._below(blocks, cut)
        wanted = np.zeros(len(CLASSES), dtype=np.bool_)
        wanted[list(kind.classes)] = True
        solid = wanted[classes]
        if hole is not None:
            solid[_box(hole, blocks.side)] = False
        lattice = np.minimum(first + blocks.side * border(solid, kind.rim, lid), self.shape).reshape(-1, 3)
        vertices = self.lower + self._cell * lattice
        vertices[:, 2] = np.minimum(vertices[:, 2], cut)
        return vertices, np.arange(len(vertices)).reshape(-1, 4)[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)

    def section(self, blocks: Blocks, cut: float, hole: Part | None = None) -> Section:
        """The classes of the blocks below a height, seen from there; of a plane, on the ground."""
        layer = self._below(blocks, cut)[0][..., -1]
        lower = self.lower[:2] + self.grid.spacing * blocks.first[:2]
        upper = np.minimum(lower + self.grid.spacing * blocks.side * np.array(layer.shape), self.upper[:2])
        image = self._colors[layer]
        if hole is not None:
            image[_box(hole, blocks.side)[:2]] = 0
        image = image.transpose(1, 0, 2)[::-1]
        repeat = max(1, PIXELS // max(layer.shape))
        image = image.repeat(repeat, axis=0).repeat(repeat, axis=1)
        return Section(image, lower, upper, cut if self.has_height else 0.0)

    def _below(self, blocks: Blocks, cut: float) -> tuple[Classes, Ints]:
        """Classes of the blocks that lie below a height, in part at least, one layer or more; and their first cell."""
        classes, first = np.atleast_3d(blocks.classes), np.array([*blocks.first, 0][:3])
        count = (min(cut, self.upper[2]) - self.lower[2]) / self._cell[2] - first[2]
        return classes[..., : max(1, math.ceil(count / blocks.side - 1e-9))], first


def _box(part: Part, side: int) -> tuple[slice, ...]:
    """The blocks of some side that make up a part of a map."""
    return tuple(slice(low // side, -(-high // side)) for low, high in zip(part.first, part.stop, strict=True))


def border(solid: Bools, rim: bool = True, lid: bool = True) -> Ints:
    """The border of cells as few rectangles: corners on the lattice of the cells, shape (n, 4, 3).

    Counterclockwise where seen from outside. Squares in a row become one rectangle, and rows of the same length one
    larger one. Corners are not shared and lie on sides of others: to be looked at, not to be computed with.

    Without a ``rim``, cells at the border of the array have none there; without a ``lid``, the topmost ones have none
    above them.
    """
    sides = ((axis, up) for axis in range(3) for up in (0, 1))
    return np.concatenate([_facing(solid, axis, up, rim and (lid or (axis, up) != (2, 1))) for axis, up in sides])


def _facing(solid: Bools, axis: int, up: int, rim: bool) -> Ints:
    """The rectangles that face down an axis, or up it."""
    one, two = (axis + 1) % 3, (axis + 2) % 3
    cells = solid.transpose(axis, one, two)
    if not cells.any():
        return np.empty((0, 4, 3), dtype=np.int64)
    seen = cells.copy()
    inner = (slice(1, None), slice(None, -1)) if up == 0 else (slice(None, -1), slice(1, None))
    seen[inner[0]] &= ~cells[inner[1]]
    seen[-up] &= rim
    low, high = merge_into_rectangles(seen)
    corners = np.empty((len(low), 4, 3), dtype=np.int64)
    corners[..., axis] = low[:, :1] + up
    corners[..., one] = np.stack([low[:, 1], high[:, 1], high[:, 1], low[:, 1]], axis=1)
    corners[..., two] = np.stack([low[:, 2], low[:, 2], high[:, 2], high[:, 2]], axis=1)
    return corners if up else corners[:, ::-1]


def robot_surface(robot: Robot, height: float) -> Surface:
    """The surface of a robot in its frame; one in the plane becomes a slab of some height."""
    return _slab(robot, height) if robot.dim == 2 else robot.shape.outer.surface


def _slab(robot: Robot, height: float) -> Surface:
    """The outline of a robot in the plane, as high as a wall, with a top and no bottom."""
    import shapely

    outline = robot.shape.outer.outline
    parts = shapely.get_parts(shapely.orient_polygons(shapely.constrained_delaunay_triangles(outline)))
    top = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    triangles = [np.concatenate([top, np.full((*top.shape[:2], 1), height)], axis=2)]
    for ring in rings(outline):
        low, high = (np.column_stack([ring, np.full(len(ring), z)]) for z in (0.0, height))
        triangles += [
            np.stack([low[:-1], low[1:], high[1:]], axis=1),
            np.stack([low[:-1], high[1:], high[:-1]], axis=1),
        ]
    vertices = np.concatenate(triangles).reshape(-1, 3)
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def path_colors(clearances: Floats) -> NDArray[np.uint8]:
    """Colours of points of a path, shape (n, 3): :data:`LOW` at a clearance of zero, :data:`HIGH` at the largest."""
    largest = float(np.nanmax(clearances, initial=0.0, where=np.isfinite(clearances)))
    share = np.clip(np.nan_to_num(clearances, nan=0.0, posinf=largest) / max(largest, 1e-12), 0.0, 1.0)[:, np.newaxis]
    return np.rint((1.0 - share) * rgb(LOW) + share * rgb(HIGH)).astype(np.uint8)


def rgb(color: str) -> Color:
    """A colour such as ``"#0072b2"`` as three numbers of a byte."""
    red, green, blue = bytes.fromhex(color[1:])
    return red, green, blue


ROBOT: Final = ROBOT_FILL
