"""Edges of robots that drive along their x axis, and their lattices."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.inside import Drive, Endpoint, Floats, Geometry, Ints
from planners._edges.local_planner import LocalPlanner

FINE_HEADINGS: Final = 96
"""Number of headings of the finest lattice of a car that does not reverse; finer ones move to and
fro in slots. Searches that stall on a lattice as fine begin anew around the blocks in vain."""


class Motions(NamedTuple):
    """The m motions at each of h headings, with costs in metres."""

    headings: Floats  # (h,), yaws, radians
    next_heading: Ints  # (h, m), the heading after each motion
    steering: Ints  # (m,), 1 to the left, -1 to the right, 0 straight on or on the spot
    lengths: Floats  # (h, m), negative in reverse, zero on the spot
    unit: float  # of the lengths, metres: the turning radius of a car, otherwise 1
    radius: float | None  # turning radius of a car
    costs: Floats  # (h, m)
    max_nodes: int  # limit of the search
    nanoseconds: int  # of work, to add a node and to expand it
    side: float  # of the cells that hold one configuration for each heading
    switch_cost: float  # of a change between driving ahead and in reverse
    greed: float  # weight of the remaining cost; above 1, searches are quicker, paths may be longer
    near: float  # distance from the goal within which each node tries an edge to the goal
    geometry: Geometry  # proves motions of a car that cells do not prove


class DrivenEdges(LocalPlanner):
    """Edges of a drive, for searches on a lattice of headings."""

    drive: Drive
    has_heading = True

    @property
    def name(self) -> str:
        """Name of the drive, in messages."""
        return type(self.drive).__name__

    @property
    def search(self) -> str:
        """Search of a default plan."""
        return "Lattice"

    @property
    def reverses(self) -> bool:
        """Whether the robot also drives backwards."""
        return self.drive.reverse

    @property
    def drive_has_costs(self) -> bool:
        """Whether driving backwards costs more than its length."""
        return self.drive.reverse_cost != 1.0

    @property
    def plain_drive(self) -> Drive:
        """The drive without costs."""
        return replace(self.drive, reverse_cost=1.0)

    @property
    def has_costs(self) -> bool:
        """Whether an edge may cost more than its length."""
        return self.weights is not None or self.drive_has_costs

    @property
    def reverse_weight(self) -> float:
        """Cost of a metre that is driven in reverse, in metres driven ahead."""
        return self.drive.reverse_cost

    @property
    def max_lateral_acceleration(self) -> float | None:
        """Largest acceleration across the way, m/s^2, if the drive has one."""
        return self.drive.max_lateral_acceleration

    @property
    def escape_reach(self) -> float:
        """Metres around the ends; a search begins at the end with less room; 0 at the start."""
        return 0.0

    @abstractmethod
    def list_lattices(
        self, ends: Sequence[Endpoint], yaws: Floats, lengths: Floats, is_backwards: bool
    ) -> list[Motions]:
        """List the motions of each lattice, coarse to fine.

        ``ends`` are the ends of the path; the search begins at the first. ``yaws`` ascend; they are
        the directions from a cell to others near it, ``lengths`` cells away. A search that
        ``is_backwards`` begins at the goal.
        """

    def check_shortest(self) -> None:
        """Raise InputError if edges may be longer than OMPL's, which are the shortest."""
        if self.drive_has_costs:
            problem = f"is {self.drive!r}"
            raise InputError("drive", problem, "planners of OMPL drive the shortest way")

    def weigh(self) -> Callable[..., float] | None:
        """Make ``cost(*q0, *q1)``; None if the cost is the length."""
        if self.weights is None and self.drive_has_costs:
            return self.edge_length
        return super().weigh()

    def path_length(self, path: Floats) -> float:
        """Return the length of a path with weighted rotations."""
        metres, radians = self.measure(path)
        return metres + self.rotation_weight * radians

    def edge_lengths(self, starts: Floats, ends: Floats) -> Floats:
        """Return edges' lengths with weighted rotations and the drive's costs, shape (n,)."""
        rows = np.hstack([starts, ends]).tolist()
        return np.array([self.edge_length(*row) for row in rows])

    def find_directions(self, rows: Floats) -> NDArray[np.int8]:
        """Return directions of rows (n, 3): ahead 1, back -1, neither 0."""
        if len(rows) < 2:
            return np.ones(len(rows), dtype=np.int8)
        dx, dy = np.diff(rows[:, :2], axis=0).T
        yaws = rows[1:, 2]
        # The sign of the step along the heading; the first row has the sign of the second.
        signs = np.sign(dx * np.cos(yaws) + dy * np.sin(yaws)).astype(np.int8)
        return np.concatenate([signs[:1], signs])

    def list_drives(self) -> list[Drive | None]:
        """List the drive, and one like it that reverses."""
        reversing: list[Drive | None] = [] if self.reverses else [replace(self.drive, reverse=True)]
        return [self.drive, *reversing]
