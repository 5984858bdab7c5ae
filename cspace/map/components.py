"""Connected components of FREE, and of non-BLOCKED cells."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Final, NamedTuple, TypeVar

import numpy as np
import scipy  # its modules are loaded at their first use
from numpy.typing import NDArray

from cspace.arrays import Bools, Ints, Words
from cspace.compiling import kernel
from cspace.map.storage import Cells, Stack, cells_of, high_bits, popcount, prefetch_cell, read_only, row_in, state_in
from cspace.raster.surfaces import merge_sets
from cspace.rotations.records import always_inline
from cspace.threads import cores, in_threads

Nodes = NDArray[np.int32]
Numbers = TypeVar("Numbers", Nodes, Words)

BLOCK_SHIFTS: Final = {2: (0, 6, 6), 3: (3, 3, 6)}
"""Binary logarithm of the cells of a block along each axis, by dimension: 64 rows of 64 cells."""

COMPONENT_BITS: Final = 11
"""Bits of a component index within a block."""
MAX_COMPONENTS_PER_BLOCK: Final = 1 << COMPONENT_BITS
"""Maximum number of runs, and so of components, in a block: 64 rows of 32 runs."""

UNLABELLED: Final = -2
"""Marks a cell whose component requires its block's labels. From it are subtracted the block index, and 6 bits each for
the row in the block and the bit in the row."""

BLOCKS_PER_TASK: Final = 4096
"""Maximum number of blocks labelled at a time by one thread."""

MIN_BLOCKS_PER_THREAD: Final = 256
"""Number of blocks below which another thread costs more than it saves."""

MIN_SLICES_PER_TILE: Final = 12
"""Minimum number of slices per work tile, if the map has that many."""

DELETED: Final = -1
"""Marks a deleted face."""

FACES_PER_DELETED: Final = 4
"""Compact the face array once more than 1/4 of its faces are deleted."""

PREFETCH_ROWS: Final = 12
"""Rows of a block between the row that is prefetched and the row that is read."""

FIRST_BOX_BLOCKS: Final = 16
"""Number of blocks in the first batch that is labelled to find a component's box."""

HINT_SLICES: Final = 8
"""Number of slices merged to guess whether a path exists; maps with fewer than twice as many give no guess."""

MIN_BLOCKS_PER_PATH_BLOCK: Final = 3
"""Label a block path first only if it has at most 1/3 of the blocks of a slice."""

_ONE, _LAST = np.uint64(1), np.uint64(63)


class Blocks(NamedTuple):
    """Blocks of cells of one kind.

    Blocks are numbered slice by slice, and in C order within a slice.

    Attributes
    ----------
    cells : ndarray of uint8, or TwoBits
        States of all slices in a row.
    grid : tuple of int, length 4
        Number of slices, then cells of the grid along three axes.
    shifts, shape : tuple of int, length 3
        Binary logarithm of the cells of a block, and number of blocks, along each axis. Each axis has at least one
        layer of cells beyond the grid. It stands for the whole exterior, so the first cells are next to it too.
    mixed : bool
        True for the cells that are not BLOCKED, False for the FREE cells.
    exterior_open : ndarray of bool, shape (slices,)
        True where a configuration outside the grid is of that kind.
    """

    cells: Cells
    grid: tuple[int, int, int, int]
    shifts: tuple[int, int, int]
    shape: tuple[int, int, int]
    mixed: bool
    exterior_open: Bools


class Labels(NamedTuple):
    """Components within each of several blocks.

    Attributes
    ----------
    words : ndarray of uint64, shape (blocks * rows,)
        Cells of each row, one bit each.
    bounds : ndarray of int32, shape (blocks * rows + 1,)
        Start of each row in ``numbers``, then the end of the last row.
    numbers : ndarray of int32
        Component of each run of a row, in ascending order of cells; a single entry if all runs of the row have the
        same.
    counts : ndarray of int32, shape (blocks,)
        Number of components of each block.
    """

    words: Words
    bounds: Nodes
    numbers: Nodes
    counts: Nodes


class SliceAdjacency(NamedTuple):
    """Adjacency of slices, derived from adjacent rotation cells.

    Adjacent rotation cells with the same slice form one copy of that slice, since each of its cells is joined to
    itself.

    Attributes
    ----------
    copy_of : ndarray of int64, shape (rotations,)
        Copy of each rotation cell.
    slice_of : ndarray of int64, shape (copies,)
        Slice of each copy.
    links : ndarray of int64, shape (slices, n)
        Adjacent slices with a higher index, for each slice; padded with -1.
    uses : ndarray of int64, shape (m, 2)
        Pairs of copies whose components are joined where their slices meet, sorted by group.
    bounds : ndarray of int64, shape (slices * (1 + n) + 1,)
        End of each group in ``uses``. Each slice has one group for faces within it, then one for each of its links.
    """

    copy_of: Ints
    slice_of: Ints
    links: Ints
    uses: Ints
    bounds: Ints

    @classmethod
    def of(cls, slice_of: Ints, neighbors: Ints, slices: int) -> SliceAdjacency:
        """Build from the slice and the neighbors of each rotation cell."""
        cell, column = np.nonzero(neighbors >= 0)
        adjacent = np.stack([cell, neighbors[cell, column]])
        adjacent = np.hstack([adjacent, adjacent[::-1]])
        slice_a, slice_b = slice_of[adjacent]
        lowest_cell = np.arange(len(slice_of))
        cell, neighbor = adjacent[:, slice_a == slice_b]
        while True:
            new_lowest = lowest_cell.copy()
            np.minimum.at(new_lowest, cell, lowest_cell[neighbor])
            if (new_lowest == lowest_cell).all():
                break
            lowest_cell = new_lowest[new_lowest]
        first_of_copy, copy_of = np.unique(lowest_cell, return_inverse=True)
        copies, copy_index = slice_of[first_of_copy], np.arange(len(first_of_copy))
        copy_a, copy_b = copy_of[adjacent[:, slice_a < slice_b]]
        a, b = divmod(np.unique(copy_a * len(copies) + copy_b), len(copies))
        slice_pairs, link = np.unique(copies[a] * slices + copies[b], return_inverse=True)
        s, later = divmod(slice_pairs, slices)
        column = np.arange(len(s)) - np.searchsorted(s, s)
        links = np.full((slices, column.max(initial=-1) + 1), -1)
        links[s, column] = later
        groups = np.concatenate([copies, copies[a]]) * (1 + links.shape[1])
        groups[len(copy_index) :] += 1 + column[link]
        uses = np.stack([np.append(copy_index, a), np.append(copy_index, b)], axis=1)[np.argsort(groups, kind="stable")]
        bounds = np.cumsum(np.bincount(groups + 1, minlength=slices * (1 + links.shape[1]) + 1))
        return cls(copy_of, copies, links, uses, bounds)


