"""Links and obstacles prepared for proofs.

They are trees of boundaries, closed surfaces, and anchors of parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cspace._bodies.box_trees import build_boxes
from cspace._bodies.hulls import Hulls, build_hulls, node_corners, wrap_convex
from cspace._bodies.part_trees import (
    PartTree,
    SurfaceTree,
    build_tree,
    distinct_rows,
    pack_boxes,
    pack_triangles,
)
from cspace._bodies.parts import as_triangles, part_anchors
from cspace._shapes import ExactShape, RoundedSimplices, Shape
from cspace._shapes.mesh import Mesh
from cspace._support.arrays import Floats, Ints


@dataclass(frozen=True, eq=False)
class Part:
    """A posed shape of a link or an obstacle, prepared for proofs.

    Attributes
    ----------
    shape : Shape
    pose : ndarray of float64, shape (4, 4)
        From the frame of the shape to the frame of the body.
    """

    shape: Shape
    pose: Floats

    @cached_property
    def bounds_pair(self) -> tuple[Part, Part]:
        """Outer and inner shape at the same pose.

        Both are the same object if the shape is exact.
        """
        outer = replace(self, shape=self.shape.outer)
        if self.shape.inner is self.shape.outer:
            return outer, outer
        return outer, replace(self, shape=self.shape.inner)

    @cached_property
    def is_filled(self) -> bool:
        """Whether the tree consists of solid boxes or balls."""
        return False

    @property
    def _exact(self) -> ExactShape:
        """The shape, if it has a boundary, trees and points inside."""
        if not isinstance(self.shape, ExactShape):
            raise TypeError("the shape has outer and inner bounds")
        return self.shape

    def transform(self, points: Floats) -> Floats:
        """Transform points, shape (..., 3), to the frame of the body."""
        return np.asarray(points @ self.pose[:3, :3].T + self.pose[:3, 3])

    @cached_property
    def boundary(self) -> RoundedSimplices:
        """Boundary as triangles."""
        triangles = as_triangles([self._exact.boundary()])
        return triangles._replace(simplices=self.transform(triangles.simplices))

    @cached_property
    def tree(self) -> PartTree:
        """Tree of the triangles of the boundary."""
        rows = pack_triangles(self.boundary)
        no_levers = np.zeros(len(rows))  # they mark solid boxes and balls
        return build_tree(rows, no_levers)

    @cached_property
    def hulls(self) -> Hulls:
        """Tree of hulls of the boundary, or of boxes and balls."""
        corners, windings = self.surface
        if len(corners) == len(self.boundary.radii) > 0:
            convex_hull = wrap_convex(corners)
            if convex_hull is not None:
                return convex_hull
        first, second, third = corners.swapaxes(0, 1)
        # The scalar triple product is six times the signed volume between triangle and origin.
        six_volumes = (np.cross(first, second) * third).sum(axis=1)
        return build_hulls(self.tree, float(six_volumes @ windings) / 6.0)

    @cached_property
    def surface(self) -> tuple[Floats, Ints]:
        """Triangles of closed bodies, shape (n, 3, 3), and their multiplicities.

        There are none if the rows are solids.
        """
        exact = self._exact
        simplices, _ = exact.boundary()
        has_triangles = simplices.shape[1] == 3
        if self.is_filled or not exact.encloses or not has_triangles:
            return np.empty((0, 3, 3)), np.empty(0, dtype=np.int64)
        mesh = exact if isinstance(exact, Mesh) else Mesh(*exact.surface)
        # The posed mesh has the same bodies. Equal corners are moved as one, to stay equal to the
        # last bit.
        vertices, numbers = distinct_rows(mesh.vertices)
        is_closed = mesh.windings != 0
        corner_numbers = numbers[mesh.faces[is_closed]]
        return self.transform(vertices)[corner_numbers], mesh.windings[is_closed]

    @cached_property
    def surface_tree(self) -> SurfaceTree:
        """Tree of the triangles of closed bodies."""
        corners, windings = self.surface
        boxes, order, spans = build_boxes(corners.min(axis=1), corners.max(axis=1))
        return SurfaceTree(boxes, spans, corners[order], windings[order])

    @cached_property
    def anchors(self) -> Floats:
        """One point of each connected part (n, 3), if hollow."""
        if self.is_filled:
            return np.empty((0, 3))
        if len(self.hulls.nodes) == 1:
            return node_corners(self.hulls, 0)[0][:1]
        anchors, _ = part_anchors(self.boundary)
        return anchors

    @cached_property
    def extremes(self) -> Floats:
        """Corners of the convex hull of the boundary's corners, shape (n, 3)."""
        from scipy.spatial import ConvexHull, QhullError

        corners, _ = distinct_rows(self.boundary.simplices.reshape(-1, 3))
        try:
            return np.asarray(corners[ConvexHull(corners).vertices])
        except QhullError:  # they are flat, or few
            return corners

    @cached_property
    def probes(self) -> Floats:
        """Some corners of the boundary, and lattice points inside, shape (n, 3).

        There are none if the tree consists of solids.
        """
        if self.is_filled:
            return np.empty((0, 3))
        corners, _ = distinct_rows(self.boundary.simplices.reshape(-1, 3))
        # Approximate number of corners and inner points of each part that are sought in others, to
        # prove collisions.
        probes_per_part = 60
        stride = math.ceil(len(corners) / probes_per_part)
        some_corners = corners[::stride]
        # A surface that encloses nothing has no points inside.
        if not self._exact.encloses:
            return some_corners
        lower, upper = self._exact.bounds
        size = upper - lower
        # A long box would have far too many points along it.
        step = max(np.cbrt(size.prod() / probes_per_part), size.max() / probes_per_part)
        counts = np.maximum(1, np.rint(size / step)).astype(np.int64)
        indices = np.array(list(np.ndindex(*counts.tolist())))
        lattice = lower + (indices + 0.5) * size / counts
        inside = lattice[self._exact.contains(lattice)]
        return np.concatenate([some_corners, self.transform(inside)])


@dataclass(frozen=True, eq=False)
class StaticShape(Part):
    """A shape that never moves.

    Boxes, cells and balls are tested as solids, others by their boundary.

    Attributes
    ----------
    reach : float
        Length above which a connected part cannot lie inside a link, metres.
    """

    reach: float

    @cached_property
    def is_filled(self) -> bool:
        """Whether the tree consists of solid boxes or balls."""
        simplices, _ = self._exact.boundary()
        has_balls = simplices.shape[1] == 1
        return self._exact.is_boxes or has_balls

    @cached_property
    def tree(self) -> PartTree:
        """Tree of boxes, of balls, or of the triangles of the boundary.

        The lever of a box or ball is 1 if its connected part is small enough to lie inside a link,
        otherwise 0.
        """
        if self._exact.is_boxes:
            lows, highs, sizes = self._exact.boxes
            fits_inside = (sizes <= self.reach).astype(np.float64)
            return build_tree(pack_boxes(lows, highs, self.pose), fits_inside)
        rows = pack_triangles(self.boundary)
        return build_tree(rows, np.full(len(rows), float(self.is_filled)))


class Solid(NamedTuple):
    """A link or an obstacle, moved and tested as one.

    Attributes
    ----------
    name : str
    body : int
    parts : tuple of Part
    """

    name: str
    body: int
    parts: tuple[Part, ...]

    @property
    def bounds_pairs(self) -> list[tuple[Part, Part]]:
        """Outer and inner shape of each part."""
        return [part.bounds_pair for part in self.parts]
