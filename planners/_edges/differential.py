"""Edges of a differential drive: turn, drive straight, turn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Final

import numpy as np
from ompl import base as ob

from cspace.inside import METRES_PER_RADIAN, Floats
from planners._edges.integrals import CellCost
from planners._edges.local_planner import LocalPlanner, wrap_yaw
from planners._ompl.states import make_curve_states

PIVOT_RADIUS_PER_SIDE: Final = 1e-9
"""OMPL's pivot radius, as a share of the map's longest side.

Curves of this radius stand for turning on the spot, and leave the driven edge by at most two radii.
With a radius a hundred times smaller, rounding would decide the direction of a turn.
"""


class TurnDriveTurn(LocalPlanner):
    """Edges of a differential drive: turn, drive straight, turn.

    It turns on the spot, the shorter way, and drives with its x axis ahead. If it reverses, it
    drives backwards when that takes less rotation. Each of the three motions is proven as a
    straight edge; :meth:`insert_breakpoints` gives their endpoints.

    OMPL gets curves with a turning radius of almost zero (:data:`PIVOT_RADIUS_PER_SIDE`). Its
    interpolation stays within 1e-8 of the map's side of the line, and its distance counts metres
    alone.
    """

    def make_states(self) -> ob.StateSpace:
        """Make OMPL's state space of curves with a tiny turning radius."""
        grid = self.cells.grid
        longest_side = grid.spacing * max(grid.shape)
        return make_curve_states(self.reverses, PIVOT_RADIUS_PER_SIDE * longest_side)

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves both turns and the drive free.

        The drive comes first: it is the longest motion and the likeliest to meet an obstacle. It
        proves turns of zero, too.
        """
        is_free = super().edge_checker()
        choose_yaw = self.choose_yaw

        def check(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> bool:
            """Return True if both turns and the drive are proven free."""
            yaw = choose_yaw(x0, y0, yaw0, x1, y1, yaw1)
            return (
                is_free(x0, y0, yaw, x1, y1, yaw)
                and (yaw == yaw0 or is_free(x0, y0, yaw0, x0, y0, yaw))
                and (yaw == yaw1 or is_free(x1, y1, yaw, x1, y1, yaw1))
            )

        return check

    def edge_cost(self, weights: CellCost) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of both turns and the drive."""
        cost = super().edge_cost(weights)

        def add(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> float:
            """Return the cost of both turns and the drive."""
            yaw = self.choose_yaw(x0, y0, yaw0, x1, y1, yaw1)
            total = cost(x0, y0, yaw, x1, y1, yaw)
            # Most edges have few turns.
            if yaw != yaw0:
                total += cost(x0, y0, yaw0, x0, y0, yaw)
            if yaw != yaw1:
                total += cost(x1, y1, yaw, x1, y1, yaw1)
            return total

        return add

    def edge_length(self, *ends: float) -> float:
        """Return an edge's metres plus half its radians."""
        x0, y0, yaw0, x1, y1, yaw1 = ends
        yaw = self.choose_yaw(x0, y0, yaw0, x1, y1, yaw1)
        turns = _turn_by_way_of(yaw, yaw0, yaw1)
        return math.hypot(x1 - x0, y1 - y0) + METRES_PER_RADIAN * turns

    def choose_yaw(
        self, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
    ) -> float:
        """Choose the yaw of a drive, with less rotation; ``yaw0`` for a pure turn."""
        if x0 == x1 and y0 == y1:
            return yaw0
        ahead = wrap_yaw(math.atan2(y1 - y0, x1 - x0))
        if not self.reverses:
            return ahead
        back = wrap_yaw(ahead + math.pi)
        is_less = _turn_by_way_of(back, yaw0, yaw1) < _turn_by_way_of(ahead, yaw0, yaw1)
        return back if is_less else ahead

    def insert_breakpoints(self, path: Floats) -> Floats:
        """Insert the configurations at which turns and drives begin."""
        rows = path.tolist()
        waypoints = rows[:1]
        for first, last in itertools.pairwise(rows):
            yaw = self.choose_yaw(*first, *last)
            drive_start = [*first[:2], yaw]
            drive_end = [*last[:2], yaw]
            # Turns of zero add no row.
            for q in (drive_start, drive_end, last):
                if q != waypoints[-1]:
                    waypoints.append(q)
        return np.array(waypoints).reshape(-1, 3)

    def turns_at(self, path: Floats, row: int) -> bool:
        """Return True if a row next to a row of a path differs by the yaw alone."""
        # The way may begin or end here, if start or goal is the place.
        beside = np.delete(path[max(row - 1, 0) : row + 2, :2], min(row, 1), axis=0)
        return bool((beside == path[row, :2]).all(axis=1).any())

    def remove_turns(self, path: Floats) -> Floats:
        """Give waypoints the yaw of arrival, if their edges remain proven free."""
        check = self.edge_checker()
        rows = path.tolist()
        for k in range(1, len(rows) - 1):
            before = rows[k - 1]
            after = rows[k + 1]
            x, y, _ = rows[k]
            arrival = [x, y, self.choose_yaw(*before, *rows[k])]
            if check(*before, *arrival) and check(*arrival, *after):
                rows[k] = arrival
        return np.array(rows).reshape(-1, 3)


def _turn_by_way_of(yaw: float, before: float, after: float) -> float:
    """Return the radians of two turns, to a yaw and on to another."""
    first = math.remainder(yaw - before, math.tau)
    return abs(first) + abs(math.remainder(after - yaw, math.tau))
