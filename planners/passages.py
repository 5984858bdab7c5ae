"""Paths along chains of cells, for passages that samples of the whole space hardly ever hit.

If the map cannot decide whether a path exists, every path follows a chain of FREE and MIXED cells. The planner joins
the FREE stretches of such a chain. Samples cross its MIXED stretches: they are drawn in and around each cell and moved
from one cell to the next, and exact geometry proves them free and joins them.
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
from planners.local_planner import EdgesOnMap
from planners.search import Search, SearchResult
from planners.states import Configuration

Cells = Ints

THROUGH_PASSAGES: Final = "through undecided passages"
"""Note about a path that crosses MIXED cells."""

DRAWS_PER_CELL: Final = 2000
"""Number of configurations drawn for each cell of a passage."""

MAX_FREE_DRAWS_PER_CELL: Final = 24
"""Largest number of free configurations used for each cell of a passage."""

DRAWS_PER_CLOCK_CHECK: Final = 200
"""Configurations that exact geometry tests between two checks of the time limit."""

APPROACH_CELLS: Final = 4
"""Number of FREE cells before and after a passage that samples cross too, so that the robot can line up."""

FIRST_SLOT_SHARE: Final = 0.1
"""Fraction of the time limit, at most 1 s, that the planner has before the first chain is sought.

