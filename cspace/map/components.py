"""Components: which cells chains of FREE cells join, and which not even chains of undecided cells do."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce
from typing import Final, NamedTuple, TypeVar

import numpy as np
import scipy  # its parts are read when they are first used
from numpy.typing import NDArray

from cspace.arrays import Bools, Ints, Words
from cspace.compiling import always_inline, kernel
from cspace.map.storage import Cells, Stack, cells_of, high_bits, popcount, prefetch_cell, read_only, row_in, state_in
from cspace.raster.surfaces import merge_sets
from cspace.threads import cores, in_threads

Nodes = NDArray[np.int32]
Numbers = TypeVar("Numbers", Nodes, Words)

SHIFTS: Final = {2: (0, 6, 6), 3: (3, 3, 6)}
"""Cells of a block along each axis, as powers of two, by dimension: 64 rows of 64 cells. A plane has one layer."""

BITS: Final = 11
MOST: Final = 1 << BITS
"""Runs in a block, at most, and so components: 64 rows of 32."""

UNLABELLED: Final = -2
"""Stands for cells whose component takes the labels of their block; less the number of the block, and of the cell's row
in it and place in the row, 6 bits each."""

TASK: Final = 4096
"""Blocks that a thread takes at a time."""

LEAST: Final = 256
"""Blocks for which a thread of their own pays."""

TALL: Final = 12
"""Slices among them, where there are so many."""

STRUCK: Final = -1
"""Marks a face that is no more."""

FEW_STRUCK: Final = 4
"""Part of the faces, its reciprocal, that may be struck out and still be there."""

AHEAD: Final = 12
"""Rows of a block that are fetched ahead of the one that is read."""

FEW: Final = 16
"""Blocks that are looked at first for the box around a component."""

HINTS: Final = 8
"""Slices that hint at whether a path joins two cells, where there are at least twice as many."""

SHORT: Final = 3
"""Part of the blocks of a slice, its reciprocal, that are few enough to be labelled before all are."""

_ONE, _LAST = np.uint64(1), np.uint64(63)


class Blocks(NamedTuple):
    """The cells of a map that are of one kind, cut into blocks, numbered slice by slice.

    cells : ndarray of uint8, or TwoBits
        The states, all slices in a row.
    grid : tuple of int, length 4
        Slices, and cells of the grid.
    shifts, shape : tuple of int, length 3
        Cells of a block, as powers of two, and number of blocks, along each axis. At least one layer of cells lies
        beyond the last ones of the grid; it stands for all that is outside, so that the first cells are beside it too.
    mixed : bool
        Whether the cells that are not BLOCKED are meant, and else those that are FREE.
    rim_is_open : ndarray of bool, shape (slices,)
        Whether any configuration outside the grid is of that kind.
    """

    cells: Cells
    grid: tuple[int, int, int, int]
    shifts: tuple[int, int, int]
    shape: tuple[int, int, int]
    mixed: bool
    exterior_open: Bools


class Labels(NamedTuple):
    """The components of some blocks, each by itself.

    words : ndarray of uint64, shape (blocks * rows,)
        The cells of each row, by bits.
    bounds : ndarray of int32, shape (blocks * rows + 1,)
        Where the numbers of each row begin, and where those of the last one end.
    numbers : ndarray of int32
        The component of each run of a row, from the lowest cell on; or of all of them, where they are one.
    counts : ndarray of int32, shape (blocks,)
        Number of components.
    """

    words: Words
    bounds: Nodes
    numbers: Nodes
    counts: Nodes


class SliceAdjacency(NamedTuple):
    """How slices are joined, from one rotation cell to the next.

    copy_of : ndarray of int64, shape (rotations,)
        Neighbours that share a slice are one copy of it, in which all is joined to itself.
    slice_of : ndarray of int64, shape (copies,)
    links : ndarray of int64, shape (slices, n)
        Later slices that copies of each slice have for neighbours; -1 fills up.
    uses : ndarray of int64, shape (m, 2)
        The copies, group by group, that are joined where components of their slices meet.
    bounds : ndarray of int64, shape (slices * (1 + n) + 1,)
        Where the groups of each slice end, of which the first one is for faces within it and the others for its links.
    """

    copy_of: Ints
    slice_of: Ints
    links: Ints
    uses: Ints
    bounds: Ints

    @classmethod
    def of(cls, slice_of: Ints, neighbors: Ints, slices: int) -> SliceAdjacency:
        """From the slice of each rotation cell, and its neighbours."""
        first, place = np.nonzero(neighbors >= 0)
        near = np.stack([first, neighbors[first, place]])
        near = np.hstack([near, near[::-1]])
        one, other = slice_of[near]
        low = np.arange(len(slice_of))
        while True:
            lower = low.copy()
            np.minimum.at(lower, near[0, one == other], low[near[1, one == other]])
            if (lower == low).all():
                break
            low = lower[lower]
        lowest, copy_of = np.unique(low, return_inverse=True)
        copies, own = slice_of[lowest], np.arange(len(lowest))
        a, b = divmod(np.unique(copy_of[near[0, one < other]] * len(own) + copy_of[near[1, one < other]]), len(own))
        pairs, link = np.unique(copies[a] * slices + copies[b], return_inverse=True)
        s, later = divmod(pairs, slices)
        place = np.arange(len(s)) - np.searchsorted(s, s)
        links = np.full((slices, place.max(initial=-1) + 1), -1)
        links[s, place] = later
        groups = np.concatenate([copies, copies[a]]) * (1 + links.shape[1])
        groups[len(own) :] += 1 + place[link]
        uses = np.stack([np.append(own, a), np.append(own, b)], axis=1)[np.argsort(groups, kind="stable")]
        bounds = np.cumsum(np.bincount(groups + 1, minlength=slices * (1 + links.shape[1]) + 1))
        return cls(copy_of, copies, links, uses, bounds)


class GlobalLabels(NamedTuple):
    """The components over the whole map.

    Component c of a layer is the node ``start + base[layer] + c``.

    base : ndarray of int32, shape (layers + 1,)
    starts, slices : ndarray of int64, shape (rotations,)
        The start of each rotation cell, and its slice.
    roots : ndarray of int32
        The component of each node.
    """

    base: Nodes
    starts: Ints
    slices: Ints
    roots: Nodes


# ---- compiled passes -------------------------------------------------------------------------------------------------


@kernel
def pack(blocks: Blocks, segment: int, words: Words) -> None:
    """Pack the cells of blocks that follow each other along the last axis, a word for each row.

    Row by row through all of them, as they lie in memory, which is several times quicker than block by block; and what
    is to come is fetched meanwhile, or each row would be waited for.
    """
    (_, nx, ny, nz), (deep, wide, long), (layers, rows, columns) = blocks.grid, blocks.shifts, blocks.shape
    first_x, first_y = segment // (columns * rows) % layers << deep, segment // columns % rows << wide
    s, z = segment // (columns * rows * layers), segment % columns << long
    rim = ~high_bits(1 << long) if blocks.exterior_open[s] else np.uint64(0)
    height = 1 << (deep + wide)
    count = len(words) // height
    for row in range(-AHEAD, height):
        x, y = first_x + ((row + AHEAD) >> wide), first_y + ((row + AHEAD) & ((1 << wide) - 1))
        for n in range(count + 1):
            prefetch_cell(blocks.cells, ((s * nx + x) * ny + y) * nz + z + (n << long))
        if row < 0:
            continue
        x, y = first_x + (row >> wide), first_y + (row & ((1 << wide) - 1))
        stop = nz if (x < nx) & (y < ny) else 0
        for n in range(count):
            first = z + (n << long)
            inside = max(0, min(1 << long, stop - first))
            taken, blocked = row_in(blocks.cells, ((s * nx + x) * ny + y) * nz + first, inside)
            words[n * height + row] = ~(blocked if blocks.mixed else taken) | (rim & high_bits(inside))


@always_inline
def runs_in(word: np.uint64) -> int:
    """Number of runs of a word."""
    number: int = popcount(word & ~(word << _ONE))
    return number


@always_inline
def number_at(labels: Labels, row: int, bit: np.uint64) -> int:
    """The component of a cell of a row, given as its bit."""
    run = runs_in(labels.words[row] & (bit | (bit - _ONE))) - 1
    number: int = np.int64(labels.numbers[min(labels.bounds[row] + run, labels.bounds[row + 1] - 1)])  # type: ignore[assignment]
    return number


@always_inline
def disjoint_run_ends(word: np.uint64, other: np.uint64) -> np.uint64:
    """The last cells of those runs of a word that have no cell in another one."""
    # A carry from the first cell of each run ends where the other has a cell, or behind the run, or leaves the word.
    apart = word & ~other
    carried = apart + (word & ~(word << _ONE))
    return ((carried & ~word) >> _ONE) | (np.uint64(carried < apart) << _LAST)


@kernel
def continue_row(labels: Labels, at: int, before: tuple[int, int], parent: Nodes, components: int) -> int:
    """Number the runs of a row by those of two rows before it that they touch; the number of components.

    Where there is no such row, it is the row itself. Runs that touch none begin components, for union-find, which joins
    them where a run touches several.
    """
    words, bounds, numbers, _ = labels
    first = stop = np.int64(bounds[at])
    left, one = words[at], True
    while left != 0:
        rest = left & (left + (left & (~left + _ONE)))
        number: int = np.int64(-1)  # type: ignore[assignment]
        for k in range(2):
            touch = (left ^ rest) & words[before[k]] if before[k] != at else np.uint64(0)
            while touch != 0:
                bit = touch & (~touch + _ONE)
                touch &= touch + bit
                other = number_at(labels, before[k], bit)
                if number < 0:
                    number = other
                elif parent[number] != parent[other]:
                    merge_sets(parent, number, other)
        if number < 0:
            number, parent[components], components = components, components, components + 1
        one = one and parent[number] == parent[numbers[first] if stop > first else number]
        numbers[stop], stop, left = number, stop + 1, rest
    bounds[at + 1] = min(first + 1, stop) if one else stop
    return components


@kernel
def label_blocks(blocks: Blocks, segments: Ints, starts: Ints, labels: Labels, parent: Nodes) -> None:
    """Label the cells of blocks, given by their numbers; ``parent``, shape (MOST,), is room for their components.

    ``starts`` has the place of each that does not follow the one before it along the last axis, and how many there are.
    """
    words, bounds, numbers, counts = labels
    rows, wide = len(words) // len(segments), 1 << blocks.shifts[1]
    zero: int = np.int64(0)  # type: ignore[assignment]  # of one type for the compiler from the start
    for n in range(len(starts) - 1):
        first_block, stop_block = starts[n], starts[n + 1]
        pack(blocks, segments[first_block], words[first_block * rows : stop_block * rows])
        for block in range(first_block, stop_block):
            components = zero
            for row in range(rows):
                at = block * rows + row
                beside, below = at - 1 if row & (wide - 1) > 0 else at, at - wide if row >= wide else at
                before, begin = min(beside, below), np.int64(bounds[at])
                word, other, first = words[at], words[before], np.int64(bounds[before])
                bounds[at + 1] = begin
                count = bounds[before + 1] - first
                alike = (
                    (beside == at or below == at) and word != 0 and count > 0 and disjoint_run_ends(word, other) == 0
                )
                if alike and count > 1:  # so they are where runs touch one each, and all of them are touched
                    alike = (
                        runs_in(word) == count
                        and runs_in(word & other) == count
                        and disjoint_run_ends(other, word) == 0
                    )
                if alike:
                    for m in range(count):
                        numbers[begin + m] = numbers[first + m]
                    bounds[at + 1] = begin + count
                else:
                    components = continue_row(labels, at, (beside, below), parent, components)
            total = zero
            for number in range(components):
                # The lower root is on top, so that it has its number by now.
                if parent[number] == number:
                    parent[number] = total
                    total += 1
                else:
                    parent[number] = parent[parent[number]]
            if components > 1:
                for m in range(bounds[block * rows], bounds[(block + 1) * rows]):
                    numbers[m] = parent[numbers[m]]
            counts[block] = total


class Faces(NamedTuple):
    """What meets where two blocks share a side, or a place in neighbouring rotation cells, face after face.

    Attributes
    ----------
    rows : ndarray of int32, shape (n, 4)
        Block, other block, which of :attr:`SliceAdjacency.bounds` is meant, or STRUCK, and number of pairs.
    pairs : ndarray of int32
        Those of the faces, one after the other, ``component * MOST + other component``.
    """

    rows: Nodes
    pairs: Nodes


@kernel
def meet_blocks(
    labels: Labels, shifts: tuple[int, int, int], beside: Ints, parent: Nodes, faces: Faces
) -> tuple[int, int]:
    """Fill in the faces of blocks that lie beside each other; how many of them, and pairs, there are.

    A row of ``beside`` has a block, another one and its group, as a face has them, the axis along which the other
    follows, 3 and more where it has the same place, and another rotation, and the place of each among the labels.
    Pairs that follow from others are left out. ``parent``, shape (3 * MOST,), is room for union-find.
    """
    words, counts = labels.words, labels.counts
    n_faces: int = np.int64(0)  # type: ignore[assignment]  # of one type for the compiler from the start
    n_pairs = n_faces
    wide, rows, long = 1 << shifts[1], 1 << (shifts[0] + shifts[1]), 1 << shifts[2]
    for n in range(len(beside)):
        pair, face = beside[n], faces.rows[n_faces]
        axis, ours, theirs, begin = pair[3], pair[4], pair[5], n_pairs
        if counts[ours] == 0 or counts[theirs] == 0:
            continue
        most = counts[ours] + counts[theirs] - 1  # at least as many as either
        for node in range(most):
            parent[node], parent[MOST + node] = node, MOST + node
        # The rows where the two touch: the last ones and the first, or, beside each other or in two slices, all.
        skipped = rows - wide if axis == 0 else (wide - 1 if axis == 1 else 0)
        ahead = np.uint64(long - 1 if axis == 2 else 0)  # the first cell of a row is beside the last one
        for row in range(skipped, rows, wide if axis == 1 else 1):
            own, other = ours * rows + row, theirs * rows + row - skipped
            touch, before = (words[own] >> ahead) & words[other], np.uint64(0)
            if touch == 0:
                continue
            if axis != 1 and row & (wide - 1) > 0:
                before |= (words[own - 1] >> ahead) & words[other - 1]
            if axis != 0 and row >= wide:
                before |= (words[own - wide] >> ahead) & words[other - wide]
            # What touches behind cells that touch is joined by these; of each other run, the last cell stands for it.
            left = disjoint_run_ends(touch, before)
            while left != 0:
                bit = left & (~left + _ONE)
                left ^= bit
                one, two = number_at(labels, own, bit << ahead), number_at(labels, other, bit)
                if merge_sets(parent, one, MOST + two):
                    faces.pairs[n_pairs] = one * MOST + two
                    n_pairs += 1
            if n_pairs == begin + most:
                break  # all are joined
        if n_pairs > begin:
            face[0], face[1], face[2], face[3] = pair[0], pair[1], pair[2], n_pairs - begin
            n_faces += 1
    return n_faces, n_pairs


@kernel
def drop_struck(faces: Faces) -> tuple[int, int]:
    """Move the faces that were not struck out to the front; how many rows and pairs there are of them."""
    rows, pairs = faces
    n_faces: int = np.int64(0)  # type: ignore[assignment]  # of one type for the compiler from the start
    begin = n_pairs = n_faces
    for n in range(len(rows)):
        count = rows[n, 3]
        if rows[n, 2] != STRUCK:
            for k in range(4):
                rows[n_faces, k] = rows[n, k]
            for k in range(count):
                pairs[n_pairs + k] = pairs[begin + k]
            n_faces, n_pairs = n_faces + 1, n_pairs + count
        begin += count
    return n_faces, n_pairs


@kernel
def join_nodes(roots: Nodes, base: Nodes, faces: Faces, fresh: int, changed: Bools, starts: Ints, bounds: Ints) -> int:
    """Join the nodes of components that meet: each becomes the lowest one of those that it is joined to.

    ``roots`` are all nodes, in order, for union-find; ``base`` is as in :class:`GlobalLabels`. Faces of blocks that
    have ``changed`` are struck out, but for those from number ``fresh`` on, read since; how many are struck out
    by then. ``starts`` and ``bounds``, shapes (m, 2) and (k + 1,), are where nodes start, of one rotation cell and of
    the other, for all of them that have these slices.
    """
    rows, pairs = faces
    begin: int = np.int64(0)  # type: ignore[assignment]  # of one type for the compiler from the start
    struck = begin
    for n in range(len(rows)):
        face = rows[n]
        if n < fresh and (changed[face[0]] or changed[face[1]]):
            face[2] = STRUCK
        group, last = face[2], begin + face[3]
        if group == STRUCK:
            struck += 1
        else:
            ours, theirs = base[face[0]], base[face[1]]
            for use in range(bounds[group], bounds[group + 1]):
                own, other = starts[use, 0] + ours, starts[use, 1] + theirs
                for k in range(begin, last):
                    one, two = own + (pairs[k] >> BITS), other + (pairs[k] & (MOST - 1))
                    if roots[one] != roots[two]:  # most are joined by now
                        merge_sets(roots, one, two)
        begin = last
    for node in range(len(roots)):
        roots[node] = roots[roots[node]]  # which is no higher, and is a root by now
    return struck


@kernel
def look_up(blocks: Blocks, joined: GlobalLabels, cells: Ints, components: Ints) -> int:
    """Components of cells ``(rotation, x, y)`` or ``(rotation, x, y, z)``, by their states; how many are left.

    States decide where all components of a block are one over the whole map; cells of other blocks get UNLABELLED less
    their place, and those without a component -1.
    """
    (_, nx, ny, nz), (deep, wide, long), (layers, rows, columns) = blocks.grid, blocks.shifts, blocks.shape
    asked: int = np.int64(0)  # type: ignore[assignment]  # of one type for the compiler from the start
    solid = cells.shape[1] == 4
    for n in range(len(cells)):
        cell = cells[n]
        rotation, x, y, z = cell[0], cell[1], cell[-2], cell[-1]
        if not solid:
            x = 0
        start, s = joined.starts[rotation], joined.slices[rotation]
        if (x >= 0) & (x < nx) & (y >= 0) & (y < ny) & (z >= 0) & (z < nz):
            # FREE, MIXED and BLOCKED count up.
            ours = state_in(blocks.cells, ((s * nx + x) * ny + y) * nz + z) <= np.int64(blocks.mixed)
        else:
            ours, x, y, z = blocks.exterior_open[s], nx if solid else 0, ny, nz
        components[n] = -1
        if not ours:
            continue
        segment = ((s * layers + (x >> deep)) * rows + (y >> wide)) * columns + (z >> long)
        first, stop = start + joined.base[segment], start + joined.base[segment + 1]
        components[n] = joined.roots[first]
        for node in range(first + 1, stop):
            if joined.roots[node] != components[n]:
                row = ((x & ((1 << deep) - 1)) << wide) | (y & ((1 << wide) - 1))
                components[n] = UNLABELLED - ((segment << 12) | (row << 6) | (z & ((1 << long) - 1)))
                asked += 1
                break
    return asked


@kernel
def look_into(joined: GlobalLabels, cells: Ints, places: Nodes, labels: Labels, components: Ints) -> None:
    """Components of the cells that :func:`look_up` left, in blocks that have labels.

    ``places`` has the place of each block among the labels, or -1.
    """
    rows = len(labels.words) // len(labels.counts)
    for n in range(len(cells)):
        left = UNLABELLED - components[n]
        segment, row, z = left >> 12, (left >> 6) & 63, left & 63
        if left >= 0 and places[segment] >= 0:
            number = number_at(labels, places[segment] * rows + row, _ONE << np.uint64(z))
            components[n] = joined.roots[joined.starts[cells[n, 0]] + joined.base[segment] + number]


# ---- the part of a map -----------------------------------------------------------------------------------------------


class Components:
    """The components of a map: of its FREE cells, and of those that are not BLOCKED. Either are made at need.

    What lies outside the grid is a layer of cells beyond its last ones and before its first ones, which are the same;
    none of it is FREE.

    Cells that share a side are joined. For FREE cells that is a path. For the others it loses none: a path goes from
    one closed cell to the next through a side, or through an edge or corner, all of whose cells are then not BLOCKED
    and are joined by their sides.

    The states are shared, not copied; :meth:`refresh` notes changes. ``neighbors``, shape (rotations, n), are the
    rotation cells that each one shares a border with; -1 fills up. ``exterior_open``, shape (slices,), is whether any
    configuration outside the grid is not BLOCKED.
    """

    def __init__(self, states: Stack, slice_of: Ints, neighbors: Ints, exterior_open: Bools) -> None:
        self._states, self._turns = states, SliceAdjacency.of(slice_of, neighbors, len(states))
        self._rims = np.zeros(len(states), dtype=np.bool_), np.asarray(exterior_open, dtype=np.bool_)
        self._kinds: dict[bool, StateComponents] = {}

    def refresh(self, boxes: Ints) -> None:
        """Note which cells have changed: those of a box for each slice, shape (slices, 6)."""
        for kind in self._kinds.values():
            kind.refresh(boxes)

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        """Numbers of the components of FREE cells, or also MIXED ones, that cells belong to; or -1.

        Within one of the FREE cells, a collision-free path exists; between two of the others, none does. Cells are
        ``(rotation, x, y)`` or ``(rotation, x, y, z)``, shape (..., 1 + d). One outside the grid counts as MIXED where
        any of them is not BLOCKED. The numbers hold until the next change.
        """
        return self._kind(mixed).of(cells)

    def hint(self, cells: Ints) -> tuple[bool, Callable[[], bool]]:
        """Whether to ask first what MIXED cells join, for two cells, shape (2, 1 + d): most likely no path does.

        A few slices, laid upon each other, tell it. Where components of one kind alone are made, they are asked first.
        Besides, what tells whether MIXED cells join the two, as far as a few blocks show it: those along a way through
        what the slices leave open.
        """
        slices = len(self._states)
        if self._kinds or slices < 2 * HINTS:
            return list(self._kinds) == [True], lambda: False
        states = read_only(reduce(np.minimum, (self._states[k] for k in range(0, slices, slices // HINTS))))
        alone = SliceAdjacency.of(np.zeros(1, dtype=np.int64), np.empty((1, 0), dtype=np.int64), 1)
        places = cells.copy()
        places[:, 0] = 0
        open_ones = StateComponents(states[None], alone, True, np.array([self._rims[True].any()]))
        one, other = open_ones.of(places).tolist()

        def few_join() -> bool:
            if not -1 != one == other:
                return False
            blocks = open_ones.way(places)
            self._kind(mixed=True)  # so that these are asked from now on
            if SHORT * len(blocks) > open_ones.count:
                return False
            few = StateComponents(self._states, self._turns, True, self._rims[True], blocks)
            first, second = few.of(cells).tolist()
            return bool(-1 != first == second)

        return bool(-1 != one != other != -1), few_join

    def box(self, cell: Ints) -> Ints:
        """First and last cell, shape (2, d), of the box around the component of a FREE cell, shape (1 + d,)."""
        return self._kind(mixed=False).box(cell)

    def _kind(self, mixed: bool) -> StateComponents:
        if mixed not in self._kinds:
            self._kinds[mixed] = StateComponents(self._states, self._turns, mixed, self._rims[mixed])
        return self._kinds[mixed]


class PeriodicComponents(Components):
    """Components of the cells of one turn, joined across the seams of periodic axes."""

    def __init__(
        self, states: Stack, slice_of: Ints, neighbors: Ints, exterior_open: Bools, periodic: Sequence[bool]
    ) -> None:
        super().__init__(states, slice_of, neighbors, exterior_open)
        sides, shape = [], states.shape[1:]
        for axis in np.flatnonzero(periodic).tolist():
            first = np.indices((*shape[:axis], 1, *shape[axis + 1 :])).reshape(len(shape), -1).T
            sides.append((first, first + (shape[axis] - 1) * np.eye(len(shape), dtype=np.int64)[axis]))
        first, last = (np.concatenate(each) for each in zip(*sides, strict=True))
        # The one rotation cell has number 0.
        self._pairs = np.insert(np.stack([last, first]), 0, 0, axis=2)
        self._met: dict[bool, tuple[Ints, Ints]] = {}

    def refresh(self, boxes: Ints) -> None:
        super().refresh(boxes)
        self._met.clear()

    def of(self, cells: Ints, mixed: bool = False) -> Ints:
        if mixed not in self._met:
            self._met[mixed] = _join_across_seams(super().of(self._pairs, mixed))
        numbers, (names, lowest) = super().of(cells, mixed), self._met[mixed]
        if not len(names):
            return numbers
        place = np.minimum(np.searchsorted(names, numbers), len(names) - 1)
        return np.where(names[place] == numbers, lowest[place], numbers)

    def box(self, cell: Ints) -> Ints:
        number = self.of(cell)
        flat = self._pairs.reshape(-1, self._pairs.shape[-1])
        one_each = flat[np.unique(super().of(self._pairs), return_index=True)[1]]
        ours = one_each[self.of(one_each) == number]
        boxes = np.stack([super(PeriodicComponents, self).box(each) for each in (cell, *ours)])
        return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])


def _join_across_seams(numbers: Ints) -> tuple[Ints, Ints]:
    """Return the components that meet across seams, ascending, and the lowest component of the class of each.

    ``numbers``, shape (2, n), are those of the cells on either side of the seams, -1 for none.
    """
    names, pairs = np.unique(numbers[:, (numbers >= 0).all(axis=0)], return_inverse=True)
    pairs = pairs.reshape(2, -1)
    graph = scipy.sparse.coo_array((np.ones(pairs.shape[1]), pairs), shape=(len(names), len(names)))
    classes = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    return names, names[np.unique(classes, return_index=True)[1]][classes]


class StateComponents:
    """The components of cells of one kind, in two levels, so that a change reads few cells, and no cell has a label.

    The cells of each block are joined by themselves, along the runs of its rows, and so are the components of blocks
    that share a side, or the same place in neighbouring rotation cells. Union-find joins them over the whole map. Only
    what joins blocks is kept; labels of cells are made again, block by block, for each look-up.

    Of some blocks alone, ``among``, numbers within a slice, all that is joined is so in the whole map too.
    """

    def __init__(
        self, states: Stack, turns: SliceAdjacency, mixed: bool, exterior_open: Bools, among: Ints | None = None
    ) -> None:
        slices, self._dim = len(states), states.ndim - 1
        flat, shifts = (1,) * (3 - self._dim), SHIFTS[self._dim]
        # Each axis has room for the layer beyond; the first one of a plane has none.
        shape = *flat, *(1 + (n >> shift) for n, shift in zip(states.shape[1:], shifts[len(flat) :], strict=True))
        grid = (slices, *flat, *states.shape[1:])
        self._blocks = Blocks(cells_of(states), grid, shifts, shape, mixed, exterior_open)
        self._turns = turns
        numbers = np.arange(math.prod(shape)).reshape(shape)
        # From the number of a block to that of the next one along each axis, and in each of the later slices, or none.
        after = [(np.roll(numbers, -1, axis) - numbers).ravel() for axis in range(3 - self._dim, 3)]
        later = (turns.links - np.arange(slices)[:, None]) * numbers.size
        self._steps = np.stack(after, axis=1), np.where(turns.links >= 0, later, -slices * numbers.size)
        self._changed = np.ones((slices, *shape), dtype=np.bool_)
        self._among = np.full(self._changed.shape, among is None)
        if among is not None:
            self._among.reshape(slices, -1)[:, among] = True
        self._counts = np.zeros(self._changed.size, dtype=np.int32)
        self._faces: Faces | None = None
        self._struck = 0
        self._joined: GlobalLabels | None = None
        self._boxes: dict[int, Ints] = {}
        self._cached = self._nothing()

    def refresh(self, boxes: Ints) -> None:
        """Note which blocks have to be joined anew at the next call: those of a box for each slice, (slices, 6)."""
        slices = np.flatnonzero((boxes[:, :3] <= boxes[:, 3:]).all(axis=1))
        places, bounds = self._cached[0].reshape(self._changed.shape), boxes[slices].reshape(-1, 2, 3)
        for s, (first, last) in zip(slices.tolist(), (bounds >> self._blocks.shifts).tolist(), strict=True):
            own = tuple(slice(low, high + 1) for low, high in zip(first, last, strict=True))
            self._changed[s][own], places[s][own] = True, -1
            self._joined = None
            self._boxes.clear()

    def of(self, cells: Ints) -> Ints:
        """Numbers of the components that cells belong to, shape (..., 1 + d), or -1. They hold until a change."""
        flat = np.ascontiguousarray(cells.reshape(-1, cells.shape[-1]))
        joined, components = self._join(), np.empty(len(flat), dtype=np.int64)
        if look_up(self._blocks, joined, flat, components):
            self._ask(joined, flat, components)
        return components.reshape(cells.shape[:-1])

    def box(self, cell: Ints) -> Ints:
        """First and last cell, shape (2, d), of the box around the component of a cell, shape (1 + d,)."""
        number = int(self.of(cell))
        if number not in self._boxes:
            self._boxes[number] = self._around(number)
        return self._boxes[number]

    @property
    def count(self) -> int:
        """How many blocks a slice has, with those beyond the grid."""
        return int(self._changed[0].size)

    def way(self, cells: Ints) -> Ints:
        """The blocks of the shortest chain of them between two cells that are joined, shape (2, 1 + d), and beside it.

        Of the cells of a single slice.
        """
        number, joined, faces = int(self.of(cells[0])), self._join(), self._faces
        base, (rows, pairs) = joined.base, faces or _no_faces()
        ours = np.repeat(base[rows[:, 0]], rows[:, 3]) + (pairs >> BITS)
        theirs = np.repeat(base[rows[:, 1]], rows[:, 3]) + (pairs & (MOST - 1))
        first, last = (np.arange(*base[[block, block + 1]]) for block in self._places(cells).tolist())
        begin, end = (own[joined.roots[own] == number][0] for own in (first, last))
        graph = scipy.sparse.coo_array((np.ones(len(ours)), (ours, theirs)), shape=(base[-1], base[-1]))
        before = scipy.sparse.csgraph.breadth_first_order(graph.tocsr(), begin, directed=False)[1]
        way = [end]
        while before[way[-1]] >= 0:
            way.append(before[way[-1]])
        blocks = np.searchsorted(base, way, side="right") - 1
        return np.unique(np.append(blocks, rows[np.isin(rows[:, :2], blocks).any(axis=1), :2]))

    def _places(self, cells: Ints) -> Ints:
        """Numbers, within a slice, of the blocks of cells, shape (n, 1 + d); the last one is beyond the grid."""
        flat, places = 3 - self._dim, cells[:, 1:]
        shape = self._changed.shape[1 + flat :]
        inside = ((places >= 0) & (places < self._blocks.grid[1 + flat :])).all(axis=1, keepdims=True)
        blocks = np.where(inside, places >> self._blocks.shifts[flat:], np.array(shape) - 1)
        return np.asarray(np.ravel_multi_index(tuple(blocks.T), shape))

    def _members(self, number: int) -> tuple[Bools, Ints]:
        """Which components of blocks, of all slices, belong to a component of the map, and the blocks they are in."""
        joined, per = self._join(), self._changed[0].size
        ours = np.zeros(joined.base[-1], dtype=np.bool_)
        for start, s in set(zip(joined.starts.tolist(), joined.slices.tolist(), strict=True)):
            nodes = slice(*joined.base[[s * per, (s + 1) * per]].tolist())
            ours[nodes] |= joined.roots[start + nodes.start : start + nodes.stop] == number
        return ours, np.flatnonzero(np.diff(np.append(0, np.cumsum(ours))[joined.base]))

    def _around(self, number: int) -> Ints:
        """The box around a component; of its blocks those are labelled that may widen it, some of all sides first."""
        (deep, wide, _), base, (ours, has) = self._blocks.shifts, self._join().base, self._members(number)
        segments = np.random.default_rng(0).permutation(has)
        low, high, size = np.array(self._blocks.grid[1:]), np.full(3, -1), FEW
        while len(segments):
            few = np.sort(segments[:size])
            labels = self._label(few)
            nodes, mine, n = base[few], np.zeros_like(labels.words), 0
            row = np.flatnonzero(labels.words)
            left = labels.words[row]
            while len(row):
                at = labels.bounds[row] + n
                # All that is left of a row has its last number.
                rest = np.where(at + 1 < labels.bounds[row + 1], left & (left + (left & (~left + _ONE))), 0)
                here = ours[nodes[row >> (deep + wide)] + labels.numbers[at]]
                mine[row[here]] |= (left ^ rest)[here]
                row, left, n = row[rest != 0], rest[rest != 0], n + 1
            row = np.flatnonzero(mine)
            cells, (x, y, z) = mine[row], self._corners(few)[:, row >> (deep + wide)]
            x, y = x + (row >> wide & ((1 << deep) - 1)), y + (row & ((1 << wide) - 1))
            low = np.minimum(low, [x.min(), y.min(), (z + np.bitwise_count(~cells & (cells - _ONE))).min()])
            for k in range(6):
                cells |= cells >> (_ONE << np.uint64(k))
            high = np.maximum(high, [x.max(), y.max(), (z + np.bitwise_count(cells)).max() - 1])
            segments, size = segments[size:], min(4 * size, TASK)
            first = self._corners(segments).T
            last = np.minimum(first + (1 << np.array(self._blocks.shifts)), self._blocks.grid[1:]) - 1
            segments = segments[((first < low) | (last > high)).any(axis=1)]
        return np.stack([low, high])[:, 3 - self._dim :]

    def _ask(self, joined: GlobalLabels, cells: Ints, components: Ints) -> None:
        """Look up the cells that are left in the labels of their blocks."""
        wanted = np.unique((UNLABELLED - components[components <= UNLABELLED]) >> 12)
        for first in range(0, len(wanted), TASK):
            self._remember(wanted[first : first + TASK])
            look_into(joined, cells, *self._cached, components)

    def _remember(self, segments: Ints) -> None:
        """Label blocks, but for those whose labels are cached; the cache is dropped where it would become too large."""
        places, labels = self._cached
        missing = segments[places[segments] < 0]
        if not len(missing):
            return
        known = len(labels.counts)
        if known + len(missing) > TASK:
            known, missing, (places, labels) = 0, segments, self._nothing()
        made = self._label(missing)
        labels = Labels(
            _append_rows(labels.words, len(labels.words), [made.words]),
            _append_rows(labels.bounds, len(labels.bounds), [made.bounds[1:] + labels.bounds[-1]]),
            _append_rows(labels.numbers, len(labels.numbers), [made.numbers[: made.bounds[-1]].copy()]),
            _append_rows(labels.counts, len(labels.counts), [made.counts]),
        )
        self._cached = places, labels
        places[missing] = np.arange(known, known + len(missing))  # last, so that no interrupt leaves one without labels

    def _nothing(self) -> tuple[Nodes, Labels]:
        """No labels of any block."""
        none, bounds = np.empty(0, dtype=np.int32), np.zeros(1, dtype=np.int32)
        labels = Labels(np.empty(0, dtype=np.uint64), bounds, none, none)
        return np.full(self._changed.size, -1, dtype=np.int32), labels

    def _join(self) -> GlobalLabels:
        """The components over the whole map; blocks that changed are read again."""
        if self._joined is None:
            stale = self._changed.copy()
            for axis in range(4 - self._dim, 4):  # the block before has the face that it shares with this one
                before, changed = stale.swapaxes(0, axis), self._changed.swapaxes(0, axis)
                before[:-1] |= changed[1:]
                before[-1] |= changed[0]
            for later in self._turns.links.T:
                stale[later >= 0] |= self._changed[later[later >= 0]]
            stale &= self._among
            faces, self._faces = self._faces, None  # none are right while some are made
            if faces is None:
                self._changed[...], stale[...], self._struck = True, self._among, 0
                faces = _no_faces()
            sizes = len(faces.rows), len(faces.pairs)
            if self._struck * FEW_STRUCK > sizes[0]:
                sizes = drop_struck(faces)
            parts, rooms = self._parts(np.flatnonzero(stale)), list[Labels]()
            made = in_threads(lambda own: self._read(own, rooms), parts, cores())
            faces = Faces(*map(_append_rows, faces, sizes, zip(*made, strict=True)))
            joined = self._nodes(faces, sizes[0])
            self._changed[...] = False
            self._faces, self._joined = faces, joined
        return self._joined

    def _parts(self, own: Ints) -> list[Ints]:
        """Blocks in parts for a thread each; those of a part lie together, where there are more than a few."""
        if len(own) <= min(TASK, self._changed.size // 2):
            parts = max(1, min(cores(), len(own) // LEAST))
            return [own[len(own) * k // parts : len(own) * (k + 1) // parts] for k in range(parts)]
        slices, columns, each = len(self._changed), self._changed.shape[3], self._changed[0].size
        tall = max(TALL, TASK // each)
        wide = max(1, TASK // min(tall, slices) // columns) * columns
        tiles = own // each // tall * each + own % each // wide
        order = np.argsort(tiles, kind="stable")
        return np.split(own[order], np.flatnonzero(np.diff(tiles[order])) + 1)

    def _read(self, own: Ints, rooms: list[Labels]) -> Faces:
        """The faces of blocks, where they or those beside them have changed.

        Room for labels is taken from ``rooms``, where there is any, and left there: new memory takes as long as they.
        """
        others, changed, among = self._beside(own), self._changed.reshape(-1), self._among.reshape(-1)
        n, face = ((others >= 0) & among[others] & (changed[own][:, None] | changed[others])).nonzero()
        own, other = own[n], others[n, face]
        # Marks and places of all blocks from the first one on, which is quicker than to sort these and to search them.
        begin = min(own.min(initial=changed.size), other.min(initial=changed.size))
        wanted = np.zeros(max(own.max(initial=begin), other.max(initial=begin)) + 1 - begin, dtype=np.bool_)
        wanted[own - begin] = wanted[other - begin] = True
        segments = np.flatnonzero(wanted)
        place_of = np.empty(len(wanted), dtype=np.int64)
        place_of[segments] = np.arange(len(segments))
        room = rooms.pop() if rooms else None
        labels = self._label(segments + begin, room)
        self._counts[segments + begin] = labels.counts
        groups = own // self._changed[0].size * (1 + self._turns.links.shape[1]) + np.maximum(face + 1 - self._dim, 0)
        places = place_of[own - begin], place_of[other - begin]
        beside = np.stack([own, other, groups, face + 3 - self._dim, *places], axis=1)
        faces = Faces(np.empty((len(own), 4), np.int32), np.empty(labels.counts[beside[:, 4:]].sum(), np.int32))
        sizes = meet_blocks(labels, self._blocks.shifts, beside, np.empty(3 * MOST, np.int32), faces)
        rooms.append(labels if room is None or len(labels.counts) > len(room.counts) else room)
        return Faces(*(array[:count].copy() for array, count in zip(faces, sizes, strict=True)))

    def _beside(self, own: Ints) -> Ints:
        """The block that follows each of some along each axis, and those in its place in later slices; -1 fills up."""
        (after, later), per = self._steps, self._changed[0].size
        steps = np.concatenate([after[own % per], later[own // per]], axis=1)
        return np.asarray(np.maximum(own[:, None] + steps, -1))

    def _corners(self, segments: Ints) -> Ints:
        """The first cells of some blocks, shape (3, n)."""
        places = np.unravel_index(segments, self._changed.shape)[1:]
        return np.stack([place << shift for place, shift in zip(places, self._blocks.shifts, strict=True)])

    def _label(self, segments: Ints, room: Labels | None = None) -> Labels:
        """Label the cells of some blocks, in a room, where they fit into it."""
        deep, wide, long = self._blocks.shifts
        count, rows = len(segments), len(segments) << (deep + wide)
        runs = rows * ((1 + (1 << long)) // 2)
        if room is None or len(room.counts) < count:
            bounds, numbers, counts = (np.empty(size, dtype=np.int32) for size in (rows + 1, runs, count))
            room = Labels(np.empty(rows, dtype=np.uint64), bounds, numbers, counts)
        labels = Labels(room.words[:rows], room.bounds[: rows + 1], room.numbers[:runs], room.counts[:count])
        labels.bounds[0] = 0
        first = np.ones(count, dtype=np.bool_)
        first[1:] = (segments[1:] != segments[:-1] + 1) | (segments[1:] % self._changed.shape[3] == 0)
        starts = np.append(np.flatnonzero(first), count)
        label_blocks(self._blocks, segments, starts, labels, np.empty(MOST, dtype=np.int32))
        return labels

    def _nodes(self, faces: Faces, fresh: int) -> GlobalLabels:
        """Join the components of blocks over the whole map; faces are as they are now from number ``fresh`` on."""
        turns, per = self._turns, self._changed[0].size
        base = np.zeros(self._counts.size + 1, dtype=np.int32)
        np.cumsum(self._counts, out=base[1:])
        begins = base[::per].astype(np.int64)
        sizes = (begins[1:] - begins[:-1])[turns.slice_of]
        bounds = np.cumsum(sizes)
        starts = bounds - sizes - begins[turns.slice_of]
        roots = np.arange(bounds[-1], dtype=np.int32)
        uses, changed = starts[turns.uses], self._changed.reshape(-1)
        self._struck = join_nodes(roots, base, faces, fresh, changed, uses, turns.bounds)
        return GlobalLabels(base, starts[turns.copy_of], turns.slice_of[turns.copy_of], roots)


def _no_faces() -> Faces:
    return Faces(np.empty((0, 4), dtype=np.int32), np.empty(0, dtype=np.int32))


def _append_rows(array: Numbers, count: int, parts: Sequence[Numbers]) -> Numbers:
    """The first rows of an array and, behind them, others; in its own memory, where there is room."""
    size = count + sum(map(len, parts))
    if size == len(parts[0]):
        return parts[0]
    room = array if array.base is None else array.base
    if size > len(room):
        room = np.empty((size + size // 8, *array.shape[1:]), dtype=array.dtype)
        room[:count] = array[:count]
    for part in parts:
        room[count : count + len(part)] = part
        count += len(part)
    return room[:size]
