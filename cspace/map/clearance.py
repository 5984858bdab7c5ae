"""Clearance: proven distances to the nearest configuration that is not FREE.

Nothing but the coarse maps of :mod:`cspace.map.mip` is kept for it. The nearest cell is searched from the configuration
outwards: first among large blocks of cells, and only those that are not all FREE, and nearer than the best cell so far,
are looked into. Places are counted in cells, along three axes; the plane is space with one layer of cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numba.cpython.unsafe.numbers import leading_zeros, trailing_zeros
from numpy.typing import NDArray

from cspace.compiling import entry, inner, reader
from cspace.grid import SLACK
from cspace.map import turning
from cspace.map.mip import SHIFT, SIDE, Mip
from cspace.map.points import FAR, Numbers, configuration, is_usable, replaced, state_at
from cspace.map.record import Map
from cspace.map.storage import Eights, eight_in, eights_of
from cspace.states import FREE

Floats = NDArray[np.float64]
Words = NDArray[np.uint64]
Place = tuple[float, float, float]

BYTE, ONE, THREE = np.uint64(255), np.uint64(1), np.uint64(3)

SIZE: Final = float(SIDE)

ROUNDING: Final = 2.0**-40
"""Share by which a distance is raised that must not be below the true one, whatever was rounded."""


class Marks(NamedTuple):
    """Which blocks of cells, as a coarse map has them, are not all FREE.

    cells : ndarray of uint64, or TwoBits
        The states, as :func:`cspace.map.storage.eights_of` gives them.
    words : ndarray of uint64, shape (slices, nx, ny, nz)
        Eight blocks along the last axis each, a byte for a block.
    occupied : ndarray of bool, shape (slices,)
        Whether a slice has any.
    """

    cells: Eights
    words: Words
    occupied: NDArray[np.bool_]

    @classmethod
    def of(cls, map_: Map, mip: Mip) -> Marks:
        """Those of a map and its coarse map, which follow its changes."""
        return cls(eights_of(map_.cells), mip.words, mip.occupied)


@inner
def clearance_at(map_: Map, marks: Marks, q: Numbers, most: float) -> float:
    """Lower bound of the distance from a configuration to the nearest one that is not FREE, in cells.

    ``most`` is known to be above it; infinity, if nothing is known.
    """
    if state_at(map_, q) != FREE:
        return 0.0
    s, dim, place = turning.slice_at(map_.rotations, q), len(map_.lower), (0.5, 0.5, 0.5)
    for axis in range(dim):
        # What is farther away is no nearer to anything.
        cells = min(max((q[axis] - map_.lower[axis]) / map_.spacing, -FAR), FAR)
        place = replaced(place, 3 - dim + axis, cells)
    best = min(most * most, square_outside(map_, s, place))
    if marks.occupied[s]:
        best = nearest_square(map_, marks, s, place, best, True)
        best = nearest_square(map_, marks, s, place, best, False)
    return max(0.0, math.sqrt(best) * (1.0 - 2.0**-48) - 4.0 * SLACK)


@inner
def square_outside(map_: Map, s: int, place: Place) -> float:
    """Squared distance to what is not FREE outside the grid, in cells; infinite where all is."""
    dim, table = len(map_.lower), map_.exterior
    beyond, best = table[s, 2 * dim] != FREE, math.inf
    for side in range(2 * dim):
        # A box as wide as what is not FREE, from one border of the grid on.
        square, empty = 0.0, False
        for axis in range(dim):
            low = -math.inf if beyond else float(table[s, axis])
            high = math.inf if beyond else table[s, dim + axis] + 1.0
            if side == 2 * axis:
                high = min(high, 0.0)
            elif side == 2 * axis + 1:
                low = max(low, float(map_.states.shape[axis + 1]))
            empty |= low >= high
            apart = max(0.0, low - place[3 - dim + axis], place[3 - dim + axis] - high)
            square += apart * apart
        if not empty:
            best = min(best, square)
    return best


@inner(forceinline=True)
def gap(place: float, cell: int, size: float) -> float:
    """Distance along an axis from a place to a block, by its number, or to a cell where blocks are of size one."""
    return max(0.0, cell * size - place, place - (cell + 1) * size)


@inner
def nearest_square(map_: Map, marks: Marks, s: int, place: Place, best: float, rough: bool) -> float:
    """Squared distance to the nearest cell of a slice that is not FREE; ``best``, if that is less.

    Rows of blocks are taken by their distance, and along each the blocks that are not all FREE, both ways. A ``rough``
    answer is the least of the distances to the far corners of blocks, and above the true one; no cell is looked at.
    """
    _, nx, ny, nz = marks.words.shape
    x, y, z = start(place[0], nx), start(place[1], ny), start(place[2], SIDE * nz)
    shift = np.uint64(8 * (z % SIDE))
    below_x, above_x = x - 1, x
    while True:
        i, x_gap, below_x, above_x = nearer(place[0], nx, below_x, above_x)
        if not x_gap * x_gap < best:
            return best
        below_y, above_y = y - 1, y
        while True:
            j, y_gap, below_y, above_y = nearer(place[1], ny, below_y, above_y)
            square = x_gap * x_gap + y_gap * y_gap
            if not square < best:
                break
            row = marks.words[s, i, j]
            k, word = z // SIDE, row[z // SIDE] >> shift << shift
            while True:
                if word != 0:
                    n = SIDE * k + lowest(word)
                    if not closer(square, place, n, best):
                        break
                    if rough:
                        corner = far(place[0], i) ** 2 + far(place[1], j) ** 2 + far(place[2], n) ** 2
                        best = min(best, corner)
                        break
                    best = nearest_in_block(map_, marks.cells, s, (i, j, n), place, best)
                    word &= ~(BYTE << np.uint64(8 * (n - SIDE * k)))
                else:
                    k += 1
                    if k == nz or not closer(square, place, SIDE * k, best):
                        break
                    word = row[k]
            k, word = z // SIDE, row[z // SIDE] & ((ONE << shift) - ONE)
            while True:
                if word != 0:
                    n = SIDE * k + highest(word)
                    if not closer(square, place, n, best):
                        break
                    if rough:
                        corner = far(place[0], i) ** 2 + far(place[1], j) ** 2 + far(place[2], n) ** 2
                        best = min(best, corner)
                        break
                    best = nearest_in_block(map_, marks.cells, s, (i, j, n), place, best)
                    word &= ~(BYTE << np.uint64(8 * (n - SIDE * k)))
                else:
                    k -= 1
                    if k < 0 or not closer(square, place, SIDE * k + 7, best):
                        break
                    word = row[k]


@inner(forceinline=True)
def far(place: float, block: int) -> float:
    """Distance along an axis from a place to the far end of a block."""
    return max(place - block * SIZE, (block + 1) * SIZE - place)


@inner(forceinline=True)
def closer(square: float, place: Place, block: int, best: float) -> bool:
    """Whether a block of a row, the square of whose distance across is given, is nearer than the best cell so far."""
    apart = gap(place[2], block, SIZE)
    return square + apart * apart < best


@inner
def nearest_in_block(map_: Map, cells: Eights, s: int, block: tuple[int, int, int], place: Place, best: float) -> float:
    """Squared distance to the nearest cell of a block that is not FREE; ``best``, if that is less."""
    shape = map_.states.shape
    nx, ny, nz = shape[1] if len(shape) == 4 else 1, shape[-2], shape[-1]
    first_x, last_x = block[0] << SHIFT, min((block[0] + 1) << SHIFT, nx) - 1
    first_y, last_y = block[1] << SHIFT, min((block[1] + 1) << SHIFT, ny) - 1
    first_z = block[2] << SHIFT
    # Cells before this one are looked at downwards, and the others upwards.
    shift = np.uint64(8 * (min(max(int(place[2]), first_z), first_z + SIDE - 1) - first_z))
    for i in range(first_x, last_x + 1):
        x_gap = gap(place[0], i, 1.0)
        if not x_gap * x_gap < best:
            continue
        for j in range(first_y, last_y + 1):
            y_gap = gap(place[1], j, 1.0)
            square = x_gap * x_gap + y_gap * y_gap
            if not square < best:
                continue
            word = eight_in(cells, map_.cells, ((s * nx + i) * ny + j) * nz + first_z, nz - first_z)
            if word == 0:
                continue
            above, below = word >> shift << shift, word & ((ONE << shift) - ONE)
            if above != 0:
                apart = gap(place[2], first_z + lowest(above), 1.0)
                best = min(best, square + apart * apart)
            if below != 0:
                apart = gap(place[2], first_z + highest(below), 1.0)
                best = min(best, square + apart * apart)
    return best


@inner
def start(place: float, count: int) -> int:
    """The block along an axis that is nearest to a place."""
    return int(min(max(place / SIZE, 0.0), count - 1.0))


@inner(forceinline=True)
def lowest(word: np.uint64) -> int:
    """The first of the eight bytes of a word that is not zero."""
    return np.int64(trailing_zeros(word) >> THREE)  # type: ignore[return-value,call-arg]


@inner(forceinline=True)
def highest(word: np.uint64) -> int:
    """The last of the eight bytes of a word that is not zero."""
    return 7 - np.int64(leading_zeros(word) >> THREE)  # type: ignore[return-value,call-arg]


@inner(forceinline=True)
def nearer(place: float, count: int, below: int, above: int) -> tuple[int, float, int, int]:
    """The nearer one of the next blocks below and above, its distance, and the next ones after it."""
    low = gap(place, below, SIZE) if below >= 0 else math.inf
    high = gap(place, above, SIZE) if above < count else math.inf
    if low <= high:
        return below, low, below - 1, above
    return above, high, below, above + 1


@reader
def clearances(map_: Map, marks: Marks, points: Floats, out: Floats) -> int:
    """Clearances of configurations, shape (n, dof), in metres; the index of the first one that is not usable, or -1."""
    last, dim = map_.lower + turning.blank(map_.rotations), len(map_.lower)
    known = math.inf
    for n in range(points.shape[0]):
        q = configuration(map_, points, n)
        if not is_usable(map_, q):
            return n
        # A configuration near the last one is not much farther from what is not FREE, at the same rotation.
        most = math.inf
        if turning.slice_at(map_.rotations, q) == turning.slice_at(map_.rotations, last):
            square = 0.0
            for axis in range(dim):
                square += ((q[axis] - last[axis]) / map_.spacing) ** 2
            most = (known + 8.0 * SLACK + math.sqrt(square)) * (1.0 + ROUNDING)
        known, last = clearance_at(map_, marks, q, most), q
        out[n] = known * map_.spacing
    return -1


@reader
def _clearance_2(map_: Map, marks: Marks, x: float, y: float) -> float:
    return clearance_at(map_, marks, (x, y), math.inf) * map_.spacing


@reader
def _clearance_3(map_: Map, marks: Marks, a: float, b: float, c: float) -> float:
    return clearance_at(map_, marks, (a, b, c), math.inf) * map_.spacing


@reader
def _clearance_4(map_: Map, marks: Marks, a: float, b: float, c: float, d: float) -> float:
    return clearance_at(map_, marks, (a, b, c, d), math.inf) * map_.spacing


@reader
def _clearance_7(
    map_: Map, marks: Marks, a: float, b: float, c: float, d: float, e: float, f: float, g: float
) -> float:
    return clearance_at(map_, marks, (a, b, c, d, e, f, g), math.inf) * map_.spacing


_CLEARANCE: Final = {2: _clearance_2, 3: _clearance_3, 4: _clearance_4, 7: _clearance_7}
# Numba calls a function of so many floats quicker than one that takes a tuple of them.


def checker(map_: Map, marks: Marks, dof: int) -> Callable[..., float]:
    """A quick clearance of the numbers of one configuration; it stays right through all changes."""
    return entry(_CLEARANCE[dof], (map_, marks), dof)