Most passages are wide enough for the planner. Afterwards chains and planner alternate, each time for twice as long.
"""

CHAIN_CELLS_PER_SECOND: Final = 1e7
"""Approximate number of cells that a search for a chain visits in a second."""


@dataclass(frozen=True, slots=True)
class Passages:
    """Search by the planner and along chains of cells.

    The chains, of FREE and MIXED cells, are tried if the planner takes long.

    Attributes
    ----------
    search : Search
        Search of the planner, also used between passages.
    edges : EdgesOnMap
        Straight edges on a map in memory.
    time_limit : float
        Seconds, without caches of the map and compilation.
    began : float
        Reading of the clock at which the time limit starts.
    """

    search: Search
    edges: EdgesOnMap
    time_limit: float
    began: float = field(default_factory=clock)

    def run(self, start: Configuration, goal: Configuration) -> SearchResult:
        """Find a path between two configurations.

        It comes from the planner, or follows a chain of undecided cells.
        """
        space = self.edges.space
        cells = (len(space.rotations), *space.grid.shape)
        needed = math.prod(cells) / CHAIN_CELLS_PER_SECOND
        # A search for a chain takes two bytes a cell: its closed cells, and how each cell was reached.
        is_worthwhile = needed <= 0.5 * self.time_limit and 2 * math.prod(cells) <= MAX_MEMORY_FRACTION * free_bytes()
        if self.edges.edge_checker()(*start, *goal) or not is_worthwhile:
            return self.search.run(self.edges, (start, goal), self.time_limit)
        space.is_free(np.array([start]), exact=True)  # fills caches of exact geometry, outside the limit
        return replace(self, began=clock())._alternate(start, goal, cells, needed)

    def _alternate(
        self, start: Configuration, goal: Configuration, cells: tuple[int, ...], needed: float
    ) -> SearchResult:
        """Alternate the planner and searches along chains.

        Each turn is twice as long as the last one. ``cells`` is the shape of the map with its rotations, and ``needed``
        the seconds that one search for a chain takes, as estimated or measured.
        """
        space, rng = self.edges.space, np.random.default_rng(self.search.seed)
        closed = np.zeros(cells, dtype=np.bool_)
        # A search for a chain cannot be interrupted, so the planner gets at least as long.
        search, slot = self.search, max(min(FIRST_SLOT_SHARE * self.time_limit, 1.0), needed)
        while True:
            is_last = self._left() - slot <= needed
            limit = max(self._left() if is_last else slot, 1e-3)
            result = search.run(self.edges, (start, goal), limit)
            if len(result.path) and result.planning > 0.9 * limit and not (is_last or search.may_stop):
                # A planner that goes on improving its path gets the rest of the time.
                improved = search.run(self.edges, (start, goal), max(self._left(), 1e-3))
                result = improved if len(improved.path) else result
            if len(result.path) or is_last:
                return replace(result, planning=clock() - self.began - result.simplification)
            left_after_slot = self._left() - slot
            while self._left() > max(left_after_slot, needed):
                search_began = clock()
                chain = self._find_chain(start, goal, closed)
                needed = max(needed, clock() - search_began)
                if not len(chain):
                    if not closed.any():
                        needed = math.inf  # no chain exists, so the planner gets the rest of the time
                    closed[...] = False  # new samples may cross a cell that earlier ones did not
                    continue
                path = self._follow_chain(chain, start, goal, closed, rng)
                if path is not None:
                    by_length = self.search.simplify and self.search.objective is None
                    until = self.began + self.time_limit
                    path = skip_waypoints(space, path, len(path), exact=True, until=until) if by_length else path
                    return SearchResult(path, THROUGH_PASSAGES, clock() - self.began)
            slot *= 2.0
            if search.seed is not None:  # the same seed would repeat the same search
                search = replace(search, seed=(search.seed + 1) % (2**32 - 1))

    def _find_chain(self, start: Configuration, goal: Configuration, closed: Bools | None = None) -> Cells:
        """Find a chain of cells from one configuration to another.

        Its cells are neither BLOCKED nor closed.
        """
        space, q = self.edges.space, np.array([start, goal])
        first, last = np.column_stack([space.rotations._cells_of(q), space.grid.cell_of(q[:, : space.grid.dim])])
        return open_chain(space._grid_kernel_map, space.rotations._neighbors, first, last, closed)

    def _left(self) -> float:
        """Return the seconds left until the time limit.

        They are negative after it.
        """
        return self.time_limit - (clock() - self.began)

    def _follow_chain(
        self,
        chain: Cells,
        start: Configuration,
        goal: Configuration,
        closed: Bools,
        rng: np.random.Generator,
    ) -> Floats | None:
        """Find a path along a chain.

        If the path breaks off, return None, and close the cells that stopped it. ``chain`` has shape (n, 1 + d),
        ``closed`` the shape of all cells.
        """
        mixed = np.asarray(self.edges.space.classify(self._centers(chain))) != FREE
        runs, path = _find_runs(mixed, APPROACH_CELLS), [np.array([start])]
        limit = self._left() / (len(runs) + 1)  # planners that go on improving use up their limit on each stretch
        for first, last in runs:
            # The run begins and ends in a FREE cell, or at the start or goal itself.
            begin = np.array(start) if first == 0 else self._centers(chain[first])
            end = np.array(goal) if last == len(chain) - 1 else self._centers(chain[last])
            stretch = self._join(path[-1][-1], begin, limit)
            crossing = None if stretch is None else self._cross(chain[first : last + 1], begin, end, closed, rng)
            if stretch is None or crossing is None:
                return None
            path += [stretch[1:], crossing[1:]]
        stretch = self._join(path[-1][-1], np.array(goal), limit)
        return None if stretch is None else np.concatenate([*path, stretch[1:]])

    def _join(self, first: Floats, last: Floats, limit: float) -> Floats | None:
        """Find a path between two configurations by the planner.

        Returns None if it finds none; ``limit`` is in seconds.
        """
        if np.array_equal(first, last):
            return first[None]
        limit = max(min(limit, self._left()), 1e-3)
        result = self.search.run(self.edges, (tuple(first.tolist()), tuple(last.tolist())), limit)
        return result.path if len(result.path) else None

    def _cross(
        self, cells: Cells, begin: Floats, end: Floats, closed: Bools, rng: np.random.Generator
    ) -> Floats | None:
        """Find a path of exact edges through cells.

        If the path breaks off, close cells and return None.
        """
        # Layer by layer: free configurations drawn in each cell, with an exact edge from one in the cell before.
        layers, parents = [begin[None]], [np.zeros(1, dtype=np.int64)]
        for before, cell in itertools.pairwise(cells):
            last = len(layers) == len(cells) - 1
            drawn = end[None] if last else self._select_free(self._draw(cell, before, layers[-1], rng), rng)
            parent = self._find_parents(layers[-1], drawn)
            reached = parent >= 0
            if not reached.any():
                for each in (cell, before):
                    closed[tuple(each)] = self.edges.space.classify(self._centers(each)) != FREE
                return None
            layers.append(drawn[reached])
            parents.append(parent[reached])
        path, index = [], 0
        for layer, parent in zip(layers[::-1], parents[::-1], strict=True):
            path.append(layer[index])
            index = int(parent[index])
        return np.array(path[::-1])

    def _select_free(self, drawn: Floats, rng: np.random.Generator) -> Floats:
        """Return some of the configurations that are free.

        There are at most MAX_FREE_DRAWS_PER_CELL, found before time is over. ``drawn`` has shape (n, size).
        """
        drawn, free = rng.permutation(drawn), drawn[:0]
        for part in np.array_split(drawn, max(1, len(drawn) // DRAWS_PER_CLOCK_CHECK)):
            if len(free) >= MAX_FREE_DRAWS_PER_CELL or self._left() < 0.0:
                break
            free = np.concatenate([free, part[np.asarray(self.edges.space.is_free(part, exact=True))]])
        return free[:MAX_FREE_DRAWS_PER_CELL]

    def _find_parents(self, starts: Floats, ends: Floats) -> Ints:
        """Find a start that an exact edge joins to each end.

        Returns the index of the first such start, or -1, shape (ends,). Ends that are not tested before time is over
        get -1 too.
        """
        parents = np.full(len(ends), -1)
        for index, start in enumerate(starts):
            left = np.flatnonzero(parents < 0)
            if not len(left) or self._left() < 0.0:
                break
            parents[left[self.edges.space.motion_is_free(start, ends[left], exact=True)]] = index
        return parents

    def _draw(self, cell: Cells, before: Cells, reached: Floats, rng: np.random.Generator) -> Floats:
        """Draw configurations around a cell.

        Half of them are uniform. The others were reached in the cell before, and are moved along.
        """
        space, size, half = self.edges.space, self._size(cell), DRAWS_PER_CELL // 2
        centers = self._centers(np.stack([before, cell]))
        uniform = space.rotations._add_steps(centers[[1] * half], size * rng.uniform(-1.5, 1.5, (half, len(size))))
        reached_before = reached[rng.integers(len(reached), size=half)]
        spread = size * 10.0 ** rng.uniform(-3.0, 0.0, (half, 1))
        steps = rng.uniform(0.0, 1.5, (half, 1)) * space.rotations._steps_between(*centers)
        steps += spread * rng.uniform(-1.0, 1.0, steps.shape)
        # Half of the steps do not turn the robot, because a passage may leave no room to turn.
        steps[rng.random(half) < 0.5, space.grid.dim :] = 0.0
        moved = space.rotations._add_steps(reached_before, steps)
        return np.concatenate([moved, uniform])

    def _centers(self, cells: Cells) -> Floats:
        """Return the centers of cells.

        Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)``; the result has shape (..., size).
        """
        space = self.edges.space
        rotations = space.rotations.centers[cells[..., 0]]
        return np.concatenate([space.grid.center_of(cells[..., 1:]), rotations], axis=-1)

    def _size(self, cell: Cells) -> Floats:
        """Return the sides of a cell.

        They are in metres and radians.
        """
        space = self.edges.space
        center = self._centers(cell)
        steps = space.rotations._steps_between(center, center)
        steps[: space.grid.dim] = space.grid.spacing
        steps[space.grid.dim :] = 2.0 * space.rotations.covering_angles[cell[0]]
        return steps


def skip_waypoints(
    space: ConfigurationSpace, path: Floats, max_skipped: int, *, exact: bool = False, until: float = math.inf
) -> Floats:
    """Remove waypoints that free edges can skip.

    From each remaining waypoint, the free edge to the farthest of the next ``max_skipped`` waypoints is taken. It ends
    at ``until``, a reading of the clock. Paths have shape (n, size).
    """
    indices, current = [0], 0
    while current < len(path) - 1:
        if clock() > until:
            return path[[*indices, *range(current + 1, len(path))]]
        after = np.arange(current + 1, min(current + 1 + max_skipped, len(path)))
        free = np.asarray(space.motion_is_free(path[current], path[after], exact=exact))
        free[0] = True  # the edge of the path itself is kept
        current = int(after[np.flatnonzero(free)[-1]])
        indices.append(current)
    return path[indices]


def _find_runs(mixed: NDArray[Any], margin: int) -> list[tuple[int, int]]:
    """Return the first and last index of each run of True.

    Runs are widened by ``margin`` on both sides, and merged if they touch.
    """
    wide = np.convolve(mixed, np.ones(2 * margin + 1), mode="full")[margin : margin + len(mixed)] > 0
    edges = np.flatnonzero(np.diff(wide.astype(np.int8), prepend=0, append=0))
    return [(int(first), int(stop) - 1) for first, stop in zip(edges[::2], edges[1::2], strict=True)]
