"""Exact solids in space: boxes, balls and triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import fcl
import numpy as np
from scipy.spatial.transform import Rotation

from cspace.support.arrays import Bools, Floats, Ints
from tests.helpers import solids
from tests.helpers.oracles import box_gaps, chunks, distance_to_triangles, winds_around

_FRONT = [[0, 1, 3], [0, 3, 2], [0, 4, 5], [0, 5, 1], [0, 2, 6], [0, 6, 4]]
_BACK = [[4, 6, 7], [4, 7, 5], [2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3]]
SIDES = np.array([*_FRONT, *_BACK])
"""Outward triangles of a box, as indices ``4 x + 2 y + z`` of its corners."""


def matrix_of(rotation: Floats) -> Floats:
    """Return the matrix of a yaw, a quaternion, or nothing."""
    turn = (
        Rotation.from_quat(rotation)
        if len(rotation) == 4
        else Rotation.from_rotvec([0.0, 0.0, rotation.sum()])
    )
    return np.asarray(turn.as_matrix())


def draw_directions(number: int, rng: np.random.Generator) -> Floats:
    """Draw unit vectors, shape (number, 3)."""
    normals = rng.normal(size=(number, 3))
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


# ---- shapes --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Blocks:
    """A union of aligned boxes, each grown by a radius; a ball is a box without extent.

    Attributes
    ----------
    low, high : ndarray, shape (n, 3)
    radius : ndarray, shape (n,)
    """

    low: Floats
    high: Floats
    radius: Floats

    @classmethod
    def boxes(cls, corners: Any) -> Blocks:
        """Make boxes from corners, shape (n, 2, 3)."""
        low, high = np.moveaxis(np.asarray(corners, dtype=np.float64).reshape(-1, 2, 3), 1, 0)
        return cls(low, high, np.zeros(len(low)))

    @classmethod
    def balls(cls, centers: Floats, radii: Floats) -> Blocks:
        return cls(centers, centers, radii)

    @property
    def are_balls(self) -> bool:
        return bool((self.low == self.high).all())

    @property
    def bounds(self) -> Floats:
        radius = self.radius[:, None]
        return np.array([(self.low - radius).min(axis=0), (self.high + radius).max(axis=0)])

    def translate(self, by: Floats) -> Blocks:
        return Blocks(self.low + by, self.high + by, self.radius)

    def rotate(self, matrix: Floats) -> Blocks | SolidSurface:
        """Rotate about the origin; boxes become triangles."""
        if self.are_balls:
            return Blocks.balls(self.low @ matrix.T, self.radius)
        return self.to_surface().rotate(matrix)

    def sample(self, number: int, rng: np.random.Generator) -> Floats:
        """Draw points of the shape, many on its boundary."""
        chosen = rng.integers(0, len(self.low), number)
        t = rng.choice([0.0, 1.0, np.nan], (number, 3))
        t = np.where(np.isnan(t), rng.random((number, 3)), t)
        away = (
            draw_directions(number, rng)
            * (rng.choice([1.0, 0.5], number) * self.radius[chosen])[:, None]
        )
        return np.asarray(self.low[chosen] + t * (self.high - self.low)[chosen] + away)

    def to_surface(self) -> SolidSurface:
        """Convert boxes to triangles."""
        extremes = np.stack([self.low, self.high])
        bits = np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)])
        corners = np.stack([extremes[bits[:, axis], :, axis] for axis in range(3)], axis=-1)
        return SolidSurface(
            corners.transpose(1, 0, 2)[:, SIDES].reshape(-1, 3, 3),
            np.repeat(np.arange(len(self.low)), 12),
        )


@dataclass(frozen=True, eq=False)
class SolidSurface:
    """Triangles, and the union of the closed bodies inside.

    Attributes
    ----------
    triangles : ndarray, shape (n, 3, 3)
    body : ndarray of int64, shape (n,)
        Index of the body that each triangle bounds; negative if it bounds none.
    """

    triangles: Floats
    body: Ints

    @classmethod
    def of_bodies(cls, bodies: list[Floats]) -> SolidSurface:
        """Unite the triangles of bodies."""
        return cls(
            np.concatenate(bodies),
            np.repeat(np.arange(len(bodies)), [len(body) for body in bodies]),
        )

    @property
    def bounds(self) -> Floats:
        corners = self.triangles.reshape(-1, 3)
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    @cached_property
    def spots(self) -> Floats:
        """A corner of each body and of each other triangle."""
        first = np.unique(self.body[self.body >= 0], return_index=True)[1]
        closed = self.triangles[self.body >= 0][first, 0]
        return np.concatenate([closed, self.triangles[self.body < 0, 0]])

    def translate(self, by: Floats) -> SolidSurface:
        return SolidSurface(self.triangles + by, self.body)

    def rotate(self, matrix: Floats) -> SolidSurface:
        """Rotate about the origin."""
        return SolidSurface(self.triangles @ matrix.T, self.body)

    def sample(self, number: int, rng: np.random.Generator) -> Floats:
        """Draw points of the triangles, shape (number, 3)."""
        share = rng.dirichlet((0.5, 0.5, 0.5), number)
        return np.asarray(
            (self.triangles[rng.integers(0, len(self.triangles), number)] * share[..., None]).sum(
                axis=1
            )
        )

    def encloses(self, points: Floats) -> Bools:
        """Return True where points lie in a body."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for body in range(int(self.body.max(initial=-1)) + 1):
            triangles = self.triangles[self.body == body]
            low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
            boxed = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1) & ~inside)
            inside[boxed] = winds_around(points[boxed], triangles)
        return inside

    def distances(self, points: Floats) -> Floats:
        """Return distances from points to the solid, zero inside."""
        return np.where(self.encloses(points), 0.0, distance_to_triangles(points, self.triangles))

    def model(self) -> Any:
        """Convert the triangles to an object of FCL."""
        return solids.surface(
            self.triangles.reshape(-1, 3), np.arange(3 * len(self.triangles)).reshape(-1, 3)
        )


