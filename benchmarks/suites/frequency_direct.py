"""Direct sums, compiled and on all cores: the spectrum of balls, and the convolution of arrays."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from cspace.spectral import Bump

Complexes = NDArray[np.complex128]
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP = 2.0**-10
"""Of the table of a bump's spectrum: its cubic interpolation errs by less than 1e-10 of the value at 0."""

AT_ONCE = 2**22
"""Entries of a matrix of phases."""


@njit(cache=True, parallel=True)
def _plain(
    centers: Floats, starts: Ints, radii: Floats, weights: Floats, table: Floats, frequencies: Floats
) -> Complexes:
    """Term by term, all cores together; balls of one radius lie together, and their factor is looked up once."""
    out = np.zeros(len(frequencies), np.complex128)
    for n in prange(len(frequencies)):
        u, v, w = frequencies[n]
        modulus = math.sqrt(u * u + v * v + w * w)
        for part in range(len(radii)):
            real, imag = 0.0, 0.0
            for ball in range(starts[part], starts[part + 1]):
                angle = 2.0 * math.pi * (u * centers[ball, 0] + v * centers[ball, 1] + w * centers[ball, 2])
                real += math.cos(angle)
                imag -= math.sin(angle)
            at = radii[part] * modulus / STEP
            cell = int(at)
            x = at - cell
            near = (table[cell + 1] * (1.0 - x) + table[cell + 2] * x) * (1.0 + x) * (2.0 - x) / 2.0
            far = (table[cell] * (2.0 - x) + table[cell + 3] * (1.0 + x)) * x * (1.0 - x) / 6.0
            out[n] += weights[part] * (near - far) * complex(real, imag)
    return out


@njit(cache=True, parallel=True)
def convolution(f: Floats, g: Floats) -> Floats:
    """The whole convolution of two arrays of the plane, product by product."""
    out = np.zeros((f.shape[0] + g.shape[0] - 1, f.shape[1] + g.shape[1] - 1))
    for row in prange(len(out)):
        for i in range(max(0, row - len(f) + 1), min(len(g), row + 1)):
            for j in range(g.shape[1]):
                times = g[i, j]
                for k in range(f.shape[1]):
                    out[row, j + k] += times * f[row - i, k]
    return out


@dataclass(frozen=True)
class DirectSum:
    """The spectrum of balls on a lattice of frequencies, summed.

    Attributes
    ----------
    centers : ndarray, shape (n, 3)
        Ordered by radius; the last column is zero in the plane.
    starts : ndarray of int64, shape (classes + 1,)
        Where the balls of each radius begin.
    radii : ndarray, shape (classes,)
    bump : Bump
    table : ndarray
        The spectrum of a ball of radius 1 at ``-STEP``, 0, ``STEP`` and so on.
    length : float
        The period, metres.
    count : int
        Frequencies along each axis.
    dim : int
    """

    centers: Floats
    starts: Ints
    radii: Floats
    bump: Bump
    table: Floats
    length: float
    count: int
    dim: int

    @classmethod
    def of(cls, centers: Floats, radii: Floats, bump: Bump, length: float, count: int) -> DirectSum:
        """All that can be done before the first frequency."""
        order = np.argsort(radii, kind="stable")
        sizes, starts = np.unique(radii[order], return_index=True)
        dim = centers.shape[1]
        padded = np.pad(centers[order], ((0, 0), (0, 3 - dim)))
        most = float(sizes[-1]) * math.sqrt(dim) * (count // 2) / length
        nodes = STEP * np.abs(np.arange(-1.0, most / STEP + 4.0))
        table = bump.table(dim, float(nodes.max()), 1e-13)(nodes)
        return cls(padded, np.append(starts, len(order)), sizes, bump, table, length, count, dim)

    def plain(self, places: Ints) -> Complexes:
        """At some places of the flattened lattice, over all pairs of a ball and a frequency."""
        frequencies = np.zeros((len(places), 3))
        for axis, index in enumerate(np.unravel_index(places, (self.count,) * self.dim)):
            frequencies[:, axis] = self._waves[index]
        return np.asarray(_plain(self.centers, self.starts, self.radii, self.radii**self.dim, self.table, frequencies))

    def by_products(self, planes: int) -> Complexes:
        """At the first so many frequencies of the first axis, with all of the others: for each radius, the phases are
        products of one for each axis, and their sums are products of matrices."""
        waves = [self._waves[:planes], *[self._waves] * (self.dim - 1)]
        moduli = np.sqrt(sum(part * part for part in np.meshgrid(*waves, indexing="ij", sparse=True)))
        total = np.zeros(moduli.shape, dtype=np.complex128)
        for radius, start, stop in zip(self.radii.tolist(), self.starts[:-1], self.starts[1:], strict=True):
            sums = np.zeros(moduli.shape, dtype=np.complex128)
            step = max(1, AT_ONCE // (moduli.size // planes))
            for first in range(start, stop, step):
                part = self.centers[first : min(first + step, stop)]
                factors = [np.exp(-2j * math.pi * wave[:, None] * part[:, axis]) for axis, wave in enumerate(waves)]
                rest = factors[1]
                if self.dim == 3:
                    rest = (rest[:, None] * factors[2][None]).reshape(-1, len(part))
                sums += (factors[0] @ rest.T).reshape(sums.shape)
            table = self.bump.table(self.dim, radius * float(moduli.max()), 1e-13)
            total += radius**self.dim * table(radius * moduli) * sums
        return total

    @property
    def _waves(self) -> Floats:
        return np.asarray(np.fft.fftfreq(self.count, 1.0 / self.count) / self.length)
