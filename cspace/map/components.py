"""Components: which cells chains of FREE cells join, and which not even chains of undecided cells do."""

from __future__ import annotations

import threading
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import inner, jit, reader
from cspace.map.kept import Change
from cspace.map.storage import Cells, Stack, cells_of, row_in, state_in
from cspace.states import BLOCKED
from cspace.threads import cores, in_threads

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Nodes = NDArray[np.int32]
Pairs = NDArray[np.uint32]
Words = NDArray[np.uint64]
"""Packed blocks, shape (blocks, KINDS, rows): a bit for each cell of a row, set where the cell is of that kind."""

SIDES: Final = {2: (1, 64, 64), 3: (8, 8, 64)}
"""Cells of a block along each axis, by dimension: 64 rows of 64 cells. A plane has one layer."""

AXES, RIM, LINKS = 3, 3, 4
"""Faces of a block: one for each axis, towards the next block; its part of the rim of the grid; and from LINKS on, one
for each later neighbour of its rotation cell."""

KINDS: Final = 2
"""Kind 0 are the FREE cells, and kind 1 those that are not BLOCKED."""

ASK: Final = -2
"""Said of cells whose component only the labels of their block tell."""

TASK: Final = 256
"""Blocks that a thread takes at a time."""

_ANSWERS = np.array([None, True, False], dtype=object)
_BITS = 11  # a component's number in its block: 64 rows of at most 32 runs make 2^11 of them
_ONE = np.uint64(1)
_DEBRUIJN = np.uint64(0x03F79D71B4CB0A89)
_PLACES = np.zeros(64, dtype=np.int64)
_PLACES[[int(_DEBRUIJN) * 2**k % 2**64 >> 58 for k in range(64)]] = np.arange(64)


class Blocks(NamedTuple):
    """The states of a map, cut into blocks.

    cells : ndarray of uint8, or TwoBits
        The states, all slices in a row.
    grid : tuple of int, length 4
        Slices, and cells of the grid.
    sides, shape : ndarray of int64, shape (3,)
        Cells of a block, and number of blocks, along each axis.
    links, link_ends : ndarray of int64, shapes (n,) and (slices,)
        The slices that each slice has for later neighbours, and where those of each end.
    solid : bool
        Whether the first axis has a rim; it has none in the plane.
    """

    cells: Cells
    grid: tuple[int, int, int, int]
    sides: Ints
    shape: Ints
    links: Ints
    link_ends: Ints
    solid: bool


