"""Clearance: proven distances to the nearest configuration that is not FREE."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.compiling import entry, inner, reader
from cspace.grid import SLACK
from cspace.map.distances import SIDE, UNIT, WIDE, Tiles, make_tiles, renew_tiles
from cspace.map.exterior import Exterior
from cspace.map.kept import Change, Lock
from cspace.map.points import Cell, Numbers, cell_of, configuration, is_usable, layered, replaced, state_at
from cspace.map.record import Map
from cspace.memory import check_memory
from cspace.states import FREE
from cspace.threads import cores, in_threads

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

TOGETHER: Final = 2**21
"""Cells of the tiles that are made at a time, at most: many cost less together, and memory."""

MISSING = -1.0
"""Answer where the tile of a configuration has not been made."""


# ---- compiled look-ups -----------------------------------------------------------------------------------------------


@inner
def clearance_at(map_: Map, tiles: Tiles, q: Numbers) -> float:
    """Lower bound of the distance from a configuration to the nearest one that is not FREE, in metres, or MISSING.

    Distance is 1-Lipschitz, so the middle of each neighbouring cell bounds it from below; the best of all is taken.
    """
    if state_at(map_, q) != FREE:
        return 0.0
    inside, cell = cell_of(map_, q)
    s, dim = cell[0], len(map_.lower)
    place = map_.lower  # in cells
    square = 0.0
    for axis in range(dim):
        place = replaced(place, axis, (q[axis] - map_.lower[axis]) / map_.spacing)
        square = math.hypot(square, max(0.0, -place[axis], place[axis] - map_.states.shape[axis + 1]))
    best = math.inf
    if tiles.occupied[s]:
        best = neighbors_bound(map_, tiles, cell, place) if inside else square
        if best == MISSING:
            return MISSING
    walls = tiles.walls[s]
    for n in range(walls.shape[0]):
        away = 0.0
        for axis in range(dim):
            away = math.hypot(away, max(0.0, walls[n, axis] - place[axis], place[axis] - walls[n, axis + dim]))
        best = min(best, away)
    if best == math.inf and (tiles.occupied[s] or walls[0, 0] != math.inf):
        return 0.0  # too far away for a distance to be told
    return max(0.0, best * (1.0 - 2.0**-48) - 4.0 * SLACK) * map_.spacing


@inner
def neighbors_bound(map_: Map, tiles: Tiles, cell: Cell, place: Numbers) -> float:
    """The best lower bound, in cells, from the cells around; MISSING where one of their tiles was not made."""
    s, dim = cell[0], len(place)
    i, j, k = layered(cell, 0)
    x, y, z = place[0] if dim == 3 else 0.5, place[dim - 2], place[dim - 1]  # a plane has one layer
    low, high = max(k - 1, 0), min(k + 1, map_.states.shape[dim] - 1)
    if tiles.ready[s, low // WIDE] == 0 or tiles.ready[s, high // WIDE] == 0:
        return MISSING
    _, _, nx, ny, _ = tiles.distances.shape
    best = 0.0
    for a in range(max(i - 1, 0), min(i + 1, nx - 1) + 1):
        for b in range(max(j - 1, 0), min(j + 1, ny - 1) + 1):
            square = (a + 0.5 - x) ** 2 + (b + 0.5 - y) ** 2
            for c in range(low, high + 1):
                apart = math.sqrt(square + (c + 0.5 - z) ** 2)
                best = max(best, tiles.distances[s, c // WIDE, a, b, c % WIDE] * (1.0 / UNIT) - apart)
    return best


@reader
def clearances(map_: Map, tiles: Tiles, points: Floats, out: Floats, missing: Bytes) -> int:
    """Clearances of points, shape (n, dof); the index of the first one that is not usable, or -1.

    Tiles, shape (slices, tiles), that were not made are marked in ``missing``.
    """
    last = map_.states.shape[-1] - 1
    for n in range(points.shape[0]):
        q = configuration(map_, points, n)
        if not is_usable(map_, q):
            return n
        out[n] = clearance_at(map_, tiles, q)
        if out[n] == MISSING:
            _, cell = cell_of(map_, q)
            missing[cell[0], max(cell[-1] - 1, 0) // WIDE] = 1
            missing[cell[0], min(cell[-1] + 1, last) // WIDE] = 1
    return -1


# Numba calls a function of so many floats quicker than one that takes a tuple of them.


@reader
def _clearance_2(map_: Map, tiles: Tiles, x: float, y: float) -> float:
    return clearance_at(map_, tiles, (x, y))


@reader
def _clearance_3(map_: Map, tiles: Tiles, a: float, b: float, c: float) -> float:
    return clearance_at(map_, tiles, (a, b, c))


@reader
def _clearance_4(map_: Map, tiles: Tiles, a: float, b: float, c: float, d: float) -> float:
    return clearance_at(map_, tiles, (a, b, c, d))


@reader
def _clearance_7(
    map_: Map, tiles: Tiles, a: float, b: float, c: float, d: float, e: float, f: float, g: float
) -> float:
    return clearance_at(map_, tiles, (a, b, c, d, e, f, g))


_CLEARANCE: Final = {2: _clearance_2, 3: _clearance_3, 4: _clearance_4, 7: _clearance_7}


# ---- the part of a map -----------------------------------------------------------------------------------------------


class Distances:
    """Distances of a map to its cells that are not FREE, made tile by tile where they are asked for.

    Parameters
    ----------
    map_ : Map
    exterior : Exterior
    lock : Lock
        That of the map, held while tiles are made.
    """

    def __init__(self, map_: Map, exterior: Exterior, lock: Lock) -> None:
        self._map, self._exterior, self._lock = map_, exterior, lock
        slices, *shape = map_.states.shape
        self._shape = tuple(shape)
        self._states = map_.states.reshape(slices, *(1,) * (3 - len(shape)), *shape)
        _, nx, ny, nz = self._states.shape
        tiles, parts = -(-nz // WIDE), (-(-nx // SIDE), -(-ny // SIDE))
        self.tiles = Tiles(
            np.empty((slices, tiles, nx, ny, WIDE), dtype=np.uint16),
            np.zeros((slices, tiles), dtype=np.uint8),
            np.zeros((slices, tiles, *parts), dtype=np.uint16),
            np.array([part.view(np.bool_).any() for part in self._states]),
            np.empty((slices, 2 * len(shape), 2 * len(shape))),
        )
        self._set_walls()

    def renew(self, change: Change) -> None:
        """Follow a change of the map; tiles that were made stay so, but for very many that all change."""
        self.tiles.occupied[...] = change.free < math.prod(self._shape)
        renew_tiles(self._states, self.tiles, change.freed)
        if change.exterior:
            self._set_walls()

    def kernel(self, points: Floats, out: Floats) -> int:
        """Clearances of configurations, shape (n, dof), into ``out``; the index of one that is not usable, or -1."""
        missing = np.zeros_like(self.tiles.ready)
        while (wrong := int(clearances(self._map, self.tiles, points, out, missing))) < 0 and missing.any():
            self._make(missing)
            missing[...] = 0
        return wrong

    def checker(self, dof: int) -> Callable[..., float]:
        """A quick clearance of the numbers of one configuration; it stays right through all changes."""
        quick = entry(_CLEARANCE[dof], (self._map, self.tiles), dof)

        def check(*q: float) -> float:
            clearance: float = quick(*q)
            if clearance == MISSING:
                out = np.empty(1)
                self.kernel(np.array([q]), out)
                clearance = float(out[0])
            return clearance

        return check

    def _make(self, missing: Bytes) -> None:
        """Make tiles, shape (slices, tiles), in threads, some that follow each other at a time."""
        with self._lock:
            _, nx, ny, _ = self._states.shape
            most = max(1, TOGETHER // (nx * ny * WIDE))
            parts: list[tuple[int, int, int]] = []
            for s, tile in np.argwhere((missing > 0) & (self.tiles.ready == 0)).tolist():
                if parts and parts[-1][0] == s and parts[-1][2] == tile and tile - parts[-1][1] < most:
                    parts[-1] = (s, parts[-1][1], tile + 1)
                else:
                    parts.append((s, tile, tile + 1))
            if not parts:
                return
            threads = min(cores(), len(parts))
            widest = max(end - start for _, start, end in parts)
            stored = 2 * sum(end - start for _, start, end in parts)
            size = (stored + 8 * threads * widest) * nx * ny * WIDE
            check_memory(size, "the clearance", self._shape, self._map.spacing)
            in_threads(lambda part: make_tiles(self._states, self.tiles, *part), parts, threads)

    def _set_walls(self) -> None:
        walls = self.tiles.walls
        walls[...] = np.inf
        for s, into in enumerate(walls):
            found = self._exterior.walls(s, self._shape)
            into[: len(found)] = found
