"""Exact shapes in space, as an oracle that shares no code with the library.

Distances of boxes by pencil and paper, of points and triangles by their closest points, and an inside test by solid
angles.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from cspace.arrays import Bools, Floats, Ints

PAIRS = 400_000
"""Pairs of shapes that are looked at in one go."""

_FRONT = [[0, 1, 3], [0, 3, 2], [0, 4, 5], [0, 5, 1], [0, 2, 6], [0, 6, 4]]
_BACK = [[4, 6, 7], [4, 7, 5], [2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3]]
SIDES = np.array([*_FRONT, *_BACK])
"""Triangles of a box, facing outward, as numbers ``4 x + 2 y + z`` of its corners."""


def matrix_of(rotation: Floats) -> Floats:
    """The matrix of a rotation as configurations tell it: by no number, a yaw, or a quaternion."""
    made = Rotation.from_quat(rotation) if len(rotation) == 4 else Rotation.from_rotvec([0.0, 0.0, rotation.sum()])
    return np.asarray(made.as_matrix())


@dataclass(frozen=True, eq=False)
class Blocks:
    """A union of boxes along the axes, each grown by a radius; a ball is a box without extent.

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
        """Boxes by their lower and upper corners, shape (n, 2, 3)."""
        low, high = np.moveaxis(np.asarray(corners, dtype=np.float64).reshape(-1, 2, 3), 1, 0)
        return cls(low, high, np.zeros(len(low)))

    @classmethod
    def balls(cls, centers: Floats, radii: Floats) -> Blocks:
        return cls(centers, centers, radii)

    @property
    def bounds(self) -> Floats:
        radius = self.radius[:, None]
        return np.array([(self.low - radius).min(axis=0), (self.high + radius).max(axis=0)])

    def moved(self, by: Floats) -> Blocks:
        return Blocks(self.low + by, self.high + by, self.radius)

    def turned(self, matrix: Floats) -> Blocks | Skin:
        """The shape turned about the origin; boxes become triangles."""
        if (self.low == self.high).all():
            return Blocks.balls(self.low @ matrix.T, self.radius)
        return self.skin().turned(matrix)

    def samples(self, number: int, rng: np.random.Generator) -> Floats:
        """Points of the shape, many of them on its border, shape (number, 3)."""
        chosen = rng.integers(0, len(self.low), number)
        t = rng.choice([0.0, 1.0, np.nan], (number, 3))
        t = np.where(np.isnan(t), rng.random((number, 3)), t)
        away = directions(number, rng) * (rng.choice([1.0, 0.5], number) * self.radius[chosen])[:, None]
        return np.asarray(self.low[chosen] + t * (self.high - self.low)[chosen] + away)

    def skin(self) -> Skin:
        """Boxes as triangles."""
        extremes = np.stack([self.low, self.high])
        bits = np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)])
        corners = np.stack([extremes[bits[:, axis], :, axis] for axis in range(3)], axis=-1)
        return Skin(corners.transpose(1, 0, 2)[:, SIDES].reshape(-1, 3, 3), np.repeat(np.arange(len(self.low)), 12))


