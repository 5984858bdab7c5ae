"""Chains through MIXED cells whose centers exact geometry proves free."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from cspace import BLOCKED, FREE, MIXED, CSpace
from cspace.inside import Bools, Effort, Floats, Ints, States, is_over, spend
from planners._searches.chains import find_cells, find_chain
from planners._searches.paths import path_length, waypoints

UNDECIDED_BYTES_PER_CELL: Final = 8
"""Memory of a search for each cell of the map, bytes: states, marks, costs and predecessors."""

NANOSECONDS_PER_PROOF: Final = 20_000
"""Work of deciding a cell or an edge by geometry."""


@dataclass(frozen=True, slots=True)
class MixedCellSearch:
    """A path search in which geometry decides the MIXED cells on the way.

    MIXED cells count as FREE until geometry tests their centers. The search then repeats without
    the cells that failed, until all cells near a chain are decided and geometry proves the edges
    along it.

    Attributes
    ----------
    space : CSpace
    states : ndarray of uint8, shape (rotations, ...)
        States of the cells.
    edge_is_free : callable
        Decides the edge between two configurations by exact geometry.
    """

    space: CSpace
    states: States
    edge_is_free: Callable[..., bool]

    def find(self, endpoints: Floats, max_length: float, until: Effort) -> Floats:
        """Find a path between two configurations.

        Return waypoints, shape (n, size), joined by edges that geometry proves; n is 0 if no chain
        exists, if no remaining chain promises a path of at most ``max_length``, or after ``until``.
        """
        no_path = np.empty((0, endpoints.shape[1]))
        space = self.space
        cells = find_cells(space, endpoints)
        is_mixed = self.states == MIXED
        passable = np.where(is_mixed, FREE, self.states)
        # Start and goal are free whether or not the centers of their cells are.
        is_mixed[tuple(cells.T)] = False
        undecided = is_mixed.copy()
        slice_of = np.arange(len(space.rotations))
        while not is_over(until):
            try:
                chain = find_chain(space, passable, slice_of, cells[0], cells[1], until)
            except TimeoutError:
                return no_path
            if not len(chain):
                return no_path
            path = self._path_along(chain, endpoints)
            # A chain up to this ratio longer than the known path may be shortened below it.
            if path_length(path, space.rotations) > 1.15 * max_length:
                return no_path
            near = _select_near(chain, undecided)
            if len(near):
                # Decide the cells near the chain first; the chain may then change.
                undecided[tuple(near.T)] = False
                spend(NANOSECONDS_PER_PROOF * len(near))
                is_free = space.exact.is_free(self._find_centers(near))
                failed = near[np.logical_not(is_free)]
            else:
                # All cells are decided, so only edges may fail; avoid the MIXED cells beside them.
                failing_edges = self._list_failing_edges(path)
                spend(NANOSECONDS_PER_PROOF * len(path))
                if not failing_edges:
                    return path
                candidates = is_mixed & (passable == FREE)
                failed = self._select_beside(np.array(failing_edges), candidates)
                if not len(failed):
                    return no_path
            passable[tuple(failed.T)] = BLOCKED
        return no_path

    def _find_centers(self, cells: Ints) -> Floats:
        """Return configurations at centers of cells, shape (n, size)."""
        positions = self.space.grid.center_of(cells[:, 1:])
        return np.column_stack([positions, self.space.rotations.centers[cells[:, 0]]])

    def _list_failing_edges(self, path: Floats) -> list[tuple[Floats, Floats]]:
        """List the edges of a path that geometry does not prove."""
        edges = itertools.pairwise(path)
        return [(start, end) for start, end in edges if not self.edge_is_free(*start, *end)]

    def _path_along(self, chain: Ints, endpoints: Floats) -> Floats:
        """Return the path through the centers of a chain.

        ``chain`` has shape (n, 1 + d), ``endpoints`` (2, size). The centers of the first and the
        last cell are left out if these are MIXED, because the ends lie in them.
        """
        path = waypoints(self.space, endpoints, chain)
        is_needed = np.ones(len(path), dtype=np.bool_)
        end_cells = chain[[0, -1]]
        is_needed[[1, -2]] = self.states[tuple(end_cells.T)] == FREE
        return path[is_needed]

    def _select_beside(self, edges: Floats, candidates: Bools) -> Ints:
        """Select the candidate cells around edges, shape (m, 1 + d).

        They lie in the boxes around the edges. ``edges`` has shape (n, 2, size); ``candidates``,
        shape (rotations, ...), is a mask.
        """
        cells = find_cells(self.space, edges)
        corners = np.sort(cells[..., 1:], axis=1)
        selected = []
        # Cells of the box between both ends, at the rotation of either end.
        for end_rotations, (first, last) in zip(cells[..., 0], corners, strict=True):
            box = tuple(map(slice, first, last + 1))
            for rotation in end_rotations:
                inside = np.argwhere(candidates[rotation][box]) + first
                selected.append(np.column_stack([np.full(len(inside), rotation), inside]))
        return np.unique(np.concatenate(selected), axis=0)


def _select_near(chain: Ints, candidates: Bools) -> Ints:
    """Select the candidate cells next to a chain, at its rotations.

    They are at most one cell away. ``chain`` has shape (n, 1 + d), the result (m, 1 + d);
    ``candidates`` is a mask of all cells.
    """
    dim = chain.shape[1] - 1
    offsets = np.array(list(itertools.product((-1, 0, 1), repeat=dim)))
    # Every cell of the chain with every offset.
    near = np.repeat(chain, len(offsets), axis=0)
    near[:, 1:] += np.tile(offsets, (len(chain), 1))
    in_grid = ((near >= 0) & (near < candidates.shape)).all(axis=1)
    near = np.unique(near[in_grid], axis=0)
    is_candidate = candidates[tuple(near.T)]
    selected: Ints = near[is_candidate]
    return selected