class GlobalLabels(NamedTuple):
    """Components of the whole map.

    Component c of a block is node ``start + base[block] + c``.

    Attributes
    ----------
    base : ndarray of int32, shape (blocks + 1,)
        Number of components in all blocks before.
    starts, slices : ndarray of int64, shape (rotations,)
        First node, less the base of the slice, and slice of each rotation cell.
    roots : ndarray of int32
        Component of each node.
    """

    base: Nodes
    starts: Ints
    slices: Ints
    roots: Nodes


# ---- compiled passes -------------------------------------------------------------------------------------------------


@kernel
def pack(blocks: Blocks, segment: int, words: Words) -> None:
    """Pack consecutive blocks along the last axis into words.

    Rows are read across all blocks, in memory order, which is several times faster than block by block. Later rows are
    prefetched; otherwise each row would wait for memory.
    """
    (_, nx, ny, nz), (x_shift, y_shift, z_shift), (layers, rows, columns) = blocks.grid, blocks.shifts, blocks.shape
    first_x, first_y = segment // (columns * rows) % layers << x_shift, segment // columns % rows << y_shift
    s, z = segment // (columns * rows * layers), segment % columns << z_shift
    exterior = ~high_bits(1 << z_shift) if blocks.exterior_open[s] else np.uint64(0)
    rows_per_block = 1 << (x_shift + y_shift)
    count = len(words) // rows_per_block
    for row in range(-PREFETCH_ROWS, rows_per_block):
        x, y = first_x + ((row + PREFETCH_ROWS) >> y_shift), first_y + ((row + PREFETCH_ROWS) & ((1 << y_shift) - 1))
        for n in range(count + 1):
            prefetch_cell(blocks.cells, ((s * nx + x) * ny + y) * nz + z + (n << z_shift))
        if row < 0:
            continue
        x, y = first_x + (row >> y_shift), first_y + (row & ((1 << y_shift) - 1))
        stop = nz if (x < nx) & (y < ny) else 0
        for n in range(count):
            first = z + (n << z_shift)
            inside = max(0, min(1 << z_shift, stop - first))
            taken, blocked = row_in(blocks.cells, ((s * nx + x) * ny + y) * nz + first, inside)
            words[n * rows_per_block + row] = ~(blocked if blocks.mixed else taken) | (exterior & high_bits(inside))


@always_inline
def count_runs(word: np.uint64) -> int:
    """Count the runs of set bits in a word."""
    count: int = popcount(word & ~(word << _ONE))
    return count


@always_inline
def component_at(labels: Labels, row: int, bit: np.uint64) -> int:
    """Return the component of the cell at ``bit``."""
    run = count_runs(labels.words[row] & (bit | (bit - _ONE))) - 1
    component: int = np.int64(labels.numbers[min(labels.bounds[row] + run, labels.bounds[row + 1] - 1)])  # type: ignore[assignment]
    return component


@always_inline
def disjoint_run_ends(word: np.uint64, other: np.uint64) -> np.uint64:
    """Return last bits of runs disjoint from ``other``."""
    # Add the first bit of each run to the run without ``other``. The carry passes through the whole run only if no bit
    # of it is in ``other``. A run at the end of the word carries out of it.
    apart = word & ~other
    carried = apart + (word & ~(word << _ONE))
    return ((carried & ~word) >> _ONE) | (np.uint64(carried < apart) << _LAST)


@kernel
def label_row(labels: Labels, at: int, before: tuple[int, int], parent: Nodes, components: int) -> int:
    """Label the runs of a row from two neighbors.

    Return the number of components. A row without a neighbor row is its own neighbor. A run that touches no earlier
    run starts a component; if it touches several, union-find merges them.
    """
    words, bounds, numbers, _ = labels
    first = stop = np.int64(bounds[at])
    left, uniform = words[at], True
    while left != 0:
        rest = left & (left + (left & (~left + _ONE)))
        component: int = np.int64(-1)  # type: ignore[assignment]
        for k in range(2):
            touch = (left ^ rest) & words[before[k]] if before[k] != at else np.uint64(0)
            while touch != 0:
                bit = touch & (~touch + _ONE)
                touch &= touch + bit
                neighbor = component_at(labels, before[k], bit)
                if component < 0:
                    component = neighbor
                elif parent[component] != parent[neighbor]:
                    merge_sets(parent, component, neighbor)
        if component < 0:
            component, parent[components], components = components, components, components + 1
        uniform = uniform and parent[component] == parent[numbers[first] if stop > first else component]
        numbers[stop], stop, left = component, stop + 1, rest
    bounds[at + 1] = min(first + 1, stop) if uniform else stop
    return components


