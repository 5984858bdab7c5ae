"""The frequencies of a period, from the lowest ring to the highest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False, slots=True)
class Rings:
    """Half of the frequencies ``k / lengths`` with ``|k| <= halves``, ordered by rings of their modulus.

    Descriptors are real, so that opposite frequencies have conjugate terms, and one of the two is enough: the one whose
    first entry that is not zero is above zero; and zero itself.

    Attributes
    ----------
    lengths : ndarray of float64, shape (d,)
        The period along each axis, metres.
    halves : tuple of int
        The highest frequency along each axis, in cycles per period.
    order : ndarray of int64, shape (n,)
        Which entry of the second half of a box of all frequencies, flattened, comes when.
    indices : ndarray of int16, shape (n, d)
        k, in the order of the rings.
    starts : ndarray of int64, shape (rings + 1,)
        Where each ring begins; the first is frequency zero alone.
    reaches : ndarray of int64, shape (rings, d)
        Largest modulus of k along each axis up to a ring.
    """

    lengths: Floats
    halves: tuple[int, ...]
    order: Ints
    indices: NDArray[np.int16]
    starts: Ints
    reaches: Ints

    @classmethod
    def of(cls, lengths: Floats, halves: tuple[int, ...]) -> Rings:
        """The rings of a period, each as wide as one cycle in its longest side."""
        axes = [np.arange(-half, half + 1, dtype=np.int16) for half in halves]
        box = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(halves))
        half = box[len(box) // 2 :]
        ring = np.ceil(np.linalg.norm(half / lengths, axis=1) * lengths.max() - 1e-9).astype(np.int64)
        order = np.argsort(ring, kind="stable")
        counts = np.bincount(ring)
        starts = np.concatenate([[0], np.cumsum(counts[counts > 0])])
        indices = np.ascontiguousarray(half[order])
        reaches = np.maximum.accumulate(np.maximum.reduceat(np.abs(indices), starts[:-1], axis=0), axis=0)
        return cls(lengths, halves, order, indices, starts, reaches.astype(np.int64))

    @property
    def counts(self) -> tuple[int, ...]:
        """Frequencies along each axis, both halves: odd numbers."""
        return tuple(2 * half + 1 for half in self.halves)

    @property
    def size(self) -> int:
        """How many frequencies there are; opposite ones count as one."""
        return len(self.order)

    @property
    def moduli(self) -> Floats:
        """|w| of each frequency, in the order of the rings, cycles per metre; shape (n,)."""
        return np.asarray(np.linalg.norm(self.indices / self.lengths, axis=1))

    @property
    def twice(self) -> Floats:
        """How often each frequency counts: once for zero, twice for those that stand for their opposites too."""
        weights = np.full(self.size, 2.0)
        weights[0] = 1.0
        return weights

    def sums(self, values: Floats) -> Floats:
        """Sum over each ring of values in the order of the rings, shape (rings,)."""
        return np.asarray(np.add.reduceat(values, self.starts[:-1]))

    def half_of(self, box: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """A spectrum over all frequencies, in numpy.fft's order, brought into the order of the rings."""
        flat = np.fft.fftshift(box).reshape(-1)
        return flat[len(flat) // 2 :][self.order]

    def box_of(self, half: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """The spectrum over all frequencies, zero in the middle, of a real function, from the half of it."""
        flat = np.empty(2 * self.size - 1, dtype=np.complex128)
        upper = flat[self.size - 1 :]
        upper[self.order] = half
        flat[: self.size - 1] = upper[:0:-1].conj()
        return flat.reshape(self.counts)
