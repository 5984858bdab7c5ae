"""Edges along the curves of cars."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from ompl import base as ob

from cspace import CSpace
from cspace.inside import Floats, bind_kernel, proofs_of
from planners._edges.car_curves import (
    DUBINS,
    REEDS_SHEPP,
    advance,
    curve_cost,
    find_shortest_words,
    prove_length,
)
from planners._edges.integrals import CellCost, bind_cost
from planners._edges.local_planner import MAX_RADIANS, LocalPlanner, Pieces
from planners._ompl.states import find_state_kind, make_curve_states


class CarCurves(LocalPlanner):
    """Edges along the shortest curve of a car.

    The map has the axes x, y, yaw. Each edge is proven along the curve itself, which is split into
    pieces. All cells that meet the box around a piece must be FREE, or with ``exact`` the geometry
    proves the piece (:mod:`planners._edges.car_curves`). A curve that leaves the grid is not
    proven. If several curves are equally short, OMPL may drive any of these, so all are proven.
    """

    rotation_weight = 0.0

    @property
    def radius(self) -> float:
        """Turning radius in metres."""
        return float(self.turning_radius or math.nan)

    @property
    def kind(self) -> int:
        """Kind of curves, for kernels."""
        return REEDS_SHEPP if self.reverses else DUBINS

    def make_states(self) -> ob.StateSpace:
        """Make OMPL's state space of the curves, without bounds."""
        return make_curve_states(self.reverses, self.radius)

    def point_checker(self) -> Callable[..., bool]:
        """Make ``check(*q)``, which proves points like curves without length.

        So proofs of straight edges need not be compiled.
        """
        if not self.exact:
            return super().point_checker()
        prove = self.edge_checker()
        return lambda *q: prove(*q, *q)

    @cached_property
    def bound_proof(self) -> Callable[..., float]:
        """:func:`prove_length` of a map in memory, whose updates it follows."""
        fixed = (self.bounded_map(), self.kind, self.radius)
        return bind_kernel(prove_length, fixed, self.geometry(), *[0.0] * 6)

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves the shortest curves free."""
        prove = self.length_prover()
        return lambda *q: prove(*q) >= 0.0

    def edge_cost(self, weights: CellCost) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of the shortest curve."""
        curve = self.kind, self.radius
        return bind_cost(curve_cost, self.cells, weights, self.rotation_weight, curve)

    def measure_distance(self, path: Floats) -> float:
        """Bound the obstacle distance along proven curves from below.

        See :meth:`cspace.CSpace.path_obstacle_distance` for the pieces of curves.
        """
        if not isinstance(self.space, CSpace):
            return super().measure_distance(path)
        step = 0.5 * self.space.resolution
        pieces = self.split_path(path, step, step / max(self.cells.robot.shape.span, step))
        distance = float(np.min(self.cells.obstacle_distance(*pieces)))
        # Proven edges keep the margin free, even if a piece has nothing left; on a floor, they keep
        # it sideways alone.
        return distance if self.cells.floor is not None else max(self.cells.margin, distance)

    def motion_checker(self) -> Callable[[ob.State, ob.State], bool]:
        """Make ``check(first, second)``, which proves a curve between OMPL states free.

        OMPL's curve must be as short as ours, because only the shortest curves are proven.
        """
        prove = find_state_kind(self.space).of_states(self.length_prover())
        states = self.make_states()
        tolerance = 1e-6 * self.radius

        def check(first: ob.State, second: ob.State) -> bool:
            """Prove our shortest curves free, and OMPL's curve as short as those."""
            length = prove(first, second)
            return length >= 0.0 and bool(states.distance(first, second) <= length + tolerance)

        return check

    def length_prover(self) -> Callable[..., float]:
        """Make ``prove(*q0, *q1)``, the metres of the shortest curve.

        It returns -1 unless the curve is proven free.
        """
        if isinstance(self.space, CSpace):
            prove = self.bound_proof
            if not self.exact:
                return partial(prove, None)
            is_free = self.cells.point_checker()

            def prove_exactly(*q: float) -> float:
                """Prove a curve among the present obstacles.

                No boundaries meet along the curve, so that its start decides containment.
                """
                length: float = prove(self.geometry(), *q)
                start = q[:3]
                if length < 0.0 or is_free(*start):
                    return length
                return length if proofs_of(self.cells).is_outside(*start) else -1.0

            return prove_exactly

        # A map in tiles has no array for kernels, so each edge opens the part around it.
        def prove_in_window(*ends: float) -> float:
            """Prove a curve in a part of the map, in memory."""
            window = self._window_around(np.reshape(ends, (2, 3)))
            return window.length_prover()(*ends)

        return prove_in_window

    def _window_around(self, edge: Floats) -> CarCurves:
        """Return curves in the map's part around an edge."""
        spacing = self.tiles.grid.spacing
        centers = self.split_path(edge, spacing, MAX_RADIANS).points
        positions = np.concatenate([edge, centers])[:, :2]
        lower = positions.min(axis=0) - 2.0 * spacing
        upper = positions.max(axis=0) + 2.0 * spacing
        return replace(self, space=self.tiles.window(lower, upper))

    def edge_length(self, *ends: float) -> float:
        """Return the metres of the shortest curve."""
        x0, y0, yaw0, x1, y1, yaw1 = ends
        start = (x0, y0, yaw0)
        goal = (x1, y1, yaw1)
        return self.radius * find_shortest_words(self.kind, self.radius, start, goal, 0.0).shortest

    def measure(self, path: Floats) -> tuple[float, float]:
        """Measure the metres and the radians of the curves of a path."""
        pieces = self.split_path(path, math.inf, math.inf)
        return math.fsum(pieces.lengths), math.fsum(pieces.rotations)

    def split_edge(
        self, first: Floats, last: Floats, step: float, rotation: float, share: float
    ) -> Pieces:
        """Split a curve into pieces of at most ``step`` and ``rotation``.

        Segments that are only rounding errors are left out, but a curve has at least one piece.
        """
        start = tuple(first.tolist())
        goal = tuple(last.tolist())
        # The first word is the shortest; its lengths are in turning radii.
        words = find_shortest_words(self.kind, self.radius, start, goal, 0.0)
        word = words.lengths[0]
        longest_segment = int(np.argmax(np.abs(word)))
        segments = zip(words.steering[0].tolist(), word.tolist(), strict=True)
        x0, y0, yaw0 = start
        pose = (0.0, 0.0, yaw0)
        points = []
        lengths = []
        rotations = []
        for k, (steer, length) in enumerate(segments):
            # Length, in turning radii, up to which a segment of a curve is only a rounding error.
            if k == longest_segment or abs(length) > 1e-9:
                longest_piece = step / self.radius
                if steer:
                    longest_piece = min(longest_piece, rotation)
                count = max(math.ceil(abs(length) / longest_piece), 1)
                for index in range(count):
                    u, v, yaw = advance(pose, steer, length * (index + share) / count)
                    points.append((x0 + self.radius * u, y0 + self.radius * v, yaw))
                lengths += [self.radius * length / count] * count
                rotations += [steer * length / count] * count
            pose = advance(pose, steer, length)
        return Pieces(np.array(points), np.array(lengths), np.array(rotations))