@kernel
def label_blocks(blocks: Blocks, segments: Ints, starts: Ints, labels: Labels, parent: Nodes) -> None:
    """Label the cells of the blocks ``segments``.

    ``starts`` has the index of each block that does not directly follow the one before it along the last axis, then the
    number of blocks. ``parent``, shape (MAX_COMPONENTS_PER_BLOCK,), is scratch.
    """
    words, bounds, numbers, counts = labels
    rows, wide = len(words) // len(segments), 1 << blocks.shifts[1]
    zero: int = np.int64(0)  # type: ignore[assignment]  # numba requires one type from the start
    for n in range(len(starts) - 1):
        first_block, stop_block = starts[n], starts[n + 1]
        pack(blocks, segments[first_block], words[first_block * rows : stop_block * rows])
        for block in range(first_block, stop_block):
            components = zero
            for row in range(rows):
                row_index = block * rows + row
                beside = row_index - 1 if row & (wide - 1) > 0 else row_index
                below = row_index - wide if row >= wide else row_index
                before, begin = min(beside, below), np.int64(bounds[row_index])
                word, other, first = words[row_index], words[before], np.int64(bounds[before])
                bounds[row_index + 1] = begin
                count = bounds[before + 1] - first
                same_runs = (
                    (beside == row_index or below == row_index)
                    and word != 0
                    and count > 0
                    and disjoint_run_ends(word, other) == 0
                )
                # If each run touches exactly one run of the row before, and touches them all, copy the components
                # of that row.
                if same_runs and count > 1:
                    same_runs = (
                        count_runs(word) == count
                        and count_runs(word & other) == count
                        and disjoint_run_ends(other, word) == 0
                    )
                if same_runs:
                    for m in range(count):
                        numbers[begin + m] = numbers[first + m]
                    bounds[row_index + 1] = begin + count
                else:
                    components = label_row(labels, row_index, (beside, below), parent, components)
            total = zero
            for node in range(components):
                # Roots are the lowest node of their set, so a root has its final index by now.
                if parent[node] == node:
                    parent[node] = total
                    total += 1
                else:
                    parent[node] = parent[parent[node]]
            if components > 1:
                for m in range(bounds[block * rows], bounds[(block + 1) * rows]):
                    numbers[m] = parent[numbers[m]]
            counts[block] = total


class Faces(NamedTuple):
    """Contacts of components across faces and rotations.

    Attributes
    ----------
    rows : ndarray of int32, shape (n, 4)
        Block a, block b, group in :attr:`SliceAdjacency.bounds` or DELETED, and number of pairs.
    pairs : ndarray of int32
        Touching components of all faces, face by face, as ``component_a * MAX_COMPONENTS_PER_BLOCK + component_b``.
    """

    rows: Nodes
    pairs: Nodes


@kernel
def find_faces(
    labels: Labels, shifts: tuple[int, int, int], beside: Ints, parent: Nodes, faces: Faces
) -> tuple[int, int]:
    """Find the touching components of adjacent blocks.

    Return the number of faces and of pairs. Each row of ``beside`` has block a, block b, their group as in
    :class:`Faces`, the axis from a to b, and the indices of both blocks in ``labels``. An axis of 3 or more means the
    same position at another rotation. Pairs implied by others are omitted. ``parent``, shape (3 *
    MAX_COMPONENTS_PER_BLOCK,), is scratch for union-find.
    """
    words, counts = labels.words, labels.counts
    n_faces: int = np.int64(0)  # type: ignore[assignment]  # numba requires one type from the start
    n_pairs = n_faces
    rows_per_layer, rows, long = 1 << shifts[1], 1 << (shifts[0] + shifts[1]), 1 << shifts[2]
    for n in range(len(beside)):
        block_pair, face = beside[n], faces.rows[n_faces]
        axis, ours, theirs, begin = block_pair[3], block_pair[4], block_pair[5], n_pairs
        if counts[ours] == 0 or counts[theirs] == 0:
            continue
        max_pairs = counts[ours] + counts[theirs] - 1  # pairs of a spanning tree
        for node in range(max_pairs):
            parent[node], parent[MAX_COMPONENTS_PER_BLOCK + node] = node, MAX_COMPONENTS_PER_BLOCK + node
        # Rows that touch: the last layer or row of one and the first of the other, or all, along z or between slices.
        skipped = rows - rows_per_layer if axis == 0 else (rows_per_layer - 1 if axis == 1 else 0)
        z_shift = np.uint64(long - 1 if axis == 2 else 0)  # along z the last cell touches the first one
        for row in range(skipped, rows, rows_per_layer if axis == 1 else 1):
            our_row, their_row = ours * rows + row, theirs * rows + row - skipped
            touch, before = (words[our_row] >> z_shift) & words[their_row], np.uint64(0)
            if touch == 0:
                continue
            if axis != 1 and row & (rows_per_layer - 1) > 0:
                before |= (words[our_row - 1] >> z_shift) & words[their_row - 1]
            if axis != 0 and row >= rows_per_layer:
                before |= (words[our_row - rows_per_layer] >> z_shift) & words[their_row - rows_per_layer]
            # Contacts that continue contacts of the row before are joined already. The last cell of each other run of
            # contacts stands for the run.
            left = disjoint_run_ends(touch, before)
            while left != 0:
                bit = left & (~left + _ONE)
                left ^= bit
                our_label = component_at(labels, our_row, bit << z_shift)
                their_label = component_at(labels, their_row, bit)
                if merge_sets(parent, our_label, MAX_COMPONENTS_PER_BLOCK + their_label):
                    faces.pairs[n_pairs] = our_label * MAX_COMPONENTS_PER_BLOCK + their_label
                    n_pairs += 1
            if n_pairs == begin + max_pairs:
                break  # all components are joined
        if n_pairs > begin:
            face[0], face[1], face[2], face[3] = block_pair[0], block_pair[1], block_pair[2], n_pairs - begin
            n_faces += 1
    return n_faces, n_pairs


@kernel
def compact_faces(faces: Faces) -> tuple[int, int]:
    """Remove deleted faces; return counts of faces and pairs."""
    rows, pairs = faces
    n_faces: int = np.int64(0)  # type: ignore[assignment]  # numba requires one type from the start
    begin = n_pairs = n_faces
    for n in range(len(rows)):
        count = rows[n, 3]
        if rows[n, 2] != DELETED:
            for k in range(4):
                rows[n_faces, k] = rows[n, k]
            for k in range(count):
                pairs[n_pairs + k] = pairs[begin + k]
            n_faces, n_pairs = n_faces + 1, n_pairs + count
        begin += count
    return n_faces, n_pairs


