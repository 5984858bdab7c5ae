"""Tiles: which transform lengths to use, chosen by a model of their cost."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from cspace.fourier.precision import MARGIN, error_bound


@dataclass(frozen=True, slots=True)
class Tiling:
    """How a map is cut for overlap-save correlation.

    Attributes
    ----------
    tile : tuple of int
        Transform length along each axis.
    step : tuple of int
        Results that one tile yields along each axis.
    precision : str
        "float32" or "float64".
    error : float
        Proven bound of the error of an overlap.
    """

    tile: tuple[int, ...]
    step: tuple[int, ...]
    precision: str
    error: float

    @property
    def spectrum_bytes(self) -> int:
        """Memory that the spectrum of a tile or robot takes."""
        width = 8 if self.precision == "float32" else 16
        return math.prod(self.tile[:-1]) * (self.tile[-1] // 2 + 1) * width


def choose_tiling(shape: Sequence[int], extent: Sequence[int], count: int, threads: int = 1) -> Tiling:
    """The cheapest tiling whose proven error stays below a quarter.

    Parameters
    ----------
    shape : sequence of int
        Cells of the map.
    extent : sequence of int
        Cells of the robot's bounding box.
    count : int
        Largest number of offsets in one raster.
    threads : int
        How many tiles are worked on at once.

    Returns
    -------
    Tiling
    """
    candidates = [_lengths(n, r) for n, r in zip(shape, extent, strict=True)]
    best, best_cost = None, math.inf
    for tile in itertools.product(*candidates):
        step = tuple(length - r + 1 for length, r in zip(tile, extent, strict=True))
        tiles = math.prod(math.ceil(n / s) for n, s in zip(shape, step, strict=True))
        for precision in ("float32", "float64"):
            cost = math.ceil(tiles / threads) * _tile_cost(tile, precision)
            if cost < best_cost and (error := error_bound(tile, count, precision)) < MARGIN:
                best, best_cost = Tiling(tile, step, precision, error), cost
    if best is None:
        raise OverflowError(f"no transform of a map of {tuple(shape)} cells keeps overlaps exact in float64")
    return best


def _tile_cost(tile: Sequence[int], precision: str) -> float:
    """Modelled time of one tile, in units of one point and one binary level of a transform in cache.

    Measured shapes: transforms cost ``size * log2(size)``; gathering, multiplying and comparing cost about as much as
    six levels; beyond a megabyte (a core's second-level cache) each doubling adds about a seventh; the calls cost as
    much as 200,000 points.
    """
    size = math.prod(tile)
    width = 4 if precision == "float32" else 8
    doublings = max(0.0, math.log2(size * width / 2**20))
    return width / 4 * size * (math.log2(size) + 6.0) * (1.0 + 0.15 * doublings) + 200_000.0


def _lengths(cells: int, extent: int) -> list[int]:
    """Transform lengths worth a try: somewhat more than the robot, and at most one tile for the whole map."""
    whole = fast_length(cells + extent - 1)
    least = min(whole, max(extent + extent // 8, 32))
    return [length for length in _fast_lengths(whole) if length >= least]


def fast_length(least: int) -> int:
    """The smallest length with quick transforms that is not below ``least``."""
    return min(length for length in _fast_lengths(2 * least) if length >= least)


@cache
def _fast_lengths(most: int) -> tuple[int, ...]:
    """Lengths with quick transforms: powers of two times 1, 3, 5, 9 or 15."""
    odd = (1, 3, 5, 9, 15)
    return tuple(sorted(o << k for o in odd for k in range(most.bit_length()) if o << k <= most))
