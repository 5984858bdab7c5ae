"""Tilings: transform lengths, chosen by what transforms cost, whose results are proven to come out whole.

*How far a correlation by FFT can be from the integer that it stands for.* A tile of ``W - 1/2`` (values of modulus 1/2,
so 2-norm ``sqrt(T) / 2`` for T cells) is correlated with a robot bitmap ``A`` (2-norm ``sqrt(count)``). Let ``u`` be
the unit roundoff and write each transform as passes over the prime factors of its lengths, every pass a set of small
butterflies followed by twiddle factors.

* *One pass.* A complex addition has relative error u, a complex product sqrt(5) u (Brent, Percival and Zimmermann,
  2007), a stored twiddle factor u. A radix-2 butterfly therefore perturbs its result by at most (1 + sqrt(5) + 1) u
  = 4.3 u, relative to the 2-norm and equally relative to the sum of the moduli of its inputs; radices 4 and 8 are
  cheaper than two and three such passes. Radix 3 and 5 butterflies, as sums of at most 5 products in any order, stay
  below 12 u and 19 u in the 2-norm; 14 and 23 are used.
* *Forward.* Passes are multiples of unitary maps, so their errors add: the spectrum of the tile has relative 2-norm
  error at most ``g u``, with ``g`` the sum of the pass constants (Higham, 2002, theorem 24.2, has the same shape with a
  larger constant). Lines and layers of the tile that are constant are not transformed: what they would yield is a
  multiple of 1/2, and exact. The robot's spectrum is computed in float64 and rounded once.
* *Product.* By Cauchy-Schwarz the errors of both spectra change the exact inverse transform, at any point, by at most
  ``(g + 1) u |W - 1/2| |A|``; the product's own rounding adds ``sqrt(5) u |W - 1/2| |A|``.
* *Inverse.* Each result is a sum over paths through the passes, so its error is at most ``g u`` times the mean modulus
  of the product, which Cauchy-Schwarz again bounds by ``|W - 1/2| |A|``.

Together ``(2 g + 8) u |W - 1/2| |A|``, where 8 covers the terms of order one (product, scaling, conversions) and those
of second order. In float64 the robot's spectrum is not better than the tile's, which adds another ``g``.

*Several rasters, or tiles, in one transform.* With overlaps below ``B = 2^b``, the digits to base ``B`` of the overlap
with ``A_0 + B A_1 + B^2 A_2 + ...`` are the overlaps with ``A_0``, ``A_1``, ... So where the error of the sum, whose
2-norm is at most ``(1 + B + B^2 + ...) |A|``, is below 1/4, one transform yields them all. In the same way a tile can
hold several of the map, ``(W_0 - 1/2) + B (W_1 - 1/2) + ...``; with n rasters, and B^n for B, there is a digit for each
tile and raster. Float64 costs half as much again as float32 and often carries three or four digits. Sums stay below
2^50, so that adding what the transform left out, in float64, costs at most another 1/8.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final

MARGIN = 0.25
"""Largest proven error with which overlaps, being whole numbers, are taken from a transform."""

UNIT_ROUNDOFF = {"float32": 2.0**-24, "float64": 2.0**-53}

SUM_BITS = 50
"""Bits that the overlaps with several rasters may take together, as digits of one sum."""

_PASS = {2: 4.3, 3: 14.0, 5: 23.0}

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


@cache
def growth(length: int) -> float:
    """Sum of the pass constants of a transform whose length has no prime factor above 5."""
    total = 0.0
    for prime, constant in _PASS.items():
        while length % prime == 0:
            length //= prime
            total += constant
    if length != 1:
        raise ValueError(f"transform length has the prime factor {length}; lengths are products of 2, 3 and 5")
    return total


def error_bound(tile: Sequence[int], count: int, precision: str, digits: int = 1) -> float:
    """Largest error of an overlap, or of a sum of several as digits, that a tile's transforms can make.

    ``tile`` are the transforms' lengths, and ``count`` is the number of offsets in the robot's raster; the largest, for
    several. There are so many ``digits``: those of rasters that share a transform, times those of the tiles.
    """
    passes = sum(growth(length) for length in tile)
    transforms = 2 if precision == "float32" else 3
    norms = math.sqrt(math.prod(tile)) / 2.0 * math.sqrt(count)
    norms *= sum(2.0 ** (count.bit_length() * k) for k in range(digits))
    return (transforms * passes + 8.0) * UNIT_ROUNDOFF[precision] * norms
