"""Collision by geometry, with shapely, for configurations of a map."""

import numpy as np
import shapely

from cspace.shapes import Balls


def draw_configurations(space, rng, n, far=False):
    """Configurations around and beyond the grid: anywhere, on borders of cells and of the grid; and far away."""
    low, high, dim = np.asarray(space.grid.lower), np.asarray(space.grid.upper), space.grid.dim
    q = rng.uniform(low - 0.3, high + 0.3, (n, dim))
    snapped = low + space.grid.spacing * np.rint((q - low) / space.grid.spacing)
    q = np.where(rng.random((n, dim)) < 0.3, snapped, q)
    q += np.where(rng.random((n, dim)) < 0.1, rng.uniform(-1e-8, 1e-8, (n, dim)), 0.0)
    q = np.where(rng.random((n, dim)) < 0.05, np.where(rng.random((n, dim)) < 0.5, low, high), q)
    if far:
        q[::97] = rng.choice([-1e300, -1e9, 1e9, 1e300], q[::97].shape)
    if not space.rotations.dof:
        return q
    if space.rotations.dof == 4:
        return np.column_stack([q, draw_quaternions(space.rotations, rng, n)])
    on_border = rng.choice(np.asarray(space.rotations.borders), n) + 2.0 * np.pi * rng.integers(-1, 2, n)
    near = on_border + rng.choice([0.0, 1e-12, -1e-12, 1e-6, -1e-6], n)
    return np.column_stack([q, np.where(rng.random(n) < 0.4, near, rng.uniform(-9.0, 9.0, n))])


def draw_quaternions(rotations, rng, n):
    """Unit quaternions anywhere, on borders, edges and corners of cells, and close to them; of either sign."""
    borders = np.asarray(rotations.borders)
    quotients = rng.choice(borders, (n, 3)) + rng.choice([0.0, 1e-15, -1e-15, 1e-12, -1e-12, 1e-6, -1e-6], (n, 3))
    quotients = np.where(rng.random((n, 3)) < 0.5, quotients, np.tan(rng.uniform(-np.pi / 4, np.pi / 4, (n, 3))))
    q = rng.permuted(np.column_stack([quotients, np.ones(n)]), axis=1)
    q = np.where(rng.random((n, 1)) < 0.3, rng.normal(size=(n, 4)), q) * rng.choice([-1.0, 1.0], (n, 1))
    return q / np.linalg.norm(q, axis=1, keepdims=True)


def obstacles_of(space):
    """The closed obstacles as one geometry, and the outside where it is blocked."""
    (left, low), (right, high), h = space.grid.lower, space.grid.upper, space.grid.spacing
    frame = shapely.box(left, low, right, high)
    if space.workspace.shapes is None:
        corners = np.argwhere(space.workspace.outer) * h + (left, low)
        parts = shapely.box(corners[:, 0], corners[:, 1], corners[:, 0] + h, corners[:, 1] + h)
    else:
        parts = [part.intersection(frame) for shape in space.workspace.shapes for part in shape.geometries]
    shape = shapely.union_all(parts)
    if space.outside == "blocked":
        shape = shape.union(shapely.box(left - 100, low - 100, right + 100, high + 100).difference(frame))
    shapely.prepare(shape)
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
