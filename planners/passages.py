"""Passages: ways through undecided cells that sampling all space would hardly ever find.

Where the map cannot decide whether a path exists, a chain of FREE and MIXED cells leads from start to goal, if any path
does. The planner joins the FREE stretches of the chain; the MIXED ones are crossed by samples, taken in and around the
cells of the chain and drawn along from one cell to the next, which exact geometry proves free and joins.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.rotations import TURN
from cspace.states import FREE
from planners.ends import End
from planners.search import Found, Search
from planners.ways import Way

Floats = NDArray[np.float64]
Cells = NDArray[np.int64]

THROUGH: Final = "Exact solution (through undecided passages)"

DRAWN: Final = 2000
"""Configurations that are drawn for each cell of a passage."""

KEPT: Final = 24
"""Free ones among them that are kept."""

FREE_ENDS: Final = 4
"""FREE cells of the chain, before and after a passage, that are crossed with it, to leave room for lining up."""


SHARE: Final = 0.25
"""Part of the time that is left to the planner alone, where no chain could be walked."""


@dataclass(frozen=True, slots=True)
class Passages:
    """A search along chains of FREE and MIXED cells.

    Attributes
    ----------
    search : Search
        Of the planner, for what lies between the passages.
    way : Way
        Straight edges, proven by exact geometry.
    """

    search: Search
    way: Way

    def run(self, start: End, goal: End) -> Found:
        """A path between two configurations: along a chain where one can be walked, otherwise by the planner alone."""
        if self.way.edge_checker()(*start, *goal):
            return self.search.run(self.way, start, goal)
        began = time.perf_counter()
        rng = np.random.default_rng(self.search.seed)
        space = self.way.space
        closed = np.zeros((len(space.slice_of), *space.grid.shape), dtype=np.bool_)
        limit = self.search.time_limit
        while (left := limit - (time.perf_counter() - began)) > SHARE * limit:
            chain = space.open_chain(start, goal, closed)
            if not len(chain):
                if not closed.any():
                    break
                closed[...] = False  # what one draw did not cross, another may
                continue
            path = self._walk(chain, start, goal, closed, rng, left)
            if path is not None:
                by_length = self.search.simplify and self.search.objective is None
                path = self._shortened(path) if by_length else path
                return Found(path, THROUGH, time.perf_counter() - began)
        left = max(limit - (time.perf_counter() - began), 1e-3)
        found = replace(self.search, time_limit=left).run(self.way, start, goal)
        return replace(found, planning=time.perf_counter() - began - found.simplification)

    def _walk(
        self, chain: Cells, start: End, goal: End, closed: NDArray[np.bool_], rng: np.random.Generator, limit: float
    ) -> Floats | None:
        """A path along a chain; None where it breaks off, with the cells that stopped it closed."""
        space = self.way.space
        mixed = space.stack[(space.slice_of[chain[:, 0]], *chain[:, 1:].T)] != FREE
        runs, path = _runs(mixed, FREE_ENDS), [np.array([start])]
        limit /= len(runs) + 1  # planners that go on improving their path use up what each leg is given
        for first, last in runs:
            # The run begins and ends in a FREE cell, or at the start or goal itself.
            begin = np.array(start) if first == 0 else self._center(chain[first])
            end = np.array(goal) if last == len(chain) - 1 else self._center(chain[last])
            leg = self._join(path[-1][-1], begin, limit)
            if leg is None:
                return None
            crossing = self._cross(chain[first : last + 1], begin, end, closed, rng)
            if crossing is None:
                return None
            path += [leg[1:], crossing[1:]]
        leg = self._join(path[-1][-1], np.array(goal), limit)
        return None if leg is None else np.concatenate([*path, leg[1:]])

    def _join(self, first: Floats, last: Floats, limit: float) -> Floats | None:
        """A path that the planner finds between two configurations."""
        if np.array_equal(first, last):
            return first[None]
        search = replace(self.search, time_limit=limit)
        found = search.run(self.way, tuple(first.tolist()), tuple(last.tolist()))
        return found.path if len(found.path) else None

    def _cross(
        self, cells: Cells, begin: Floats, end: Floats, closed: NDArray[np.bool_], rng: np.random.Generator
    ) -> Floats | None:
        """A path from cell to cell, of configurations that exact edges join to ones of the cell before."""
        space = self.way.space
        layers, parents = [begin[None]], [np.zeros(1, dtype=np.int64)]
        for number, cell in enumerate(cells[1:], start=1):
            if number == len(cells) - 1:
                drawn = end[None]
            else:
                drawn = self._draw(cell, cells[number - 1], layers[-1], rng)
                drawn = drawn[np.asarray(space.is_free(drawn, exact=True))]
                drawn = drawn[rng.permutation(len(drawn))[:KEPT]]
            joined = np.asarray(space.motion_is_free(layers[-1][:, None], drawn[None], exact=True))
            reached = joined.any(axis=0)
            if not reached.any():
                closed[tuple(cell)] = space.classify(self._center(cell)) != FREE
                closed[tuple(cells[number - 1])] = space.classify(self._center(cells[number - 1])) != FREE
                return None
            layers.append(drawn[reached])
            parents.append(joined[:, reached].argmax(axis=0))
        path, index = [], 0
        for layer, parent in zip(layers[::-1], parents[::-1], strict=True):
            path.append(layer[index])
            index = int(parent[index])
        return np.array(path[::-1])

    def _draw(self, cell: Cells, before: Cells, reached: Floats, rng: np.random.Generator) -> Floats:
        """Configurations in the block of cells around one, and near those reached in the cell before, moved along."""
        space, size = self.way.space, self._size(cell)
        middle = self._center(cell)
        around = middle + size * rng.uniform(-1.5, 1.5, (DRAWN // 2, len(size)))
        step = middle - self._center(before)
        if space.rotations is not None:
            step[2] = (step[2] + np.pi) % TURN - np.pi
        along = reached[rng.integers(len(reached), size=DRAWN // 2)]
        share = rng.uniform(0.0, 1.5, (DRAWN // 2, 1))
        spread = size * 10.0 ** rng.uniform(-3.0, 0.0, (DRAWN // 2, 1))
        near = along + share * step + spread * rng.uniform(-1.0, 1.0, along.shape)
        if space.rotations is not None:
            # A step into another rotation cell need not turn the robot, if the passage allows for no turn.
            kept = rng.random(DRAWN // 2) < 0.5
            near[kept, 2] = along[kept, 2]
        return np.concatenate([near, around])

    def _center(self, cell: Cells) -> Floats:
        space = self.way.space
        place = space.grid.center_of(cell[1:])
        return place if space.rotations is None else np.append(place, space.rotations.representatives[cell[0]])

    def _size(self, cell: Cells) -> Floats:
        space = self.way.space
        sides = np.full(space.grid.dim, space.grid.spacing)
        if space.rotations is None:
            return sides
        return np.append(sides, np.diff(space.rotations.borders)[cell[0]])

    def _shortened(self, path: Floats) -> Floats:
        """The path without the configurations that exact edges can leave out."""
        kept, at = [0], 0
        while at < len(path) - 1:
            ahead = np.arange(at + 1, len(path))
            free = np.asarray(self.way.space.motion_is_free(path[at], path[ahead], exact=True))
            free[0] = True
            at = int(ahead[np.flatnonzero(free)[-1]])
            kept.append(at)
        return path[kept]


def _runs(mixed: NDArray[Any], more: int) -> list[tuple[int, int]]:
    """First and last index of the runs of MIXED cells, widened by ``more`` on both sides and merged where they meet."""
    wide = np.convolve(mixed, np.ones(2 * more + 1), mode="full")[more : more + len(mixed)] > 0
    edges = np.flatnonzero(np.diff(wide.astype(np.int8), prepend=0, append=0))
    return [(int(first), int(stop) - 1) for first, stop in zip(edges[::2], edges[1::2], strict=True)]
