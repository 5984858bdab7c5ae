"""Task and result of a search."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from cspace.inside import Effort, Endpoint, Floats, Upright
from planners._catalogue import PlannerName
from planners._edges.integrals import Weigh
from planners._edges.local_planner import Endpoints, LocalPlanner
from planners._goals import Room
from planners._searches.objectives import ObjectiveLike
from planners._stages import Existence

NO_SEARCH: Final = "a single edge is free; no search needed"
"""Note of a path that is a single edge."""

NO_EFFORT: Final = Effort(0.0, 0.0)
"""Planning of a search that did no work."""

DEFAULT_SECONDS: Final = 1.0
"""Work of a plan without a time limit, seconds on an idle machine."""

TRIAL_SHARE: Final = 0.1
MAX_TRIAL: Final = Effort.from_seconds(0.5, math.inf)
"""Share of the plan's work, and the largest one, of a search around a blocked part of a previous
plan, and of one that tries what a failed plan may advise."""


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
    planner: PlannerName | None = None  # that searched
    goal: Endpoint = ()  # reached; the path may end before it in its room


@dataclass(frozen=True, slots=True)
class PlanTask:
    """The checked arguments of a plan, or of its search in a part of a space."""

    edges: LocalPlanner
    planner: PlannerName  # name of a planner of OMPL, or of a built-in search
    objective: ObjectiveLike
    weigh: Weigh | None  # makes what a metre costs on a map in memory, unless it is the length
    limit: Effort
    time_limit: float | None  # seconds, if the user gave a limit
    iterations: int | None  # largest number of checks of OMPL's termination condition
    range: float | None  # longest edge of a tree of OMPL, if given
    simplify: bool
    seed: int | None
    is_named: bool  # whether the user chose the planner
    previous: Floats  # (n, size), waypoints of the plan before this one
    fallback: PlannerName | None = None  # planner that takes over if this one finds no path
    endpoints: Endpoints = ()  # start and goals as OMPL holds them, the nearest goal first
    routes: tuple[Endpoints, ...] = ()  # starts, each with its goals, the most promising first
    keep: tuple[Upright, ...] = ()  # directions that links of an arm keep
    starts: tuple[Room, ...] = ()  # of which a path may begin in any
    rooms: tuple[Room, ...] = ()  # of which a path may end in any, instead of one goal on a map
    existence: Existence | None = None  # of a path between the endpoints; None if nobody asks

    def may_succeed(self) -> bool:
        """Return False if no path of proven edges joins the endpoints."""
        return self.existence is None or self.existence.may_join

    def limit_trial(self) -> Effort:
        """Return the limit of a search beside those of the plan."""
        work = self.limit.share(TRIAL_SHARE).work
        return Effort(work, self.limit.seconds).at_most(MAX_TRIAL)
