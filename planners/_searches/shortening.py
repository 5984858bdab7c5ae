"""Shortening of a path by the edges of its drive."""

from __future__ import annotations

import math

import numpy as np

from cspace.inside import Effort, Floats
from planners._edges.local_planner import MAX_TURN, LocalPlanner
from planners._searches.paths import pulled_straight


def shorten(edges: LocalPlanner, path: Floats, until: Effort) -> Floats:
    """Shorten a path, shape (n, size), by proven edges.

    With costs, lower its cost instead. Stop at ``until``.
    """
    if edges.drive is not None:
        from planners._searches.lattice import shorten_path

        return shorten_path(edges, path, until)
    check = edges.edge_checker()
    size = edges.space.size
    # Edges turn the shorter way, so a turn of over half a circle would be another motion.
    longest = np.where(edges.space.is_periodic, MAX_TURN, math.inf)

    def is_free(*ends: float) -> bool:
        """Return True if an edge is short enough and proven free."""
        steps = np.abs(np.subtract(ends[size:], ends[:size]))
        return bool((steps < longest).all()) and check(*ends)

    return pulled_straight(path, edges.space.rotations, is_free, edges.weigh(), until)
