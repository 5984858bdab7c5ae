"""Stages of a plan, from its start by places on the way to its goal, and paths between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cspace.inside import NEVER, Endpoint, Floats, Ints, is_labelled, is_over
from planners._edges.local_planner import Endpoints, LocalPlanner
from planners._goals import Room, find_joined


class Stage(NamedTuple):
    """The start, a place on the way, or the goal of a plan."""

    name: str  # in messages
    goals: Sequence[Endpoint]  # its configurations, the most promising from the start first
    rooms: tuple[Room, ...]  # of a map, unless it is one goal; of its start always
    whole: tuple[Room, ...] = ()  # of all its configurations, free or not, if they can be listed

    @classmethod
    def of(cls, name: str, goals: Sequence[Endpoint]) -> Stage:
        """Make a stage from configurations alone."""
        rooms = tuple(Room(name, np.array(q)) for q in goals)
        return cls(name, goals, rooms, rooms)

    @property
    def choices(self) -> Sequence[Room]:
        """The rooms of which a path may take any configuration."""
        return self.rooms or [Room(self.name, np.array(q)) for q in self.goals]

    def takes_any_yaw(self, edges: LocalPlanner, q: Floats) -> bool:
        """Return True if a configuration lies in a room of any yaw."""
        return any(
            room.angle >= math.pi and room.contains(edges.space, q[np.newaxis])[0]
            for room in self.rooms
        )

    def asks_turn(self, edges: LocalPlanner, path: Floats, row: int) -> bool:
        """Return True if the robot turns to a required yaw.

        It turns on the spot at a row of the path.
        """
        return edges.turns_at(path, row) and not self.takes_any_yaw(edges, path[row])


@dataclass(frozen=True)
class Existence:
    """Proofs that a path leads through stages in order, or that none does.

    The path passes one configuration of each stage, and all are asked together. Both answers may be
    False; each is computed at its first use. Both are False if the caller ended the search before
    the map was labelled.

    Attributes
    ----------
    edges : LocalPlanner
    stages : sequence of Stage
        At least two.
    """

    edges: LocalPlanner
    stages: Sequence[Stage]

    @classmethod
    def along(cls, edges: LocalPlanner, route: Endpoints) -> Existence:
        """Make the existence of a path along a route."""
        return cls(edges, (Stage.of("", route[:1]), Stage.of("", route[1:])))

    def upto(self, count: int) -> Existence:
        """Return the existence for the first ``count`` stages."""
        return self if count == len(self.stages) else replace(self, stages=self.stages[:count])

    @cached_property
    def is_connected(self) -> bool:
        """Whether cells or space prove a path of a holonomic robot."""
        return self._can_ask and self._leads_through([stage.choices for stage in self.stages], True)

    @cached_property
    def is_disconnected(self) -> bool:
        """Whether cells, or the space, prove that there is no path."""
        listed = [stage.whole for stage in self.stages if stage.whole]
        return self._can_ask and len(listed) > 1 and not self._leads_through(listed, False)

    @cached_property
    def may_join(self) -> bool:
        """Whether proven edges may join the stages.

        Unless the geometry decides, an edge of any drive is proven only if every closed cell that
        it touches is FREE. The cells of the grid that contain a point of the edge form a block in
        position and rotation, so they are joined through sides. Along the edge, the cells change
        only at points that lie in both the old and the new cells. So all cells of a path, start and
        goal included, belong to one component of FREE cells. No path leaves the grid, even if the
        outside is free. Start and goal lie in the grid, straight edges between such points stay
        there, and curves that leave it are not proven.
        """
        return not self.is_disconnected if self.edges.exact else self.is_connected

    def find_joined(self) -> Ints:
        """Return the components of cells that a path through all stages may take."""
        places = [stage.choices for stage in self.stages]
        return find_joined(self.edges.cells, places, mixed=self.edges.exact)

    @property
    def _can_ask(self) -> bool:
        """Whether the map is labelled, or the search may go on."""
        return not is_over(NEVER) or is_labelled(self.edges.space)

    def _leads_through(self, places: Sequence[Sequence[Room]], is_proof: bool) -> bool:
        """Return whether a path is proven through rooms, or if it is no proof, may exist."""
        are_points = all(len(rooms) == 1 and rooms[0].is_point for rooms in places)
        if self.edges.has_cells and not (is_proof and are_points):
            return len(find_joined(self.edges.cells, places, mixed=not is_proof)) > 0
        exists = self.edges.space.path_exists
        answers = (True,) if is_proof else (True, None)
        reached, *others = places
        for rooms in others:
            reached = [
                room
                for room in rooms
                if any(exists(q.middle, room.middle) in answers for q in reached)
            ]
        return bool(reached)
