"""No path: cells that bar the way, and a flood of all others that never meets each place."""

from typing import NamedTuple

import numpy as np
import shapely

from .pieces import turn
from .verdict import NOT_SHOWN, PROVEN, TOLERANCE, TOO_MUCH, Verdict

TURN = 2.0 * np.pi


class Place(NamedTuple):
    """Configurations within a distance of a geometry or a point, and an angle of a yaw.

    A point is a tuple of numbers, in the plane or in space; a yaw of None is any yaw.
    """

    where: object
    distance: float = 0.0
    yaw: float | None = None
    angle: float = 0.0

    @property
    def is_one(self):
        """Whether it is a single configuration, if the robot has no other yaws than its own."""
        return isinstance(self.where, tuple) and not self.distance and not self.angle

    def holds(self, q, slack=1e-6):
        """Return True if a configuration lies in the place, but for a slack."""
        dim = 2 if hasattr(self.where, "geom_type") else len(self.where)
        if dim == 2 and hasattr(self.where, "geom_type"):
            gap = self.where.distance(shapely.Point(q[:2]))
        else:
            gap = float(np.linalg.norm(np.subtract(q[:dim], self.where)))
        if self.yaw is None or len(q) <= dim:
            return gap <= self.distance + slack
        off = abs((q[dim] - self.yaw + np.pi) % TURN - np.pi)
        return gap <= self.distance + slack and off <= self.angle + slack

    def find_cells(self, lower, spacing, shape, borders):
        """Return flat indices of the cells (yaw, x, y(, z)) that the place meets."""
        slack = TOLERANCE * spacing
        flat = hasattr(self.where, "geom_type")
        box = np.reshape(self.where.bounds, (2, 2)) if flat else np.array([self.where] * 2)
        reach = self.distance + slack
        first = np.floor((box[0] - reach - lower) / spacing).astype(int)
        last = np.floor((box[1] + reach - lower) / spacing).astype(int)
        sides = [
            np.arange(max(a - 1, 0), min(b + 2, n))
            for a, b, n in zip(first, last, shape, strict=True)
        ]
        cells = np.stack(np.meshgrid(*sides, indexing="ij"), -1).reshape(-1, len(shape))
        low = lower + spacing * cells
        if flat:
            boxes = shapely.box(*(low - slack).T, *(low + spacing + slack).T)
            near = shapely.intersects(self.where, boxes)
            near |= shapely.distance(self.where, boxes) <= self.distance
        else:
            away = np.maximum(np.maximum(low - self.where, self.where - low - spacing), 0.0)
            near = np.linalg.norm(away, axis=1) <= reach
        turns = np.arange(max(len(borders) - 1, 1))
        if self.yaw is not None and len(borders):
            middles, halves = 0.5 * (borders[1:] + borders[:-1]), 0.5 * np.diff(borders)
            off = abs((middles - self.yaw + np.pi) % TURN - np.pi) - halves
            turns = np.flatnonzero(off <= self.angle + 1e-9)
        positions = np.ravel_multi_index(tuple(cells[near].T), shape)
        return (turns[:, None] * int(np.prod(shape)) + positions).ravel()


def holds(places, q, slack=1e-6):
    """Return True if a configuration lies in one of the alternatives."""
    return any(place.holds(q, slack) for place in places)


