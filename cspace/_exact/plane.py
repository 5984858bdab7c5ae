"""Compiled proofs of a robot in the plane, by the segments of its boundary and of obstacles."""

from __future__ import annotations

import math
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from cspace._bodies import ADVANCE_FACTOR, DISTANCE_ROUNDING, MAX_DISTANCES_PER_EDGE, MIN_ADVANCE
from cspace._bodies.box_trees import MAX_PENDING_PAIRS
from cspace._bodies.part_trees import PartTree
from cspace._exact.arcs import (
    MAX_PENDING_PARTS,
    EdgeArc,
    arc_state,
    cells_are_free,
    reference_point,
)
from cspace._exact.segment_proofs import Motion, free_fraction
from cspace._queries.edges import position_along
from cspace._queries.points import neighborhood_is_free, position_in_plane
from cspace._record.cells import Map
from cspace._rotations.lookup import matrix_rows, rotation_along
from cspace._support.arrays import BLOCKED, FREE, Floats, Ints, Row
from cspace._support.compiling import internal, kernel
from cspace._support.records import keep
from cspace._support.vectors import Matrix, dot, minus, row_at


class BoundaryTrees(NamedTuple):
    """Trees of the robot, the walls and the obstacles in the plane, in scaled lengths.

    Attributes
    ----------
    trees : PartTree
    robot : int
        Root of the robot.
    others : tuple of int
        Roots of the walls and of the obstacles, -1 for none. Walls are the faces of the grid, used
        if the exterior is blocked.
    max_lever : float
        Largest distance of a point of the robot from the reference point, or from the z axis if it
        rotates about z alone.
    scale : float
        Factor from metres to scaled lengths.
    required : float
        Distance that proves a configuration free.
    """

    trees: PartTree
    robot: int
    others: tuple[int, int]
    max_lever: float
    scale: float
    required: float


class Scratch(NamedTuple):
    """Scratch memory of an edge proof.

    Attributes
    ----------
    parts : ndarray of float64, shape (MAX_PENDING_PARTS, 2)
        Stack of unproven parts: where each begins and ends, from 0 to 1.
    node_pairs : ndarray of int64, shape (MAX_PENDING_PAIRS, 2)
        See :func:`cspace._exact.segment_proofs.free_fraction`.
    measured : ndarray of int64, shape (1,)
        Number of distances measured along the edge.
    """

    parts: Floats
    node_pairs: Ints
    measured: Ints


def make_scratch() -> Scratch:
    """Allocate scratch memory."""
    scratch = Scratch(
        parts=np.empty((MAX_PENDING_PARTS, 2)),
        node_pairs=np.full((MAX_PENDING_PAIRS, 2), -1),
        measured=np.zeros(1, dtype=np.int64),
    )
    return keep(scratch)


@internal
def prove_arc(map_: Map, boundaries: BoundaryTrees, arc: EdgeArc, scratch: Scratch) -> bool:
    """Return True if an arc is proven free.

    The arc is cut into equal pieces. Most colliding edges of a planner collide at their end, so it
    is proven first.
    """
    start = reference_point(map_, arc.p0, boundaries.scale)
    step = minus(reference_point(map_, arc.p1, boundaries.scale), start)
    length = math.sqrt(dot(step, step)) + arc.angle * boundaries.max_lever
    # Length of the pieces of an edge, in cells; the tree search is slow for longer ones.
    max_length = 2.0 * boundaries.scale * map_.spacing
    count = math.ceil(length / max_length)
    # Piece -1 is the end alone.
    for piece in range(-1, count):
        first = piece / count if piece >= 0 else 1.0
        last = (piece + 1) / count if piece >= 0 else 1.0
        if not prove_part(map_, boundaries, arc, step, first, last, scratch):
            return False
    return True


@internal
def prove_part(
    map_: Map,
    boundaries: BoundaryTrees,
    arc: EdgeArc,
    step: Row,
    first: float,
    last: float,
    scratch: Scratch,
) -> bool:
    """Return True if a part of an arc in the plane is proven free.

    The part reaches from ``first`` to ``last``, in [0, 1], of the scaled ``step``. The map proves
    the part, or the distance at its midpoint proves an interval around the midpoint and leaves the
    remainders on both sides.
    """
    # A stack of unproven parts, each with its beginning and its end.
    parts = scratch.parts
    parts[0, 0] = first
    parts[0, 1] = last
    pending = 1
    while pending > 0:
        pending -= 1
        first = parts[pending, 0]
        last = parts[pending, 1]
        if first < last and cells_are_free(map_, arc, first, last):
            continue
        half = 0.5 * (last - first)
        center = 0.5 * (first + last)
        position = position_along(arc.p0, arc.p1, center)
        rotation = rotation_along(arc.r0, arc.r1, arc.number, center)
        state = arc_state(map_, arc, center)
        if state == FREE and first == last:
            continue
        if state == BLOCKED or scratch.measured[0] == MAX_DISTANCES_PER_EDGE:
            return False
        # The distance at the midpoint proves the arc as far as the robot can move that distance.
        place = reference_point(map_, position, boundaries.scale)
        motion = Motion(matrix_rows(rotation), place, step, arc.angle, arc.required, 0.0)
        enough = half / ADVANCE_FACTOR
        fraction = free_fraction(
            boundaries.trees,
            boundaries.robot,
            boundaries.others,
            motion,
            enough,
            scratch.node_pairs,
        )
        proven = ADVANCE_FACTOR * fraction
        scratch.measured[0] += 1
        if proven < min(half, MIN_ADVANCE):
            return False
        if proven < half:
            # Remainders on both sides; the first one comes next.
            parts[pending, 0] = center + proven
            parts[pending, 1] = last
            parts[pending + 1, 0] = first
            parts[pending + 1, 1] = center - proven
            pending += 2
    return True


