"""Tiles: which transform lengths to use, chosen by what transforms cost on the machine."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

from cspace.costs import Costs, figures
from cspace.fourier.precision import MARGIN, SUM_BITS, UNIT_ROUNDOFF, error_bound

TASKS = 8
"""Tasks that each thread should have, for all to end at about the same time."""

LEAST_INVERSES = 4
"""Inverse transforms in one task, at least: each task makes the spectrum of its tile afresh."""


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
    digits : int
        Rasters that share a transform.
    stack : int
        Tiles that share a transform.
    bits : int
        Bits that the overlaps with one raster take in their sum.
    pieces : int
        Parts that the rasters of a tile are settled in, so that all threads have work.
    seconds : float
        What the whole correlation is expected to take.
    """

    tile: tuple[int, ...]
    step: tuple[int, ...]
    precision: str
    error: float
    digits: int
    stack: int
    bits: int
    pieces: int
    seconds: float = 0.0

    @property
    def spectrum_bytes(self) -> int:
        """Memory that the spectrum of a tile or robot takes."""
        width = 8 if self.precision == "float32" else 16
        return math.prod(self.tile[:-1]) * (self.tile[-1] // 2 + 1) * width


def choose_tiling(
    shape: Sequence[int], extent: Sequence[int], count: int, threads: int = 1, rasters: int = 1
) -> Tiling:
    """The cheapest tiling whose proven error stays below a quarter.

    Parameters
    ----------
    shape : sequence of int
        Cells of the map.
    extent : sequence of int
        Cells of the robots' common bounding box.
    count : int
        Largest number of offsets in one raster.
    threads : int
        How many tiles are worked on at once.
    rasters : int
        Number of rasters.

    Returns
    -------
    Tiling
    """
    costs = figures().now
    candidates = [_lengths(n, r) for n, r in zip(shape, extent, strict=True)]
    bits = count.bit_length()
    most = max(1, SUM_BITS // bits)
    best, best_cost = None, math.inf
    for axes in itertools.product(*candidates):
        tile, numbers = zip(*axes, strict=True)
        tiles = math.prod(numbers)
        for precision in UNIT_ROUNDOFF:
            cost_of_one = _transform_seconds(costs, math.prod(tile), precision)
            for shares in range(min(most, rasters * tiles), 0, -1):
                digits = min(shares, rasters)
                stack = shares // digits
                inverses = -(-rasters // digits)
                pieces = max(1, min(inverses // LEAST_INVERSES, -(-TASKS * threads * stack // tiles)))
                rounds = math.ceil(math.ceil(tiles / stack) * pieces / threads)
                cost = rounds * (1 - (-inverses // pieces)) * cost_of_one
                if cost >= best_cost:
                    break
                if (error := error_bound(tile, count, precision, digits * stack)) < MARGIN:
                    step = tuple(length - r + 1 for length, r in zip(tile, extent, strict=True))
                    best = Tiling(tile, step, precision, error, digits, stack, bits, pieces, cost)
                    best_cost = cost
                    break
    if best is None:
        raise OverflowError(f"no transform of a map of {tuple(shape)} cells keeps overlaps exact in float64")
    return best


@cache
def _transform_seconds(costs: Costs, size: int, precision: str) -> float:
    return costs.transform(size, precision)


def _lengths(cells: int, extent: int) -> list[tuple[int, int]]:
    """Transform lengths worth a try, and the number of tiles that each makes: the shortest one for each number."""
    whole = fast_length(cells + extent - 1)
    least = min(whole, max(extent + extent // 2, 64))
    tiles = {-(-cells // (length - extent + 1)): length for length in reversed(_fast_lengths(whole)) if length >= least}
    return [(length, number) for number, length in tiles.items()]


def fast_length(least: int) -> int:
    """The smallest length with quick transforms that is not below ``least``."""
    return min(length for length in _fast_lengths(2 * least) if length >= least)


@cache
def _fast_lengths(most: int) -> tuple[int, ...]:
    """Lengths with quick transforms: powers of two times 1, 3, 5, 9 or 15."""
    odd = (1, 3, 5, 9, 15)
    return tuple(sorted(o << k for o in odd for k in range(most.bit_length()) if o << k <= most))
