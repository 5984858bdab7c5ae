"""Exact regions of the plane, by shapely, and of space, by FCL, without code of the library.

Configurations are positions, shape (n, 2) or (n, 3), followed by a yaw or a quaternion, if any.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import fcl
import numpy as np
import shapely
from scipy.spatial.transform import Rotation

from tests.helpers import solids
from tests.helpers.oracles import box_gaps, chunks, distance_to_triangles, winds_around

CORNERS = np.array([[n >> 2 & 1, n >> 1 & 1, n & 1] for n in range(8)])
"""Corners ``4 x + 2 y + z`` of the unit cube."""

FRONT = [[0, 1, 3], [0, 3, 2], [0, 4, 5], [0, 5, 1], [0, 2, 6], [0, 6, 4]]
BACK = [[4, 6, 7], [4, 7, 5], [2, 3, 7], [2, 7, 6], [1, 5, 7], [1, 7, 3]]
SIDES = np.array([*FRONT, *BACK])
"""Outward triangles of a box, as indices of its corners."""


def rotations_of(q, dim):
    """Return the rotations of configurations."""
    turns = q[:, dim:]
    if turns.shape[1] == 4:
        return Rotation.from_quat(turns)
    yaws = turns if turns.shape[1] else np.zeros((len(q), 1))
    return Rotation.from_rotvec(yaws * (0.0, 0.0, 1.0))


def move_points(points, q):
    """Move points (m, d) to configurations: shape (n, m, d)."""
    dim = points.shape[1]
    matrices = rotations_of(q, dim).as_matrix()[:, :dim, :dim]
    return np.einsum("nij,mj->nmi", matrices, points) + q[:, None, :dim]


def place_polygon(polygon, q):
    """Copy a polygon to configurations."""

    def place(ring):
        return shapely.linearrings(move_points(shapely.get_coordinates(ring), q))

    holes = [place(ring) for ring in polygon.interiors]
    return shapely.polygons(
        place(polygon.exterior), holes=np.stack(holes, axis=1) if holes else None
    )


def place_at(polygon, pose):
    """Copy a polygon to one configuration."""
    return place_polygon(polygon, np.array([pose]))[0]


def cell_boxes(occupied, lower=0.0, spacing=1.0):
    """Merge rows of closed cells to boxes (low, high), shape (n, 2, d)."""
    steps = np.diff(np.pad(occupied, [*[(0, 0)] * (occupied.ndim - 1), (1, 1)]).astype(int))
    first, last = np.argwhere(steps > 0), np.argwhere(steps < 0)
    last[:, :-1] += 1
    return lower + spacing * np.stack([first, last], axis=1)


class Region:
    """A closed set, as the robot or the obstacles.

    Attributes
    ----------
    centers, radii : ndarray, shape (n, d) and (n,)
        Of its balls.
    vertices : ndarray, shape (n, d)
        Of its other parts.
    """

    centers: Any
    radii: Any
    vertices: Any

    @cached_property
    def _corners(self):
        """Vertices and centers, and the radius of the ball around each."""
        radii = np.append(np.zeros(len(self.vertices)), self.radii)
        return np.concatenate([self.vertices, self.centers]), radii

    @property
    def reach(self):
        """Largest distance from the reference point to the region."""
        corners, radii = self._corners
        return float((np.linalg.norm(corners, axis=1) + radii).max())

    def leaves(self, q, low, high, distance):
        """Return True where the region comes within a distance of the outside of a box."""
        (corners, radii), hit = self._corners, np.zeros(len(q), dtype=np.bool_)
        for chunk in chunks(len(q), len(corners)):
            at = move_points(corners, q[chunk])
            spare = np.minimum(at - low, high - at).min(axis=2) - radii
            hit[chunk] = spare.min(axis=1) <= distance[chunk]
        return hit


@dataclass(frozen=True, eq=False)
class Flat(Region):
    """Polygons and discs; obstacles are geometries of shapely of any type, without discs."""

    polygons: Sequence[Any]
    centers: Any = field(default_factory=lambda: np.empty((0, 2)))
    radii: Any = field(default_factory=lambda: np.empty(0))

    def __post_init__(self):
        shapely.prepare(self.polygons)

    @classmethod
    def boxes(cls, corners):
        """Unite boxes, shape (n, 2, 2)."""
        boxes = shapely.box(*np.reshape(corners, (-1, 4)).T)
        return cls(list(shapely.get_parts(shapely.union_all(boxes))))

    @classmethod
    def balls(cls, centers, radii):
        return cls([], centers, radii)

    @cached_property
    def vertices(self):
        return shapely.get_coordinates(self.polygons)

    def translate(self, by):
        moved = [shapely.transform(each, lambda points: points + by) for each in self.polygons]
        return Flat(moved, self.centers + by, self.radii)

    def within(self, others, q, distance):
        """Return True where the moved region comes within a distance of others."""
        hit = np.zeros(len(q), dtype=np.bool_)
        for center, radius in zip(self.centers, self.radii, strict=True):
            points = shapely.points(move_points(center[None], q)[:, 0])
            for other in others.polygons:
                hit |= shapely.dwithin(other, points, radius + distance)
        for polygon in self.polygons:
            placed = place_polygon(polygon, q)
            for other in others.polygons:
                # dwithin of a prepared polygon misses some polygons crossing it (GEOS 3.14).
                hit |= shapely.intersects(other, placed)
                hit |= (distance > 0.0) & shapely.dwithin(other, placed, distance)
        return hit

    def sample(self, number, rng):
        """Draw points of the boundary."""
        which = rng.integers(0, len(self.radii) + len(self.polygons), number)
        discs = shapely.points(self.centers).tolist()
        rounds = [disc.buffer(radius) for disc, radius in zip(discs, self.radii, strict=True)]
        outlines = np.array([part.exterior for part in (*rounds, *self.polygons)])[which]
        return shapely.get_coordinates(
            shapely.line_interpolate_point(outlines, rng.random(number), normalized=True)
        )


@dataclass(frozen=True, eq=False)
class Body(Region):
    """A union of closed solids inside triangles, of single triangles, and of balls.

    Attributes
    ----------
    triangles : ndarray, shape (n, 3, 3)
    solid : ndarray of int, shape (n,)
        Index of the solid that each triangle bounds; negative if it bounds none.
    """

    triangles: Any = field(default_factory=lambda: np.empty((0, 3, 3)))
    solid: Any = field(default_factory=lambda: np.empty(0, dtype=int))
    centers: Any = field(default_factory=lambda: np.empty((0, 3)))
    radii: Any = field(default_factory=lambda: np.empty(0))

    @classmethod
    def boxes(cls, corners):
        """Unite boxes, shape (n, 2, 3)."""
        low, high = np.reshape(corners, (-1, 2, 3)).swapaxes(0, 1)[:, :, None]
        return cls.join(list(np.where(CORNERS, high, low)[:, SIDES]))

    @classmethod
    def balls(cls, centers, radii):
        return cls(centers=centers, radii=radii)

    @classmethod
    def join(cls, parts):
        """Unite the solids inside the triangles of each part."""
        return cls(np.concatenate(parts), np.repeat(range(len(parts)), [len(p) for p in parts]))

    @cached_property
    def vertices(self):
        return np.unique(self.triangles.reshape(-1, 3), axis=0)

    @cached_property
    def spots(self):
        """A corner of each solid and of each other triangle."""
        first = np.unique(self.solid, return_index=True)[1]
        return self.triangles[np.union1d(first, np.flatnonzero(self.solid < 0)), 0]

    @cached_property
    def model(self):
        """The triangles as an object of FCL."""
        faces = np.arange(3 * len(self.triangles)).reshape(-1, 3)
        return solids.surface(self.triangles.reshape(-1, 3), faces)

    def translate(self, by):
        return Body(self.triangles + by, self.solid, self.centers + by, self.radii)

    def sample(self, number, rng):
        """Draw points of the triangles, or of the balls if there are no triangles."""
        if len(self.triangles):
            shares = rng.dirichlet((0.5, 0.5, 0.5), number)
            chosen = self.triangles[rng.integers(0, len(self.triangles), number)]
            return (chosen * shares[..., None]).sum(axis=1)
        which, away = rng.integers(0, len(self.radii), number), rng.normal(size=(number, 3))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        return self.centers[which] + self.radii[which, None] * away

    def encloses(self, points):
        """Return True where points lie in a solid."""
        inside = np.zeros(len(points), dtype=np.bool_)
        for number in range(int(self.solid.max(initial=-1)) + 1):
            triangles = self.triangles[self.solid == number]
            low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
            boxed = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1) & ~inside)
            inside[boxed] = winds_around(points[boxed], triangles)
        return inside

    def distances(self, points):
        """Return the distance of each point, zero inside."""
        least = np.full(len(points), np.inf)
        for center, radius in zip(self.centers, self.radii, strict=True):
            least = np.minimum(least, np.linalg.norm(points - center, axis=1) - radius)
        if len(self.triangles):
            least = np.minimum(least, distance_to_triangles(points, self.triangles))
            least[self.encloses(points)] = 0.0
        return np.maximum(least, 0.0)

    def gaps(self, others, q):
        """Return the distance of the moved region from others, zero if they meet."""
        gaps, matrices = np.full(len(q), np.inf), rotations_of(q, 3).as_matrix()

        def move_back(points):
            return np.einsum("nji,nmj->nmi", matrices, points - q[:, None, :3])

        if len(self.triangles) and len(others.triangles):
            for k, matrix in enumerate(matrices):
                self.model.setTransform(fcl.Transform(matrix, q[k, :3]))
                gaps[k] = fcl.distance(others.model, self.model)
            for region, spots in (
                (others, move_points(self.spots, q)),
                (self, move_back(others.spots)),
            ):
                inside = region.encloses(spots.reshape(-1, 3)).reshape(spots.shape[:2])
                gaps[inside.any(axis=1)] = 0.0
        for region, centers, radii in (
            (others, move_points(self.centers, q), self.radii),
            (self, move_back(others.centers), others.radii),
        ):
            apart = region.distances(centers.reshape(-1, 3)).reshape(centers.shape[:2]) - radii
            gaps = np.minimum(gaps, apart.min(axis=1, initial=np.inf))
        return np.maximum(gaps, 0.0)

    def within(self, others, q, distance):
        """Return True where the moved region comes within a distance of others."""
        corners, radii = others._corners
        low, high = (corners.T - radii).min(axis=1), (corners.T + radii).max(axis=1)
        hit = box_gaps(q[:, :3], q[:, :3], low, high) <= distance + self.reach
        near = np.flatnonzero(hit)
        for chunk in chunks(len(near), len(self.spots) + len(others.spots) + 1):
            rows = near[chunk]
            hit[rows] = self.gaps(others, q[rows]) <= distance[rows]
        return hit
