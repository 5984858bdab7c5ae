"""Collision by geometry, with shapely, for configurations of a map."""

import numpy as np
import shapely

from cspace.shapes import Balls


def draw_configurations(space, rng, n):
    """Configurations around and beyond the grid: anywhere, on borders and corners of cells, and close to them."""
    low, high, dim = np.asarray(space.grid.lower), np.asarray(space.grid.upper), space.grid.dim
    q = rng.uniform(low - 0.3, high + 0.3, (n, dim))
    snapped = low + space.grid.spacing * np.rint((q - low) / space.grid.spacing)
    q = np.where(rng.random((n, dim)) < 0.3, snapped, q)
    q += np.where(rng.random((n, dim)) < 0.1, rng.uniform(-1e-8, 1e-8, (n, dim)), 0.0)
    if not space.rotations.dof:
        return q
    on_border = rng.choice(np.asarray(space.rotations.borders), n) + 2.0 * np.pi * rng.integers(-1, 2, n)
    near = on_border + rng.choice([0.0, 1e-12, -1e-12, 1e-6, -1e-6], n)
    return np.column_stack([q, np.where(rng.random(n) < 0.4, near, rng.uniform(-9.0, 9.0, n))])


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


def turned(points, q):
    """Points of the robot, shape (m, 2), at configurations ``(x, y)`` or ``(x, y, yaw)``: shape (n, m, 2)."""
    z = (points[:, 0] + 1j * points[:, 1]) * np.exp(1j * q[:, 2:].sum(axis=1))[:, None]
    return np.stack([z.real, z.imag], axis=-1) + q[:, None, :2]


def placed(robot, q):
    """The robot's geometry at each configuration."""
    return [shapely.transform(robot, lambda points, one=one: turned(points, one[None])[0]) for one in q]


def collides(space, q, margin, obstacles=None):
    """Whether the robot at q comes within ``margin`` of an obstacle; a negative margin asks for as much depth."""
    shape = obstacles_of(space) if obstacles is None else shapely.union_all(obstacles)
    shapely.prepare(shape)
    robot = space.robot.shape
    if isinstance(robot, Balls):
        distances = shapely.distance(shapely.points(turned(robot.centers, q)), shape) - robot.radii
        return distances.min(axis=1) <= margin
    geometry = space.robot.geometry if margin >= 0 else space.robot.geometry.buffer(margin)
    if margin <= 0:
        return shapely.intersects(placed(geometry, q), shape)
    return shapely.dwithin(placed(geometry, q), shape, margin)