Shape = Blocks | SolidSurface


def merge_cells(occupied: Bools) -> Ints:
    """Merge cells into boxes (first, stop), shape (n, 2, 3)."""
    steps = np.diff(np.pad(occupied.astype(np.int8), ((0, 0), (0, 0), (1, 1))), axis=2)
    boxes = np.column_stack([np.argwhere(steps > 0), np.argwhere(steps < 0)])
    boxes[:, 3:5] += 1
    for axis in (1, 0):
        # Merge boxes that are equal on the other axes and follow one another along this one.
        others = [column for column in range(6) if column not in (axis, axis + 3)]
        boxes = boxes[np.lexsort([boxes[:, axis], *(boxes[:, column] for column in others)])]
        new = np.ones(len(boxes), dtype=np.bool_)
        new[1:] = (boxes[1:, others] != boxes[:-1, others]).any(axis=1) | (
            boxes[1:, axis] != boxes[:-1, axis + 3]
        )
        last = (
            np.append(np.flatnonzero(new)[1:], len(boxes)) - 1
            if len(boxes)
            else np.empty(0, dtype=np.int64)
        )
        upper = boxes[last, axis + 3]
        boxes = boxes[new]
        boxes[:, axis + 3] = upper
    return boxes.reshape(-1, 2, 3)


# ---- a robot among obstacles ---------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Pair:
    """A robot and obstacles; robot positions have shape (n, 3)."""

    robot: Any
    obstacles: Any

    @classmethod
    def of(cls, robot: Shape, obstacles: Shape) -> Pair:
        """Choose the class for a pair of shapes."""
        if isinstance(robot, Blocks) and isinstance(obstacles, Blocks):
            return BlockPair(robot, obstacles)
        if any(isinstance(shape, Blocks) and shape.are_balls for shape in (robot, obstacles)):
            return BallPair(robot, obstacles)
        return SurfacePair(_to_surface(robot), _to_surface(obstacles))

    def gaps(self, q: Floats) -> Floats:
        """Return distances (n,), zero if the shapes meet."""
        raise NotImplementedError

    def within(self, q: Floats, distance: Floats) -> Bools:
        """Return True where they come within distances, shape (n,)."""
        low, high = self.robot.bounds
        hit = np.zeros(len(q), dtype=np.bool_)
        near = np.flatnonzero(box_gaps(q + low, q + high, *self.obstacles.bounds) <= distance)
        hit[near] = self._near_within(q[near], distance[near])
        return hit

    def _near_within(self, q: Floats, distance: Floats) -> Bools:
        return np.asarray(self.gaps(q) <= distance)


