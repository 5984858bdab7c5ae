"""Tiles: which transform lengths to use, chosen by what transforms cost."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

from cspace.engines.precision import MARGIN, SUM_BITS, UNIT_ROUNDOFF, error_bound

TASKS = 8
"""Tasks that each thread should have, for all to end at about the same time."""

LEAST_INVERSES = 4
"""Inverse transforms in one task, at least: each task makes the spectrum of its tile afresh."""

SIZES: Final = tuple(2**k for k in (12, 14, 16, 18, 20, 22))
"""Points of the transforms that were timed, once, on two cores of a server."""

SECONDS_A_POINT: Final = {
    "float32": (2.4e-9, 2.5e-9, 2.5e-9, 2.6e-9, 3.0e-9, 4.8e-9),
    "float64": (3.4e-9, 3.5e-9, 3.6e-9, 4.0e-9, 7.0e-9, 14.0e-9),
}
"""Half of what a tile's transforms, there and back, and all that is done with its numbers take, for each size."""

SECONDS_A_TILE: Final = 4e-5
"""For each tile, whatever its size."""


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
    """

    tile: tuple[int, ...]
    step: tuple[int, ...]
    precision: str
    error: float
    digits: int
    stack: int
    bits: int
    pieces: int

    @property
    def spectrum_bytes(self) -> int:
        """Memory that the spectrum of a tile or robot takes."""
        width = 8 if self.precision == "float32" else 16
        return math.prod(self.tile[:-1]) * (self.tile[-1] // 2 + 1) * width


def choose_tiling(
    shape: Sequence[int], extent: Sequence[int], count: int, threads: int = 1, rasters: int = 1
) -> Tiling:
    """The cheapest tiling whose proven error stays below a quarter.

    ``shape`` is that of the map, and ``extent`` that of the robots' common bounding box, in cells; ``count`` is the
    largest number of offsets in one of the rasters. So many ``threads`` work on a tile each.
    """
    candidates = [_lengths(n, r) for n, r in zip(shape, extent, strict=True)]
    bits = count.bit_length()
    most = max(1, SUM_BITS // bits)
    best, best_cost = None, math.inf
    for axes in itertools.product(*candidates):
        tile, numbers = zip(*axes, strict=True)
        tiles = math.prod(numbers)
        for precision in UNIT_ROUNDOFF:
            cost_of_one = transform_seconds(math.prod(tile), precision)
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
                    best = Tiling(tile, step, precision, error, digits, stack, bits, pieces)
                    best_cost = cost
                    break
    if best is None:
        raise OverflowError(f"no transform of a map of {tuple(shape)} cells keeps overlaps exact in float64")
    return best


@cache
def transform_seconds(size: int, precision: str) -> float:
    """Half of what a tile of so many points takes: one transform and its share of the rest."""
    known = SECONDS_A_POINT[precision]
    place = max(math.log2(size / SIZES[0]) / 2.0, 0.0)
    left = min(int(place), len(SIZES) - 2)
    # Between the sizes that were timed, and above the largest, the cost of a point goes on as it does around.
    return size * (known[left + 1] + (known[left + 1] - known[left]) * (place - left - 1)) + 0.5 * SECONDS_A_TILE


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
