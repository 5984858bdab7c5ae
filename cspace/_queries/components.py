"""Connected components of FREE cells, and of cells that are not BLOCKED.

A *run* is a maximal row of such cells along the last axis. Union-find joins the runs of a slice
that share sides; runs so joined have one label. A *node* is a label at a rotation cell. Nodes of
neighbouring rotation cells are joined where their runs overlap.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from cspace._support.arrays import FREE, MIXED, Bools, Ints, States
from cspace._support.compiling import kernel
from cspace._support.threads import count_cores, map_in_threads


class Components:
    """Connected components of FREE cells, and of cells that are not BLOCKED.

    Either kind is computed at its first use. Cells that share a side are joined. Between FREE cells
    of one component a path exists. Between components of cells that are not BLOCKED no path exists:
    if a path crosses an edge or a corner, all cells around it are not BLOCKED, and they are joined
    by their sides.

    Parameters
    ----------
    states : ndarray of uint8, shape (slices, nx, ny) or (slices, nx, ny, nz)
    slice_of : ndarray of int64, shape (rotations,)
        Slice of each rotation cell.
    neighbors : ndarray of int64, shape (rotations, n)
        Adjacent rotation cells, padded with -1.
    exterior_open : ndarray of bool, shape (slices,)
        True where a configuration outside the grid is not BLOCKED.
    """

    def __init__(
        self, states: States, slice_of: Ints, neighbors: Ints, exterior_open: Bools
    ) -> None:
        """Keep the states, which are labelled when they are first needed."""
        self._states = states
        self._slice_of = slice_of
        self._exterior_open = exterior_open
        # List each pair of neighbours once, the lower rotation cell first.
        rotation, column = np.nonzero(neighbors >= 0)
        pairs = np.stack([rotation, neighbors[rotation, column]], axis=1)
        self._rotation_pairs = np.unique(np.sort(pairs, axis=1), axis=0)

    @cached_property
    def _free(self) -> JoinedCells:
        """Components of FREE cells; no exterior counts as FREE."""
        never_open = np.zeros_like(self._exterior_open)
        return self._join(FREE, never_open)

    @cached_property
    def _passable(self) -> JoinedCells:
        """Components of FREE and MIXED cells."""
        return self._join(MIXED, self._exterior_open)

    def _join(self, highest: int, exterior_open: Bools) -> JoinedCells:
        """Compute the components of cells whose state is at most ``highest``."""
        runs = label_runs(list_runs(self._states, highest), self._states.shape)
        shape = self._states.shape
        return JoinedCells.of(runs, shape, self._slice_of, self._rotation_pairs, exterior_open)

    def find(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the component of each cell, or -1.

        Components join FREE cells, or FREE and MIXED cells if ``mixed``. Cells are ``(rotation, x,
        y)`` or ``(rotation, x, y, z)``, shape (..., 1 + d). A cell outside the grid counts as MIXED
        if any configuration there is not BLOCKED.
        """
        joined = self._passable if mixed else self._free
        return joined.component_of(cells)

    def count(self, mixed: bool = False) -> int:
        """Return a number above all components that :meth:`find` returns."""
        joined = self._passable if mixed else self._free
        return joined.count

    def are_joined(self, flat_cell: int, other: int, mixed: bool = False) -> bool:
        """Return True if two cells of the grid are in one component.

        Components are those of :meth:`find`. A cell is given by its flat index over all rotation
        cells.
        """
        joined = self._passable if mixed else self._free
        component = joined.component_at(flat_cell)
        return component != -1 and component == joined.component_at(other)


class Runs(NamedTuple):
    """Runs of cells along the last axis, in the order of their cells.

    Attributes
    ----------
    starts, stops : ndarray of int64, shape (n,)
        First cell of each run, and the cell after its last one, as indices over all slices.
    labels : ndarray of int64, shape (n,)
        Label of each run; at first its own number, or later its node.
    """

    starts: Ints
    stops: Ints
    labels: Ints

    def select(self, chosen: Bools | slice, shift: int = 0, first_label: int = 0) -> Runs:
        """Return chosen runs, moved by ``shift`` cells, with ``first_label`` added to labels."""
        return Runs(
            self.starts[chosen] + shift,
            self.stops[chosen] + shift,
            self.labels[chosen] + first_label,
        )