@dataclass(frozen=True, eq=False)
class Skin:
    """Triangles, and what they enclose: the union of closed bodies whose triangles are turned alike.

    Attributes
    ----------
    triangles : ndarray, shape (n, 3, 3)
    body : ndarray of int64, shape (n,)
        The body, from 0, that each triangle bounds; below zero those that bound none and hang together with no other.
    """

    triangles: Floats
    body: Ints

    @property
    def bounds(self) -> Floats:
        corners = self.triangles.reshape(-1, 3)
        return np.array([corners.min(axis=0), corners.max(axis=0)])

    @cached_property
    def spots(self) -> Floats:
        """A corner of each body and of each triangle that bounds none."""
        first = np.unique(self.body[self.body >= 0], return_index=True)[1]
        closed = self.triangles[self.body >= 0][first, 0]
        return np.concatenate([closed, self.triangles[self.body < 0, 0]])

    def moved(self, by: Floats) -> Skin:
        return Skin(self.triangles + by, self.body)

    def turned(self, matrix: Floats) -> Skin:
        """The shape turned about the origin."""
        return Skin(self.triangles @ matrix.T, self.body)

    def samples(self, number: int, rng: np.random.Generator) -> Floats:
        """Points of the triangles, shape (number, 3); enclosed ones need no looking at."""
        share = rng.dirichlet((0.5, 0.5, 0.5), number)
        return np.asarray((self.triangles[rng.integers(0, len(self.triangles), number)] * share[..., None]).sum(axis=1))

    def encloses(self, points: Floats) -> Bools:
        """Whether points lie in a body, by solid angles (van Oosterom and Strackee, 1983)."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for body in range(int(self.body.max(initial=-1)) + 1):
            triangles = self.triangles[self.body == body]
            corners = triangles.reshape(-1, 3)
            boxed = ((points >= corners.min(axis=0)) & (points <= corners.max(axis=0))).all(axis=1) & ~inside
            for chunk in chunks(np.flatnonzero(boxed), len(triangles)):
                inside[chunk] = np.abs(_turns(triangles, points[chunk])) > 0.5
        return inside

    def distances(self, points: Floats) -> Floats:
        """Distances of points from the solid, zero inside."""
        distances = np.empty(len(points))
        for chunk in chunks(np.arange(len(points)), len(self.triangles)):
            distances[chunk] = self._surface_distances(points[chunk])
        distances[self.encloses(points)] = 0.0
        return distances

    def _surface_distances(self, points: Floats) -> Floats:
        low, high = self.triangles.min(axis=1), self.triangles.max(axis=1)
        least = box_gaps(points[:, None], points[:, None], low, high)
        nearest = self.triangles[least.argmin(axis=1)]
        distances = _to_triangles(points, nearest)
        # Whose bounding box is farther than what was found is not looked at.
        point, triangle = np.nonzero(least < distances[:, None])
        np.minimum.at(distances, point, _to_triangles(points[point], self.triangles[triangle]))
        return distances

    def model(self) -> Any:
        """The triangles for FCL."""
        import fcl

        made = fcl.BVHModel()
        made.beginModel(3 * len(self.triangles), len(self.triangles))
        made.addSubModel(self.triangles.reshape(-1, 3), np.arange(3 * len(self.triangles)).reshape(-1, 3))
        made.endModel()
        return fcl.CollisionObject(made)


Shape = Blocks | Skin


def merged_cells(occupied: Bools) -> Ints:
    """Boxes of cells that make up all occupied ones, as first cells and the cells after the last, shape (n, 2, 3)."""
    steps = np.diff(np.pad(occupied.astype(np.int8), ((0, 0), (0, 0), (1, 1))), axis=2)
    boxes = np.column_stack([np.argwhere(steps > 0), np.argwhere(steps < 0)])
    boxes[:, 3:5] += 1
    for axis in (1, 0):
        # Boxes that are alike but for this axis, and follow one another along it, become one.
        others = [column for column in range(6) if column not in (axis, axis + 3)]
        boxes = boxes[np.lexsort([boxes[:, axis], *(boxes[:, column] for column in others)])]
        new = np.ones(len(boxes), dtype=np.bool_)
        new[1:] = (boxes[1:, others] != boxes[:-1, others]).any(axis=1) | (boxes[1:, axis] != boxes[:-1, axis + 3])
        last = np.append(np.flatnonzero(new)[1:], len(boxes)) - 1 if len(boxes) else np.empty(0, dtype=np.int64)
        upper = boxes[last, axis + 3]
        boxes = boxes[new]
        boxes[:, axis + 3] = upper
    return boxes.reshape(-1, 2, 3)


def chunks(numbers: Ints, each: int) -> list[Ints]:
    """Parts of ``numbers`` that make ``PAIRS`` pairs at most, with so many partners each."""
    size = max(1, PAIRS // max(each, 1))
    return [numbers[first : first + size] for first in range(0, len(numbers), size)]


def directions(number: int, rng: np.random.Generator) -> Floats:
    """Unit vectors, shape (number, 3)."""
    normals = rng.normal(size=(number, 3))
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def box_gaps(low: Floats, high: Floats, other_low: Floats, other_high: Floats) -> Floats:
    """Distances of boxes along the axes, zero where they meet."""
    apart = np.maximum(np.maximum(other_low - high, low - other_high), 0.0)
    return np.asarray(np.sqrt((apart * apart).sum(axis=-1)))


def _turns(triangles: Floats, points: Floats) -> Floats:
    """How many times triangles go around points, shape (n,)."""
    a, b, c = np.moveaxis(triangles[None] - points[:, None, None], 2, 0)
    lengths = [np.sqrt((side * side).sum(axis=-1)) for side in (a, b, c)]
    volume = (a * np.cross(b, c)).sum(axis=-1)
    sides = ((a, b, lengths[2]), (b, c, lengths[0]), (c, a, lengths[1]))
    dots = [(x * y).sum(axis=-1) * length for x, y, length in sides]
    return np.asarray(np.arctan2(volume, lengths[0] * lengths[1] * lengths[2] + sum(dots)).sum(axis=1) / (2.0 * np.pi))


def _to_triangles(points: Floats, triangles: Floats) -> Floats:
    """Distances of points from triangles, one each: to the sides, and to the plane where that is met inside."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    distances = np.min([_to_segments(points, x, y) for x, y in ((a, b), (b, c), (c, a))], axis=0)
    normal = np.cross(b - a, c - a)
    square = (normal * normal).sum(axis=1)
    above = np.all(
        [(np.cross(y - x, points - x) * normal).sum(axis=1) >= 0.0 for x, y in ((a, b), (b, c), (c, a))], axis=0
    )
    inside = above & (square > 0.0)
    height = np.abs(((points - a) * normal).sum(axis=1)) / np.sqrt(np.where(square > 0.0, square, 1.0))
    return np.asarray(np.where(inside, np.minimum(distances, height), distances))


def _to_segments(points: Floats, start: Floats, end: Floats) -> Floats:
    along = end - start
    square = (along * along).sum(axis=1)
    t = ((points - start) * along).sum(axis=1) / np.where(square > 0.0, square, 1.0)
    apart = points - (start + np.clip(t, 0.0, 1.0)[:, None] * along)
    return np.asarray(np.sqrt((apart * apart).sum(axis=1)))
