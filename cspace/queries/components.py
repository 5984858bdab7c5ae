"""Connected components of FREE cells, and of cells that are not BLOCKED.

Each slice is labelled by :func:`scipy.ndimage.label`. Labels of neighbouring rotation cells are
joined where their cells overlap, as a graph whose components :mod:`scipy.sparse.csgraph` finds.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage, sparse
from scipy.sparse import csgraph

from cspace.support.arrays import FREE, MIXED, Bools, Ints, States

MAX_SHORT_LABEL: Final = np.iinfo(np.uint16).max
"""Largest label that takes two bytes a cell."""

PAIR_BASE: Final = 2**32
"""Base of the number that codes a pair of labels, above all labels."""

Labels = NDArray[np.uint16] | NDArray[np.int32]


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
    def _free(self) -> LabelledCells:
        """Components of FREE cells; no exterior counts as FREE."""
        never_open = np.zeros_like(self._exterior_open)
        is_free = self._states == FREE
        return LabelledCells.of(is_free, self._slice_of, self._rotation_pairs, never_open)

    @cached_property
    def _passable(self) -> LabelledCells:
        """Components of FREE and MIXED cells."""
        is_passable = self._states <= MIXED
        return LabelledCells.of(
            is_passable, self._slice_of, self._rotation_pairs, self._exterior_open
        )

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the component of each cell, or -1.

        Components join FREE cells, or FREE and MIXED cells if ``mixed``. Cells are ``(rotation, x,
        y)`` or ``(rotation, x, y, z)``, shape (..., 1 + d). A cell outside the grid counts as MIXED
        if any configuration there is not BLOCKED.
        """
        labelled = self._passable if mixed else self._free
        return labelled.component_of(cells)

    def count(self, mixed: bool = False) -> int:
        """Return a number above all components of :meth:`of`."""
        labelled = self._passable if mixed else self._free
        return int(labelled.components.max(initial=-1)) + 1

    def are_joined(self, place: int, other: int, mixed: bool = False) -> bool:
        """Return True if two cells of the grid are in one component, as of :meth:`of`.

        A cell is given by its index over all rotation cells.
        """
        labelled = self._passable if mixed else self._free
        component = labelled.component_at(place)
        return component != -1 and component == labelled.component_at(other)

    def box(self, cell: Ints) -> Ints:
        """Return the first and last cell of a FREE component's box.

        ``cell``, shape (1 + d,), is one cell of the component; the result has shape (2, d).
        """
        boxes: Ints = self._free.boxes[int(self.of(cell))]
        return boxes


