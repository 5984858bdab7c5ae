"""Task and result of a search."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Final

from cspace import Space
from cspace.errors import InputError
from cspace.inside import Effort, Endpoint, Floats, Upright
from planners._edges.drives import list_examples
from planners._edges.local_planner import Endpoints, LocalPlanner
from planners._goals import Room
from planners._searches.objectives import (
    CLEARANCE,
    COSTS,
    LENGTH,
    TIME,
    Objective,
)
from planners._stages import Existence

NO_SEARCH: Final = "a single edge is free; no search needed"
"""Note of a path that is a single edge."""

NO_EFFORT: Final = Effort(0.0, 0.0)
"""Planning of a search that did no work."""

DEFAULT_SECONDS: Final = 1.0
"""Work of a plan without a time limit, seconds on an idle machine."""

WEIGHTED: Final = (LENGTH, CLEARANCE, TIME, COSTS)
"""Objectives that weigh the cells of a map, and the length."""


@dataclass(frozen=True, slots=True)
class SearchResult:
    """Outcome of a search."""

    path: Floats  # (n, size), configurations that edges join; n is 0 if the goal was not reached
    note: str = ""  # source of the path, or reason of the failure
    planning: Effort = NO_EFFORT
    simplification: float = 0.0  # seconds
    proven: bool = False  # whether all edges were proven free in a final check
    lattice: str = ""  # proof by a lattice of headings, in words
    where: str = (
        ""  # part of the path that was not found, " from ... to ...", if the map has several tiles
    )
    found_by: str = ""  # name of the planner that searched
    goal: Endpoint = ()  # reached; the path may end before it in its room


@dataclass(frozen=True, slots=True)
class PlanTask:
    """The checked arguments of a plan, or of its search in a part."""

    edges: LocalPlanner
    planner: Planner
    objective: Objective
    limit: Effort
    time_limit: float | None  # seconds, if the user gave a limit
    iterations: int | None  # largest number of checks of OMPL's termination condition
    range: float | None  # longest edge of a tree of OMPL, if given
    simplify: bool
    seed: int | None
    is_named: bool  # whether the user chose the planner
    previous: Floats  # (n, size), waypoints of the plan before this one
    fallback: Planner | None = None  # planner that takes over if this one finds no path
    endpoints: Endpoints = ()  # start and goals as OMPL holds them, the nearest goal first
    routes: tuple[Endpoints, ...] = ()  # starts, each with its goals, the most promising first
    keep: tuple[Upright, ...] = ()  # directions that links of an arm keep
    starts: tuple[Room, ...] = ()  # a path may begin in any room
    rooms: tuple[Room, ...] = ()  # on a map, a path may end in any room instead of one goal
    existence: Existence | None = None  # of a path between the endpoints; None if nobody asks

    def may_succeed(self) -> bool:
        """Return False if no path of proven edges joins the endpoints."""
        return self.existence is None or self.existence.may_join

    def limit_trial(self) -> Effort:
        """Return a detour's or trial's limit: a tenth, at most 0.5 s."""
        work = self.limit.share(0.1).work
        return Effort(work, self.limit.seconds).at_most(Effort.from_seconds(0.5, math.inf))


class Planner(ABC):
    """A search for paths, which declares its options.

    Attributes
    ----------
    name : str
        Its name, as the ``planner`` of :func:`planners.plan`.
    objectives : tuple of str
        Kinds of objectives that it minimises.
    keeps : bool
        Whether links of an arm may keep directions.
    counts_iterations, has_range : bool
        Whether it has these settings of :class:`planners.Search`.
    """

    name: str
    objectives: tuple[str, ...] = (LENGTH,)
    keeps = False
    counts_iterations = False
    has_range = False

    @property
    def optimises(self) -> bool:
        """Whether it goes on after the first path until its limit."""
        return False

    @abstractmethod
    def takes_space(self, space: Space) -> bool:
        """Return whether it searches in a space."""

    def takes_drive(self, edges: LocalPlanner) -> bool:
        """Return whether it searches along a drive's edges."""
        return not edges.has_heading

    def may_fail(self, edges: LocalPlanner) -> bool:
        """Return whether trees of OMPL may find other paths."""
        return False

    def check(self, task: PlanTask) -> None:
        """Raise InputError for an option that it does not take."""
        asked = (
            ("drive", task.edges.drive, self.takes_drive(task.edges)),
            ("objective", task.objective.given, task.objective.kind in self.objectives),
            ("keep", task.keep, self.keeps or not task.keep),
        )
        for option, value, is_taken in asked:
            if not is_taken:
                problem = f"is {value!r} and planner is {self.name!r}"
                if not task.is_named:
                    problem += f", the default for objective={task.objective.given!r}"
                taken = ", ".join(self.list_taken()[option])
                raise InputError(option, problem, f"{self.name} takes {option}: {taken}")

    def list_taken(self) -> dict[str, list[str]]:
        """List the values of options that it takes, for messages."""
        return {
            "drive": [edges.name for edges in list_examples() if self.takes_drive(edges)],
            "objective": list(self.objectives),
            "keep": ["None", "any"] if self.keeps else ["None"],
        }

    def prepare(self, task: PlanTask) -> None:
        """Check the space, and load all code, before the time begins."""
        return

    @abstractmethod
    def find(self, task: PlanTask) -> SearchResult:
        """Search for a path between a task's endpoints."""
