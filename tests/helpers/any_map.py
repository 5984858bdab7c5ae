"""Maps of every space in several storages, with the states that they must have."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import shapely
import trimesh

import cspace
from cspace import Robot, Rotations, Workspace
from cspace._support.arrays import Bools, Floats, States
from tests.helpers.placements import draw_configurations
from tests.helpers.regions import rotations_of

SPACING = 0.1

WEDGE = np.array([(-0.2, -0.15), (0.65, -0.05), (0.1, 0.25)])
"""Corners of a robot in the plane, far from round and large next to the cells."""

PLANK = np.array([(x, y, z) for x in (-0.05, 0.45) for y in (-0.1, 0.1) for z in (0.0, 0.1)])
"""Corners of a box in space, most of it far from the reference point."""

NEEDLE = np.array([(-0.1, -0.1), (3.0, 0.0), (-0.1, 0.1)])
"""Corners of a robot in the plane that is thirty cells long."""

TIP = np.array([(1.1, -1.1, 0.0)])
"""Center of a small ball in space, perpendicular to the axis of the longest turn in a cell."""


BLOCKED_OUTSIDE = ("plane", "yaw in space")


class Inputs(NamedTuple):
    """Cells of the workspace, corners of the robot, rotation cells and number of obstacles.

    One corner is the center of a small ball, two or more those of a polygon or box. A robot on a
    floor is a prism over its corners, and meets each obstacle at some height.
    """

    shape: tuple[int, ...]
    corners: Floats
    rotations: Any
    obstacles: int
    on_floor: bool = False


LONG_INPUTS = {
    "plane": Inputs((72, 70), NEEDLE, 3, 1),
    "space": Inputs((36, 35, 36), TIP, Rotations.quaternions(1), 1),
}
"""Inputs with long robots and few rotation cells, so that a turn sweeps many cells."""

MAP_INPUTS = {
    "plane": Inputs((40, 33), WEDGE, None, 14),
    "space": Inputs((14, 12, 13), PLANK, None, 8),
    "yaw": Inputs((30, 27), WEDGE, 8, 5),
    "yaw in space": Inputs((15, 15, 9), PLANK, 6, 1),
    "quaternions": Inputs((14, 13, 12), PLANK, Rotations.quaternions(2), 1),
}

ON_FLOOR = Inputs((30, 27), WEDGE, 8, 5, on_floor=True)
"""Inputs of a map in the plane whose workspace is in space."""

ALL_KINDS = [
    *((space, "memory") for space in MAP_INPUTS),
    ("yaw", "tiled"),
    ("quaternions", "saved"),
]
"""Kinds of maps: space and storage."""


class AnyMap(NamedTuple):
    """A map of any kind with its expected states.

    Attributes
    ----------
    space : CSpace or TiledCSpace
    memory : CSpace
        The same map in memory.
    states : ndarray of uint8, shape (rotations, nx, ny(, nz))
        The state of each cell of ``memory``.
    occupied : ndarray of bool, shape (nx, ny(, nz))
        The obstacle cells.
    corners : ndarray of float, shape (n, d)
        Corners of the robot, which is convex, metres.
    rebuild : callable
        Build the map of other obstacles in memory.
    """

    space: Any
    memory: cspace.CSpace
    states: States
    occupied: Bools
    corners: Floats
    rebuild: Callable[[Bools], cspace.CSpace]

    @property
    def on_floor(self):
        """Whether the robot drives on a floor, where overlaps are not counted."""
        return self.memory.floor is not None

    @property
    def dim(self):
        """Dimension of the workspace."""
        return self.occupied.ndim

    def draw_inside(self, rng, n):
        """Draw configurations inside cells, with their cells ``(rotation, x, y(, z))``."""
        cells = np.column_stack([rng.integers(0, size, n) for size in self.states.shape])
        shares = rng.uniform(0.02, 0.98, (n, self.dim))
        positions = np.array(self.space.grid.lower) + SPACING * (cells[:, 1:] + shares)
        return np.hstack([positions, self.space.rotations.centers[cells[:, 0]]]), cells

    def draw_contacts(self, rng, n):
        """Draw configurations at which a point of the robot touches an obstacle.

        Rotations often lie on borders of cells, and points on corners.
        """
        q = draw_configurations(self.memory, rng, n)
        weights = rng.dirichlet(np.full(len(self.corners), 0.1), n)
        points = weights @ self.corners
        cells = rng.choice(np.argwhere(self.occupied), n)
        shares = np.clip(rng.uniform(-1.0, 2.0, cells.shape), 0.0, 1.0)
        touched = np.array(self.space.grid.lower) + SPACING * (cells + shares)
        in_space = np.pad(points, [(0, 0), (0, 3 - self.dim)])
        moved = rotations_of(q, self.dim).apply(in_space)[:, : self.dim]
        q[:, : self.dim] = touched - moved
        return q

    def draw_moves(self, rng, n):
        """Draw steps of a few cells, some along axes, and turns of up to a radian."""
        steps = rng.normal(0.0, 1.5 * SPACING, (n, self.dim))
        steps *= rng.random((n, self.dim)) < 0.7
        turns = rng.normal(0.0, 0.3, (n, 3)) * (rng.random((n, 1)) < 0.6)
        return steps, turns


def draw_obstacles(shape, number, rng):
    """Draw obstacle cells at random."""
    occupied = np.zeros(shape, dtype=bool)
    occupied.flat[rng.choice(occupied.size, number, replace=False)] = True
    return occupied


def reopen(space, path):
    """Save a map in memory and open the file."""
    space.save(path)
    return cspace.open(path)


def build_map(space, storage, outside, seed, folder, thin=False):
    """Build a map of a space in memory, tiled, or saved and opened.

    If ``thin``, the obstacles fill only half of the cells that they touch.
    """
    inputs = ON_FLOOR if space == "floor" else MAP_INPUTS[space]
    return build_of(inputs, storage, outside, seed, folder, thin)


def build_of(inputs, storage, outside, seed, folder, thin=False):
    """Build a map as :func:`build_map`, of given inputs."""
    shape, corners, rotations, number, on_floor = inputs
    low, high = corners.min(axis=0), corners.max(axis=0)
    if len(corners) == 1:
        robot = Robot.ball(0.01, corners[0])
    elif on_floor:
        prism = trimesh.creation.extrude_polygon(shapely.Polygon(corners), 0.2)
        robot = Robot.from_mesh(prism)
    elif len(shape) == 2:
        robot = Robot.polygon(corners)
    else:
        robot = Robot.box(high - low, (low + high) / 2)
    rng = np.random.default_rng(seed)
    lower = rng.uniform(-1.0, 1.0, len(shape))
    filled = rng.random(shape) < 0.5
    heights = np.random.default_rng(seed).integers(2, 5, shape)  # layers that the robot meets

    def rebuild(occupied, **options):
        if on_floor:
            # Each obstacle stands at one of the robot's heights, and others stand beyond them.
            layers = np.arange(8)
            cells = (heights[..., np.newaxis] == layers) & occupied[..., np.newaxis]
            cells[..., [0, 6, 7]] = rng.random((*shape, 3)) < 0.3
            scene = Workspace.from_array(cells, SPACING, (*lower, 0.0))
            return cspace.build(
                scene, robot, rotations=rotations, outside=outside, floor=0.25, **options
            )
        inner = occupied & filled if thin else None
        workspace = Workspace.from_array(occupied, SPACING, lower, inner=inner)
        return cspace.build(workspace, robot, rotations=rotations, outside=outside, **options)

    occupied = draw_obstacles(shape, number, rng)
    memory = rebuild(occupied)
    states = memory.cell_states.reshape(-1, *shape)
    made = memory
    if storage == "tiled":
        made = rebuild(occupied, store=folder / "tiled.zarr", tile=7)
    elif storage == "saved":
        made = reopen(memory, folder / "saved.zarr")
    return AnyMap(made, memory, states, occupied, corners, rebuild)


def build_kind(kind, folder):
    """Build a map of a kind; its exterior is blocked or free, depending on the space."""
    space, storage = kind
    outside = "blocked" if space in BLOCKED_OUTSIDE else "free"
    return build_map(space, storage, outside, 5, folder)


def draw_on_borders(any_map, rng, n):
    """Draw configurations in the grid, half of whose coordinates lie on borders of cells."""
    q, cells = any_map.draw_inside(rng, n)
    borders = np.array(any_map.space.grid.lower) + SPACING * cells[:, 1:]
    on_border = rng.random(borders.shape) < 0.5
    q[:, : any_map.dim] = np.where(on_border, borders, q[:, : any_map.dim])
    if any_map.space.rotations.names == ("yaw",):
        yaws = any_map.space.rotations._stored_arrays["yaw_bounds"].ravel()
        q[:, -1] = np.where(rng.random(n) < 0.5, rng.choice(yaws, n), q[:, -1])
    return q


def draw_free_pairs(any_map, rng):
    """Draw FREE configurations on borders of cells, as firsts and lasts."""
    q = draw_on_borders(any_map, rng, 200)
    q = q[any_map.space.is_free(q)][:40]
    return np.split(q[: len(q) // 2 * 2], 2)
