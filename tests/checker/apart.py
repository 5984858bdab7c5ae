"""Two timed motions in the plane: apart by more than a distance at each instant."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import shapely

from .plane import _move
from .verdict import FREE, NOT_SHOWN, TOLERANCE, TOO_MUCH, TOUCHES, Verdict

DEEPEST = 30


class Timed(NamedTuple):
    """A robot of parts on a motion.

    ``place`` returns rows x, y and yaw at times; ``bound`` the largest speeds of the reference
    point and of the yaw between two arrays of times. The error is of the position, and it grows
    after ``begin``.
    """

    parts: Sequence
    place: Callable
    bound: Callable
    error: float = 0.0
    growth: float = 0.0
    begin: float = 0.0
    end: float = 0.0

    def bound_error(self, t):
        """Return the largest error up to times."""
        return self.error + self.growth * np.maximum(t - self.begin, 0.0)


def check_apart(first, second, begin, end, budget, margin=0.0):
    """Check that two robots keep more than a margin and their errors, from begin to end."""
    pairs = [(a, b) for a in first.parts for b in second.parts]
    levers = [max(p.reach + p.radius for p in each.parts) for each in (first, second)]
    count = 64 if end > begin else 1
    borders = np.linspace(begin, end, count + 1)
    t0, t1 = borders[:-1], borders[1:]
    slack = TOLERANCE * sum(levers)
    for _ in range(DEEPEST):
        if not budget.take(len(t0) * len(pairs)):
            return TOO_MUCH
        t = 0.5 * (t0 + t1)
        placed = [_place(each, t) for each in (first, second)]
        gaps = np.full(len(t), np.inf)
        for k, a in enumerate(first.parts):
            for n, b in enumerate(second.parts):
                gap = shapely.distance(placed[0][k], placed[1][n])
                met = np.flatnonzero(gap == 0.0)
                shrunk = shapely.buffer(placed[0][k][met], -slack, join_style="mitre")
                gap[met[shapely.intersects(shrunk, placed[1][n][met])]] = -2.0 * slack
                gaps = np.minimum(gaps, gap - a.radius - b.radius)
        errors = first.bound_error(t) + second.bound_error(t)
        touches = np.flatnonzero(gaps < margin + errors - slack)
        if len(touches):
            k = touches[0]
            return Verdict(TOUCHES, f"at {t[k]}: {gaps[k]} m instead of {margin + errors[k]}")
        travel = sum(
            speed + lever * turn
            for lever, (speed, turn) in zip(
                levers, (each.bound(t0, t1) for each in (first, second)), strict=True
            )
        )
        needed = margin + first.bound_error(t1) + second.bound_error(t1) - slack
        left = gaps - needed < 0.5 * (t1 - t0) * travel
        if not left.any():
            return Verdict(FREE)
        t0, t, t1 = t0[left], t[left], t1[left]
        t0, t1 = np.ravel([t0, t], "F"), np.ravel([t, t1], "F")
    return Verdict(NOT_SHOWN, f"they graze each other at {t0[0]}")


def _place(mover, t):
    """Return the parts of a mover at times, as geometries."""
    rows = np.asarray(mover.place(t), float)
    yaws = rows[:, 2] if rows.shape[1] > 2 else np.zeros(len(rows))
    return [
        shapely.convex_hull(shapely.multipoints(_move(part.corners, rows[:, :2], yaws)))
        for part in mover.parts
    ]
