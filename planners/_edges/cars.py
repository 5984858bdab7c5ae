"""Edges along the curves of cars."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import ClassVar, Final, Literal

import numpy as np

from cspace import Rotations
from cspace.errors import InputError
from cspace.inside import (
    Car,
    Drive,
    Endpoint,
    Floats,
    bind_kernel,
    proofs_of,
    tell_apart,
    wrap_angles,
)
from planners._edges.car_curves import (
    DUBINS,
    MAX_GAP,
    REEDS_SHEPP,
    ROUNDING_LENGTH,
    Curves,
    advance,
    curve_cost,
    find_shortest_words,
    prove_length,
)
from planners._edges.driven import FINE_HEADINGS, DrivenEdges, Motions
from planners._edges.integrals import CellCost, bind_cost
from planners._edges.local_planner import MAX_RADIANS, Pieces

CAR_LATTICES: Final = {24: 100_000, 48: 200_000, 96: 800_000, 192: 800_000, 384: 800_000}
"""Numbers of headings of the lattices for a car, coarse to fine, and of nodes after which a search
tries the next finer one. An arc leads from one heading to the next."""


class CarCurves(DrivenEdges):
    """Edges along the shortest curve of a car, or with costs of its drive the cheapest one.

    The map has the axes x, y, yaw. Each edge is proven along the curve itself, which is split into
    pieces. All cells that meet the box around a piece must be FREE, or with ``exact`` the geometry
    proves the piece (:mod:`planners._edges.car_curves`). A curve that leaves the grid is not
    proven. If several curves are equally short, OMPL may drive any of these, so all are proven.
    """

    drive: Car
    examples = (Car(1.0, reverse=True), Car(1.0))
    rotation_weight = 0.0
    has_curves = True
    max_gap = MAX_GAP
    hints = ("a smaller turning_radius",)
    # It need not turn on the spot in narrow blocks.
    narrow_cost: ClassVar[float] = 0.3

    @property
    def name(self) -> str:
        """Name of the drive, in messages."""
        return "Car(reverse=True)" if self.reverses else "Car"

    @property
    def tree_planner(self) -> Literal["RRT", "RRTConnect"]:
        """Planner of OMPL for default plans."""
        # RRTConnect's tree at the goal grows by curves that leave the goal; a Dubins car needs
        # curves that arrive.
        return "RRTConnect" if self.reverses else "RRT"

    @property
    def tries_trees(self) -> bool:
        """Whether a default plan first tries :attr:`tree_planner` for a short time."""
        return self.reverses

    @property
    def drive_has_costs(self) -> bool:
        """Whether driving backwards costs more than its length."""
        return self.drive.reverse_cost != 1.0 or self.drive.switch_cost > 0.0

    @property
    def plain_drive(self) -> Drive:
        """The drive without costs."""
        return replace(self.drive, reverse_cost=1.0, switch_cost=0.0)

    @property
    def reverse_weight(self) -> float:
        """Cost of a metre that is driven in reverse, in metres driven ahead."""
        return self.drive.reverse_cost if self.drive_has_costs else 1.5

    @property
    def radius(self) -> float:
        """Turning radius in metres."""
        return self.drive.turning_radius

    @property
    def metres_per_radian(self) -> float:
        """Metres that turning by a radian costs."""
        return self.radius

    @property
    def escape_reach(self) -> float:
        """Reach of the comparison of both ends' surroundings, metres; 0 for none.

        A car that reverses can drive its paths both ways.
        """
        return 0.25 * self.radius if self.reverses else 0.0

    @property
    def sample_drive(self) -> Drive:
        """A car that fits cells of 0.1 m."""
        return replace(self.drive, turning_radius=0.5)

    @property
    def curve_states(self) -> tuple[bool, float]:
        """Whether OMPL's curves reverse, and their radius in metres."""
        self.check_shortest()
        return self.reverses, self.radius

    def check_drive(self) -> None:
        """Raise InputError if the turning radius does not suit the cells."""
        # Rounding errors of curves grow with the radius in cells, and with its inverse.
        spacing = 2.0 * self.space.resolution
        lowest = 1e-3 * spacing
        highest = 1e3 * spacing
        if not lowest <= self.radius <= highest:
            least = tell_apart(self.radius, lowest)[1]
            most = tell_apart(self.radius, highest)[1]
            raise InputError(
                "turning_radius",
                f"is {self.radius!r}",
                f"it must be {least} to {most} m, to keep rounding errors small",
            )

    @property
    def kind(self) -> int:
        """Kind of curves, for kernels."""
        return REEDS_SHEPP if self.reverses else DUBINS

    @property
    def curves(self) -> Curves:
        """Curves and their costs, for kernels."""
        drive = self.drive
        switch_cost = drive.switch_cost / self.radius
        return Curves(self.kind, self.radius, drive.reverse_cost, switch_cost)

    def point_checker(self) -> Callable[..., bool]:
        """Make ``check(*q)``, which proves points like curves without length.

        Then proofs of straight edges need not be compiled.
        """
        if not self.exact:
            return super().point_checker()
        prove = self.edge_checker()
        return lambda *q: prove(*q, *q)

    @cached_property
    def bound_proof(self) -> Callable[..., float]:
        """Kernel :func:`prove_length`, bound to a map in memory and its updates."""
        fixed = (self.bounded_map(), self.curves)
        return bind_kernel(prove_length, fixed, self.geometry(), *[0.0] * 6)

    def edge_checker(self) -> Callable[..., bool]:
        """Make ``check(*q0, *q1)``, which proves the shortest curves free."""
        prove = self.curve_prover()
        return lambda *q: prove(*q) >= 0.0

    def edge_cost(self, weights: CellCost) -> Callable[..., float]:
        """Make ``cost(*q0, *q1)``, the cost of the shortest curve."""
        return bind_cost(curve_cost, self.cells, weights, self.rotation_weight, self.curves)

    def path_cost(self, path: Floats) -> float:
        """Return the cost of a path, with changes of direction at its waypoints."""
        cost = super().path_cost(path)
        if not self.drive.switch_cost:
            return cost
        edges = [self.split_edge(*ends, np.inf, np.inf, 1.0) for ends in itertools.pairwise(path)]
        changes = [a.lengths[-1] * b.lengths[0] < 0.0 for a, b in itertools.pairwise(edges)]
        return cost + self.drive.switch_cost * changes.count(True)

    def measure_distance(self, path: Floats) -> float:
        """Compute a lower bound of the obstacle distance along proven curves.

        See :meth:`cspace.CSpace.path_obstacle_distance` for the pieces of curves.
        """
        if not self.in_memory:
            return super().measure_distance(path)
        step = 0.5 * self.space.resolution
        pieces = self.split_path(path, step, step / max(self.cells.robot.shape.span, step))
        distance = float(np.min(self.cells.obstacle_distance(*pieces)))
        # Proven edges keep the margin free, even if a piece's bound is 0; on a floor, only
        # sideways.
        return distance if self.cells.floor is not None else max(self.cells.margin, distance)

    def curve_prover(self) -> Callable[..., float]:
        """Make ``prove(*q0, *q1)``, the metres of the shortest curve, with the drive's costs.

        It returns -1 unless the curve is proven free.
        """
        if self.in_memory:
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
            """Prove a curve in a part of the map."""
            window = self._window_around(np.reshape(ends, (2, 3)))
            return window.curve_prover()(*ends)

        return prove_in_window

    def _window_around(self, edge: Floats) -> CarCurves:
        """Return these edges on the map's part around an edge."""
        spacing = self.tiles.grid.spacing
        centers = self.split_path(edge, spacing, MAX_RADIANS).points
        positions = np.concatenate([edge, centers])[:, :2]
        lower = positions.min(axis=0) - 2.0 * spacing
        upper = positions.max(axis=0) + 2.0 * spacing
        return replace(self, space=self.tiles.window(lower, upper))

    def edge_length(self, *ends: float) -> float:
        """Return the metres of the shortest curve, with the drive's costs."""
        x0, y0, yaw0, x1, y1, yaw1 = ends
        start = (x0, y0, yaw0)
        goal = (x1, y1, yaw1)
        return self.radius * find_shortest_words(self.curves, start, goal, 0.0).shortest

    def curve_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return the lengths of the shortest curves, shape (n,)."""
        return self.edge_lengths(starts, ends)

    def measure(self, path: Floats) -> tuple[float, float]:
        """Measure the metres and radians along a path."""
        pieces = self.split_path(path, math.inf, math.inf)
        return math.fsum(pieces.lengths), math.fsum(pieces.rotations)

    def split_edge(
        self, first: Floats, last: Floats, step: float, rotation: float, share: float
    ) -> Pieces:
        """Split a curve into pieces of at most ``step`` and ``rotation``.

        Segments that are only rounding errors are skipped, but a curve has at least one piece.
        """
        start = tuple(first.tolist())
        goal = tuple(last.tolist())
        # The first word is the shortest; its lengths are in turning radii.
        words = find_shortest_words(self.curves, start, goal, 0.0)
        word = words.lengths[0]
        longest_segment = int(np.argmax(np.abs(word)))
        segments = zip(words.steering[0].tolist(), word.tolist(), strict=True)
        x0, y0, yaw0 = start
        pose = (0.0, 0.0, yaw0)
        points = []
        lengths = []
        rotations = []
        for k, (steer, length) in enumerate(segments):
            if k == longest_segment or abs(length) > ROUNDING_LENGTH:
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

    def list_chords(self, path: Floats) -> tuple[Floats, float]:
        """Return rows along the curves, and their largest distance from the chords."""
        # Rows are a quarter of a cell apart. An arc of length s and radius r leaves its chord by at
        # most s^2 / (8 r).
        step = 0.5 * self.space.resolution
        return self.resample(path, step), step**2 / (8.0 * self.radius)

    def list_segments(self, path: Floats, rotations: Rotations) -> tuple[Floats, Floats, Floats]:
        """Split a path into straight lines and arcs."""
        parts = [Pieces(np.zeros((0, 3)), np.zeros(0), np.zeros(0))]
        for first, last in itertools.pairwise(path):
            parts.append(self.split_edge(first, last, np.inf, np.inf, 0.0))
        starts, metres, radians = map(np.concatenate, zip(*parts, strict=True))
        yaws = starts[:, 2]
        steps = np.column_stack([metres * np.cos(yaws), metres * np.sin(yaws), radians])
        return np.concatenate([starts, path[-1:]]), steps, radians

    def list_lattices(
        self, ends: Sequence[Endpoint], yaws: Floats, lengths: Floats, is_backwards: bool
    ) -> list[Motions]:
        """List the motions of each lattice, coarse to fine."""
        counts = [count for count in CAR_LATTICES if self.reverses or count <= FINE_HEADINGS]
        return [self._list_motions(ends[0], count, is_backwards) for count in counts]

    def _list_motions(self, start: Endpoint, count: int, is_backwards: bool) -> Motions:
        """List a car's motions at each of ``count`` headings.

        These are arcs to the next of ``count`` headings, and drives straight on, ahead or in
        reverse. The first heading is the start's.
        """
        radius = self.radius
        arc = math.tau / count
        spacing = self.cells.grid.spacing
        yaws = wrap_angles(np.asarray(start[2] + arc * np.arange(count), dtype=np.float64))
        # The chord of an arc is twice as long as the diagonal of a cell. In larger cells, one
        # configuration often replaces another that alone leads into a tight slot.
        side = 0.5 * max(2.0 * radius * math.sin(0.5 * arc), spacing) / math.sqrt(2.0)
        # On drives shorter than 0.07 radii, curves that turn to and fro are as short up to
        # TIE_TOLERANCE, and the proof of an edge needs these, too.
        straight = max(arc, 0.07, 1.01 * math.sqrt(2.0) * side / radius)
        steering = np.array([1, -1, 0])
        lengths = np.array([arc, arc, straight])
        if self.reverses:
            steering = np.tile(steering, 2)
            lengths = np.concatenate([lengths, -lengths])
        costs = radius * np.abs(lengths) * np.where(lengths < 0.0, self.reverse_weight, 1.0)
        if is_backwards:
            # The costs are of the motions as the robot will drive them.
            lengths = -lengths
        turns = np.where(lengths < 0.0, -steering, steering)
        return Motions(
            headings=yaws,
            next_heading=(np.arange(count)[:, None] + turns) % count,
            steering=steering,
            lengths=np.tile(lengths, (count, 1)),
            unit=radius,
            radius=radius,
            max_nodes=CAR_LATTICES[count],
            nanoseconds=5_000,
            costs=np.tile(costs, (count, 1)),
            side=side,
            switch_cost=self.drive.switch_cost if self.drive_has_costs else 0.5 * radius,
            # A car by cost loses no time if it is less greedy.
            greed=1.2 if self.has_costs else 1.5,
            near=max(4.0 * radius, 8.0 * spacing),
            geometry=self.geometry(),
        )