@dataclass(frozen=True)
class JoinedCells:
    """Cells of one kind with their components.

    Attributes
    ----------
    shape : tuple of int
        Slices, and cells along each axis.
    runs : Runs
        Labelled runs of all slices, in the order of their cells.
    slice_of : ndarray of int64, shape (rotations,)
    first_node : ndarray of int64, shape (rotations,)
        Node of label 0 at each rotation cell, as if the rotation cell had all labels.
    components : ndarray of int64, shape (nodes,)
        Component of each node.
    outside : ndarray of int64, shape (rotations,)
        Component of all space outside the grid at each rotation cell, or -1.
    """

    shape: tuple[int, ...]
    runs: Runs
    slice_of: Ints
    first_node: Ints
    components: Ints
    outside: Ints

    @classmethod
    def of(
        cls,
        runs: Runs,
        shape: tuple[int, ...],
        slice_of: Ints,
        rotation_pairs: Ints,
        exterior_open: Bools,
    ) -> JoinedCells:
        """Join labelled runs across rotation cells.

        ``rotation_pairs``, shape (n, 2), are the adjacent rotation cells; ``exterior_open``, shape
        (slices,), is True where the outside of the grid is of this kind.
        """
        # List the first run and the first label of each slice, and the end of both.
        size = math.prod(shape[1:])
        first_run = np.searchsorted(runs.starts, size * np.arange(shape[0] + 1))
        first_label = np.append(runs.labels, runs.labels.max(initial=-1) + 1)[first_run]
        # A rotation cell has a node for each label of its slice: ``first_node`` plus the label.
        # Then comes a node for the outside of each rotation cell.
        label_counts = np.diff(first_label)[slice_of]
        number_of_nodes = int(label_counts.sum())
        first_node = np.cumsum(label_counts) - label_counts - first_label[slice_of]
        outside = number_of_nodes + np.arange(len(slice_of))
        parents = np.arange(number_of_nodes + len(slice_of))

        def runs_at(rotation: int) -> Runs:
            """Return the runs at a rotation cell, labelled by their nodes.

            Their cells are indices within the slice.
            """
            number = int(slice_of[rotation])
            span = slice(first_run[number], first_run[number + 1])
            return runs.select(span, -number * size, int(first_node[rotation]))

        is_open = exterior_open[slice_of]
        for first, second in rotation_pairs.tolist():
            join_overlaps(runs_at(first), runs_at(second), parents)
            if is_open[first] and is_open[second]:
                join_nodes(outside[[first]], outside[[second]], parents)
        for rotation in np.flatnonzero(is_open).tolist():
            own_runs = runs_at(rotation)
            nodes = own_runs.labels[find_border_runs(own_runs, shape[1:])]
            join_nodes(nodes, np.full_like(nodes, outside[rotation]), parents)
        components, components_outside = np.split(number_components(parents), [number_of_nodes])
        components_outside[~is_open] = -1
        return cls(shape, runs, slice_of, first_node, components, components_outside)

    @cached_property
    def count(self) -> int:
        """Number above all components."""
        return int(max(self.components.max(initial=-1), self.outside.max(initial=-1))) + 1

    @cached_property
    def component_at(self) -> Callable[[int], int]:
        """Look-up of a cell's component by its flat index, or -1."""
        *lines, cells_of_line = self.shape
        cells_of_slice = math.prod(self.shape[1:])
        first_cells = cells_of_line * np.arange(math.prod(lines) + 1)
        # Entries of views are plain integers, several times faster than those of arrays.
        first_runs = np.searchsorted(self.runs.starts, first_cells).data
        starts = self.runs.starts.data
        stops = self.runs.stops.data
        labels = self.runs.labels.data
        slice_of = self.slice_of.data
        first_node = self.first_node.data
        components = self.components.data

        def look_up(flat_cell: int) -> int:
            """Return the component of a cell, or -1."""
            rotation, position = divmod(flat_cell, cells_of_slice)
            cell = slice_of[rotation] * cells_of_slice + position
            line = cell // cells_of_line
            end = first_runs[line + 1]
            # The first run of the line that stops after the cell.
            run = bisect_right(stops, cell, first_runs[line], end)
            if run == end or starts[run] > cell:
                return -1
            component: int = components[first_node[rotation] + labels[run]]
            return component

        return look_up

    def component_of(self, cells: Ints) -> Ints:
        """Return the component of each cell ``(rotation, x, ...)``, or -1."""
        rotations = cells[..., 0]
        positions = cells[..., 1:]
        shape = self.shape[1:]
        is_inside = ((positions >= 0) & (positions < np.array(shape))).all(axis=-1)
        components = np.array(self.outside[rotations])
        components[is_inside] = -1
        # Find the first run that stops after each cell of the grid.
        coordinates = (self.slice_of[rotations], *np.moveaxis(positions, -1, 0))
        places = np.ravel_multi_index(coordinates, self.shape, mode="clip")
        runs = np.searchsorted(self.runs.stops, places, side="right")
        starts = np.append(self.runs.starts, math.prod(self.shape))  # after the last run, no cell
        is_member = is_inside & (starts[runs] <= places)
        nodes = self.first_node[rotations[is_member]] + self.runs.labels[runs[is_member]]
        components[is_member] = self.components[nodes]
        return components