class Runs(NamedTuple):
    """The cells of one kind in a block, as runs along its rows.

    table : ndarray of int64, shape (n, 3)
        First cell, last cell and component of each run.
    begins : ndarray of int64, shape (rows + 1,)
        Where the runs of each row begin, and where those of the last one end.
    parent : ndarray of int32, shape (n,)
        For union-find.
    """

    table: Ints
    begins: Ints
    parent: Nodes

    @classmethod
    def room(cls, blocks: Blocks) -> Runs:
        """Room for the runs of any block."""
        deep, wide, long = blocks.sides.tolist()
        rows, most = deep * wide, deep * wide * ((long + 1) // 2)
        return cls(np.empty((most, 3), np.int64), np.zeros(rows + 1, np.int64), np.empty(most, np.int32))


class Room(NamedTuple):
    """What :func:`join_blocks` works in; one thread at a time. Compiled code that makes no arrays is compiled sooner.

    runs : tuple of Runs
        By kind those of a block at an even place, and those of one at an odd place; and of another neighbour.
    known : ndarray of int32, shape (2 * KINDS,)
        Number of components of each but the last, -1 where it is not labelled: the labels of the next block along the
        last axis serve again when its turn comes.
    packed : ndarray of uint64, shape (LINKS + links, blocks, KINDS, rows)
        By face the packed neighbours of blocks that follow each other along the last axis; the blocks themselves, and
        the one after them, are in the place of RIM.
    parent : ndarray of int32
        For union-find.
    pool : ndarray of uint32
        For the pairs.
    """

    runs: tuple[Runs, Runs, Runs, Runs, Runs]
    known: Nodes
    packed: Words
    parent: Nodes
    pool: Pairs

    @classmethod
    def of(cls, blocks: Blocks, count: int) -> Room:
        """Room for ``count`` blocks, or for as many pairs as :func:`join_blocks` finds in several calls."""
        links = int(np.diff(blocks.link_ends, prepend=0).max())
        rows, length = int(blocks.sides[0] * blocks.sides[1]), min(int(blocks.shape[2]), count)
        return cls(
            (Runs.room(blocks), Runs.room(blocks), Runs.room(blocks), Runs.room(blocks), Runs.room(blocks)),
            np.empty(2 * KINDS, np.int32),
            np.empty((LINKS + links, length + 1, KINDS, rows), np.uint64),
            np.empty(2 << _BITS, np.int32),
            np.empty(KINDS * (LINKS + links) * (2 << _BITS) + 8 * count, np.uint32),
        )


class Joined(NamedTuple):
    """The components of one kind over the whole map.

    Component c of a block is the node ``start[rotation] + base[slice, block] + c``, the rim of a rotation cell the last
    of its nodes, and ``roots`` has the component of each node. ``rim`` tells, of each slice, whether the rim joins what
    it touches.
    """

    counts: Nodes
    base: Ints
    start: Ints
    roots: Nodes
    rim: NDArray[np.bool_]


# ---- compiled passes -------------------------------------------------------------------------------------------------


@inner
def find(parent: Nodes, node: int) -> int:
    """The root of a node; the way there is halved (Tarjan, 1975)."""
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return int(node)


@inner
def unite(parent: Nodes, a: int, b: int) -> bool:
    """Join two nodes, the lower root on top; whether they were apart."""
    a, b = find(parent, a), find(parent, b)
    if a == b:
        return False
    if a < b:
        parent[b] = a
    else:
        parent[a] = b
    return True


@inner
def corner_of(blocks: Blocks, block: int) -> tuple[int, int, int]:
    """First cell of a block, by its number."""
    plane, row = blocks.shape[1] * blocks.shape[2], blocks.shape[2]
    i, j, k = block // plane, block // row % blocks.shape[1], block % row
    return i * blocks.sides[0], j * blocks.sides[1], k * blocks.sides[2]


@inner
def pack(blocks: Blocks, s: int, first: int, words: Words) -> None:
    """Pack the cells of blocks of a slice that follow each other along the last axis, from ``first`` on.

    Row by row through all of them, as they lie in memory, which is several times quicker than block by block.
    """
    x, y, z = corner_of(blocks, first)
    _, nx, ny, nz = blocks.grid
    deep, wide = min(blocks.sides[0], nx - x), min(blocks.sides[1], ny - y)
    for block in range(len(words) if deep * wide < words.shape[2] else 0):
        for row in range(words.shape[2]):
            words[block, 0, row] = words[block, 1, row] = 0
    for i in range(deep):
        for j in range(wide):
            line, row = ((s * nx + x + i) * ny + y + j) * nz, i * blocks.sides[1] + j
            for block in range(len(words)):
                begin = z + block * blocks.sides[2]
                taken, blocked = row_in(blocks.cells, line + begin, min(blocks.sides[2], nz - begin))
                words[block, 0, row], words[block, 1, row] = ~taken, ~blocked


@inner
def lowest(word: np.uint64) -> np.uint64:
    """The lowest bit of a word that is set, alone."""
    return word & (~word + _ONE)


@inner
def place_of(bit: np.uint64) -> int:
    """The number of a single bit."""
    return int(_PLACES[np.int64((bit * _DEBRUIJN) >> np.uint64(58))])


@inner
def unite_rows(runs: Runs, first: int, stop: int, other: int, other_stop: int) -> None:
    """Join the runs of one row with those of another that they touch."""
    table = runs.table
    while first < stop and other < other_stop:
        if table[first, 0] <= table[other, 1] and table[other, 0] <= table[first, 1]:
            unite(runs.parent, other, first)
        if table[first, 1] < table[other, 1]:
            first += 1
        else:
            other += 1


@inner
def label(blocks: Blocks, words: NDArray[np.uint64], runs: Runs) -> int:
    """Label the cells of a block, packed in a word for each row; the number of components, counted from 0."""
    count: int = np.int64(0)  # type: ignore[assignment]  # of one type for the compiler from the start
    begins, table = runs.begins, runs.table
    deep, wide = blocks.sides[0], blocks.sides[1]
    for row in range(deep * wide):
        word, first = words[row], count
        starts, stops = word & ~(word << _ONE), word & ~(word >> _ONE)
        while starts != 0:
            start, stop = lowest(starts), lowest(stops)
            table[count, 0], table[count, 1] = place_of(start), place_of(stop)
            runs.parent[count] = count
            starts, stops, count = starts ^ start, stops ^ stop, count + 1
        begins[row + 1] = count
        if row % wide > 0 and (word & words[row - 1]) != 0:
            unite_rows(runs, first, count, begins[row - 1], first)
        if row >= wide and (word & words[row - wide]) != 0:
            unite_rows(runs, first, count, begins[row - wide], begins[row - wide + 1])
    components = 0
    for n in range(count):
        # The lower root is on top, so that it has its number by now.
        root = find(runs.parent, n)
        if root == n:
            table[n, 2] = components
            components += 1
        else:
            table[n, 2] = table[root, 2]
    return components


@inner
def label_block(blocks: Blocks, s: int, block: int, kind: int, runs: Runs, words: Words) -> int:
    """Label the cells of one kind in a block of a slice; the number of components. ``words`` has room for it."""
    pack(blocks, s, block, words)
    return int(label(blocks, words[0, kind], runs))


@inner
def meet(blocks: Blocks, face: int, ours: Runs, theirs: Runs, parent: Nodes, found: Pairs) -> int:
    """Pairs of components of two blocks that meet at a face, without those that follow from others; how many.

    ``parent`` has a node for each of our components and, from as many on as we may have, for theirs.
    """
    deep, wide, last = blocks.sides[0], blocks.sides[1], blocks.sides[2] - 1
    count = 0
    for row in range(deep * wide):
        # The rows where the two touch: the last ones and the first, or, beside each other or in two slices, all.
        other = row
        if face == 0:
            other = row - (deep - 1) * wide
        elif face == 1:
            other = row - (wide - 1) if row % wide == wide - 1 else -1
        if other < 0:
            continue
        n, stop = ours.begins[row], ours.begins[row + 1]
        m, other_stop = theirs.begins[other], theirs.begins[other + 1]
        if face == 2:
            # Only the last cell of our row touches the first one of theirs.
            n = max(n, stop - 1)
        while n < stop and m < other_stop:
            if face == 2:
                touch = ours.table[n, 1] == last and theirs.table[m, 0] == 0
            else:
                touch = ours.table[n, 0] <= theirs.table[m, 1] and theirs.table[m, 0] <= ours.table[n, 1]
            a, b = ours.table[n, 2], theirs.table[m, 2]
            if touch and unite(parent, a, ours.parent.size + b):
                found[count] = np.uint32((a << _BITS) | b)
                count += 1
            if face == 2 or ours.table[n, 1] < theirs.table[m, 1]:
                n += 1
            else:
                m += 1
    return count


@inner
def rim_pairs(blocks: Blocks, block: int, runs: Runs, components: int, code: int, found: Pairs, seen: Nodes) -> int:
    """Components of a block with a cell at the border of the grid, each once; how many there are."""
    x, y, z = corner_of(blocks, block)
    _, nx, ny, nz = blocks.grid
    begins, ends = z == 0, z + blocks.sides[2] >= nz
    beside = y == 0 or y + blocks.sides[1] >= ny or (blocks.solid and (x == 0 or x + blocks.sides[0] >= nx))
    if not (begins or ends or beside):
        return 0
    for a in range(components):
        seen[a] = 0
    count = n = 0
    for i in range(blocks.sides[0]):
        for j in range(blocks.sides[1]):
            border = y + j == 0 or y + j == ny - 1 or (blocks.solid and (x + i == 0 or x + i == nx - 1))
            while n < runs.begins[i * blocks.sides[1] + j + 1]:
                touches = border or (begins and runs.table[n, 0] == 0) or (ends and z + runs.table[n, 1] == nz - 1)
                a = runs.table[n, 2]
                if touches and seen[a] == 0:
                    seen[a] = 1
                    found[count] = np.uint32((code << (2 * _BITS)) | (a << _BITS))
                    count += 1
                n += 1
    return count


@inner
def pairs_of(blocks: Blocks, s: int, block: int, place: int, room: Room, counts: Nodes, found: Pairs) -> int:
    """What joins the components of a block of a slice with others; how many pairs there are.

    A pair is one number: its face and kind, a component of the block, and one of the neighbour's. Pairs that follow
    from others are left out. The block is packed at a ``place`` in the room; ``counts``, shape (2,), is given the
    number of components of each kind.
    """
    number, own, after = 0, KINDS * (place % 2), KINDS * ((place + 1) % 2)
    parent, packed, known = room.parent, room.packed, room.known
    plane, row = blocks.shape[1] * blocks.shape[2], blocks.shape[2]
    at = (block // plane, block // row % blocks.shape[1], block % row)
    for kind in range(KINDS):
        ours = room.runs[own + kind]
        counts[kind] = known[own + kind] if known[own + kind] >= 0 else label(blocks, packed[RIM, place, kind], ours)
        known[after + kind] = -1
        if counts[kind] > 0:
            number += rim_pairs(blocks, block, ours, counts[kind], KINDS * RIM + kind, found[number:], parent)
    if counts[1] == 0:
        return number
    for face in range(LINKS + blocks.link_ends[s] - first_link(blocks, s)):
        if face == RIM or (face < AXES and at[face] + 1 == blocks.shape[face]):
            continue
        for kind in range(KINDS):
            if counts[kind] == 0:
                continue
            ours, theirs = room.runs[own + kind], room.runs[after + kind if face == 2 else 2 * KINDS]
            others = label(blocks, packed[face, place, kind], theirs)
            if face == 2:
                known[after + kind] = others
            for node in range(counts[kind]):
                parent[node] = node
            for node in range(ours.parent.size, ours.parent.size + others):
                parent[node] = node
            first = number
            number += meet(blocks, face, ours, theirs, parent, found[first:])
            for n in range(first, number):
                found[n] |= np.uint32((KINDS * face + kind) << (2 * _BITS))
    return number


@inner
def first_link(blocks: Blocks, s: int) -> int:
    """Where the links of a slice begin."""
    return int(blocks.link_ends[s - 1]) if s > 0 else 0


@reader
def join_blocks(blocks: Blocks, segments: Ints, counts: Nodes, sizes: Ints, room: Room) -> tuple[int, int]:
    """The pairs of blocks, one after the other, as many as there is room for; of how many blocks, and how many pairs.

    Parameters
    ----------
    segments : ndarray of int64, shape (n,)
        Blocks of slices, by ``slice * blocks + block``.
    counts : ndarray of int32, shape (n, 2)
        Is given the number of components of each kind.
    sizes : ndarray of int64, shape (n,)
        Is given the number of pairs.
    room : Room
        Its ``pool`` is given the pairs.
    """
    pool, packed = room.pool, room.packed
    blocks_each = blocks.shape[0] * blocks.shape[1] * blocks.shape[2]
    most, rows, length = KINDS * len(packed) * (2 << _BITS), packed.shape[3], blocks.shape[2]
    filled = n = 0
    while n < len(segments):
        s, first = segments[n] // blocks_each, segments[n] % blocks_each
        stop = n + 1
        while stop < len(segments) and segments[stop] == segments[stop - 1] + 1 and segments[stop] % length != 0:
            stop += 1
        count, link = stop - n, first_link(blocks, s)
        pack(blocks, s, first, packed[RIM, : count + (1 if (first + count) % length != 0 else 0)])
        if first // (blocks.shape[1] * length) + 1 < blocks.shape[0]:
            pack(blocks, s, first + blocks.shape[1] * length, packed[0, :count])
        if first // length % blocks.shape[1] + 1 < blocks.shape[1]:
            pack(blocks, s, first + length, packed[1, :count])
        for k in range(count):
            for row in range(rows):
                packed[2, k, 0, row], packed[2, k, 1, row] = packed[RIM, k + 1, 0, row], packed[RIM, k + 1, 1, row]
        for other in range(link, blocks.link_ends[s]):
            pack(blocks, blocks.links[other], first, packed[LINKS + other - link, :count])
        room.known[:] = -1
        for k in range(count):
            if filled + most > len(pool):
                return n + k, filled
            sizes[n + k] = pairs_of(blocks, s, first + k, k, room, counts[n + k], pool[filled:])
            filled += sizes[n + k]
        n = stop
    return n, filled


@jit
def merge(pool: Pairs, ends: Ints, stale: Ints, fresh: Pairs, sizes: Ints) -> Pairs:
    """The pairs of all blocks, some of them new; ``ends``, where those of each block end, is changed in place."""
    total = len(pool) + len(fresh)
    for n in range(len(stale)):
        total -= ends[stale[n]] - (ends[stale[n] - 1] if stale[n] > 0 else 0)
    merged = np.empty(total, np.uint32)
    first, filled, taken, n = 0, 0, 0, 0
    for segment in range(len(ends)):
        stop = ends[segment]
        if n < len(stale) and stale[n] == segment:
            for k in range(sizes[n]):
                merged[filled + k] = fresh[taken + k]
            filled, taken, n = filled + sizes[n], taken + sizes[n], n + 1
        else:
            for k in range(first, stop):
                merged[filled + k - first] = pool[k]
            filled += stop - first
        ends[segment], first = filled, stop
    return merged


@reader
def join_all(
    blocks: Blocks,
    kind: int,
    pool: Pairs,
    ends: Ints,
    joined: Joined,
    turns: tuple[Ints, Ints, Ints],
) -> None:
    """Join the nodes of one kind, and write the root of each into ``joined``.

    Parameters
    ----------
    pool : ndarray of uint32
        Pairs of all blocks of all slices; those of a block end at its entry of ``ends``.
    turns : tuple of ndarray of int64
        The slice of each rotation cell; rows (other rotation cell, link, or -1 where both share a slice) for the later
        neighbours of rotation cells; and where those of each end.
    """
    (slice_of, neighbors, neighbor_ends), (_, base, start, parent, rim) = turns, joined
    steps = (blocks.shape[1] * blocks.shape[2], blocks.shape[2], 1)
    mask, blocks_each = (1 << _BITS) - 1, base.shape[1]
    for node in range(len(parent)):
        parent[node] = node
    for r in range(len(slice_of)):
        s, rim_node = slice_of[r], start[r + 1] - 1
        nearby = neighbors[neighbor_ends[r - 1] if r > 0 else 0 : neighbor_ends[r]]
        for n in range(len(nearby)):
            other = nearby[n, 0]
            if rim[s] and rim[slice_of[other]]:
                unite(parent, rim_node, start[other + 1] - 1)
            if nearby[n, 1] < 0:
                for node in range(start[r + 1] - 1 - start[r]):
                    unite(parent, start[r] + node, start[other] + node)
        for b in range(blocks_each):
            ours, segment = start[r] + base[s, b], s * blocks_each + b
            for k in range(ends[segment - 1] if segment > 0 else 0, ends[segment]):
                pair = np.int64(pool[k])
                code, node, there = pair >> (2 * _BITS), ours + ((pair >> _BITS) & mask), pair & mask
                if code % KINDS != kind:
                    continue
                face = code // KINDS
                if face < AXES:
                    unite(parent, node, start[r] + base[s, b + steps[face]] + there)
                elif face == RIM:
                    if rim[s]:
                        unite(parent, node, rim_node)
                else:
                    for n in range(len(nearby)):
                        if nearby[n, 1] == face - LINKS:
                            other = nearby[n, 0]
                            unite(parent, node, start[other] + base[slice_of[other], b] + there)
    for node in range(len(parent)):
        parent[node] = parent[parent[node]]  # the lower root is on top, so that it is known by now


@reader
def roots_of(blocks: Blocks, kind: int, joined: Joined, turns: Ints, cells: Ints, roots: Ints) -> int:
    """Component of each cell ``(rotation, x, y)`` or ``(rotation, x, y, z)``, where its state is enough to tell.

    It is, where all components of its block are one over the whole map; cells of other blocks get ASK, and what has no
    component -1. Gives the number of cells that got ASK.
    """
    _, nx, ny, nz = blocks.grid
    asked, solid = 0, cells.shape[1] == 4
    for n in range(len(cells)):
        r = min(cells[n, 0], len(turns) - 1)
        x, y, z, s = cells[n, 1] if solid else 0, cells[n, -2], cells[n, -1], turns[r]
        roots[n] = -1
        if not (0 <= x < nx and 0 <= y < ny and 0 <= z < nz):
            if joined.rim[s]:
                roots[n] = joined.roots[joined.start[r + 1] - 1]
            continue
        if state_in(blocks.cells, ((s * nx + x) * ny + y) * nz + z) > kind:  # FREE, MIXED and BLOCKED count up
            continue
        block = block_of(blocks, x, y, z)
        first, count = joined.start[r] + joined.base[s, block], joined.counts[s, block]
        for node in range(first + 1, first + count):
            if joined.roots[node] != joined.roots[first]:
                count = -1
                break
        if count > 0:
            roots[n] = joined.roots[first]
        elif count < 0:
            roots[n] = ASK
            asked += 1
    return asked


@reader
def roots_in(
    blocks: Blocks,
    kind: int,
    joined: Joined,
    turns: Ints,
    cells: Ints,
    roots: Ints,
    order: Ints,
    room: tuple[Runs, Words],
) -> None:
    """Components of those cells that :func:`roots_of` left to ask; ``order`` takes a block's one after the other."""
    (runs, words), known, components = room, -1, 0
    for n in order:
        r = min(cells[n, 0], len(turns) - 1)
        x, y, z = cells[n, 1] if cells.shape[1] == 4 else 0, cells[n, -2], cells[n, -1]
        s, block = turns[r], block_of(blocks, x, y, z)
        if s * joined.base.shape[1] + block != known:
            known, components = s * joined.base.shape[1] + block, label_block(blocks, s, block, kind, runs, words)
        row = x % blocks.sides[0] * blocks.sides[1] + y % blocks.sides[1]
        roots[n] = -1
        # While another thread changes the map, a block may have other components than were joined.
        for k in range(runs.begins[row], runs.begins[row + 1]):
            if runs.table[k, 0] <= z % blocks.sides[2] <= runs.table[k, 1] and components == joined.counts[s, block]:
                roots[n] = joined.roots[joined.start[r] + joined.base[s, block] + runs.table[k, 2]]


@inner
def block_of(blocks: Blocks, x: int, y: int, z: int) -> int:
    """Number of the block of a cell."""
    plane = (x // blocks.sides[0]) * blocks.shape[1] + y // blocks.sides[1]
    return int(plane * blocks.shape[2] + z // blocks.sides[2])


@reader
def widen_box(
    blocks: Blocks, joined: Joined, slice_of: Ints, root: int, kind: int, room: tuple[Runs, Words], box: Ints
) -> None:
    """Widen a box, first and last cell, around all cells of a component; only blocks that may widen it are read."""
    _, nx, ny, nz = blocks.grid
    (runs, words), sides = room, blocks.sides
    for r in range(len(slice_of)):
        s = slice_of[r]
        for b in range(joined.base.shape[1]):
            first, found = joined.start[r] + joined.base[s, b], False
            for c in range(joined.counts[s, b]):
                found |= joined.roots[first + c] == root
            x, y, z = corner_of(blocks, b)
            wider = x < box[0] or y < box[1] or z < box[2] or min(x + sides[0], nx) - 1 > box[3]
            wider |= min(y + sides[1], ny) - 1 > box[4] or min(z + sides[2], nz) - 1 > box[5]
            if not (found and wider) or label_block(blocks, s, b, kind, runs, words) != joined.counts[s, b]:
                continue
            n = 0
            for row in range(sides[0] * sides[1]):
                i, j = x + row // sides[1], y + row % sides[1]
                while n < runs.begins[row + 1]:
                    if joined.roots[first + runs.table[n, 2]] == root:
                        box[0], box[3] = min(box[0], i), max(box[3], i)
                        box[1], box[4] = min(box[1], j), max(box[4], j)
                        box[2], box[5] = min(box[2], z + runs.table[n, 0]), max(box[5], z + runs.table[n, 1])
                    n += 1


# ---- the part of a map -----------------------------------------------------------------------------------------------


class Components:
    """The components of a map, in two levels, so that a change asks for few cells, and no cell has a label in memory.

    The cells of each block are joined by themselves, along the runs of its rows, and so are the components of blocks
    that share a side, or the same place in neighbouring rotation cells. Union-find joins them over the whole map. Only
    what joins blocks is kept; labels of cells are made again, block by block, where they are asked for. What lies
    outside the grid is one more component of each rotation cell.

    Cells that share a side are joined. For FREE cells that is a path. For the others it loses none: a path goes from
    one closed cell to the next through a side, or through an edge or corner, all of whose cells are then not BLOCKED
    and are joined by their sides.

    Parameters
    ----------
    states : ndarray of uint8, or PackedStates, shape (slices, nx, ny) or (slices, nx, ny, nz)
        Kept, not copied; :meth:`renew` tells of changes.
    slice_of : ndarray of int64, shape (rotations,)
    neighbors : ndarray of int64, shape (rotations, n)
        The rotation cells that each one shares a border with; -1 fills up.
    rim_is_open : ndarray of bool, shape (slices,)
        Whether some configuration outside the grid is not BLOCKED.
    sides : tuple of int, length 3, optional
        Cells of a block along each axis; at most 64 rows of at most 64 cells.
    """

    def __init__(
        self,
        states: Stack,
        slice_of: Ints,
        neighbors: Ints,
        rim_is_open: NDArray[np.bool_],
        sides: tuple[int, int, int] | None = None,
    ) -> None:
        self._dim = states.ndim - 1
        slices, (nx, ny, nz) = len(states), (1,) * (3 - self._dim) + states.shape[1:]
        of_block = np.array(SIDES[self._dim] if sides is None else sides, dtype=np.int64)
        shape = -(-np.array((nx, ny, nz)) // of_block)
        # One rotation cell stands for all where there is a single slice.
        self._slice_of = np.ascontiguousarray(slice_of if len(states) > 1 else slice_of[:1], dtype=np.int64)
        links, later = _links(self._slice_of, neighbors, len(states))
        flat = np.array([other for row in links for other in row], dtype=np.int64)
        ends = np.cumsum([len(row) for row in links])
        self._blocks = Blocks(cells_of(states), (slices, nx, ny, nz), of_block, shape, flat, ends, self._dim == 3)
        self._turns = (
            self._slice_of,
            np.array([row for rows in later for row in rows], dtype=np.int64).reshape(-1, 2),
            np.cumsum([len(rows) for rows in later]),
        )
        words = np.empty((1, KINDS, int(of_block[0] * of_block[1])), dtype=np.uint64)
        self._room = Runs.room(self._blocks), words
        self._linked_from: list[list[int]] = [[] for _ in links]
        for s, row in enumerate(links):
            for other in row:
                self._linked_from[other].append(s)
        self._rim_is_open = np.asarray(rim_is_open, dtype=np.bool_)
        self._stale = np.ones((len(states), *shape), dtype=np.bool_)
        self._counts = np.zeros((self._stale.size, KINDS), dtype=np.int32)
        self._pool, self._ends = np.empty(0, dtype=np.uint32), np.zeros(self._stale.size, dtype=np.int64)
        self._joined: tuple[Joined, Joined] | None = None
        self._boxes: dict[int, Ints] = {}
        self._lock = threading.Lock()

    def renew(self, change: Change) -> None:
        """Note which blocks have to be joined anew at the next call."""
        with self._lock:
            for s, box in enumerate(change.states):
                if (box[:3] <= box[3:]).all():
                    first, last = box[:3] // self._blocks.sides, box[3:] // self._blocks.sides
                    own = [slice(low, high + 1) for low, high in zip(first.tolist(), last.tolist(), strict=True)]
                    for other in self._linked_from[s]:
                        self._stale[other][tuple(own)] = True
                    for axis in range(AXES):  # the block before has the face that it shares with this one
                        before = [*own]
                        before[axis] = slice(max(int(first[axis]) - 1, 0), int(last[axis]) + 1)
                        self._stale[s][tuple(before)] = True
                    self._joined = None
                    self._boxes.clear()

    def of(self, cells: Ints) -> tuple[Ints, Ints]:
        """Numbers of the components of FREE cells, and of cells that are not BLOCKED, that cells belong to.

        Within one of the FREE cells, a collision-free path exists; between two of the others, none does. A cell
        outside the grid counts as not BLOCKED where any of them is.

        Parameters
        ----------
        cells : ndarray of int64, shape (..., 1 + d)
            ``(rotation, x, y)`` or ``(rotation, x, y, z)``, in the grid or not.

        Returns
        -------
        free, passable : ndarray of int64, shape (...)
            -1 where a cell belongs to none. The numbers hold until the next change.
        """
        flat = np.ascontiguousarray(cells.reshape(-1, cells.shape[-1]))
        free, passable = self._roots(flat).reshape(KINDS, *cells.shape[:-1])
        return free, passable

    def box(self, cell: Ints) -> Ints:
        """First and last cell, shape (2, d), of the box around the component of a FREE cell, shape (1 + d,)."""
        number = int(self.of(cell)[0])
        with self._lock:
            if number not in self._boxes:
                box = np.array([*self._blocks.grid[1:], -1, -1, -1], dtype=np.int64)
                widen_box(self._blocks, self._join()[0], self._slice_of, number, 0, self._room, box)
                self._boxes[number] = box.reshape(2, 3)[:, 3 - self._dim :]
            return self._boxes[number]

    def joins(self, start: tuple[Ints, Bytes], goal: tuple[Ints, Bytes]) -> NDArray[np.object_]:
        """Whether a path joins configurations: True, False (proven) or None (undecided), shape (...).

        ``start`` and ``goal`` are their cells, shape (..., 1 + d), in the grid or not, and their states, shape (...).
        """
        number = start[1].size
        cells = np.concatenate([cells.reshape(-1, cells.shape[-1]) for cells, _ in (start, goal)])
        free, passable = self._roots(cells)
        passable[np.concatenate([states.reshape(-1) for _, states in (start, goal)]) == BLOCKED] = -1
        free0, open0 = (each[:number].reshape(start[1].shape) for each in (free, passable))
        free1, open1 = (each[number:].reshape(goal[1].shape) for each in (free, passable))
        joined, apart = (free0 == free1) & (free0 >= 0), (open0 != open1) | (open0 < 0)
        answers: NDArray[np.object_] = _ANSWERS[np.where(apart, 2, joined), ...]
        return answers

    def _roots(self, cells: Ints) -> Ints:
        """Of both kinds, the components of cells, shape (n, 1 + d)."""
        found = np.empty((KINDS, len(cells)), dtype=np.int64)
        with self._lock:
            for kind, joined in enumerate(self._join()):
                roots = found[kind]
                asked = roots_of(self._blocks, kind, joined, self._slice_of, cells, roots)
                if asked:
                    order = np.flatnonzero(roots == ASK)
                    if asked > 1:
                        blocks = cells[order]
                        blocks[:, 1:] //= self._blocks.sides[3 - self._dim :]
                        order = order[np.lexsort(blocks.T)]
                    roots_in(self._blocks, kind, joined, self._slice_of, cells, roots, order, self._room)
        return found

    def _join(self) -> tuple[Joined, Joined]:
        """Of both kinds, what all blocks come to; those that changed are read again."""
        if self._joined is None:
            stale = np.flatnonzero(self._stale)
            parts = [stale[k : k + TASK] for k in range(0, len(stale), TASK)]
            sizes, counts = np.zeros(len(stale), dtype=np.int64), np.zeros((len(stale), KINDS), dtype=np.int32)

            def join(number: int) -> Pairs:
                own, found = slice(number * TASK, (number + 1) * TASK), []
                rest = parts[number], counts[own], sizes[own]
                room = Room.of(self._blocks, len(rest[0]))
                while len(rest[0]):
                    done, filled = join_blocks(self._blocks, *rest, room)
                    found.append(room.pool[:filled].copy())
                    rest = rest[0][done:], rest[1][done:], rest[2][done:]
                return np.concatenate(found)

            fresh = in_threads(join, range(len(parts)), cores()) if parts else []
            pairs = np.concatenate([self._pool[:0], *fresh])
            if len(stale) < self._stale.size:
                pairs = merge(self._pool, self._ends, stale, pairs, sizes)
            else:
                self._ends = np.cumsum(sizes)
            self._pool = pairs
            self._counts[stale] = counts
            self._stale[...] = False
            first, second = (self._nodes(kind) for kind in range(KINDS))
            self._joined = first, second
        return self._joined

    def _nodes(self, kind: int) -> Joined:
        slices = self._blocks.grid[0]
        counts = np.ascontiguousarray(self._counts[:, kind].reshape(slices, -1))
        base = np.cumsum(counts, axis=1, dtype=np.int64) - counts
        sizes = counts.sum(axis=1, dtype=np.int64)[self._slice_of] + 1
        start = np.concatenate([[0], np.cumsum(sizes)])
        joined = Joined(counts, base, start, np.empty(start[-1], dtype=np.int32), self._rim_is_open & (kind == 1))
        join_all(self._blocks, kind, self._pool, self._ends, joined, self._turns)
        return joined


def _links(slice_of: Ints, neighbors: Ints, slices: int) -> tuple[list[list[int]], list[list[tuple[int, int]]]]:
    """The slices that come after each slice, and, of each rotation cell, (later neighbour, which of these it is)."""
    links: list[list[int]] = [[] for _ in range(slices)]
    later: list[list[tuple[int, int]]] = [[] for _ in slice_of]
    for r, s in enumerate(slice_of.tolist()):
        for other in sorted({n for n in neighbors[r].tolist() if n > r}) if len(slice_of) > 1 else []:
            there = int(slice_of[other])
            if there != s and there not in links[s]:
                links[s].append(there)
            later[r].append((other, links[s].index(there) if there != s else -1))
    return links, later