@kernel
def join_nodes(roots: Nodes, base: Nodes, faces: Faces, fresh: int, changed: Bools, starts: Ints, bounds: Ints) -> int:
    """Replace each node by the lowest of its component.

    Return the number of deleted faces. ``roots`` are all nodes, in order; ``base`` is as in :class:`GlobalLabels`.
    Faces before index ``fresh`` are deleted if either block has ``changed``; later faces are new. ``starts``,
    shape (m, 2), and ``bounds``, shape (k + 1,), have the first nodes of the copies that each group joins.
    """
    rows, pairs = faces
    begin: int = np.int64(0)  # type: ignore[assignment]  # numba requires one type from the start
    n_deleted = begin
    for n in range(len(rows)):
        face = rows[n]
        if n < fresh and (changed[face[0]] or changed[face[1]]):
            face[2] = DELETED
        group, last = face[2], begin + face[3]
        if group == DELETED:
            n_deleted += 1
        else:
            ours, theirs = base[face[0]], base[face[1]]
            for use in range(bounds[group], bounds[group + 1]):
                our_start, their_start = starts[use, 0] + ours, starts[use, 1] + theirs
                for k in range(begin, last):
                    our_node = our_start + (pairs[k] >> COMPONENT_BITS)
                    their_node = their_start + (pairs[k] & (MAX_COMPONENTS_PER_BLOCK - 1))
                    if roots[our_node] != roots[their_node]:  # cheap test first: most nodes are joined by now
                        merge_sets(roots, our_node, their_node)
        begin = last
    for node in range(len(roots)):
        roots[node] = roots[roots[node]]  # the parent is not higher, so it points to its root by now
    return n_deleted


@kernel
def look_up(blocks: Blocks, labels: GlobalLabels, cells: Ints, components: Ints) -> int:
    """Look up components by state; count the undecided cells.

    Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)``. The state decides if all components of the cell's block
    are one component of the map. Other cells get UNLABELLED less their block, row and bit; cells of another kind get
    -1.
    """
    (_, nx, ny, nz), (deep, wide, long), (layers, rows, columns) = blocks.grid, blocks.shifts, blocks.shape
    n_undecided: int = np.int64(0)  # type: ignore[assignment]  # numba requires one type from the start
    solid = cells.shape[1] == 4
    for n in range(len(cells)):
        cell = cells[n]
        rotation, x, y, z = cell[0], cell[1], cell[-2], cell[-1]
        if not solid:
            x = 0
        start, s = labels.starts[rotation], labels.slices[rotation]
        if (x >= 0) & (x < nx) & (y >= 0) & (y < ny) & (z >= 0) & (z < nz):
            # FREE < MIXED < BLOCKED.
            ours = state_in(blocks.cells, ((s * nx + x) * ny + y) * nz + z) <= np.int64(blocks.mixed)
        else:
            ours, x, y, z = blocks.exterior_open[s], nx if solid else 0, ny, nz
        components[n] = -1
        if not ours:
            continue
        segment = ((s * layers + (x >> deep)) * rows + (y >> wide)) * columns + (z >> long)
        first, stop = start + labels.base[segment], start + labels.base[segment + 1]
        components[n] = labels.roots[first]
        for node in range(first + 1, stop):
            if labels.roots[node] != components[n]:
                row = ((x & ((1 << deep) - 1)) << wide) | (y & ((1 << wide) - 1))
                components[n] = UNLABELLED - ((segment << 12) | (row << 6) | (z & ((1 << long) - 1)))
                n_undecided += 1
                break
    return n_undecided


@kernel
def look_up_labelled(
    global_labels: GlobalLabels, cells: Ints, label_index: Nodes, labels: Labels, components: Ints
) -> None:
    """Look up undecided cells in labelled blocks.

    ``label_index`` has the index of each block in ``labels``, or -1.
    """
    rows = len(labels.words) // len(labels.counts)
    for n in range(len(cells)):
        left = UNLABELLED - components[n]
        segment, row, z = left >> 12, (left >> 6) & 63, left & 63
        if left >= 0 and label_index[segment] >= 0:
            component = component_at(labels, label_index[segment] * rows + row, _ONE << np.uint64(z))
            components[n] = global_labels.roots[
                global_labels.starts[cells[n, 0]] + global_labels.base[segment] + component
            ]


# ---- components of a map ---------------------------------------------------------------------------------------------


