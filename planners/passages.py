"""Passages: paths along chains of cells, where sampling all space takes long or would hardly ever find one.

If FREE cells join start and goal and the user names no planner, the map's own search finds a path along them when the
planner finds none soon.

Where the map cannot decide whether a path exists, a chain of FREE and MIXED cells leads from start to goal, if any path
does. The planner joins the FREE stretches of the chain; the MIXED ones are crossed by samples, taken in and around the
cells of the chain and drawn along from one cell to the next, which exact geometry proves free and joins.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.arrays import FREE, Bools, Floats, Ints
from cspace.compiling import clock
from cspace.configuration_space import ConfigurationSpace
from cspace.limits import MAX_MEMORY_FRACTION, free_bytes
from cspace.map.search import open_chain
from cspace.space import CSpace
from planners.catalogue import GRID
from planners.local_planner import LocalPlanner
from planners.search import GRACE, Search, SearchResult
from planners.states import Configuration

Cells = Ints

THROUGH: Final = "through undecided passages"

ALONG: Final = "along FREE cells"

SOON: Final = 10_000
"""Iterations of the planner before the map's own search takes over: a fiftieth of a second. The planner's times have a
long tail, and those of the map's own search do not; a count, and not the clock, keeps plans repeatable."""

DRAWN: Final = 2000
"""Configurations that are drawn for each cell of a passage."""

FREE_DRAWS: Final = 24
"""Free ones among them that are used, at most."""

BATCH: Final = 200
"""Configurations that are tested by the geometry between two looks at the clock."""

APPROACH: Final = 4
"""FREE cells of the chain, before and after a passage, that are crossed with it: room to line up."""

FIRST: Final = 0.1
"""Part of the time, at most a second, that the planner has to itself before chains are looked for, or as long as that
takes: most passages are wide enough for it. Then it is the chains' turn, for as long, and so on, each time for twice as
long."""

RATE: Final = 1e7
"""Cells a second that a search for a chain gets over, about."""


