"""Robots among obstacles in space, as an oracle: by pencil and paper, and by FCL where triangles meet triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from benchmarks.soak.space_geometry import Blocks, Shape, Skin, box_gaps, chunks
from cspace.arrays import Bools, Floats, Ints


class Pair(Protocol):
    """A robot and obstacles."""

    def gaps(self, q: Floats) -> Floats:
        """Their distances, shape (n,), with the robot moved by ``q``, shape (n, 3); zero where they meet."""

    def within(self, q: Floats, distance: Floats) -> Bools:
        """Whether they are that close, one distance for each of ``q``."""


def pair(robot: Shape, obstacles: Shape) -> Pair:
    """The way to decide a pair of shapes."""
    if isinstance(robot, Blocks) and isinstance(obstacles, Blocks):
        return BlockPair(robot, obstacles)
    if isinstance(robot, Blocks) and robot.radius.any():
        return BallPair(robot, _as_skin(obstacles), 1.0)
    if isinstance(obstacles, Blocks) and (obstacles.low == obstacles.high).all():
        return BallPair(obstacles, _as_skin(robot), -1.0)
    return SkinPair(_as_skin(robot), _as_skin(obstacles))


def _as_skin(shape: Shape) -> Skin:
    return shape.skin() if isinstance(shape, Blocks) else shape


@dataclass(frozen=True, eq=False)
class BlockPair:
    """Boxes and balls among boxes and balls."""

    robot: Blocks
    obstacles: Blocks

    def gaps(self, q: Floats) -> Floats:
        gaps = np.empty(len(q))
        for chunk in chunks(np.arange(len(q)), len(self.obstacles.low)):
            gaps[chunk] = self._gaps(q[chunk])
        return gaps

    def within(self, q: Floats, distance: Floats) -> Bools:
        return np.asarray(self.gaps(q) <= distance)

    def _gaps(self, q: Floats) -> Floats:
        robot, there = self.robot, self.obstacles
        low, high = robot.bounds
        least = box_gaps(q[:, None] + low, q[:, None] + high, there.low, there.high) - there.radius
        place = np.arange(len(q))
        gaps = self._between(q, 0, least.argmin(axis=1))
        place, other = np.nonzero(least < gaps[:, None])
        for part in range(len(robot.low)):
            np.minimum.at(gaps, place, self._between(q[place], part, other))
        return np.maximum(gaps, 0.0)

    def _between(self, q: Floats, part: int, other: Ints) -> Floats:
        robot, there = self.robot, self.obstacles
        apart = box_gaps(q + robot.low[part], q + robot.high[part], there.low[other], there.high[other])
        return np.asarray(apart - robot.radius[part] - there.radius[other])


@dataclass(frozen=True, eq=False)
class BallPair:
    """Balls and triangles, of which the balls are the robot (``sign`` 1) or the obstacles (-1)."""

    balls: Blocks
    skin: Skin
    sign: float

    def gaps(self, q: Floats) -> Floats:
        points = self.balls.low[None] + self.sign * q[:, None]
        apart = self.skin.distances(points.reshape(-1, 3)).reshape(points.shape[:2]) - self.balls.radius
        return np.asarray(np.maximum(apart.min(axis=1), 0.0))

    def within(self, q: Floats, distance: Floats) -> Bools:
        low, high = self.skin.bounds
        points = self.balls.low[None] + self.sign * q[:, None]
        far = box_gaps(points, points, low, high) - self.balls.radius
        near = np.flatnonzero(far.min(axis=1) <= distance)
        hit = np.zeros(len(q), dtype=np.bool_)
        hit[near] = self.gaps(q[near]) <= distance[near]
        return hit


@dataclass(frozen=True, eq=False)
class SkinPair:
    """Triangles among triangles: FCL tells whether they meet and how far they are apart."""

    robot: Skin
    obstacles: Skin

    @cached_property
    def _models(self) -> tuple[Any, Any]:
        return self.robot.model(), self.obstacles.model()

    def gaps(self, q: Floats) -> Floats:
        gaps = np.zeros(len(q))
        apart = np.flatnonzero(~self._meet(q))
        gaps[apart] = self._distances(q[apart])
        return gaps

    def within(self, q: Floats, distance: Floats) -> Bools:
        low, high = self.robot.bounds
        hit = np.zeros(len(q), dtype=np.bool_)
        near = np.flatnonzero(box_gaps(q + low, q + high, *self.obstacles.bounds) <= distance)
        hit[near] = self._meet(q[near])
        open_ = near[~hit[near] & (distance[near] > 0.0)]
        hit[open_] = self._distances(q[open_]) <= distance[open_]
        return hit

    def _meet(self, q: Floats) -> Bools:
        """Whether surfaces meet, or a piece of one lies in the other."""
        import fcl

        moved, fixed = self._models
        asked = fcl.CollisionRequest()
        hit = np.zeros(len(q), dtype=np.bool_)
        low, high = self.robot.bounds
        near = np.flatnonzero(box_gaps(q + low, q + high, *self.obstacles.bounds) <= 0.0)
        for i in near.tolist():
            moved.setTranslation(q[i])
            hit[i] = fcl.collide(fixed, moved, asked, fcl.CollisionResult()) > 0
        for spots, skin, sign in ((self.robot.spots, self.obstacles, 1.0), (self.obstacles.spots, self.robot, -1.0)):
            left = near[~hit[near]]
            points = spots[None] + sign * q[left, None]
            hit[left] = skin.encloses(points.reshape(-1, 3)).reshape(points.shape[:2]).any(axis=1)
        return hit

    def _distances(self, q: Floats) -> Floats:
        import fcl

        moved, fixed = self._models
        distances = np.empty(len(q))
        for i, place in enumerate(q):
            moved.setTranslation(place)
            distances[i] = fcl.distance(fixed, moved, fcl.DistanceRequest(), fcl.DistanceResult())
        return np.maximum(distances, 0.0)


@dataclass(frozen=True, eq=False)
class Walls:
    """What lies around a box, in which the robot must stay.

    Attributes
    ----------
    bounds : ndarray, shape (2, 3)
        Of the robot.
    box : ndarray, shape (2, 3)
    """

    bounds: Floats
    box: Floats

    def gaps(self, q: Floats) -> Floats:
        low, high = self.bounds
        apart = np.minimum(q + low - self.box[0], self.box[1] - q - high).min(axis=1)
        return np.asarray(np.maximum(apart, 0.0))

    def within(self, q: Floats, distance: Floats) -> Bools:
        return np.asarray(self.gaps(q) <= distance)