def _to_surface(shape: Shape) -> SolidSurface:
    return shape.to_surface() if isinstance(shape, Blocks) else shape


class BlockPair(Pair):
    """Boxes and balls among boxes and balls."""

    def gaps(self, q: Floats) -> Floats:
        parts = [self._gaps(q[chunk]) for chunk in chunks(len(q), len(self.obstacles.low))]
        return np.concatenate([np.empty(0), *parts])

    def _gaps(self, q: Floats) -> Floats:
        robot, there = self.robot, self.obstacles
        low, high = robot.bounds
        bounds = box_gaps(q[:, None] + low, q[:, None] + high, there.low, there.high) - there.radius
        gaps = self._between(q, 0, bounds.argmin(axis=1))
        position, other = np.nonzero(bounds < gaps[:, None])
        for part in range(len(robot.low)):
            np.minimum.at(gaps, position, self._between(q[position], part, other))
        return np.maximum(gaps, 0.0)

    def _between(self, q: Floats, part: int, other: Ints) -> Floats:
        robot, there = self.robot, self.obstacles
        apart = box_gaps(
            q + robot.low[part], q + robot.high[part], there.low[other], there.high[other]
        )
        return np.asarray(apart - robot.radius[part] - there.radius[other])


class BallPair(Pair):
    """Balls among triangles, or triangles among balls."""

    def gaps(self, q: Floats) -> Floats:
        balls_move = isinstance(self.robot, Blocks) and self.robot.are_balls
        balls, others = (self.robot, self.obstacles) if balls_move else (self.obstacles, self.robot)
        points = balls.low[None] + (q if balls_move else -q)[:, None]
        apart = (
            _to_surface(others).distances(points.reshape(-1, 3)).reshape(points.shape[:2])
            - balls.radius
        )
        return np.asarray(np.maximum(apart.min(axis=1), 0.0))


class SurfacePair(Pair):
    """Triangles among triangles, by FCL."""

    @cached_property
    def _models(self) -> tuple[Any, Any]:
        return self.robot.model(), self.obstacles.model()

    def gaps(self, q: Floats) -> Floats:
        gaps = np.zeros(len(q))
        apart = np.flatnonzero(~self._meet(q))
        gaps[apart] = self._distances(q[apart])
        return gaps

    def _near_within(self, q: Floats, distance: Floats) -> Bools:
        hit = self._meet(q)
        open_ = np.flatnonzero(~hit & (distance > 0.0))
        hit[open_] = self._distances(q[open_]) <= distance[open_]
        return hit

    def _meet(self, q: Floats) -> Bools:
        """Return True where surfaces meet or contain pieces."""
        hit = np.zeros(len(q), dtype=np.bool_)
        low, high = self.robot.bounds
        near = np.flatnonzero(box_gaps(q + low, q + high, *self.obstacles.bounds) <= 0.0)
        moving, fixed = self._models
        for i in near.tolist():
            moving.setTranslation(q[i])
            hit[i] = solids.meet(fixed, moving)
        for spots, shape, sign in (
            (self.robot.spots, self.obstacles, 1.0),
            (self.obstacles.spots, self.robot, -1.0),
        ):
            left = near[~hit[near]]
            points = spots[None] + sign * q[left, None]
            hit[left] = shape.encloses(points.reshape(-1, 3)).reshape(points.shape[:2]).any(axis=1)
        return hit

    def _distances(self, q: Floats) -> Floats:
        (moving, fixed), distances = self._models, np.empty(len(q))
        for i, position in enumerate(q):
            moving.setTranslation(position)
            distances[i] = fcl.distance(fixed, moving)
        return np.maximum(distances, 0.0)


class Walls(Pair):
    """A robot in a box that it must not leave."""

    def gaps(self, q: Floats) -> Floats:
        (low, high), (first, last) = self.robot.bounds, self.obstacles
        return np.asarray(np.maximum(np.minimum(q + low - first, last - q - high).min(axis=1), 0.0))

    def within(self, q: Floats, distance: Floats) -> Bools:
        return np.asarray(self.gaps(q) <= distance)