@dataclass(frozen=True)
class LabelledCells:
    """Cells of one kind with their components.

    Attributes
    ----------
    labels : ndarray of uint16 or int32, shape (slices, ...)
        Label of each cell within its slice, from 1 on; 0 for all other cells.
    slice_of : ndarray of int64, shape (rotations,)
    first_node : ndarray of int64, shape (rotations,)
        Node of label 0 at each rotation cell, which stands for the outside of the grid.
    components : ndarray of int64, shape (nodes,)
        Component of each node; -1 if no cell outside the grid is of this kind.
    """

    labels: Labels
    slice_of: Ints
    first_node: Ints
    components: Ints

    @classmethod
    def of(
        cls, members: Bools, slice_of: Ints, rotation_pairs: Ints, exterior_open: Bools
    ) -> LabelledCells:
        """Label the True cells of slices, and join them across rotation cells.

        ``members``, shape (slices, ...), marks these cells. ``rotation_pairs``, shape (n, 2), are
        the adjacent rotation cells.
        """
        # A node of the graph is a label at a rotation cell; label 0 stands for the outside.
        labels, counts = _label_slices(members)
        node_counts = counts[slice_of] + 1
        first_node = np.cumsum(node_counts) - node_counts
        # Links of the graph, shape (2, n) each: labels at the border with the outside, and labels
        # that overlap at neighbouring rotations.
        is_open = exterior_open[slice_of]
        links = [np.empty((2, 0), dtype=np.int64)]
        for rotation in np.flatnonzero(is_open).tolist():
            border_labels = _find_border_labels(labels[slice_of[rotation]])
            outside = np.zeros_like(border_labels)
            links.append(first_node[rotation] + np.stack([border_labels, outside]))
        for pair in rotation_pairs:
            pair_nodes = first_node[pair, np.newaxis]
            links.append(pair_nodes + _find_shared_labels(labels, slice_of[pair]))
            if is_open[pair].all():
                links.append(pair_nodes)  # the space outside is open at both rotations
        first, second = np.concatenate(links, axis=1)
        n_nodes = int(node_counts.sum())
        graph = sparse.coo_array((np.ones(len(first)), (first, second)), (n_nodes, n_nodes))
        _, numbers = csgraph.connected_components(graph, directed=False)
        components = numbers.astype(np.int64)
        components[first_node[~is_open]] = -1
        return cls(labels, slice_of, first_node, components)

    def component_at(self, place: int) -> int:
        """Return the component of a cell, given by its index over all rotation cells, or -1."""
        rotation, position = divmod(place, self._rows.shape[1])
        label = int(self._rows[self.slice_of[rotation], position])
        if label == 0:
            return -1
        return int(self.components[self.first_node[rotation] + label])

    @cached_property
    def _rows(self) -> Labels:
        """Labels, a row of cells for each slice."""
        return self.labels.reshape(len(self.labels), -1)

    def component_of(self, cells: Ints) -> Ints:
        """Return the component of each cell ``(rotation, x, ...)``; -1 without one."""
        rotations = cells[..., 0]
        positions = cells[..., 1:]
        shape = np.array(self.labels.shape[1:])
        is_inside = ((positions >= 0) & (positions < shape)).all(axis=-1)
        coordinates = np.moveaxis(np.clip(positions, 0, shape - 1), -1, 0)
        labels = self.labels[self.slice_of[rotations], *coordinates]
        # Label 0 stands for the outside, so that other cells of the grid have no component.
        nodes = self.first_node[rotations] + np.where(is_inside, labels, 0)
        return np.where(is_inside & (labels == 0), -1, self.components[nodes])

    @cached_property
    def boxes(self) -> Ints:
        """First and last cell of each component, shape (components, 2, d)."""
        dim = self.labels.ndim - 1
        n_components = int(self.components.max(initial=-1)) + 1
        lowest = np.full((n_components, dim), max(self.labels.shape))
        highest = np.full((n_components, dim), -1)
        corners = [_find_label_corners(slice_labels) for slice_labels in self.labels]
        # The box of a component contains the boxes of its labels at all rotation cells.
        for number, outside in zip(self.slice_of.tolist(), self.first_node.tolist(), strict=True):
            low, high = corners[number]
            components = self.components[outside + 1 : outside + 1 + len(low)]
            np.minimum.at(lowest, components, low)
            np.maximum.at(highest, components, high)
        return np.stack([lowest, highest], axis=1)


def _label_slices(members: Bools) -> tuple[Labels, Ints]:
    """Label the connected True cells of each slice from 1 on.

    ``members`` has shape (slices, ...). Returns the labels, which have the same shape, and their
    number in each slice.
    """
    labels: Labels = np.empty(members.shape, dtype=np.uint16)
    counts = np.empty(len(members), dtype=np.int64)
    for number, slice_members in enumerate(members):
        slice_labels, counts[number] = ndimage.label(slice_members)
        # Most maps need only short labels.
        if counts[number] > MAX_SHORT_LABEL and labels.dtype == np.uint16:
            labels = labels.astype(np.int32)
        labels[number] = slice_labels
    return labels, counts


def _find_label_corners(labels: Labels) -> tuple[Ints, Ints]:
    """Find the first and the last cell of each label's box, shapes (labels, d), in a slice."""
    boxes = ndimage.find_objects(labels)
    corners = [[(side.start, side.stop - 1) for side in box] for box in boxes]
    array = np.array(corners, dtype=np.int64).reshape(-1, labels.ndim, 2)
    return array[..., 0], array[..., 1]


def _find_border_labels(labels: Labels) -> Ints:
    """Return the labels of cells at the border of a slice, without 0."""
    faces = list[Labels]()
    for axis in range(labels.ndim):
        faces += [labels.take(0, axis).ravel(), labels.take(-1, axis).ravel()]
    border_labels = np.unique(np.concatenate(faces)).astype(np.int64)
    return border_labels[border_labels > 0]


def _find_shared_labels(labels: Labels, slices: Ints) -> Ints:
    """Find the pairs of labels that share a cell of two slices, shape (2, n)."""
    first, second = (labels[number].ravel() for number in slices)
    # Runs of one pair are long, so repeated pairs are dropped before the rest is sorted.
    is_new = np.ones(len(first), dtype=np.bool_)
    is_new[1:] = (first[1:] != first[:-1]) | (second[1:] != second[:-1])
    is_new &= (first > 0) & (second > 0)
    # Numbers are sorted faster than pairs.
    codes = first[is_new].astype(np.int64) * PAIR_BASE + second[is_new]
    return np.stack(np.divmod(np.unique(codes), PAIR_BASE))