def check_no_path(robot, world, grid, borders, places, barred, offsets, budget, is_open=False):
    """Check that no motion leads from the first place by way of the others to the last one.

    Parameters
    ----------
    robot : sequence of Part
        Convex polygons and discs; in space, boxes and balls.
    world : Plane, or anything else with ``cover``
    grid : (lower, spacing, shape)
    borders : array-like, shape (k + 1,), or empty
        Borders of the cells of yaws, increasing by a whole turn; empty if the robot does not turn.
    places : sequence of lists of Place
        Alternatives of the start, of each place on the way, and of the goal.
    barred : ndarray of int, shape (n, 1 + d)
        Cells (yaw, x, y(, z)) that bar the way.
    offsets : ndarray of float, shape (n, d)
        From the reference point to a point of the robot that lies in an obstacle wherever the robot
        is in the cell, and however it is turned there.
    is_open : bool
        Whether a motion may leave the grid.
    """
    lower, spacing, shape = np.asarray(grid[0], float), grid[1], tuple(grid[2])
    borders = np.asarray(borders, float)
    turns = max(len(borders) - 1, 1)
    if not budget.take(len(barred) + turns * int(np.prod(shape)) // 64):
        return TOO_MUCH
    if len(borders) and not np.isclose(borders[-1] - borders[0], TURN):
        return Verdict(NOT_SHOWN, "the cells of yaws are no whole turn")
    slack = TOLERANCE * spacing
    low = lower + spacing * barred[:, 1:] + offsets
    outside = ~world.cover(low + slack, low + spacing - slack)
    if outside.any():
        k = int(np.flatnonzero(outside)[0])
        return Verdict(NOT_SHOWN, f"cell {barred[k].tolist()}: its witness leaves the obstacles")
    middle = half = np.zeros(len(barred))
    if len(borders):
        middle = 0.5 * (borders[1:] + borders[:-1])[barred[:, 0]]
        half = 0.5 * np.diff(borders)[barred[:, 0]]
    points = np.column_stack([turn(offsets[:, :2], -middle), offsets[:, 2:]])
    moved = 2.0 * np.linalg.norm(offsets[:, :2], axis=1) * np.sin(0.5 * half)
    depth = np.max([_find_depths(part, points) for part in robot], axis=0)
    shallow = depth < moved - slack
    if shallow.any():
        k = int(np.flatnonzero(shallow)[0])
        return Verdict(
            NOT_SHOWN, f"cell {barred[k].tolist()}: its witness is no point of the robot"
        )
    return _flood(lower, spacing, shape, borders, places, barred, is_open)


def _find_depths(part, points):
    """Return how deep points lie in a part, metres; negative outside."""
    corners = np.asarray(part.corners)
    if len(corners) == 1:
        return part.radius - np.linalg.norm(points - corners[0], axis=1)
    if corners.shape[1] == 3:  # a box
        low, high = corners.min(axis=0), corners.max(axis=0)
        return part.radius + np.minimum(points - low, high - points).min(axis=1)
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.column_stack([edges[:, 1], -edges[:, 0]])
    normals /= np.linalg.norm(edges, axis=1, keepdims=True)
    x, y = corners.T
    normals *= np.sign(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))  # outward
    return part.radius + ((normals * corners).sum(axis=1) - points @ normals.T).min(axis=1)


def _flood(lower, spacing, shape, borders, places, barred, is_open):
    """Check that no component of the cells that are not barred meets each place."""
    turns, positions = max(len(borders) - 1, 1), int(np.prod(shape))
    passable = np.ones((turns, *shape), bool)
    passable[tuple(barred.T)] = False
    rim = np.zeros((turns, *shape), bool)
    for axis in range(1, passable.ndim):
        rim.swapaxes(0, axis)[[0, -1]] = True
    rim, passable = rim.ravel(), passable.ravel()
    steps = [int(np.prod(shape[k + 1 :])) for k in range(len(shape))]
    found = []
    for place in places:
        cells = [each.find_cells(lower, spacing, shape, borders) for each in place]
        # A single configuration in a closed cell that is barred is in collision.
        kept = [
            c for c, each in zip(cells, place, strict=True) if not each.is_one or passable[c].all()
        ]
        found.append(np.unique(np.concatenate([*kept, np.zeros(0, int)]).astype(int)))
    fewest = min(0, -1, key=lambda k: len(found[k]))
    seeds = found[fewest][passable[found[fewest]]]
    number = np.zeros(passable.size, np.int32)
    count = 0
    for seed in seeds:
        if number[seed]:
            continue
        count += 1
        front, left = np.array([seed]), False
        number[seed] = count
        while len(front):
            following = []
            at = front % positions
            for step, size in zip(steps, shape, strict=True):
                index = at // step % size
                following += [front[index > 0] - step, front[index < size - 1] + step]
            if turns > 1:
                following += [(front + by * positions) % passable.size for by in (1, -1)]
            if is_open and not left and rim[front].any():
                left = True
                following.append(np.flatnonzero(rim))
            front = np.concatenate(following)
            front = np.unique(front[passable[front] & (number[front] == 0)])
            number[front] = count
        reached = [bool((number[cells] == count).any()) for cells in found]
        if all(reached):
            return Verdict(NOT_SHOWN, "cells that nothing bars join all places")
    return Verdict(PROVEN, f"{len(barred)} cells bar {count} components")
