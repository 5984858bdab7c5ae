"""Compiled parts of :mod:`cspace.connectivity`. The plane has one layer of cells, and of blocks, one cell thick.

Kind 0 are the FREE cells, and kind 1 those that are not BLOCKED. A block's components are numbered from 1 on. Of each
block there are five faces: the sides that it shares with the next block along each axis, the one that it shares with
the same block of the next slice, and its part of the rim of the grid.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cspace.states import BLOCKED, FREE

Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]
Labels = NDArray[np.uint16]
Nodes = NDArray[np.int32]

FACES = 5
NEXT, RIM = 3, 4


@njit(cache=True, nogil=True)
def find(parent: Nodes, node: int) -> int:
    """The root of a node; the way there is halved."""
    while parent[node] != node:
        parent[node] = parent[parent[node]]
        node = parent[node]
    return int(node)


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def label_blocks(stack: Bytes, labels: Labels, counts: Nodes, sides: Ints, boxes: Ints) -> None:
    """Label the cells of blocks.

    Parameters
    ----------
    stack : ndarray of uint8, shape (slices, nx, ny, nz)
    labels : ndarray of uint16, shape (2, slices, nx, ny, nz)
    counts : ndarray of int32, shape (2, slices, bx, by, bz)
        Number of components of each kind, slice and block.
    sides : ndarray of int64, shape (3,)
        Cells of a block along each axis.
    boxes : ndarray of int64, shape (slices, 6)
        First and last block of each slice that is to be labelled; beyond all others, and -1, where there is none.
    """
    parent = np.empty(sides[0] * sides[1] * sides[2] + 1, np.int32)
    names = np.empty(parent.size, np.uint16)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for s in range(stack.shape[0]):
        box = boxes[s]
        for i in range(box[0], box[3] + 1):
            for j in range(box[1], box[4] + 1):
                for k in range(box[2], box[5] + 1):
                    for axis, at in enumerate((i, j, k)):
                        low[axis] = at * sides[axis]
                        high[axis] = min(low[axis] + sides[axis], stack.shape[1 + axis])
                    for kind in range(2):
                        counts[kind, s, i, j, k] = _label(stack[s], labels[kind, s], kind, low, high, parent, names)


@njit(cache=True, nogil=True)
def _label(states: Bytes, labels: Labels, kind: int, low: Ints, high: Ints, parent: Nodes, names: Labels) -> int:
    """Label the cells from ``low`` on and before ``high``; the number of components."""
    count = 0
    for x in range(low[0], high[0]):
        for y in range(low[1], high[1]):
            row, into = states[x, y], labels[x, y]
            before, under = labels[max(x - 1, 0), y], labels[x, max(y - 1, 0)]
            last = 0
            for z in range(low[2], high[2]):
                if (row[z] != FREE) if kind == 0 else (row[z] == BLOCKED):
                    into[z] = 0
                    last = 0
                    continue
                label = last
                if x > low[0] and before[z] > 0 and before[z] != label:
                    if label > 0:
                        unite(parent, label, before[z])
                    else:
                        label = int(before[z])
                if y > low[1] and under[z] > 0 and under[z] != label:
                    if label > 0:
                        unite(parent, label, under[z])
                    else:
                        label = int(under[z])
                if label == 0:
                    count += 1
                    label = count
                    parent[label] = label
                into[z] = label
                last = label
    named = 0
    names[0] = 0
    for label in range(1, count + 1):
        # The lower root is on top, so that it has its name by now.
        root = find(parent, label)
        if root == label:
            named += 1
            names[label] = named
        else:
            names[label] = names[root]
    if named < count:
        for x in range(low[0], high[0]):
            for y in range(low[1], high[1]):
                into = labels[x, y]
                for z in range(low[2], high[2]):
                    into[z] = names[into[z]]
    return named


@njit(cache=True, nogil=True)
def join_blocks(
    labels: Labels, counts: Nodes, sides: Ints, boxes: Ints, places: Ints, pool: Labels, filled: Ints, start: int
) -> int:
    """Find which components meet at the faces of blocks.

    Parameters
    ----------
    labels, counts, sides, boxes
        As :func:`label_blocks` leaves them.
    places : ndarray of int64, shape (2, slices, bx, by, bz, FACES, 3)
        Of each face, the first of its pairs in the pool, how many there are, and how many have room.
    pool : ndarray of uint16, shape (n, 2)
        Pairs: a component of the block, and one of its neighbour, or 0 for the rim. They join what meets at the face,
        with none to spare.
    filled : ndarray of int64, shape (1,)
        How many pairs of the pool are taken, also by faces that have others by now.
    start : int
        Which face to go on with.

    Returns
    -------
    int
        The face for which the pool has no room, or -1 where all are done.
    """
    most = 2 * sides[0] * sides[1] * sides[2] + 2
    parent, scratch = np.empty(most, np.int32), np.empty((most, 2), np.uint16)
    number = 0
    for kind in range(2):
        for s in range(counts.shape[1]):
            for face in range(FACES):
                if face == NEXT and counts.shape[1] == 1:
                    continue
                shared, box = s, boxes[s].copy()
                if face < 3:
                    # The block before has its far side here.
                    box[face] = max(0, box[face] - 1)
                    box[3 + face] = min(box[3 + face], counts.shape[2 + face] - 2)
                elif face == NEXT:
                    shared = (s + 1) % counts.shape[1]
                    for axis in range(3):
                        box[axis] = min(box[axis], boxes[shared, axis])
                        box[3 + axis] = max(box[3 + axis], boxes[shared, 3 + axis])
                for i in range(box[0], box[3] + 1):
                    for j in range(box[1], box[4] + 1):
                        for k in range(box[2], box[5] + 1):
                            number += 1
                            if number <= start:
                                continue
                            found = _pairs(
                                labels[kind], counts[kind], sides, (s, shared), face, (i, j, k), parent, scratch
                            )
                            place = places[kind, s, i, j, k, face]
                            if found > place[2]:
                                if filled[0] + found > len(pool):
                                    return number - 1
                                place[0], place[2] = filled[0], found
                                filled[0] += found
                            place[1] = found
                            pool[place[0] : place[0] + found] = scratch[:found]
    return -1


@njit(cache=True, nogil=True)
def _pairs(
    labels: Labels,
    counts: Nodes,
    sides: Ints,
    slices: tuple[int, int],
    face: int,
    block: tuple[int, int, int],
    parent: Nodes,
    scratch: Labels,
) -> int:
    """Pairs of components that meet at a face, none of which follows from others; their number."""
    (s, shared), (i, j, k) = slices, block
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for axis, at in enumerate(block):
        low[axis] = at * sides[axis]
        high[axis] = min(low[axis] + sides[axis], labels.shape[1 + axis])
    ours = counts[s, i, j, k]
    if ours == 0:
        return 0
    shift = np.zeros(3, np.int64)
    solid = sides[0] > 1  # in the plane, the first axis has no rim
    if face == RIM:
        theirs = 0
        inside = low[1] > 0 and high[1] < labels.shape[2] and low[2] > 0 and high[2] < labels.shape[3]
        if inside and (not solid or (low[0] > 0 and high[0] < labels.shape[1])):
            return 0
    elif face == NEXT:
        theirs = counts[shared, i, j, k]
    else:
        shift[face] = 1
        theirs = counts[shared, i + shift[0], j + shift[1], k + shift[2]]
        low[face] = high[face] - 1
    for node in range(ours + theirs + 1):
        parent[node] = node
    found = 0
    for x in range(low[0], high[0]):
        for y in range(low[1], high[1]):
            edge = y == 0 or y == labels.shape[2] - 1 or (solid and (x == 0 or x == labels.shape[1] - 1))
            row, other = labels[s, x, y], labels[shared, x + shift[0], y + shift[1]]
            last_a, last_b = 0, 0
            for z in range(low[2], high[2]):
                a = int(row[z])
                if a == 0:
                    continue
                if face == RIM:
                    if not (edge or z == 0 or z == labels.shape[3] - 1):
                        continue
                    b = 0
                else:
                    b = int(other[z + shift[2]])
                    if b == 0:
                        continue
                if a == last_a and b == last_b:
                    continue
                last_a, last_b = a, b
                # Node 0 is the rim; ours follow, and then theirs.
                if unite(parent, a, 0 if face == RIM else ours + b):
                    scratch[found, 0], scratch[found, 1] = a, b
                    found += 1
    return found


@njit(cache=True, nogil=True)
def compact(places: Ints, pool: Labels, into: Labels) -> int:
    """Move the pairs of all faces into another pool, without gaps; how many there are."""
    used = 0
    flat = places.reshape(-1, 3)
    for n in range(len(flat)):
        first, count = flat[n, 0], flat[n, 1]
        into[used : used + count] = pool[first : first + count]
        flat[n, 0], flat[n, 2] = used, count
        used += count
    return used


@njit(cache=True, nogil=True)
def number_nodes(counts: Nodes, slice_of: Ints, base: Ints, start: Ints) -> int:
    """Number the components of one kind over all rotations and blocks; how many there are.

    ``counts`` has the shape (slices, blocks). Component c of a block is node ``start[rotation] + base[slice, block] +
    c - 1``, and the rim of a rotation its last node, ``start[rotation + 1] - 1``.
    """
    sizes = np.zeros(counts.shape[0], np.int64)
    for s in range(counts.shape[0]):
        for b in range(counts.shape[1]):
            base[s, b] = sizes[s]
            sizes[s] += counts[s, b]
    start[0] = 0
    for r in range(len(slice_of)):
        start[r + 1] = start[r] + sizes[slice_of[r]] + 1
    return int(start[-1])


@njit(cache=True, nogil=True)
def join_all(
    places: Ints,
    pool: Labels,
    shape: Ints,
    slice_of: Ints,
    rim_is_open: NDArray[np.bool_],
    base: Ints,
    start: Ints,
    parent: Nodes,
) -> None:
    """Join the nodes of one kind; ``parent`` is given the root of each.

    ``places`` has the shape (slices, blocks, FACES, 3), ``shape`` is the number of blocks along each axis, and
    ``rim_is_open`` tells of each slice whether its rim joins what it touches.
    """
    for node in range(len(parent)):
        parent[node] = node
    steps = (shape[1] * shape[2], shape[2], 1)
    turns = len(slice_of)
    for r in range(turns):
        s, after = slice_of[r], (r + 1) % turns
        rim = start[r + 1] - 1
        if rim_is_open[s] and rim_is_open[slice_of[after]]:
            unite(parent, rim, start[after + 1] - 1)
        for b in range(base.shape[1]):
            ours = start[r] + base[s, b] - 1
            for face in range(FACES):
                first, count = places[s, b, face, 0], places[s, b, face, 1]
                if count == 0:
                    continue
                if face == RIM:
                    if rim_is_open[s]:
                        for n in range(first, first + count):
                            unite(parent, ours + pool[n, 0], rim)
                    continue
                if face == NEXT:
                    theirs = start[after] + base[slice_of[after], b] - 1
                else:
                    theirs = start[r] + base[s, b + steps[face]] - 1
                for n in range(first, first + count):
                    unite(parent, ours + pool[n, 0], theirs + pool[n, 1])
    for node in range(len(parent)):
        parent[node] = parent[parent[node]]  # the lower root is on top, so that it is known by now


@njit(cache=True, nogil=True)
def roots_of(
    labels: Labels,
    sides: Ints,
    shape: Ints,
    slice_of: Ints,
    base: Ints,
    start: Ints,
    roots: Nodes,
    cells: Ints,
    out: Ints,
) -> None:
    """Root of the component of one kind of each cell ``(rotation, x, y, z)``, shape (n, 4); -1 for none.

    One rotation may stand for all. What lies outside the grid is the rim.
    """
    for n in range(len(cells)):
        r = min(cells[n, 0], len(slice_of) - 1)
        x, y, z = cells[n, 1], cells[n, 2], cells[n, 3]
        if not (0 <= x < labels.shape[1] and 0 <= y < labels.shape[2] and 0 <= z < labels.shape[3]):
            out[n] = roots[start[r + 1] - 1]
            continue
        s = slice_of[r]
        label = labels[s, x, y, z]
        b = ((x // sides[0]) * shape[1] + y // sides[1]) * shape[2] + z // sides[2]
        out[n] = roots[start[r] + base[s, b] + label - 1] if label > 0 else -1


@njit(cache=True, nogil=True)
def box_of(
    labels: Labels,
    counts: Nodes,
    sides: Ints,
    shape: Ints,
    slice_of: Ints,
    base: Ints,
    start: Ints,
    roots: Nodes,
    root: int,
) -> Ints:
    """First and last cell of the box around the component of a root; only blocks that widen it are read."""
    box = np.array([labels.shape[1], labels.shape[2], labels.shape[3], -1, -1, -1])
    ours = np.empty(sides[0] * sides[1] * sides[2] + 1, np.bool_)
    low, high = np.empty(3, np.int64), np.empty(3, np.int64)
    for r in range(len(slice_of)):
        s = slice_of[r]
        for b in range(base.shape[1]):
            first, found = start[r] + base[s, b], False
            for c in range(counts[s, b]):
                ours[c + 1] = roots[first + c] == root
                found |= ours[c + 1]
            if not found:
                continue
            ours[0] = False
            wider = False
            for axis, at in enumerate((b // (shape[1] * shape[2]), b // shape[2] % shape[1], b % shape[2])):
                low[axis] = at * sides[axis]
                high[axis] = min(low[axis] + sides[axis], labels.shape[1 + axis])
                wider |= low[axis] < box[axis] or high[axis] - 1 > box[3 + axis]
            if not wider:
                continue
            for x in range(low[0], high[0]):
                for y in range(low[1], high[1]):
                    for z in range(low[2], high[2]):
                        if ours[labels[s, x, y, z]]:
                            box[0], box[3] = min(box[0], x), max(box[3], x)
                            box[1], box[4] = min(box[1], y), max(box[4], y)
                            box[2], box[5] = min(box[2], z), max(box[5], z)
    return box