@dataclass(frozen=True, slots=True)
class Passages:
    """A search by the planner, and, where that takes long, along chains of FREE and MIXED cells.

    Attributes
    ----------
    search : Search
        Of the planner, for what lies between the passages.
    edges : LocalPlanner
        Straight edges, proven by exact geometry.
    time_limit : float
        Seconds, for :meth:`run`; but not for what the map makes first, nor for compiling.
    """

    search: Search
    edges: LocalPlanner
    time_limit: float
    began: float = field(default_factory=clock)

    def run_free(self, start: Configuration, goal: Configuration) -> SearchResult:
        """Find a path between two configurations that FREE cells join: by the planner, or else along such cells.

        The map's own search has the rest of the time limit, and GRACE seconds at least. If it finds none in that time,
        the planner goes on, unless its iterations are limited.
        """
        counted = self.search.iterations
        soon = replace(self.search, iterations=counted or SOON)
        result = soon.run(self.edges, start, goal, self.time_limit, joined=True)
        if len(result.path):
            return result
        path = self.edges.search(GRID, (start, goal), self.search.simplify, None, max(self._left(), GRACE))
        if len(path):
            return SearchResult(path, ALONG, clock() - self.began)
        if counted or self._left() <= 0.0:
            return replace(result, planning=clock() - self.began)
        result = self.search.run(self.edges, start, goal, max(self._left(), 1e-3), joined=True)
        return replace(result, planning=clock() - self.began - result.simplification)

    def run(self, start: Configuration, goal: Configuration) -> SearchResult:
        """A path between two configurations: by the planner alone, or else along a chain that can be walked."""
        space = self.edges.space
        cells = (space.rotations.count, *space.grid.shape)
        needed = math.prod(cells) / RATE
        # Two bytes a cell: what is closed, and how each was reached.
        worth = needed <= 0.5 * self.time_limit and 2 * math.prod(cells) <= MAX_MEMORY_FRACTION * free_bytes()
        if self.edges.edge_checker()(*start, *goal) or not worth:
            return self.search.run(self.edges, start, goal, self.time_limit)
        space.is_free(np.array([start]), exact=True)  # what exact answers need is made here, and not within the limit
        return replace(self, began=clock())._run(start, goal, cells, needed)

    def _run(self, start: Configuration, goal: Configuration, cells: tuple[int, ...], needed: float) -> SearchResult:
        """The planner and the search along chains in turns, each time for twice as long."""
        space, rng = self.edges.space, np.random.default_rng(self.search.seed)
        closed = np.zeros(cells, dtype=np.bool_)
        # A look for a chain runs on to its end, so that the planner has at least as long.
        search, share = self.search, max(min(FIRST * self.time_limit, 1.0), needed)
        while True:
            last = self._left() - share <= needed
            alone = max(self._left() if last else share, 1e-3)
            result = search.run(self.edges, start, goal, alone)
            if len(result.path) and result.planning > 0.9 * alone and not (last or search.may_stop):
                # A planner that goes on improving has the rest of the time for it.
                again = search.run(self.edges, start, goal, max(self._left(), 1e-3))
                result = again if len(again.path) else result
            if len(result.path) or last:
                return replace(result, planning=clock() - self.began - result.simplification)
            until = self._left() - share
            while self._left() > max(until, needed):
                looked = clock()
                chain = self._chain(start, goal, closed)
                needed = max(needed, clock() - looked)
                if not len(chain):
                    if not closed.any():
                        needed = math.inf  # there is none: the planner has the rest
                    closed[...] = False  # what one draw did not cross, another may
                    continue
                path = self._walk(chain, start, goal, closed, rng)
                if path is not None:
                    by_length = self.search.simplify and self.search.objective is None
                    until = self.began + self.time_limit
                    path = shortened(space, path, len(path), exact=True, until=until) if by_length else path
                    return SearchResult(path, THROUGH, clock() - self.began)
            share *= 2.0
            if search.seed is not None:  # else it would look again where it was
                search = replace(search, seed=(search.seed + 1) % (2**32 - 1))

    def _chain(self, start: Configuration, goal: Configuration, closed: Bools | None = None) -> Cells:
        """A chain of cells that are not BLOCKED, and not closed, from one configuration to another."""
        space, q = self.edges.space, np.array([start, goal])
        first, last = np.column_stack([space.rotations.cells_of(q), space.grid.cell_of(q[:, : space.grid.dim])])
        return open_chain(space._grid_kernel_map, space.rotations.neighbors, first, last, closed)

    def _left(self) -> float:
        """Seconds that are left; below zero where time is over."""
        return self.time_limit - (clock() - self.began)

    def _walk(
        self,
        chain: Cells,
        start: Configuration,
        goal: Configuration,
        closed: Bools,
        rng: np.random.Generator,
    ) -> Floats | None:
        """A path along a chain; None where it breaks off, with the cells that stopped it closed."""
        mixed = np.asarray(self.edges.space.classify(self._centers(chain))) != FREE
        runs, path = _runs(mixed, APPROACH), [np.array([start])]
        limit = self._left() / (len(runs) + 1)  # planners that go on improving use up what each leg is given
        for first, last in runs:
            # The run begins and ends in a FREE cell, or at the start or goal itself.
            begin = np.array(start) if first == 0 else self._centers(chain[first])
            end = np.array(goal) if last == len(chain) - 1 else self._centers(chain[last])
            leg = self._join(path[-1][-1], begin, limit)
            crossing = None if leg is None else self._cross(chain[first : last + 1], begin, end, closed, rng)
            if leg is None or crossing is None:
                return None
            path += [leg[1:], crossing[1:]]
        leg = self._join(path[-1][-1], np.array(goal), limit)
        return None if leg is None else np.concatenate([*path, leg[1:]])

    def _join(self, first: Floats, last: Floats, limit: float) -> Floats | None:
        """A path that the planner finds between two configurations."""
        if np.array_equal(first, last):
            return first[None]
        limit = max(min(limit, self._left()), 1e-3)
        result = self.search.run(self.edges, tuple(first.tolist()), tuple(last.tolist()), limit)
        return result.path if len(result.path) else None

    def _cross(
        self, cells: Cells, begin: Floats, end: Floats, closed: Bools, rng: np.random.Generator
    ) -> Floats | None:
        """A path through a chain of cells, joined by exact edges; None, and cells closed, where it breaks off."""
        layers, parents = [begin[None]], [np.zeros(1, dtype=np.int64)]
        for before, cell in itertools.pairwise(cells):
            last = len(layers) == len(cells) - 1
            drawn = end[None] if last else self._free_ones(self._draw(cell, before, layers[-1], rng), rng)
            joined = self._joined(layers[-1], drawn)
            reached = joined >= 0
            if not reached.any():
                for each in (cell, before):
                    closed[tuple(each)] = self.edges.space.classify(self._centers(each)) != FREE
                return None
            layers.append(drawn[reached])
            parents.append(joined[reached])
        path, index = [], 0
        for layer, parent in zip(layers[::-1], parents[::-1], strict=True):
            path.append(layer[index])
            index = int(parent[index])
        return np.array(path[::-1])

    def _free_ones(self, drawn: Floats, rng: np.random.Generator) -> Floats:
        """Up to FREE_DRAWS of some configurations that are free, none where time is over."""
        drawn, free = rng.permutation(drawn), drawn[:0]
        for part in np.array_split(drawn, max(1, len(drawn) // BATCH)):
            if len(free) >= FREE_DRAWS or self._left() < 0.0:
                break
            free = np.concatenate([free, part[np.asarray(self.edges.space.is_free(part, exact=True))]])
        return free[:FREE_DRAWS]

    def _joined(self, firsts: Floats, lasts: Floats) -> Ints:
        """The first of some configurations that exact edges join to each of others; -1 where none, or time is over."""
        joined = np.full(len(lasts), -1)
        for number, first in enumerate(firsts):
            left = np.flatnonzero(joined < 0)
            if not len(left) or self._left() < 0.0:
                break
            joined[left[self.edges.space.motion_is_free(first, lasts[left], exact=True)]] = number
        return joined

    def _draw(self, cell: Cells, before: Cells, reached: Floats, rng: np.random.Generator) -> Floats:
        """Configurations in the block of cells around one, and near those reached in the cell before, moved along."""
        space, size, half = self.edges.space, self._size(cell), DRAWN // 2
        middles = self._centers(np.stack([before, cell]))
        around = space.rotations.moved(middles[[1] * half], size * rng.uniform(-1.5, 1.5, (half, len(size))))
        along = reached[rng.integers(len(reached), size=half)]
        spread = size * 10.0 ** rng.uniform(-3.0, 0.0, (half, 1))
        steps = rng.uniform(0.0, 1.5, (half, 1)) * space.rotations.steps(*middles)
        steps += spread * rng.uniform(-1.0, 1.0, steps.shape)
        # A step into another rotation cell need not turn the robot, if the passage allows for no turn.
        steps[rng.random(half) < 0.5, space.grid.dim :] = 0.0
        near = space.rotations.moved(along, steps)
        return np.concatenate([near, around])

    def _centers(self, cells: Cells) -> Floats:
        """Middles of cells ``(rotation, x, y)`` or ``(rotation, x, y, z)``, shape (..., size)."""
        space = self.edges.space
        turns = space.rotations.centers[cells[..., 0]]
        return np.concatenate([space.grid.center_of(cells[..., 1:]), turns], axis=-1)

    def _size(self, cell: Cells) -> Floats:
        """Sides of a cell, metres and radians."""
        space: CSpace = self.edges.space
        center = self._centers(cell)
        steps = space.rotations.steps(center, center)
        steps[: space.grid.dim] = space.grid.spacing
        steps[space.grid.dim :] = 2.0 * space.rotations.covering_angles[cell[0]]
        return steps


def shortened(
    space: ConfigurationSpace, path: Floats, ahead: int, *, exact: bool = False, until: float = math.inf
) -> Floats:
    """A path without the waypoints that a free edge to one of the next ``ahead`` can skip, as far as time allows."""
    indices, at = [0], 0
    while at < len(path) - 1:
        if clock() > until:
            return path[[*indices, *range(at + 1, len(path))]]
        after = np.arange(at + 1, min(at + 1 + ahead, len(path)))
        free = np.asarray(space.motion_is_free(path[at], path[after], exact=exact))
        free[0] = True  # the path itself
        at = int(after[np.flatnonzero(free)[-1]])
        indices.append(at)
    return path[indices]


def _runs(mixed: NDArray[Any], more: int) -> list[tuple[int, int]]:
    """First and last index of the runs of MIXED cells, widened by ``more`` on both sides and merged where they meet."""
    wide = np.convolve(mixed, np.ones(2 * more + 1), mode="full")[more : more + len(mixed)] > 0
    edges = np.flatnonzero(np.diff(wide.astype(np.int8), prepend=0, append=0))
    return [(int(first), int(stop) - 1) for first, stop in zip(edges[::2], edges[1::2], strict=True)]