class Components:
    """Connected components of FREE, and of non-BLOCKED cells.

    Either kind is computed at its first use. Cells that share a side are joined. Between FREE cells of one component a
    path exists. Between components of cells that are not BLOCKED no path exists: if a path crosses an edge or a corner,
    all cells around it are not BLOCKED, and they are joined by their sides.

    The exterior is one layer of cells that follows the last cells and precedes the first cells along each axis; none of
    it is FREE.

    The states are shared, not copied; call :meth:`refresh` after changes. ``neighbors``, shape (rotations, n), are the
    adjacent rotation cells, padded with -1. ``exterior_open``, shape (slices,), is True where a configuration outside
    the grid is not BLOCKED.
    """

    def __init__(self, states: Stack, slice_of: Ints, neighbors: Ints, exterior_open: Bools) -> None:
        self._states, self._adjacency = states, SliceAdjacency.of(slice_of, neighbors, len(states))
        self._exterior_open = np.zeros(len(states), dtype=np.bool_), np.asarray(exterior_open, dtype=np.bool_)
        self._kinds: dict[bool, StateComponents] = {}

    def refresh(self, boxes: Ints) -> None:
        """Mark the cells in boxes as changed.

        ``boxes``, shape (slices, 6), has a box for each slice.
        """
        for kind in self._kinds.values():
            kind.refresh(boxes)

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the component of each cell, or -1.

        Components join FREE cells, or FREE and MIXED cells if ``mixed``. Cells are ``(rotation, x,
        y)`` or ``(rotation, x, y, z)``, shape (..., 1 + d). Within a FREE component a collision-free path exists;
        between two components of FREE and MIXED cells none does. A cell outside the grid counts as MIXED if any
        configuration there is not BLOCKED. Components keep their indices until the next change.
        """
        return self._kind(mixed).of(cells)

    def hint(self, cells: Ints) -> tuple[bool, Callable[[], bool]]:
        """Guess whether two cells, shape (2, 1 + d), are disconnected.

        If so, the caller tests the components of non-BLOCKED cells first. The guess merges a few slices; if only one
        kind of components exists already, that kind comes first. Also return a function that returns True if
        non-BLOCKED cells join the two along a short block path of the merged slices; False proves nothing.
        """
        slices = len(self._states)
        if self._kinds or slices < 2 * HINT_SLICES:
            return list(self._kinds) == [True], lambda: False
        states = read_only(reduce(np.minimum, (self._states[k] for k in range(0, slices, slices // HINT_SLICES))))
        no_adjacency = SliceAdjacency.of(np.zeros(1, dtype=np.int64), np.empty((1, 0), dtype=np.int64), 1)
        merged_cells = cells.copy()
        merged_cells[:, 0] = 0
        merged = StateComponents(states[None], no_adjacency, True, np.array([self._exterior_open[True].any()]))
        component_a, component_b = merged.of(merged_cells).tolist()

        def joined_along_path() -> bool:
            """Return True if a short block path joins the cells."""
            if not -1 != component_a == component_b:
                return False
            path_blocks = merged.block_path(merged_cells)
            self._kind(mixed=True)  # later queries test these first
            if MIN_BLOCKS_PER_PATH_BLOCK * len(path_blocks) > merged.count:
                return False
            path_components = StateComponents(
                self._states, self._adjacency, True, self._exterior_open[True], path_blocks
            )
            first, second = path_components.of(cells).tolist()
            return bool(-1 != first == second)

        return bool(-1 != component_a != component_b != -1), joined_along_path

    def box(self, cell: Ints) -> Ints:
        """Return the first and last cell of a FREE component's box.

        ``cell``, shape (1 + d,), is one cell of the component; the result has shape (2, d).
        """
        return self._kind(mixed=False).box(cell)

    def _kind(self, mixed: bool) -> StateComponents:
        if mixed not in self._kinds:
            self._kinds[mixed] = StateComponents(self._states, self._adjacency, mixed, self._exterior_open[mixed])
        return self._kinds[mixed]


class PeriodicComponents(Components):
    """Components of one period, joined across seams."""

    def __init__(
        self, states: Stack, slice_of: Ints, neighbors: Ints, exterior_open: Bools, periodic: Sequence[bool]
    ) -> None:
        super().__init__(states, slice_of, neighbors, exterior_open)
        seams, shape = [], states.shape[1:]
        for axis in np.flatnonzero(periodic).tolist():
            low_cells = np.indices((*shape[:axis], 1, *shape[axis + 1 :])).reshape(len(shape), -1).T
            seams.append((low_cells, low_cells + (shape[axis] - 1) * np.eye(len(shape), dtype=np.int64)[axis]))
        low_cells, high_cells = (np.concatenate(each) for each in zip(*seams, strict=True))
        # Maps with periodic axes have one rotation cell, number 0.
        self._seam_cells = np.insert(np.stack([high_cells, low_cells]), 0, 0, axis=2)
        self._seam_classes: dict[bool, tuple[Ints, Ints]] = {}

    def refresh(self, boxes: Ints) -> None:
        """Mark the cells in boxes as changed.

        ``boxes``, shape (slices, 6), has a box for each slice.
        """
        super().refresh(boxes)
        self._seam_classes.clear()

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Return the component of each cell; see :meth:`Components.of`."""
        if mixed not in self._seam_classes:
            self._seam_classes[mixed] = _join_across_seams(super().of(self._seam_cells, mixed))
        components, (seam_components, merged) = super().of(cells, mixed), self._seam_classes[mixed]
        if not len(seam_components):
            return components
        position = np.minimum(np.searchsorted(seam_components, components), len(seam_components) - 1)
        return np.where(seam_components[position] == components, merged[position], components)

    def box(self, cell: Ints) -> Ints:
        """Return the bounding box of a FREE component.

        The first and the last cell have shape (2, d).
        """
        component = self.of(cell)
        seam_cells = self._seam_cells.reshape(-1, self._seam_cells.shape[-1])
        one_cell_each = seam_cells[np.unique(super().of(self._seam_cells), return_index=True)[1]]
        our_cells = one_cell_each[self.of(one_cell_each) == component]
        boxes = np.stack([super(PeriodicComponents, self).box(each) for each in (cell, *our_cells)])
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _join_across_seams(components: Ints) -> tuple[Ints, Ints]:
    """Merge components across seams; return components and their replacements.

    ``components``, shape (2, n), belong to the cells on either side of the seams; -1 for none. Return the components
    that touch a seam, ascending, and the lowest component joined to each.
    """
    seam_components, pairs = np.unique(components[:, (components >= 0).all(axis=0)], return_inverse=True)
    pairs = pairs.reshape(2, -1)
    graph = scipy.sparse.coo_array((np.ones(pairs.shape[1]), pairs), shape=(len(seam_components), len(seam_components)))
    classes = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    return seam_components, seam_components[np.unique(classes, return_index=True)[1]][classes]


