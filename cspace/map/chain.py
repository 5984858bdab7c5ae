"""Chains of cells that are not BLOCKED, with the fewest MIXED ones: where a path has to be looked for exactly."""

from __future__ import annotations

import math

import numpy as np

from cspace.arrays import BLOCKED, FREE, MIXED, Bools, Bytes, Ints
from cspace.compiling import jit
from cspace.map.storage import Cells, Map, check_bytes, state_in

START, CLOSED = 254, 255
"""How a cell was reached: not at all, if 0; by the steps from 1 to 6, down and up along x, y and z; from 7 on, out of
the rotation cell that its own has for a neighbour in that place; or these."""

TURNS = 7


@jit
def trace_chain(cells: Cells, slice_of: Ints, neighbors: Ints, start: Ints, goal: Ints, came: Bytes) -> bool:
    """Search a chain of cells ``(rotation, x, y, z)`` from start to goal, none BLOCKED, with the fewest MIXED ones.

    Breadth first, all FREE cells that can be reached before the next MIXED ones; only the front is held. ``came`` is 0,
    or CLOSED where a cell is left out, and is given the step by which each cell was reached. In the plane x has a
    single cell.
    """
    _, nx, ny, nz = came.shape
    size, most = nx * ny * nz, neighbors.shape[1]
    reached = came.reshape(-1)
    origin = ((start[0] * nx + start[1]) * ny + start[2]) * nz + start[3]
    if state_in(cells, slice_of[start[0]] * size + origin % size) == BLOCKED:
        return False
    target = ((goal[0] * nx + goal[1]) * ny + goal[2]) * nz + goal[3]
    # Breadth first where a step costs 0 or 1: a MIXED cell costs one more than all that FREE cells still lead to. So it
    # waits in ``later``, which becomes the front when nothing else is left. As the cost of a step is that of the cell
    # that it enters, the first way into a cell is a cheapest one.
    front, ahead, later = [origin], [origin], [origin]
    ahead.clear()
    later.clear()
    reached[origin] = START
    strides = (ny * nz, nz, 1)
    while len(front) > 0:
        for cell in front:
            if cell == target:
                return True
            r, place = cell // size, cell % size
            at = (place // (ny * nz), place // nz % ny, place % nz)
            for step in range(1, TURNS + most):
                a, near = r, place
                if step < TURNS:
                    axis, up = (step - 1) // 2, (step - 1) % 2
                    if at[axis] == (came.shape[1 + axis] - 1 if up else 0):
                        continue
                    near += strides[axis] if up else -strides[axis]
                else:
                    a = neighbors[r, step - TURNS]
                    if a < 0:
                        continue
                there = a * size + near
                if reached[there] != 0:
                    continue
                state = state_in(cells, slice_of[a] * size + near)
                if state != FREE and state != MIXED:
                    continue
                reached[there] = step
                if step >= TURNS:
                    # As the place in which the other rotation cell has this one, for the way back.
                    for back in range(most):
                        if neighbors[a, back] == r:
                            reached[there] = TURNS + back
                if state == FREE:
                    ahead.append(there)
                else:
                    later.append(there)
        front, ahead = ahead, front
        ahead.clear()
        if len(front) == 0:
            front, later = later, front
    return False


def open_chain(map_: Map, neighbors: Ints, start: Ints, goal: Ints, closed: Bools | None = None) -> Ints:
    """A chain of FREE and MIXED cells, each sharing a side with the next, with as few MIXED ones as can be.

    Where :meth:`cspace.CSpace.path_exists` is None, this is where a path has to be looked for with ``exact=True``.
    Cells are ``(rotation, x, y)`` or ``(rotation, x, y, z)`` in the grid, and the chain has the shape (n, 1 + d), from
    start to goal; n is 0 where there is none. ``neighbors``, shape (rotations, n), are the rotation cells that each one
    shares a border with; -1 fills up. Cells that are ``closed``, shape (rotations, *cells), are left out.
    """
    shape, slice_of = map_.states.shape[1:], map_.slice_of
    flat = (1,) * (3 - len(shape))  # the plane is space with one layer
    check_bytes(len(slice_of) * math.prod(shape))
    came = np.zeros((len(slice_of), *flat, *shape), dtype=np.uint8)
    if closed is not None:
        came[closed.reshape(came.shape)] = CLOSED
    first, last = (np.array([cell[0], *[0] * len(flat), *cell[1:]], dtype=np.int64) for cell in (start, goal))
    if not trace_chain(map_.cells, slice_of, neighbors, first, last, came):
        return np.empty((0, 1 + len(shape)), dtype=np.int64)
    cell, cells = last.tolist(), [last.tolist()]
    while (step := int(came[tuple(cell)])) != START:
        if step < TURNS:
            cell[1 + (step - 1) // 2] -= 2 * ((step - 1) % 2) - 1
        else:
            cell[0] = int(neighbors[cell[0], step - TURNS])
        cells.append(cell.copy())
    rows = np.array(cells[::-1], dtype=np.int64)
    return np.delete(rows, 1, axis=1) if flat else rows
