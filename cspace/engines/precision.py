"""How far a correlation by FFT can be from the integer that it stands for.

A tile of ``W - 1/2`` (values of modulus 1/2, so 2-norm ``sqrt(T) / 2`` for T cells) is correlated with a robot bitmap
``A`` (2-norm ``sqrt(count)``). Let ``u`` be the unit roundoff and write each transform as passes over the prime factors
of its lengths, every pass a set of small butterflies followed by twiddle factors.

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

import math
from collections.abc import Sequence
from functools import cache

MARGIN = 0.25
"""Largest proven error with which overlaps, being whole numbers, are taken from a transform."""

UNIT_ROUNDOFF = {"float32": 2.0**-24, "float64": 2.0**-53}

SUM_BITS = 50
"""Bits that the overlaps with several rasters may take together, as digits of one sum."""

_PASS = {2: 4.3, 3: 14.0, 5: 23.0}


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
