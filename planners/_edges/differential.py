"""Edges of a differential drive: turn, drive straight, turn."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from cspace.inside import METRES_PER_RADIAN, Differential, Endpoint, Floats, wrap_angles
from planners._edges.driven import DrivenEdges, Motions
from planners._edges.integrals import CellCost
from planners._edges.local_planner import wrap_yaw

PIVOT_RADIUS_PER_SIDE: Final = 1e-9
"""OMPL's pivot radius, as a share of the map's longest side.

Curves of this radius stand for turning on the spot, and leave the driven edge by at most two radii.
With a radius a hundred times smaller, rounding would decide the direction of a turn.
"""


class TurnDriveTurn(DrivenEdges):
    """Edges of a differential drive: turn, drive straight, turn.

    It turns on the spot, the shorter way, and drives with its x axis ahead. If it reverses, it
    drives backwards when that takes less rotation, or with a cost of reversing, when that costs
    less. Each of the three motions is proven as a
    straight edge; :meth:`insert_breakpoints` gives their endpoints.

    OMPL gets curves with a turning radius of almost zero (:data:`PIVOT_RADIUS_PER_SIDE`). Its
    interpolation stays within 1e-8 of the map's side of the line, and its distance counts metres
    alone.
    """

    examples = (Differential(),)
    turns_on_spot = True

    @property
    def search_by_length(self) -> str:
        """Search of a default plan for the length."""
        # The lattice proves turns on the spot by cells alone.
        return self.tree_planner if self.exact else self.search

    @property
    def curve_states(self) -> tuple[bool, float]:
        """Whether OMPL's curves reverse, and their tiny radius, metres."""
        self.check_shortest()
        grid = self.cells.grid
        longest_side = grid.spacing * max(grid.shape)
        return self.reverses, PIVOT_RADIUS_PER_SIDE * longest_side

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves turns and drive free.

        The drive comes first: it is the longest motion and the likeliest to meet an obstacle. It
        proves turns of zero, too.
        """
        is_free = super().edge_checker()
        choose_yaw = self.choose_yaw

        def check(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> bool:
            """Return True if turns and drive are proven free."""
            yaw = choose_yaw(x0, y0, yaw0, x1, y1, yaw1)
            return (
                is_free(x0, y0, yaw, x1, y1, yaw)
                and (yaw == yaw0 or is_free(x0, y0, yaw0, x0, y0, yaw))
                and (yaw == yaw1 or is_free(x1, y1, yaw, x1, y1, yaw1))
            )

        return check

    def edge_cost(self, weights: CellCost) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of turns and drive."""
        cost = super().edge_cost(weights)

        def add(x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float) -> float:
            """Return the cost of turns and drive."""
            yaw, price = self._choose_drive(x0, y0, yaw0, x1, y1, yaw1)
            total = price * cost(x0, y0, yaw, x1, y1, yaw)
            # Most edges have few turns.
            if yaw != yaw0:
                total += cost(x0, y0, yaw0, x0, y0, yaw)
            if yaw != yaw1:
                total += cost(x1, y1, yaw, x1, y1, yaw1)
            return total

        return add

    def edge_length(self, *ends: float) -> float:
        """Return an edge's metres plus half its radians, with the drive's costs."""
        x0, y0, yaw0, x1, y1, yaw1 = ends
        yaw, price = self._choose_drive(x0, y0, yaw0, x1, y1, yaw1)
        turns = _turn_by_way_of(yaw, yaw0, yaw1)
        return price * math.hypot(x1 - x0, y1 - y0) + METRES_PER_RADIAN * turns

    def choose_yaw(
        self, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
    ) -> float:
        """Choose the yaw of the drive that costs less, by default with less rotation.

        It is ``yaw0`` if the edge is a pure turn.
        """
        return self._choose_drive(x0, y0, yaw0, x1, y1, yaw1)[0]

    def _choose_drive(
        self, x0: float, y0: float, yaw0: float, x1: float, y1: float, yaw1: float
    ) -> tuple[float, float]:
        """Choose the yaw of the drive that costs less; return also the cost of a metre."""
        if x0 == x1 and y0 == y1:
            return yaw0, 1.0
        ahead = wrap_yaw(math.atan2(y1 - y0, x1 - x0))
        if not self.reverses:
            return ahead, 1.0
        back = wrap_yaw(ahead + math.pi)
        price = self.drive.reverse_cost
        # In radians, in which the drives differ by default.
        extra = (price - 1.0) * math.hypot(x1 - x0, y1 - y0) / METRES_PER_RADIAN
        is_less = extra + _turn_by_way_of(back, yaw0, yaw1) < _turn_by_way_of(ahead, yaw0, yaw1)
        return (back, price) if is_less else (ahead, 1.0)

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
        """Return True if the path turns on the spot at a row."""
        # The path may also begin or end at this row.
        beside = np.delete(path[max(row - 1, 0) : row + 2, :2], min(row, 1), axis=0)
        return bool((beside == path[row, :2]).all(axis=1).any())

    def remove_turns(self, path: Floats) -> Floats:
        """Give waypoints the yaw of arrival, if all edges remain free."""
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

    def list_lattices(
        self, ends: Sequence[Endpoint], yaws: Floats, lengths: Floats, is_backwards: bool
    ) -> list[Motions]:
        """List the motions of each lattice, coarse to fine."""
        # Headings for each direction from a cell to others near it.
        return [self._list_motions(ends, yaws, lengths, count) for count in (1, 4)]

    def _list_motions(
        self, ends: Sequence[Endpoint], yaws: Floats, lengths: Floats, count: int
    ) -> Motions:
        """List turns to the next headings, and drives along each heading."""
        spacing = self.cells.grid.spacing
        headings, ahead = _list_headings(ends, yaws, lengths, count)
        turns = [1, -1, 0]
        directions = [0.0, 0.0, 1.0]
        if self.reverses:
            turns.append(0)
            directions.append(-1.0)
        metres = spacing * np.outer(ahead, directions)
        next_heading = (np.arange(len(headings))[:, None] + turns) % len(headings)
        radians = np.abs(wrap_angles(headings[next_heading] - headings[:, None]))
        return Motions(
            headings=headings,
            next_heading=next_heading,
            steering=np.zeros(len(turns), dtype=np.int64),
            lengths=metres,
            unit=1.0,
            radius=None,
            max_nodes=1_000_000,
            nanoseconds=2_000,
            costs=METRES_PER_RADIAN * radians + np.maximum(metres, -self.reverse_weight * metres),
            side=spacing,
            switch_cost=0.0,
            greed=1.2,
            near=8.0 * spacing,
            geometry=None,
        )


