"""Motions of a robot in the plane among shapely's geometries, discs and a border."""

from typing import NamedTuple

import numpy as np
import shapely

from .pieces import turn
from .verdict import FREE, NOT_SHOWN, TOLERANCE, TOO_MUCH, TOUCHES, ULPS, Verdict

DEEPEST = 40
"""Times that a piece is halved."""


class Part(NamedTuple):
    """The convex hull of corners, (m, 2), grown by a radius: a polygon, or a disc."""

    corners: np.ndarray
    radius: float = 0.0

    @property
    def reach(self):
        """Largest distance of a corner from the reference point."""
        return float(np.linalg.norm(self.corners, axis=1).max())


class Plane:
    """Obstacles of the plane: geometries, each grown by a radius, and the outside of a room."""

    def __init__(self, geometries, radii=0.0, room=None):
        """Index the parts of geometries; ``room`` is a lower and an upper corner, or None."""
        parts, owners = shapely.get_parts(np.asarray(geometries, object), return_index=True)
        is_there = ~shapely.is_empty(parts)
        parts, owners = parts[is_there], owners[is_there]
        self.shapes = parts
        self.radii = np.broadcast_to(radii, len(geometries))[owners]
        self.room = None if room is None else np.asarray(room, float)
        self.tree = shapely.STRtree(parts)
        bounds = shapely.bounds(parts) if len(parts) else np.zeros((1, 4))
        self.size = float(np.abs(bounds).max()) if room is None else float(np.abs(room).max())

    def are_near(self, points, distances):
        """Return which hulls of points, (n, m, 2), come within distances of an obstacle.

        A negative distance asks for an overlap deeper than its opposite.
        """
        hit = np.zeros(len(points), bool)
        if self.room is not None:
            low, high = points.min(axis=1), points.max(axis=1)
            need = distances[:, None]
            hit |= ((low - need < self.room[0]) | (high + need > self.room[1])).any(axis=1)
        if not len(self.shapes):
            return hit
        hulls = shapely.convex_hull(shapely.multipoints(points))
        reach = np.maximum(distances, 0.0) + self.radii.max(initial=0.0)
        # dwithin of prepared polygons misses some that cross them (GEOS 3.14).
        pairs = [self.tree.query(hulls, "intersects")]
        pairs += [self.tree.query(hulls, "dwithin", distance=reach)] if reach.any() else []
        hull, shape = np.unique(np.concatenate(pairs, axis=1), axis=1)
        undecided = ~hit[hull]
        hull, shape = hull[undecided], shape[undecided]
        need = distances[hull] + self.radii[shape]
        met = need >= 0.0
        met[met] = shapely.distance(hulls[hull[met]], self.shapes[shape[met]]) <= need[met]
        deep = np.flatnonzero(need < 0.0)
        shrunk = shapely.buffer(hulls[hull[deep]], need[deep], join_style="mitre")
        met[deep] = shapely.intersects(shrunk, self.shapes[shape[deep]])
        hit[hull[met]] = True
        return hit

    def cover(self, low, high):
        """Return which boxes, two times (n, 2), lie in obstacles, or outside of the room."""
        covered = np.zeros(len(low), bool)
        if self.room is not None:
            covered |= ((high <= self.room[0]) | (low >= self.room[1])).any(axis=1)
        boxes = shapely.box(*low.T, *high.T)
        flat = np.flatnonzero(self.radii == 0.0)
        if len(flat):
            box, shape = self.tree.query(boxes, "covered_by")
            covered[box[self.radii[shape] == 0.0]] = True
            box, shape = self.tree.query(boxes[~covered], "intersects")
            left = np.flatnonzero(~covered)
            for k in np.unique(box):
                joined = shapely.union_all(self.shapes[shape[box == k]])
                covered[left[k]] = shapely.covers(joined, boxes[left[k]])
        for k in np.flatnonzero(self.radii):
            if self.shapes[k].geom_type == "Point":
                away = np.maximum(
                    abs(low - self.shapes[k].coords[0]), abs(high - self.shapes[k].coords[0])
                )
                covered |= np.linalg.norm(away, axis=1) <= self.radii[k]
        return covered


def check_plane(pieces, robot, world, budget, margin=0.0):
    """Check that a robot of parts keeps more than a margin from obstacles along pieces."""
    reach = max(part.reach + part.radius for part in robot)
    # Overlaps below this depth count as none.
    slack = TOLERANCE * reach + ULPS * world.size
    rows = np.arange(len(pieces.start))
    t0, t1 = np.zeros(len(rows)), np.ones(len(rows))
    for depth in range(DEEPEST):
        if not budget.take(len(rows) * len(robot)):
            return TOO_MUCH
        ends = [_place(pieces, rows, t) for t in (t0, t1)]
        _, moves, spin, spins = pieces.bound(rows, t0, t1, 2)
        eighth = (t1 - t0) ** 2 / 8.0
        left = np.zeros(len(rows), bool)
        exact = np.ones(len(rows), bool)
        for part in robot:
            # No point of the part leaves its chord farther. A disc about the robot's point has no reach.
            turning = part.reach * (spin**2 + spins) if part.reach > 0.0 else 0.0
            sagitta = eighth * (moves + turning)
            points = np.concatenate([_move(part.corners, *end) for end in ends], axis=1)
            far = ~np.isfinite(sagitta)
            need = np.where(far, 0.0, sagitta) + part.radius + margin - slack
            hit = far | world.are_near(points, need)
            left |= hit
            # The hull of a turning part is larger than what it sweeps, and decides nothing.
            exact &= ~hit | ((sagitta <= 0.25 * slack) & (spin == 0.0))
        wrong = left & exact
        if not wrong.any() and left.any() and (depth % 3 == 2 or depth == DEEPEST - 1):
            wrong = _touch_in_the_middle(
                pieces, rows, 0.5 * (t0 + t1), left, robot, world, margin, slack
            )
        if wrong.any():
            k = int(np.flatnonzero(wrong)[0])
            q = pieces.at(rows[[k]], 0.5 * (t0 + t1)[[k]])[0]
            return Verdict(
                TOUCHES, f"near {q.tolist()}, within {t1[k] - t0[k]:.1g} of piece {rows[k]}"
            )
        if not left.any():
            return Verdict(FREE)
        rows, t0, t1 = np.repeat(rows[left], 2), np.repeat(t0[left], 2), np.repeat(t1[left], 2)
        t0[1::2] = t1[::2] = 0.5 * (t0 + t1)[::2]
    return Verdict(
        NOT_SHOWN,
        f"piece {rows[0]} grazes an obstacle at {pieces.at(rows[:1], t0[:1])[0].tolist()}",
    )


def _place(pieces, rows, t):
    """Return positions and yaws of pieces at times."""
    q = pieces.at(rows, t)
    return q[:, :2], q[:, 2] if q.shape[1] > 2 else np.zeros(len(q))


def _move(corners, positions, yaws):
    """Move corners (m, 2) to poses: (n, m, 2)."""
    return (
        turn(np.broadcast_to(corners, (len(yaws), *corners.shape)), yaws[:, None])
        + positions[:, None]
    )


def _touch_in_the_middle(pieces, rows, t, left, robot, world, margin, slack):
    """Return which of the pieces that are left touch an obstacle at a time."""
    touches = np.zeros(len(rows), bool)
    which = np.flatnonzero(left)[:50]
    positions, yaws = _place(pieces, rows[which], t[which])
    for part in robot:
        need = np.full(len(which), part.radius + margin - slack)
        touches[which] |= world.are_near(_move(part.corners, positions, yaws), need)
    return touches
