"""Compiled sums over frequencies, ring by ring."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Shorts = NDArray[np.int16]
Complexes = NDArray[np.complex128]

MISS, HIT, UNDECIDED = 0, 1, 2


@njit(cache=True, nogil=True)
def add_phases(shares: Floats, first: Ints, last: Ints, phases: Complexes) -> None:
    """Set ``phases[axis, middle + k]`` to exp(2 pi i k shares[axis]) for ``first[axis] <= |k| <= last[axis]``.

    ``shares`` is the placement in periods. Each factor is computed by itself, so that errors do not add up.
    """
    middle = phases.shape[1] // 2
    for axis in range(len(shares)):
        for k in range(first[axis], last[axis] + 1):
            turns = k * shares[axis]
            angle = 2.0 * math.pi * (turns - round(turns))
            value = complex(math.cos(angle), math.sin(angle))
            phases[axis, middle + k] = value
            phases[axis, middle - k] = value.conjugate()


@njit(cache=True, nogil=True)
def add_terms(products: Complexes, indices: Shorts, phases: Complexes, start: int, stop: int) -> float:
    """Sum of the real parts of ``products * exp(2 pi i k.t)`` over a stretch of frequencies."""
    middle = phases.shape[1] // 2
    total = 0.0
    if len(phases) == 2:
        for n in range(start, stop):
            turn = phases[0, middle + indices[n, 0]] * phases[1, middle + indices[n, 1]]
            total += products[n].real * turn.real - products[n].imag * turn.imag
    else:
        for n in range(start, stop):
            turn = phases[0, middle + indices[n, 0]] * phases[1, middle + indices[n, 1]]
            turn *= phases[2, middle + indices[n, 2]]
            total += products[n].real * turn.real - products[n].imag * turn.imag
    return total


@njit(cache=True, nogil=True)
def sum_of_terms(shares: Floats, products: Complexes, indices: Shorts, reaches: Ints) -> float:
    """The sum over all frequencies, with ``reaches`` the highest along each axis."""
    phases = np.empty((len(shares), 2 * reaches.max() + 1), np.complex128)
    add_phases(shares, np.zeros_like(reaches), reaches, phases)
    return add_terms(products, indices, phases, 0, len(products))


@njit(cache=True, nogil=True)
def sum_of_slopes(
    shares: Floats, products: Complexes, indices: Shorts, reaches: Ints, lengths: Floats, out: Floats
) -> None:
    """Derivatives along each axis of :func:`sum_of_terms`."""
    phases = np.empty((len(shares), 2 * reaches.max() + 1), np.complex128)
    add_phases(shares, np.zeros_like(reaches), reaches, phases)
    middle = phases.shape[1] // 2
    out[:] = 0.0
    for n in range(len(products)):
        turn = products[n]
        for axis in range(len(shares)):
            turn *= phases[axis, middle + indices[n, axis]]
        for axis in range(len(shares)):
            out[axis] -= indices[n, axis] * turn.imag
    out *= 2.0 * math.pi / lengths


@njit(cache=True, nogil=True)
def is_apart(place: Floats, centers: Floats, radii: Floats, reach: float) -> bool:
    """Whether a ball of radius ``reach`` at ``place`` meets no ball: whether a point lies in none that is swollen."""
    for n in range(len(centers)):
        square = 0.0
        for axis in range(len(place)):
            gap = centers[n, axis] - place[axis]
            square += gap * gap
        far = reach + radii[n]
        if square <= far * far:
            return False
    return True


@njit(cache=True, nogil=True)
def separate(
    place: Floats,
    far: float,
    products: Complexes,
    indices: Shorts,
    starts: Ints,
    reaches: Ints,
    lengths: Floats,
    tails: Floats,
    slacks: Floats,
    threshold: float,
    phases: Complexes,
) -> tuple[int, int, float, float]:
    """Sum ring after ring until the sum decides.

    Parameters
    ----------
    place : ndarray, shape (d,)
        Placement relative to the middles, metres.
    far : float
        By how much rounding may have moved it.
    products, tails, slacks : ndarray
        As in :class:`cspace.spectral.separation.terms.Terms`.
    indices, starts, reaches, lengths : ndarray
        As in :class:`cspace.spectral.separation.rings.Rings`.
    threshold : float
    phases : ndarray of complex128, shape (d, 2 m + 1)
        Room for the phases, with m the highest frequency of an axis.

    Returns
    -------
    verdict, number of frequencies, sum, bound
    """
    shares = place / lengths
    first = np.zeros(len(place), np.int64)
    total = 0.0
    bound = tails[0]
    for ring in range(len(starts) - 1):
        add_phases(shares, first, reaches[ring], phases)
        first = reaches[ring] + 1
        total += add_terms(products, indices, phases, starts[ring], starts[ring + 1])
        bound = tails[ring + 1] + slacks[ring + 1, 0] + slacks[ring + 1, 1] * far
        if total + bound < threshold:
            return MISS, starts[ring + 1], total, bound
        if total - bound > threshold:
            return HIT, starts[ring + 1], total, bound
    return UNDECIDED, starts[-1], total, bound


@njit(cache=True, nogil=True)
def separate_all(
    places: Floats,
    fars: Floats,
    limits: Floats,
    centers: Floats,
    radii: Floats,
    reach: float,
    products: Complexes,
    indices: Shorts,
    starts: Ints,
    reaches: Ints,
    lengths: Floats,
    tails: Floats,
    slacks: Floats,
    threshold: float,
    verdicts: NDArray[np.uint8],
    counts: Ints,
    sums: Floats,
) -> None:
    """A verdict for each placement: where the swollen balls prove no miss, by :func:`separate`.

    Parameters
    ----------
    places : ndarray, shape (n, d)
    fars : ndarray, shape (n,)
    limits : ndarray, shape (d,)
        Beyond these moduli of the placement there is no overlap.
    centers, radii : ndarray, shape (k, d) and (k,)
        Balls of B, relative to its middle.
    reach : float
        Radius of a ball around the middle of A that holds A, rounding included.
    verdicts, counts : ndarray, shape (n,)
    sums : ndarray, shape (n, 2)
        Sum and bound.
    """
    phases = np.empty((len(lengths), 2 * reaches[-1].max() + 1), np.complex128)
    for n in range(len(places)):
        place = places[n]
        verdicts[n], counts[n], sums[n, 0], sums[n, 1] = MISS, 0, 0.0, tails[0]
        if np.all(np.abs(place) <= limits) and not is_apart(place, centers, radii, reach):
            verdict, count, total, bound = separate(
                place, fars[n], products, indices, starts, reaches, lengths, tails, slacks, threshold, phases
            )
            verdicts[n], counts[n], sums[n, 0], sums[n, 1] = verdict, count, total, bound


@njit(cache=True, nogil=True)
def _share(place: float, lower: float, spacing: float, count: int) -> tuple[int, float]:
    """The cell whose middle lies below a coordinate, and how far it is to the next one, 0 to 1."""
    cells = min(max((place - lower) / spacing - 0.5, 0.0), count - 1.0)
    first = min(int(cells), max(count - 2, 0))
    return first, cells - first


@njit(cache=True, nogil=True)
def field_at(values: Floats, slice_of: Ints, borders: Floats, frame: Floats, x: float, y: float, z: float) -> float:
    """A field, linear between the middles of cells, at ``(x, y, z)`` or, with borders of yaw cells, ``(x, y, yaw)``.

    Parameters
    ----------
    values : ndarray, shape (slices, nx, ny, nz)
    slice_of : ndarray of int64, shape (rotations,)
    borders : ndarray, shape (rotations + 1,) or (0,)
    frame : ndarray
        Lower corner, and the spacing.
    """
    turn = 0
    spacing = frame[-1]
    if len(borders):
        full = 2.0 * math.pi
        wrapped = z - np.floor((z - borders[0]) / full) * full
        turn = min(max(np.searchsorted(borders, wrapped, side="right") - 1, 0), len(borders) - 2)
    part = values[slice_of[turn]]
    i, a = _share(x, frame[0], spacing, part.shape[0])
    j, b = _share(y, frame[1], spacing, part.shape[1])
    k, c = 0, 0.0
    if part.shape[2] > 1:
        k, c = _share(z, frame[2], spacing, part.shape[2])
    total = 0.0
    for di in range(2):
        for dj in range(2):
            for dk in range(2):
                share = (a if di else 1.0 - a) * (b if dj else 1.0 - b) * (c if dk else 1.0 - c)
                if share > 0.0:
                    total += share * part[i + di, j + dj, k + dk]
    return max(total, 0.0)


@njit(cache=True, nogil=True)
def field_of_two(values: Floats, slice_of: Ints, borders: Floats, frame: Floats, x: float, y: float) -> float:
    """:func:`field_at` of a robot that only translates in the plane."""
    return field_at(values, slice_of, borders, frame, x, y, 0.0)


@njit(cache=True, nogil=True)
def field_of_three(
    values: Floats, slice_of: Ints, borders: Floats, frame: Floats, x: float, y: float, z: float
) -> float:
    """:func:`field_at` in space, or of a robot that turns."""
    return field_at(values, slice_of, borders, frame, x, y, z)


@njit(cache=True, nogil=True)
def field_values(values: Floats, slice_of: Ints, borders: Floats, frame: Floats, points: Floats, out: Floats) -> int:
    """:func:`field_at` for many configurations; the index of the first that is not finite, or -1."""
    for n in range(len(points)):
        if not np.all(np.isfinite(points[n])):
            return n
        z = points[n, 2] if points.shape[1] == 3 else 0.0
        out[n] = field_at(values, slice_of, borders, frame, points[n, 0], points[n, 1], z)
    return -1
