"""Spectra of sampled descriptors.

What is transformed is ``h^dim sum over cells of f(x) delta(. - x)``, with the cells' middles x and their side h. Its
spectrum repeats with the period ``1 / h`` and is that of the function itself as far as that has no frequencies beyond
``1 / (2 h)``, and otherwise with those folded in.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.spectral.descriptors.checks import (
    LEAST_SPECTRUM_TOLERANCE,
    check_counts,
    check_fits,
    check_frequencies,
    check_lengths,
    check_spectrum_memory,
    check_tolerance,
    finufft_module,
    tolerance_to_ask,
    transform_threads,
)
from cspace.spectral.descriptors.descriptor import Descriptor, check_sampled

Complexes = NDArray[np.complex128]
Floats = NDArray[np.float64]

WHOLE: Final = 1e-12
"""Part of itself by which a period may miss a whole number of cells, from rounding, and still be one."""

ARRAYS: Final = 3.0
"""Complex arrays of the result's size that are held at once."""


def sampled_spectrum(descriptor: Descriptor, lengths: ArrayLike, counts: Any) -> Complexes:
    """Spectrum of a sampled descriptor on a lattice of frequencies, up to rounding.

    Axis by axis: by FFT where the period is a whole number of cells, else by a product with the matrix of waves.

    Parameters
    ----------
    descriptor : Descriptor
    lengths : array-like, shape (dim,), or one number
        Periods, metres, into which the grid must fit.
    counts : sequence of int, length dim, or one int
        Frequencies along each axis, as for :func:`ball_spectrum`; more than there are cells in a period repeat.

    Returns
    -------
    ndarray of complex128, shape counts
        ``F(k / lengths)`` in the order of :func:`numpy.fft.fftfreq`, metres to the power ``dim``.

    Raises
    ------
    InputError
        If a value is not usable, the grid does not fit into one period, or the result does not fit into memory.
    """
    grid = check_sampled(descriptor).grid
    periods, numbers = check_lengths(lengths, grid.dim), check_counts(counts, grid.dim)
    check_fits(np.array(grid.lower), np.array(grid.upper), periods)
    check_spectrum_memory(tuple(max(n, m) for n, m in zip(numbers, grid.shape, strict=True)), ARRAYS)
    spectrum: NDArray[Any] = descriptor.values * grid.spacing**grid.dim
    # The last axis is the one whose rows lie together.
    for axis in reversed(range(grid.dim)):
        spectrum = _along(spectrum, axis, grid.centers(axis), grid.spacing, float(periods[axis]), numbers[axis])
    return spectrum


def sampled_spectrum_at(descriptor: Descriptor, frequencies: ArrayLike, tolerance: float = 1e-9) -> Complexes:
    """Spectrum of a sampled descriptor at any frequencies, by a non-uniform FFT of type 2.

    Parameters
    ----------
    descriptor : Descriptor
    frequencies : array-like, shape (..., dim)
        Cycles per metre.
    tolerance : float
        Largest error, relative to the integral of the descriptor's modulus; from 1e-12 to 0.1.

    Returns
    -------
    ndarray of complex128, shape (...)
        Metres to the power ``dim``.

    Raises
    ------
    InputError
        If a value is not usable.
    MissingPackageError
        If finufft is not installed.
    """
    grid = check_sampled(descriptor).grid
    within = check_tolerance(tolerance, LEAST_SPECTRUM_TOLERANCE)
    waves = check_frequencies(frequencies, grid.dim)
    flat = waves.reshape(-1, grid.dim)
    if not flat.size:
        return np.zeros(waves.shape[:-1], dtype=np.complex128)
    transform = getattr(finufft_module(), f"nufft{grid.dim}d2")
    turns = flat * grid.spacing
    # Cell n // 2 of each axis stands at the transform's zero.
    middle = grid.center_of(np.array(grid.shape) // 2)
    angles = [np.ascontiguousarray(2.0 * math.pi * column) for column in (turns - np.round(turns)).T]
    asked = tolerance_to_ask(within)
    threads = transform_threads(descriptor.values.size + len(flat))
    sums = transform(*angles, descriptor.values.astype(np.complex128), eps=asked, isign=-1, nthreads=threads)
    phase = np.exp(-2j * math.pi * (flat @ middle))
    return np.asarray(grid.spacing**grid.dim * phase * sums).reshape(waves.shape[:-1])


def _along(values: NDArray[Any], axis: int, centers: Floats, spacing: float, period: float, count: int) -> Complexes:
    """Sums along one axis of ``value exp(-2 pi i k x / period)``."""
    from scipy import fft

    k = np.fft.fftfreq(count, 1.0 / count)
    cells = round(period / spacing)
    shape = [1] * values.ndim
    shape[axis] = count
    if cells >= len(centers) and abs(cells * spacing - period) <= WHOLE * period:
        sums = fft.fft(values, n=cells, axis=axis)
        sums = np.take(sums, k.astype(np.int64) % cells, axis=axis)
        return np.asarray(sums * np.exp(-2j * math.pi * k * centers[0] / period).reshape(shape))
    waves = np.exp(-2j * math.pi * k[:, None] * (centers / period))
    return np.ascontiguousarray(np.moveaxis(np.tensordot(waves, values, axes=(1, axis)), 0, axis))
