"""Collision by geometry, with shapely, for configurations of a map."""

import numpy as np
import shapely
from shapely import affinity

from cspace import CSpace, Robot, Workspace
from cspace.rotations import Rotations
from cspace.shapes import Balls


def draw_configurations(space, rng, n):
    """Configurations around and beyond the grid: anywhere, on borders and corners of cells, and close to them."""
    low, high = np.asarray(space.grid.lower), np.asarray(space.grid.upper)
    q = rng.uniform(low - 0.3, high + 0.3, (n, 2))
    snapped = np.asarray(space.grid.lower) + space.grid.spacing * np.rint((q - low) / space.grid.spacing)
    on_border = rng.random((n, 2)) < 0.3
    q = np.where(on_border, snapped, q)
    return q + np.where(rng.random((n, 2)) < 0.1, rng.uniform(-1e-8, 1e-8, (n, 2)), 0.0)


def obstacles_of(space):
    """The obstacle cells of a grid map, and the outside where it is blocked, as one geometry."""
    h, low = space.grid.spacing, np.asarray(space.grid.lower)
    corners = np.argwhere(space.workspace.outer) * h + low
    cells = shapely.box(corners[:, 0], corners[:, 1], corners[:, 0] + h, corners[:, 1] + h)
    shape = shapely.union_all(cells)
    if space.outside == "blocked":
        frame = shapely.box(*space.grid.lower, *space.grid.upper)
        shape = shape.union(frame.buffer(100, join_style="mitre").difference(frame))
    return shape


def collides(space, q, margin, obstacles=None):
    """Whether the robot at q comes within ``margin`` of an obstacle; a negative margin asks for as much depth."""
    shape = obstacles_of(space) if obstacles is None else shapely.union_all(obstacles)
    if isinstance(space.robot.shape, Balls):
        distance = np.min(
            [shapely.distance(shapely.points(q + center), shape) - radius for center, radius in zip_balls(space.robot)],
            axis=0,
        )
        return distance <= margin
    robot = space.robot.geometry if margin >= 0 else space.robot.geometry.buffer(margin)
    placed = [affinity.translate(robot, x, y) for x, y in q]
    return shapely.distance(placed, shape) <= max(margin, 0.0)


def zip_balls(robot):
    return zip(robot.shape.centers, robot.shape.radii, strict=True)


def draw_turned(space, rng, n):
    """Configurations ``(x, y, yaw)``: as :func:`draw_configurations`, with yaws anywhere and on borders of cells."""
    borders = np.asarray(space.rotations.borders)
    yaw = rng.uniform(-9.0, 9.0, n)
    on_border = rng.choice(borders, n) + 2.0 * np.pi * rng.integers(-1, 2, n)
    near = on_border + rng.choice([0.0, 1e-12, -1e-12, 1e-6, -1e-6], n)
    yaw = np.where(rng.random(n) < 0.4, near, yaw)
    return np.column_stack([draw_configurations(space, rng, n), yaw])


def turned(points, q):
    """Points of the robot, shape (m, 2), at configurations ``(x, y, yaw)``, shape (n, 3): shape (n, m, 2)."""
    z = (points[:, 0] + 1j * points[:, 1]) * np.exp(1j * q[:, 2])[:, None]
    return np.stack([z.real, z.imag], axis=-1) + q[:, None, :2]


def turned_collides(space, q, margin, obstacles=None):
    """:func:`collides` for configurations ``(x, y, yaw)``; discs by exact distances, polygons by their corners."""
    shape = obstacles_of(space) if obstacles is None else obstacles
    shapely.prepare(shape)
    if isinstance(space.robot.shape, Balls):
        centers = turned(space.robot.shape.centers, q)
        distance = np.min(
            [
                shapely.distance(shapely.points(centers[:, k]), shape) - radius
                for k, radius in enumerate(space.robot.shape.radii)
            ],
            axis=0,
        )
        return distance <= margin
    robot = space.robot.geometry if margin >= 0 else space.robot.geometry.buffer(margin)
    placed = [shapely.transform(robot, lambda points, one=one: turned(points, one[None])[0]) for one in q]
    if margin <= 0:
        return shapely.intersects(placed, shape)
    return shapely.dwithin(placed, shape, margin)


def map_of(state, spacing=0.25, outside="blocked"):
    """A map made by hand, of a robot that is a point to speak of."""
    robot = Robot.disc(1e-6) if state.ndim == 2 else Robot.ball(1e-6)
    workspace = Workspace.from_array(np.zeros(state.shape, bool), spacing)
    return CSpace(workspace, robot, state.astype(np.uint8), outside=outside, margin=0.0, precision="float32")


def stack_of(state, rotations, robot=None, outside="free", spacing=0.25):
    """A map made by hand from slices, of a robot that is a point to speak of and shares no slices."""
    state = np.asarray(state, dtype=np.uint8)
    return CSpace(
        Workspace.from_array(np.zeros(state.shape[1:], dtype=bool), spacing),
        robot or Robot.disc(1e-6, (1e-7, 0.0)),
        state,
        outside=outside,
        margin=0.0,
        precision="float32",
        rotations=Rotations.of(rotations),
    )
