"""Balls inside solids, which prove contact of whole boxes of configurations."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from cspace.inside import (
    Floats,
    Ints,
    Solids,
    SurfaceTree,
    bound_point_distance,
    box_trees,
    winding_number,
)

MAX_BALLS_PER_SURFACE: Final = 64
"""Largest number of balls inside a closed surface, or inside the boxes and balls of a solid."""


class InnerBalls(NamedTuple):
    """Balls inside solids.

    Attributes
    ----------
    centers : ndarray of float64, shape (n, 3)
        Centers of the balls, in the frame of the solid's body.
    radii : ndarray of float64, shape (n,)
    starts : ndarray of int64, shape (s + 1,)
        First ball of each solid.
    """

    centers: Floats
    radii: Floats
    starts: Ints


def find_inner_balls(solids: Solids) -> InnerBalls:
    """Find balls inside solids, and points, as balls without radius."""
    # Rows of a center and a radius.
    rows = [np.empty((0, 4))]
    counts = [0]
    for starts, stops in pairwise(solids.starts):
        # The surfaces, anchors and parts of one solid.
        surfaces, anchors, parts = (slice(*ends) for ends in zip(starts, stops, strict=True))
        probes = solids.anchors[anchors]
        roots = solids.tree_roots[parts]
        spans = solids.trees.spans[roots[roots >= 0]].tolist()
        pieces = [solids.trees.triangles[first : first + count] for first, count in spans]
        surface_roots = solids.surface_roots[surfaces].tolist()
        balls = [
            np.column_stack([probes, np.zeros(len(probes))]),
            _find_solid_balls(np.concatenate([np.empty((0, 10)), *pieces])),
            *(_find_surface_balls(solids.surfaces, root) for root in surface_roots),
        ]
        rows += balls
        counts.append(sum(map(len, balls)))
    all_balls = np.concatenate(rows)
    return InnerBalls(
        centers=all_balls[:, :3].copy(), radii=all_balls[:, 3].copy(), starts=np.cumsum(counts)
    )


def _find_surface_balls(surfaces: SurfaceTree, root: int) -> Floats:
    """Find large balls inside a closed surface, around points of a lattice.

    Returns their centers and radii, shape (n, 4). Points near larger balls are skipped.
    """
    center, half_sides = surfaces.boxes[root].reshape(2, 3)
    balls = np.empty((0, 4))
    # A flat surface has no inside.
    if not half_sides.all():
        return balls
    volume = 8.0 * half_sides.prod()
    # Approximate number of lattice points in the box of a closed surface.
    lattice_points_per_surface = 1000
    step = np.cbrt(volume / lattice_points_per_surface)
    # Odd counts put lattice points in the center plane of thin bodies. The limit keeps long bodies
    # from far more points than wanted.
    counts = np.minimum(2 * np.floor(half_sides / step) + 1, lattice_points_per_surface // 4)
    lattice = np.array(list(np.ndindex(*counts.astype(np.int64).tolist())))
    points = center - half_sides + (lattice + 0.5) * 2.0 * half_sides / counts
    scratch = np.empty((box_trees.MAX_PENDING_PAIRS, 2), dtype=np.int64)
    depths = np.empty(len(points))
    for k, point in enumerate(map(tuple, points.tolist())):
        depths[k], _ = bound_point_distance(surfaces, root, point, math.inf, 0.0, scratch)
    for k in np.argsort(-depths, kind="stable").tolist():
        if len(balls) == MAX_BALLS_PER_SURFACE or not depths[k]:
            break
        distances = np.linalg.norm(balls[:, :3] - points[k], axis=1)
        # Smallest distance between two balls' centers, as a share of the larger ball's radius.
        is_separate = (distances > 0.6 * balls[:, 3]).all()
        if is_separate and winding_number(surfaces, root, tuple(points[k].tolist()), scratch) != 0:
            balls = np.vstack([balls, [*points[k], depths[k]]])
    return balls


def _find_solid_balls(pieces: Floats) -> Floats:
    """Find the largest balls in boxes and balls, shape (n, 4).

    ``pieces``, shape (m, 10), are rows of a tree: a center, two half sides as vectors, and the
    radius of a ball, or the negative third half side of a box.
    """
    first_half = np.linalg.norm(pieces[:, 3:6], axis=1)
    second_half = np.linalg.norm(pieces[:, 6:9], axis=1)
    signed_radii = pieces[:, 9]
    smallest_half = np.minimum(np.minimum(first_half, second_half), -signed_radii)
    radii = np.where(signed_radii < 0.0, smallest_half, signed_radii)
    largest = np.argsort(-radii, kind="stable")[:MAX_BALLS_PER_SURFACE]
    largest = largest[radii[largest] > 0.0]
    return np.column_stack([pieces[largest, :3], radii[largest]])
