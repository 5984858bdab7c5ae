"""Common parts of our own searches, and the search of a user's space."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from cspace import Space
from cspace.errors import InputError
from cspace.inside import NEVER, ConfigurationSpace, Floats, SearchOptions, is_over, now
from planners._edges.own_space import check_found_path
from planners._searches.paths import reached_goal
from planners._task import NO_SEARCH, Planner, PlanTask, SearchResult


class BuiltInSearch(Planner):
    """A search of our own.

    Attributes
    ----------
    tries_edge : bool
        Whether it first tries the edge from start to goal.
    """

    tries_edge = True

    def find(self, task: PlanTask) -> SearchResult:
        """Search for a path between a task's endpoints."""
        edges = task.edges
        if edges.exact and not task.may_succeed():  # cells tell soon by themselves
            return SearchResult(np.empty((0, edges.space.size)))
        began = now()
        path, proof = self.find_path(task)
        if len(path) > 2 and is_over(NEVER):
            path = path[:0]  # proving and measuring thousands of edges takes long
        planning = now() - began
        is_edge = len(path) == 2 and self.tries_edge and not edges.has_costs
        return SearchResult(path, NO_SEARCH if is_edge else "", planning, lattice=proof)

    @abstractmethod
    def find_path(self, task: PlanTask) -> tuple[Floats, str]:
        """Return waypoints, (n, size), and the proof of a lattice in words."""


class SpaceSearch(BuiltInSearch):
    """Search of a space's own, run by its method ``search``."""

    tries_edge = False
    keeps = True
    counts_iterations = True

    def __init__(self, name: str) -> None:
        """Store the name that the space gives the search."""
        self.name = name

    def takes_space(self, space: Space) -> bool:
        """Return whether the space has the named search."""
        return self.name in space.searches

    def prepare(self, task: PlanTask) -> None:
        """Raise InputError for poses with axes in another order."""
        if not isinstance(task.edges.space, ConfigurationSpace):
            from planners._ompl.states import find_state_kind

            find_state_kind(task.edges.space)

    def find_path(self, task: PlanTask) -> tuple[Floats, str]:
        """Return the waypoints that the space finds, checked for a user's space."""
        space = task.edges.space
        options = SearchOptions(
            task.simplify, task.edges.exact, task.iterations, task.seed, task.limit
        )
        path = space.search(self.name, task.endpoints, options)
        if not isinstance(space, ConfigurationSpace):  # an arm may turn farther than its bounds
            path = check_found_path(space, path)
            if len(path):
                _check_ends(task, path)
        return path, ""


def _check_ends(task: PlanTask, path: Floats) -> None:
    """Raise InputError unless a found path joins the start and a goal."""
    space = task.edges.space
    rows = space.rotations.make_canonical(path)
    if reached_goal(rows, task.endpoints, space.is_periodic):
        return
    first, last = map(tuple, rows[[0, -1]].tolist())
    start, *goals = map(str, task.endpoints)
    problem = f"returned a path from {first} to {last}"
    rule = f"a path leads from {start} to {' or '.join(goals[:3])}, or has no row"
    raise InputError("search", problem, rule)
