"""Chains through MIXED cells whose centers exact geometry proves free."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from cspace.grid import Grid
from cspace.queries.paths import path_length, waypoints
from cspace.queries.search import find_chain
from cspace.rotations import Rotations
from cspace.support.arrays import BLOCKED, FREE, MIXED, Bools, Floats, Ints, States
from cspace.support.compiling import clock

MAX_CHAIN_EXCESS: Final = 1.15
"""Length of a chain of cells over that of the path, from which a chain no longer promises a shorter
path."""

UNDECIDED_BYTES_PER_CELL: Final = 8
"""Bytes of memory that a search takes for each cell of the map: states, marks, costs, and how a
cell was reached."""


@dataclass(frozen=True, slots=True)
class Undecided:
    """A search in which geometry decides MIXED cells.

    It decides the cells on the way of the search. MIXED cells count as FREE until geometry tests
    their centers. The search then repeats without the cells that failed, until all cells near a
    chain are decided and geometry proves the edges along it.

    Attributes
    ----------
    grid : Grid
    rotations : Rotations
    states : ndarray of uint8, shape (rotations, ...)
        States of the cells.
    turn_costs : ndarray of float64
        Cost of rotating to neighbouring rotation cells, as of
        :func:`cspace.queries.search.turn_costs`.
    are_free : callable
        Decides configurations of shape (n, size) by exact geometry.
    edge_is_free : callable
        Decides the edge between two configurations by exact geometry.
    """

    grid: Grid
    rotations: Rotations
    states: States
    turn_costs: Floats
    are_free: Callable[[Floats], Bools]
    edge_is_free: Callable[..., bool]

    def find(self, endpoints: Floats, cells: Ints, max_length: float, until: float) -> Floats:
        """Find a path between two configurations.

        ``cells``, shape (2, 1 + d), are their cells. Returns waypoints of shape (n, size), joined
        by edges that geometry proves. The length n is 0 if no chain is found, if all chains left
        promise no path of at most ``max_length``, or if time is over.
        """
        none = endpoints[:0]
        mixed = self.states == MIXED
        passable = np.where(mixed, FREE, self.states)
        mixed[tuple(cells.T)] = (
            False  # start and goal are free wherever the centers of their cells are
        )
        undecided = mixed.copy()
        slice_of = np.arange(len(self.rotations))
        turns = (self.rotations.neighbors, self.turn_costs)
        while clock() < until:
            try:
                chain = find_chain(passable, slice_of, turns, cells[0], cells[1], until)
            except TimeoutError:
                return none
            path = self._path_along(chain, endpoints) if len(chain) else none
            if not len(path) or path_length(path, self.rotations) > MAX_CHAIN_EXCESS * max_length:
                return none
            failed = near = _cells_near(chain, undecided)
            if len(near):
                centers = np.column_stack(
                    [self.grid.center_of(near[:, 1:]), self.rotations.centers[near[:, 0]]]
                )
                undecided[tuple(near.T)] = False
                failed = near[~self.are_free(centers)]
            else:
                failing = [
                    edge
                    for edge in itertools.pairwise(path)
                    if not self.edge_is_free(*edge[0], *edge[1])
                ]
                if not failing:
                    return path
                failed = self._cells_beside(np.array(failing), mixed & (passable == FREE))
                if not len(failed):
                    return none
            passable[tuple(failed.T)] = BLOCKED
        return none

    def _path_along(self, chain: Ints, endpoints: Floats) -> Floats:
        """Return the path through the centers of cells.

        MIXED cells at the ends are left out.
        """
        path = waypoints(self.grid, self.rotations, endpoints, chain)
        kept = np.ones(len(path), dtype=np.bool_)
        kept[[1, -2]] = self.states[tuple(chain[[0, -1]].T)] == FREE
        return path[kept]

    def _cells_beside(self, edges: Floats, which: Bools) -> Ints:
        """Return the cells around edges.

        They lie in the boxes around edges, shape (n, 2, size), and are set in ``which``.
        """
        rotations = self.rotations.find_cells(edges)
        positions = self.grid.cell_of(edges[..., : self.grid.dim])
        found = []
        for turned, (first, last) in zip(rotations, np.sort(positions, axis=1), strict=True):
            box = [slice(low, high + 1) for low, high in zip(first, last, strict=True)]
            for rotation in turned:
                inside = np.argwhere(which[rotation, *box]) + first
                found.append(np.column_stack([np.full(len(inside), rotation), inside]))
        return np.unique(np.concatenate(found), axis=0)


def _cells_near(chain: Ints, which: Bools) -> Ints:
    """Return the cells near a chain.

    They are at most one cell away, in its rotations, and are set in ``which``.
    """
    around = np.array(list(itertools.product((-1, 0, 1), repeat=chain.shape[1] - 1)))
    near = np.repeat(chain, len(around), axis=0)
    near[:, 1:] += np.tile(around, (len(chain), 1))
    near = np.unique(near[((near >= 0) & (near < which.shape)).all(axis=1)], axis=0)
    found: Ints = near[which[tuple(near.T)]]
    return found