def _list_headings(
    ends: Sequence[Endpoint], yaws: Floats, lengths: Floats, count: int
) -> tuple[Floats, Floats]:
    """List headings by ascending yaw, and their drives' lengths.

    Headings are the directions from a cell to others near it, and the yaws of the ends. Each gap is
    divided into ``count`` steps; the headings between bring the robot close to a wall. Lengths are
    in cells.
    """
    own_yaws = np.unique([q[2] for q in ends])
    is_new = np.abs(wrap_angles(yaws - own_yaws[:, None])).min(axis=1) > 1e-9
    all_yaws = np.concatenate([wrap_angles(yaws), own_yaws[is_new]])
    order = np.argsort(all_yaws)
    first = all_yaws[order]
    gaps = np.diff(first, append=first[0] + math.tau)
    shares = np.arange(count) / count
    # A drive as long as a cell's diagonal leaves the cell.
    drives = np.full((len(order), count), math.sqrt(2.0))
    is_move = order < len(yaws)
    drives[is_move, 0] = lengths[order[is_move]]
    return wrap_angles(first[:, None] + np.outer(gaps, shares)).ravel(), drives.ravel()


def _turn_by_way_of(yaw: float, before: float, after: float) -> float:
    """Return the radians of turns from ``before`` to ``yaw`` to ``after``."""
    first = math.remainder(yaw - before, math.tau)
    return abs(first) + abs(math.remainder(after - yaw, math.tau))
