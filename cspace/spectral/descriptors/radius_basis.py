"""Many radii by few: the radial spectra of balls of all radii as combinations of a few functions.

As a function of the radius, ``psi^(r |w|)`` is a mixture of exponentials that turn by at most ``2 pi |w| r``. So it is
interpolated between Chebyshev nodes ``rho_q`` in the radius with the same proven error as in the frequency
(:mod:`cspace.spectral.descriptors.radial_table`), ``psi^(r |w|) = sum over q of l_q(r) psi^(rho_q |w|)``. A singular
value decomposition of the nodes' spectra leaves as many combinations as the tolerance needs, and each of these is one
non-uniform FFT of all centres, with strengths that depend on the radii.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cspace.spectral.descriptors.bump import Bump
from cspace.spectral.descriptors.checks import LEAST_TOLERANCE
from cspace.spectral.descriptors.radial_table import HALF, RadialTable, nodes_needed, table_points

Floats = NDArray[np.float64]

SHARE: Final = 0.02
"""Part of the tolerance for each of: the spectra, the nodes, the decomposition, and the tables of its functions. Errors
of the first three grow by the nodes' Lebesgue constant, below 6 for a thousand of them."""

MOST_NODES: Final = 6.0
"""Nodes, for each transform that radii by themselves would take, beyond which no basis is sought."""

SAMPLES: Final = 4
"""Frequencies at which spectra are decomposed, for each node."""


@dataclass(frozen=True, eq=False)
class RadiusBasis:
    """Functions of the frequency of which the spectra of all radii are combinations.

    Attributes
    ----------
    middle, half : float
        Of the interval of radii, metres.
    dim : int
    combinations : ndarray, shape (nodes, n)
        Orthonormal columns: what each function takes of the nodes' spectra.
    largest : float
        Radius, metres.
    tables : tuple of RadialTable
        The functions, of ``largest * |w|``.
    """

    middle: float
    half: float
    dim: int
    combinations: Floats
    largest: float
    tables: tuple[RadialTable, ...]

    @classmethod
    def of(cls, bump: Bump, radii: Floats, most: float, dim: int, tolerance: float, alone: float) -> RadiusBasis | None:
        """The basis for radii and frequencies up to ``most``, or None where it takes ``alone`` functions or more."""
        least, largest = float(radii.min()), float(radii.max())
        middle, half = 0.5 * (least + largest), 0.5 * (largest - least)
        within = SHARE * tolerance
        count = nodes_needed(within, 2.0 * math.pi * most * half)
        if count > MOST_NODES * alone:
            return None
        spectrum = bump.table(dim, largest * most + 2.0 * HALF, max(LEAST_TOLERANCE, within))
        nodes = middle + half * np.cos(_angles(count))
        samples = most * np.linspace(0.0, 1.0, SAMPLES * count)
        values = spectrum(nodes[:, None] * samples)
        left, sizes, _ = np.linalg.svd(values, full_matrices=False)
        rank = int(np.count_nonzero(sizes > within * values[0, 0]))
        if rank >= alone:
            return None
        combinations = np.ascontiguousarray(left[:, :rank])
        # Of unit band limit, as a table asks, in cycles per largest radius.
        points = table_points(largest * most, within / math.sqrt(count))
        known = spectrum((nodes / largest)[:, None, None] * points)
        tables = tuple(RadialTable(each, largest * most) for each in np.einsum("qc,qij->cij", combinations, known))
        return cls(middle, half, dim, combinations, largest, tables)

    def terms(self, radii: Floats) -> Iterator[tuple[Floats, Callable[[Floats], Floats]]]:
        """For each function the strengths of the balls, shape (n,), and the function of ``|w|``."""
        count = len(self.combinations)
        degrees = np.arange(count)
        to_coefficients = 2.0 / count * np.cos(degrees[:, None] * _angles(count))
        to_coefficients[0] /= 2.0
        position = np.clip((radii - self.middle) / self.half, -1.0, 1.0)
        coefficients = to_coefficients @ self.combinations
        strengths = np.polynomial.chebyshev.chebval(position, coefficients) * radii**self.dim
        for row, table in zip(strengths, self.tables, strict=True):
            yield row, partial(_scaled, table, self.largest)


def _angles(count: int) -> Floats:
    return math.pi * (np.arange(count) + 0.5) / count


def _scaled(table: RadialTable, largest: float, moduli: Floats) -> Floats:
    return table(largest * moduli)