class StateComponents:
    """Connected components of one kind of cells.

    There are two levels, so that a change reads few cells. Runs of cells are joined within each block. Union-find joins
    the components of adjacent blocks over the whole map. Contacts between blocks are cached; cell labels are
    computed again for each look-up.

    If ``among`` gives block indices within a slice, only cells of these blocks are joined; cells joined then are
    joined in the whole map too.
    """

    def __init__(
        self, states: Stack, adjacency: SliceAdjacency, mixed: bool, exterior_open: Bools, among: Ints | None = None
    ) -> None:
        slices, self._dim = len(states), states.ndim - 1
        flat, shifts = (1,) * (3 - self._dim), BLOCK_SHIFTS[self._dim]
        # Each axis has one layer for the exterior, except the first axis of a plane.
        shape = *flat, *(1 + (n >> shift) for n, shift in zip(states.shape[1:], shifts[len(flat) :], strict=True))
        grid = (slices, *flat, *states.shape[1:])
        self._blocks = Blocks(cells_of(states), grid, shifts, shape, mixed, exterior_open)
        self._adjacency = adjacency
        numbers = np.arange(math.prod(shape)).reshape(shape)
        # Offsets from a block's index to the next block along each axis, and to the same block in later slices.
        after = [(np.roll(numbers, -1, axis) - numbers).ravel() for axis in range(3 - self._dim, 3)]
        later = (adjacency.links - np.arange(slices)[:, None]) * numbers.size
        self._strides = np.stack(after, axis=1), np.where(adjacency.links >= 0, later, -slices * numbers.size)
        self._changed = np.ones((slices, *shape), dtype=np.bool_)
        self._among = np.full(self._changed.shape, among is None)
        if among is not None:
            self._among.reshape(slices, -1)[:, among] = True
        self._counts = np.zeros(self._changed.size, dtype=np.int32)
        self._faces: Faces | None = None
        self._deleted = 0
        self._labels: GlobalLabels | None = None
        self._boxes: dict[int, Ints] = {}
        self._cached = self._empty_labels()

    def refresh(self, boxes: Ints) -> None:
        """Mark the blocks in boxes as changed.

        ``boxes``, shape (slices, 6), has a box of cells for each slice.
        """
        slices = np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1))
        label_index, bounds = self._cached[0].reshape(self._changed.shape), boxes[slices].reshape(-1, 2, 3)
        for s, (first, last) in zip(slices.tolist(), (bounds >> self._blocks.shifts).tolist(), strict=True):
            block_box = tuple(slice(low, high + 1) for low, high in zip(first, last, strict=True))
            self._changed[s][block_box], label_index[s][block_box] = True, -1
            self._labels = None
            self._boxes.clear()

    def of(self, cells: Ints) -> Ints:
        """Return the component of each cell, or -1.

        ``cells`` has shape (..., 1 + d).
        """
        flat = np.ascontiguousarray(cells.reshape(-1, cells.shape[-1]))
        global_labels, components = self._global_labels(), np.empty(len(flat), dtype=np.int64)
        if look_up(self._blocks, global_labels, flat, components):
            self._look_up_labelled(global_labels, flat, components)
        return components.reshape(cells.shape[:-1])

    def box(self, cell: Ints) -> Ints:
        """Return the bounding box of a component.

        The first and the last cell have shape (2, d).
        """
        component = int(self.of(cell))
        if component not in self._boxes:
            self._boxes[component] = self._compute_box(component)
        return self._boxes[component]

    @property
    def count(self) -> int:
        """Number of blocks of a slice, including those beyond the grid."""
        return int(self._changed[0].size)

    def block_path(self, cells: Ints) -> Ints:
        """Return blocks on and beside a shortest block path.

        The path leads between two joined cells, shape (2, 1 + d), of a map with a single slice.
        """
        component, global_labels, faces = int(self.of(cells[0])), self._global_labels(), self._faces
        base, (rows, pairs) = global_labels.base, faces or _no_faces()
        ours = np.repeat(base[rows[:, 0]], rows[:, 3]) + (pairs >> COMPONENT_BITS)
        theirs = np.repeat(base[rows[:, 1]], rows[:, 3]) + (pairs & (MAX_COMPONENTS_PER_BLOCK - 1))
        start_nodes, goal_nodes = (np.arange(*base[[block, block + 1]]) for block in self._block_of(cells).tolist())
        start, goal = (nodes[global_labels.roots[nodes] == component][0] for nodes in (start_nodes, goal_nodes))
        graph = scipy.sparse.coo_array((np.ones(len(ours)), (ours, theirs)), shape=(base[-1], base[-1]))
        predecessors = scipy.sparse.csgraph.breadth_first_order(graph.tocsr(), start, directed=False)[1]
        path_nodes = [goal]
        while predecessors[path_nodes[-1]] >= 0:
            path_nodes.append(predecessors[path_nodes[-1]])
        blocks = np.searchsorted(base, path_nodes, side="right") - 1
        return np.unique(np.append(blocks, rows[np.isin(rows[:, :2], blocks).any(axis=1), :2]))

    def _block_of(self, cells: Ints) -> Ints:
        """Return the block of each cell within its slice.

        Cells outside the grid are in the last block.
        """
        flat, positions = 3 - self._dim, cells[:, 1:]
        shape = self._changed.shape[1 + flat :]
        inside = ((positions >= 0) & (positions < self._blocks.grid[1 + flat :])).all(axis=1, keepdims=True)
        blocks = np.where(inside, positions >> self._blocks.shifts[flat:], np.array(shape) - 1)
        return np.asarray(np.ravel_multi_index(tuple(blocks.T), shape))

    def _members(self, component: int) -> tuple[Bools, Ints]:
        """Return the block components of a component, and their blocks."""
        global_labels, blocks_per_slice = self._global_labels(), self._changed[0].size
        ours = np.zeros(global_labels.base[-1], dtype=np.bool_)
        for start, s in set(zip(global_labels.starts.tolist(), global_labels.slices.tolist(), strict=True)):
            nodes = slice(*global_labels.base[[s * blocks_per_slice, (s + 1) * blocks_per_slice]].tolist())
            ours[nodes] |= global_labels.roots[start + nodes.start : start + nodes.stop] == component
        return ours, np.flatnonzero(np.diff(np.append(0, np.cumsum(ours))[global_labels.base]))

    def _compute_box(self, component: int) -> Ints:
        """Compute the box around a component.

        Only blocks that may widen it are labelled. Random blocks come first, because they reach most of the box at
        once.
        """
        (deep, wide, _), base = self._blocks.shifts, self._global_labels().base
        ours, members = self._members(component)
        segments = np.random.default_rng(0).permutation(members)
        low, high, batch_size = np.array(self._blocks.grid[1:]), np.full(3, -1), FIRST_BOX_BLOCKS
        while len(segments):
            batch = np.sort(segments[:batch_size])
            labels = self._label(batch)
            nodes, in_component, n = base[batch], np.zeros_like(labels.words), 0
            row = np.flatnonzero(labels.words)
            left = labels.words[row]
            while len(row):
                at = labels.bounds[row] + n
                # If the row has no further label, all remaining runs have the last one.
                rest = np.where(at + 1 < labels.bounds[row + 1], left & (left + (left & (~left + _ONE))), 0)
                inside = ours[nodes[row >> (deep + wide)] + labels.numbers[at]]
                in_component[row[inside]] |= (left ^ rest)[inside]
                row, left, n = row[rest != 0], rest[rest != 0], n + 1
            row = np.flatnonzero(in_component)
            cells, (x, y, z) = in_component[row], self._first_cells(batch)[:, row >> (deep + wide)]
            x, y = x + (row >> wide & ((1 << deep) - 1)), y + (row & ((1 << wide) - 1))
            low = np.minimum(low, [x.min(), y.min(), (z + np.bitwise_count(~cells & (cells - _ONE))).min()])
            for k in range(6):
                cells |= cells >> (_ONE << np.uint64(k))
            high = np.maximum(high, [x.max(), y.max(), (z + np.bitwise_count(cells)).max() - 1])
            segments, batch_size = segments[batch_size:], min(4 * batch_size, BLOCKS_PER_TASK)
            first = self._first_cells(segments).T
            last = np.minimum(first + (1 << np.array(self._blocks.shifts)), self._blocks.grid[1:]) - 1
            segments = segments[((first < low) | (last > high)).any(axis=1)]
        return np.stack([low, high])[:, 3 - self._dim :]

    def _look_up_labelled(self, global_labels: GlobalLabels, cells: Ints, components: Ints) -> None:
        """Label the blocks of undecided cells, and look again."""
        wanted = np.unique((UNLABELLED - components[components <= UNLABELLED]) >> 12)
        for first in range(0, len(wanted), BLOCKS_PER_TASK):
            self._cache_labels(wanted[first : first + BLOCKS_PER_TASK])
            look_up_labelled(global_labels, cells, *self._cached, components)

    def _cache_labels(self, segments: Ints) -> None:
        """Label blocks; clear a full cache first."""
        label_index, labels = self._cached
        missing = segments[label_index[segments] < 0]
        if not len(missing):
            return
        known = len(labels.counts)
        if known + len(missing) > BLOCKS_PER_TASK:
            known, missing, (label_index, labels) = 0, segments, self._empty_labels()
        new_labels = self._label(missing)
        labels = Labels(
            _append_rows(labels.words, len(labels.words), [new_labels.words]),
            _append_rows(labels.bounds, len(labels.bounds), [new_labels.bounds[1:] + labels.bounds[-1]]),
            _append_rows(labels.numbers, len(labels.numbers), [new_labels.numbers[: new_labels.bounds[-1]].copy()]),
            _append_rows(labels.counts, len(labels.counts), [new_labels.counts]),
        )
        self._cached = label_index, labels
        # Last, so that an interrupt leaves no index without labels.
        label_index[missing] = np.arange(known, known + len(missing))

    def _empty_labels(self) -> tuple[Nodes, Labels]:
        """Return an empty label cache."""
        none, bounds = np.empty(0, dtype=np.int32), np.zeros(1, dtype=np.int32)
        labels = Labels(np.empty(0, dtype=np.uint64), bounds, none, none)
        return np.full(self._changed.size, -1, dtype=np.int32), labels

    def _global_labels(self) -> GlobalLabels:
        """Return the components of the map.

        Only changed blocks are read again.
        """
        if self._labels is None:
            stale = self._changed.copy()
            for axis in range(4 - self._dim, 4):  # a shared face belongs to the first of two blocks
                before, changed = stale.swapaxes(0, axis), self._changed.swapaxes(0, axis)
                before[:-1] |= changed[1:]
                before[-1] |= changed[0]
            for later in self._adjacency.links.T:
                stale[later >= 0] |= self._changed[later[later >= 0]]
            stale &= self._among
            faces, self._faces = self._faces, None  # an interrupt leaves none rather than wrong faces
            if faces is None:
                self._changed[...], stale[...], self._deleted = True, self._among, 0
                faces = _no_faces()
            sizes = len(faces.rows), len(faces.pairs)
            if self._deleted * FACES_PER_DELETED > sizes[0]:
                sizes = compact_faces(faces)
            tasks, scratch = self._split_blocks(np.flatnonzero(stale)), list[Labels]()
            new_faces = in_threads(lambda blocks: self._find_faces(blocks, scratch), tasks, cores())
            faces = Faces(*map(_append_rows, faces, sizes, zip(*new_faces, strict=True)))
            global_labels = self._join_blocks(faces, sizes[0])
            self._changed[...] = False
            self._faces, self._labels = faces, global_labels
        return self._labels

    def _split_blocks(self, blocks: Ints) -> list[Ints]:
        """Split blocks into compact parts, one for each task.

        Few blocks are split in order instead, into one part for each thread.
        """
        if len(blocks) <= min(BLOCKS_PER_TASK, self._changed.size // 2):
            n_parts = max(1, min(cores(), len(blocks) // MIN_BLOCKS_PER_THREAD))
            return [blocks[len(blocks) * k // n_parts : len(blocks) * (k + 1) // n_parts] for k in range(n_parts)]
        slices, columns, blocks_per_slice = len(self._changed), self._changed.shape[3], self._changed[0].size
        slices_per_tile = max(MIN_SLICES_PER_TILE, BLOCKS_PER_TASK // blocks_per_slice)
        blocks_per_tile = max(1, BLOCKS_PER_TASK // min(slices_per_tile, slices) // columns) * columns
        s, block = np.divmod(blocks, blocks_per_slice)
        tiles = s // slices_per_tile * blocks_per_slice + block // blocks_per_tile
        order = np.argsort(tiles, kind="stable")
        return np.split(blocks[order], np.flatnonzero(np.diff(tiles[order])) + 1)

    def _find_faces(self, blocks: Ints, scratch: list[Labels]) -> Faces:
        """Find changed faces between blocks and later neighbors.

        Label buffers are popped from ``scratch`` and pushed back, because allocating memory takes as long as labelling.
        """
        others, changed, among = self._next_blocks(blocks), self._changed.reshape(-1), self._among.reshape(-1)
        n, face = ((others >= 0) & among[others] & (changed[blocks][:, None] | changed[others])).nonzero()
        blocks, other = blocks[n], others[n, face]
        # A mask over all blocks in between is faster than sorting and searching.
        begin = min(blocks.min(initial=changed.size), other.min(initial=changed.size))
        wanted = np.zeros(max(blocks.max(initial=begin), other.max(initial=begin)) + 1 - begin, dtype=np.bool_)
        wanted[blocks - begin] = wanted[other - begin] = True
        segments = np.flatnonzero(wanted)
        position_of = np.empty(len(wanted), dtype=np.int64)
        position_of[segments] = np.arange(len(segments))
        buffer = scratch.pop() if scratch else None
        labels = self._label(segments + begin, buffer)
        self._counts[segments + begin] = labels.counts
        groups = blocks // self._changed[0].size * (1 + self._adjacency.links.shape[1])
        groups += np.maximum(face + 1 - self._dim, 0)
        positions = position_of[blocks - begin], position_of[other - begin]
        beside = np.stack([blocks, other, groups, face + 3 - self._dim, *positions], axis=1)
        faces = Faces(np.empty((len(blocks), 4), np.int32), np.empty(labels.counts[beside[:, 4:]].sum(), np.int32))
        sizes = find_faces(labels, self._blocks.shifts, beside, np.empty(3 * MAX_COMPONENTS_PER_BLOCK, np.int32), faces)
        scratch.append(labels if buffer is None or len(labels.counts) > len(buffer.counts) else buffer)
        return Faces(*(array[:count].copy() for array, count in zip(faces, sizes, strict=True)))

    def _next_blocks(self, blocks: Ints) -> Ints:
        """Return the next blocks along each axis and slice.

        The result has shape (n, k), padded with -1.
        """
        (after, later), blocks_per_slice = self._strides, self._changed[0].size
        steps = np.concatenate([after[blocks % blocks_per_slice], later[blocks // blocks_per_slice]], axis=1)
        return np.asarray(np.maximum(blocks[:, None] + steps, -1))

    def _first_cells(self, segments: Ints) -> Ints:
        """Return the first cell of blocks, shape (3, n)."""
        positions = np.unravel_index(segments, self._changed.shape)[1:]
        return np.stack([position << shift for position, shift in zip(positions, self._blocks.shifts, strict=True)])

    def _label(self, segments: Ints, scratch: Labels | None = None) -> Labels:
        """Label cells of blocks, in ``scratch`` if they fit."""
        deep, wide, long = self._blocks.shifts
        count, rows = len(segments), len(segments) << (deep + wide)
        runs = rows * ((1 + (1 << long)) // 2)
        if scratch is None or len(scratch.counts) < count:
            bounds, numbers, counts = (np.empty(size, dtype=np.int32) for size in (rows + 1, runs, count))
            scratch = Labels(np.empty(rows, dtype=np.uint64), bounds, numbers, counts)
        words, bounds = scratch.words[:rows], scratch.bounds[: rows + 1]
        labels = Labels(words, bounds, scratch.numbers[:runs], scratch.counts[:count])
        labels.bounds[0] = 0
        first = np.ones(count, dtype=np.bool_)
        first[1:] = (segments[1:] != segments[:-1] + 1) | (segments[1:] % self._changed.shape[3] == 0)
        starts = np.append(np.flatnonzero(first), count)
        label_blocks(self._blocks, segments, starts, labels, np.empty(MAX_COMPONENTS_PER_BLOCK, dtype=np.int32))
        return labels

    def _join_blocks(self, faces: Faces, fresh: int) -> GlobalLabels:
        """Join block components over the whole map.

        Faces from index ``fresh`` on are up to date.
        """
        adjacency, blocks_per_slice = self._adjacency, self._changed[0].size
        base = np.zeros(self._counts.size + 1, dtype=np.int32)
        np.cumsum(self._counts, out=base[1:])
        first_node = base[::blocks_per_slice].astype(np.int64)
        sizes = (first_node[1:] - first_node[:-1])[adjacency.slice_of]
        bounds = np.cumsum(sizes)
        starts = bounds - sizes - first_node[adjacency.slice_of]
        roots = np.arange(bounds[-1], dtype=np.int32)
        uses, changed = starts[adjacency.uses], self._changed.reshape(-1)
        self._deleted = join_nodes(roots, base, faces, fresh, changed, uses, adjacency.bounds)
        return GlobalLabels(base, starts[adjacency.copy_of], adjacency.slice_of[adjacency.copy_of], roots)


def _no_faces() -> Faces:
    """Return an empty face array."""
    return Faces(np.empty((0, 4), dtype=np.int32), np.empty(0, dtype=np.int32))


def _append_rows(array: Numbers, count: int, parts: Sequence[Numbers]) -> Numbers:
    """Append parts to the first ``count`` rows.

    Work in place if the array's buffer has room.
    """
    size = count + sum(map(len, parts))
    if size == len(parts[0]):
        return parts[0]
    buffer = array if array.base is None else array.base
    if size > len(buffer):
        buffer = np.empty((size + size // 8, *array.shape[1:]), dtype=array.dtype)
        buffer[:count] = array[:count]
    for part in parts:
        buffer[count : count + len(part)] = part
        count += len(part)
    return buffer[:size]
