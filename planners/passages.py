"""Paths along chains of cells, for narrow passages.

Samples of the whole space hardly ever hit such passages. If the map cannot decide whether a path exists, every path
follows a chain of FREE and MIXED cells. Samples cross the MIXED stretches of such a chain. They are drawn in and around
each cell and moved from one cell to the next; exact geometry proves them free and joins them.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Final

import numpy as np

from cspace.arrays import BLOCKED, FREE, Bools, Floats, Ints
from cspace.compiling import clock
from cspace.map.search import EXACT_WEIGHT, find_chain, turn_costs
from planners.local_planner import EdgesOnMap, Endpoints

DRAWS_PER_CELL: Final = 2000
"""Number of configurations drawn for each cell of a passage."""

MAX_FREE_DRAWS_PER_CELL: Final = 24
"""Largest number of free configurations used for each cell of a passage."""

DRAWS_PER_CLOCK_CHECK: Final = 200
"""Configurations that exact geometry tests between two checks of the time limit."""

APPROACH_CELLS: Final = 4
"""Number of FREE cells before and after a passage that samples cross too, so that the robot can line up."""

MIXED_COST: Final = 1e3
"""Cost of entering a MIXED cell, in cells, so that chains enter the fewest."""


@dataclass(frozen=True, slots=True)
class Passages:
    """Search along chains of FREE and MIXED cells."""

    edges: EdgesOnMap  # straight edges on a map in memory, which exact geometry proves
    rng: np.random.Generator  # source of the samples
    until: float  # reading of the clock at which the search ends

    def find(self, endpoints: Endpoints) -> Floats:
        """Find a path between two configurations, shape (n, size).

        If the search finds no path in time, n is 0.
        """
        space, ends = self.edges.space, np.array(endpoints[:2])
        first, last = np.column_stack([space.rotations.find_cells(ends), space.grid.cell_of(ends[:, : space.grid.dim])])
        closed = np.zeros((len(space.rotations), *space.grid.shape), dtype=np.bool_)
        while clock() < self.until:
            try:
                chain = self._find_chain(first, last, closed)
            except TimeoutError:
                break
            if len(chain):
                path = self._follow(chain, ends, closed)
                if len(path):
                    return path
            elif not closed.any():
                break
            else:
                closed[...] = False  # new samples may cross a cell that earlier ones did not
        return ends[:0]

    def _find_chain(self, first: Ints, last: Ints, closed: Bools) -> Ints:
        """Find a chain of cells with the fewest MIXED ones, without the ``closed`` cells."""
        space = self.edges.space
        rotations, grid = space.rotations, space.grid
        states = np.where(closed, np.uint8(BLOCKED), np.asarray(space._seen)[space.slice_of])
        turns = rotations.neighbors, turn_costs(rotations, grid.dim, grid.spacing)
        slice_of = np.arange(len(rotations))
        ends = first, last, self.until
        return find_chain(states, slice_of, turns, *ends, weight=EXACT_WEIGHT, mixed_cost=MIXED_COST, by_sides=True)

    def _follow(self, chain: Ints, ends: Floats, closed: Bools) -> Floats:
        """Find a path along a chain, shape (n, 1 + d).

        If the path breaks off, return no rows, and close the cells that stopped it. ``closed`` has the shape of all
        cells.
        """
        path = np.concatenate([ends[:1], self._centers(chain), ends[1:]])
        chain = chain[[0, *range(len(chain)), -1]]
        # The centers of FREE cells are joined by edges, unless an edge leaves its two cells.
        is_hard = np.asarray(self.edges.space.classify(path)) != FREE
        is_hard[1:] |= ~self.edges.edges_are_free(path)
        near = np.convolve(is_hard, np.ones(2 * APPROACH_CELLS + 1))[APPROACH_CELLS:-APPROACH_CELLS] > 0
        rows = [path[:1]]
        for is_passage, group in itertools.groupby(range(1, len(path)), key=lambda k: bool(near[k])):
            indices = list(group)
            part = path[indices]
            if is_passage:
                part = self._cross(chain[[indices[0] - 1, *indices]], rows[-1][-1], path[indices[-1]], closed)
            if not len(part):
                return ends[:0]
            rows.append(part)
        return np.concatenate(rows)

    def _cross(self, cells: Ints, begin: Floats, end: Floats, closed: Bools) -> Floats:
        """Find a path of exact edges through cells.

        The path leaves ``begin`` out. If it breaks off, close cells and return no rows. Layer by layer, free
        configurations are drawn in each cell, with an exact edge from one in the cell before.
        """
        layers, parents = [begin[None]], [np.zeros(1, dtype=np.int64)]
        for before, cell in itertools.pairwise(cells):
            is_last = len(layers) == len(cells) - 1
            drawn = end[None] if is_last else self._select_free(self._draw(cell, before, layers[-1]))
            parent = self._find_parents(layers[-1], drawn)
            reached = parent >= 0
            if not reached.any():
                for each in (cell, before):
                    closed[tuple(each)] = self.edges.space.classify(self._centers(each)) != FREE
                return begin[None][:0]
            layers.append(drawn[reached])
            parents.append(parent[reached])
        path, index = [], 0
        for layer, parent in zip(layers[:0:-1], parents[:0:-1], strict=True):
            path.append(layer[index])
            index = int(parent[index])
        return np.array(path[::-1])

    def _select_free(self, drawn: Floats) -> Floats:
        """Return at most MAX_FREE_DRAWS_PER_CELL free draws, until time is over."""
        drawn, free = self.rng.permutation(drawn), drawn[:0]
        for part in np.array_split(drawn, max(1, len(drawn) // DRAWS_PER_CLOCK_CHECK)):
            if len(free) >= MAX_FREE_DRAWS_PER_CELL or clock() > self.until:
                break
            free = np.concatenate([free, part[np.asarray(self.edges.space.is_free(part, exact=True))]])
        return free[:MAX_FREE_DRAWS_PER_CELL]

    def _find_parents(self, starts: Floats, ends: Floats) -> Ints:
        """Return the index of the start joined to each end.

        It is the first start with an exact edge, or -1 without one in time.
        """
        parents = np.full(len(ends), -1)
        for index, start in enumerate(starts):
            left = np.flatnonzero(parents < 0)
            if not len(left) or clock() > self.until:
                break
            parents[left[self.edges.space.motion_is_free(start, ends[left], exact=True)]] = index
        return parents

    def _draw(self, cell: Ints, before: Ints, reached: Floats) -> Floats:
        """Draw configurations around a cell.

        Half are uniform. The others were reached in the cell before, and are moved along.
        """
        space, rng, half = self.edges.space, self.rng, DRAWS_PER_CELL // 2
        rotations, dim, centers = space.rotations, space.grid.dim, self._centers(np.stack([before, cell]))
        step = rotations.steps_between(*centers)
        size = np.full(len(step), space.grid.spacing)
        size[dim:] = 2.0 * rotations.covering_angles[cell[0]]
        uniform = rotations.add_steps(centers[[1] * half], size * rng.uniform(-1.5, 1.5, (half, len(size))))
        steps = rng.uniform(0.0, 1.5, (half, 1)) * step
        steps += size * 10.0 ** rng.uniform(-3.0, 0.0, (half, 1)) * rng.uniform(-1.0, 1.0, steps.shape)
        # Half of the steps do not turn the robot, because a passage may leave no room to turn.
        steps[rng.random(half) < 0.5, dim:] = 0.0
        return np.concatenate([rotations.add_steps(reached[rng.integers(len(reached), size=half)], steps), uniform])

    def _centers(self, cells: Ints) -> Floats:
        """Return the centers, shape (..., size), of cells ``(rotation, x, ...)``."""
        space = self.edges.space
        rotations = space.rotations.centers[cells[..., 0]]
        return np.concatenate([space.grid.center_of(cells[..., 1:]), rotations], axis=-1)