FIRST_REACH: Final = 2.0**-10
"""First bound of a distance, which is doubled until it holds, in lengths of trees, about one."""


@kernel
def path_slack(
    boundaries: BoundaryTrees,
    required: float,
    positions: Floats,
    matrices: Floats,
    spans: Floats,
    scratch: Ints,
) -> float:
    """Return a lower bound of (distance - required distance) along a path.

    The bound is at least zero. The robot is placed at the midpoint of each piece of the path, given
    by ``positions``, shape (n, 3), and rotation ``matrices``, shape (n, 3, 3). No point of the
    robot moves farther than the span of the piece, shape (n,), from there. All lengths are scaled
    like the trees. No part of robot or obstacles may lie inside the other.
    """
    best = math.inf
    no_step = (0.0, 0.0, 0.0)
    for k in range(len(positions)):
        position = row_at(positions[k], 0)
        rows = matrices[k]
        matrix = row_at(rows[0], 0), row_at(rows[1], 0), row_at(rows[2], 0)
        # With a drift of 1 and no other motion, the free fraction is the distance itself, capped at
        # best + span.
        enough = best + spans[k]
        # Without a bound, a search would meet most pairs of triangles, so the first one is doubled.
        reach = enough if k > 0 else FIRST_REACH
        while True:
            distance = fraction_apart(
                boundaries, required, position, matrix, no_step, 0.0, 1.0, reach, scratch
            )
            if distance < reach or reach == enough:
                break
            reach *= 2.0
        best = min(best, distance - spans[k])
        if best <= 0.0:
            return 0.0
    return best


@internal
def fraction_apart(
    boundaries: BoundaryTrees,
    required: float,
    position: Row,
    matrix: Matrix,
    step: Row,
    angle: float,
    drift: float,
    enough: float,
    scratch: Ints,
) -> float:
    """Return the fraction of a motion proven apart.

    The fraction is at most ``enough``. From its position, the robot moves by up to ``step``
    forwards or backwards, by up to ``drift`` in any direction, and rotates by up to ``angle``. All
    lengths are scaled like the trees.
    """
    x, y, z = position
    required += 2.0 * DISTANCE_ROUNDING * (abs(x) + abs(y) + abs(z))
    motion = Motion(matrix, position, step, angle, required, drift)
    return free_fraction(
        boundaries.trees, boundaries.robot, boundaries.others, motion, enough, scratch
    )


Geometry: TypeAlias = tuple[BoundaryTrees, Ints] | None
"""Boundaries of robot and obstacles with scratch memory, for compiled callers; None to prove by
cells alone."""


@internal
def poses_are_free(
    map_: Map,
    geometry: Geometry,
    pose: tuple[float, float, float],
    reach: float,
    ahead: float,
    drift: float,
    turn: float,
) -> bool:
    """Return True if all poses near one in the plane are free, for compiled callers.

    They are at most ``reach`` metres away along each axis, and turned by at most ``turn`` radians.
    FREE cells prove them, or boundaries of robot and obstacles that stay apart: then the robot gets
    to the poses by at most ``ahead`` metres along its heading, forwards or backwards, and by
    ``drift`` metres in any direction. Where boundaries stay apart, all poses are
    free if one of them is known to be free. They prove nothing outside the grid.
    """
    x, y, yaw = pose
    if neighborhood_is_free(map_, position_in_plane(map_, x, y), (yaw,), reach, turn):
        return True
    # The branch of the geometry is left out if there is none.
    if geometry is None:
        return False
    is_inside_x = map_.lower[1] + reach <= x <= map_.upper[1] - reach
    is_inside_y = map_.lower[2] + reach <= y <= map_.upper[2] - reach
    if not (is_inside_x and is_inside_y):
        return False
    boundaries, node_pairs = geometry
    scale = boundaries.scale
    place = (scale * x, scale * y, 0.0)
    step = (scale * ahead * math.cos(yaw), scale * ahead * math.sin(yaw), 0.0)
    enough = 1.0 / ADVANCE_FACTOR
    proven = fraction_apart(
        boundaries,
        boundaries.required,
        place,
        matrix_rows((yaw,)),
        step,
        turn,
        scale * drift,
        enough,
        node_pairs,
    )
    return proven >= enough
