"""Collision by geometry, with shapely, for configurations of a map."""

import numpy as np
import shapely
from shapely import affinity


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
    if len(space.robot.radii):
        distance = np.min(
            [shapely.distance(shapely.points(q + center), shape) - radius for center, radius in zip_balls(space.robot)],
            axis=0,
        )
        return distance <= margin
    robot = space.robot.geometry if margin >= 0 else space.robot.geometry.buffer(margin)
    placed = [affinity.translate(robot, x, y) for x, y in q]
    return shapely.distance(placed, shape) <= max(margin, 0.0)


def zip_balls(robot):
    return zip(robot.centers, robot.radii, strict=True)