def list_runs(states: States, highest: int) -> Runs:
    """List the runs of cells whose state is at most ``highest``.

    Runs are labelled by their number, from 0 on. ``states`` has shape (slices, ...).
    """
    number_of_slices, *shape = states.shape
    rows = states.reshape(number_of_slices, -1, shape[-1])

    def list_slice(number: int) -> Ints:
        """Return the starts and stops of a slice's runs, shape (2, n)."""
        lines, length = rows[number].shape
        # A cell that is not a member precedes and follows each line.
        is_member = np.zeros(1 + lines * (length + 1), dtype=np.bool_)
        members = is_member[1:].reshape(lines, length + 1)[:, :length]
        np.less_equal(rows[number], highest, out=members)
        # A run starts at one change, and stops at the next.
        borders = np.flatnonzero(is_member[1:] != is_member[:-1]).reshape(-1, 2).T
        # Leave out the added cells of the lines before, one each.
        first_cell: Ints = number * lines * length - borders[0] // (length + 1)
        return borders + first_cell

    parts = map_in_threads(list_slice, range(number_of_slices), count_cores())
    starts, stops = np.concatenate([np.empty((2, 0), dtype=np.int64), *parts], axis=1)
    return Runs(starts, stops, np.arange(len(starts)))


def label_runs(runs: Runs, shape: tuple[int, ...]) -> Runs:
    """Label runs so that connected runs of a slice share a label.

    The runs are those of :func:`list_runs`. ``shape`` has the number of slices, and that of cells
    along each axis.
    """
    parents = np.arange(len(runs.starts))
    for axis in range(1, len(shape) - 1):
        # Cells of neighbouring lines along the axis are ``stride`` cells apart.
        stride = math.prod(shape[axis + 1 :])
        period = stride * shape[axis]
        has_next = runs.starts % period < period - stride
        join_overlaps(runs.select(has_next, stride), runs, parents)
    return runs._replace(labels=number_components(parents))


def number_components(parents: Ints) -> Ints:
    """Return the component of each node.

    Components are numbered in the order of their first nodes. ``parents`` is a forest: the parent
    of each node, itself at a root, which is the first node of its tree.
    """
    roots = parents
    while True:
        higher = roots[roots]
        if np.array_equal(higher, roots):
            break
        roots = higher
    is_root = roots == np.arange(len(roots))
    numbers: Ints = np.cumsum(is_root) - 1
    return numbers[roots]


def find_corners(runs: Runs, shape: tuple[int, ...]) -> tuple[Ints, Ints]:
    """Return first and last cells of runs (n, d)."""
    size = math.prod(shape)
    low = np.stack(np.unravel_index(runs.starts % size, shape), axis=1)
    high = low.copy()
    high[:, -1] += runs.stops - runs.starts - 1
    return low, high


def find_border_runs(runs: Runs, shape: tuple[int, ...]) -> Bools:
    """Return a mask of the runs that touch the grid's border."""
    low, high = find_corners(runs, shape)
    is_last = high == np.array(shape) - 1
    return np.asarray(((low == 0) | is_last).any(axis=1))


def join_nodes(first: Ints, second: Ints, parents: Ints) -> None:
    """Join pairs of nodes, ``first[i]`` and ``second[i]``."""
    # Runs of one cell each, the same in both records.
    places = np.arange(len(first))
    join_overlaps(Runs(places, places + 1, first), Runs(places, places + 1, second), parents)


@kernel
def join_overlaps(first: Runs, second: Runs, parents: Ints) -> None:
    """Join nodes of runs with a common cell.

    The runs of each record are in the order of their cells. The parent of a node is never above it.
    Two trees are joined on the way to their roots, whose nodes change trees, by M. Rem's algorithm
    (E. Dijkstra, "A discipline of programming", 1976).
    """
    next_of_second = 0
    for i in range(len(first.starts)):
        # Skip runs that end before this one, and thus before all later ones.
        start = first.starts[i]
        while next_of_second < len(second.starts) and second.stops[next_of_second] <= start:
            next_of_second += 1
        k = next_of_second
        while k < len(second.starts) and second.starts[k] < first.stops[i]:
            a = first.labels[i]
            b = second.labels[k]
            while parents[a] != parents[b]:
                if parents[a] < parents[b]:
                    a, b = b, a
                # The parent of a is above that of b, which takes its place.
                above = parents[a]
                parents[a] = parents[b]
                a = above
            k += 1
