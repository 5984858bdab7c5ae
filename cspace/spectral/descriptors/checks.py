"""Numbers that a caller passes, checked, and the optional package of non-uniform transforms."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError, MissingPackageError
from cspace.grid import Grid, finite
from cspace.memory import KEEP, cells_of, free_bytes, in_words
from cspace.shapes import check_balls
from cspace.threads import cores

Floats = NDArray[np.float64]

LEAST_TOLERANCE: Final = 1e-13
"""Below this, rounding in float64 leaves nothing to ask for."""

LEAST_SPECTRUM_TOLERANCE: Final = 1e-12
"""Of non-uniform transforms, whose rounding is larger."""

MOST_TOLERANCE: Final = 0.1

STRICTER: Final = 0.03
"""Part of a tolerance that is asked of a non-uniform transform, whose own tolerance is that of a 2-norm: single values
were seen to err by up to seven times that."""

LEAST_ASKED: Final = 2e-14
"""Less is not asked of a non-uniform transform: rounding would be left."""

FIT_SLACK: Final = 1e-9
"""Part of a period by which a body may be longer, from rounding."""

COMPLEX_BYTES: Final = 16

THREADED: Final = 2**19
"""Samples of a transform from which on several threads pay: they wait for each other, for long on a busy machine."""


def check_tolerance(tolerance: Any, least: float = LEAST_TOLERANCE) -> float:
    """A relative tolerance from ``least`` to 0.1."""
    value = finite(tolerance, "tolerance")
    if value.ndim or not least <= value <= MOST_TOLERANCE:
        raise InputError(
            f"tolerance is {tolerance!r}; it must be one number from {least:g} to {MOST_TOLERANCE:g}, for it is "
            "relative to the largest value; pass e.g. 1e-9"
        )
    return float(value)


def check_dim(dim: Any) -> int:
    """2 or 3."""
    if isinstance(dim, bool) or dim not in (2, 3):
        raise InputError(f"dim is {dim!r}; descriptors live in the plane or in space; pass 2 or 3")
    return int(dim)


def check_not_below_zero(values: ArrayLike, name: str) -> Floats:
    """Finite numbers, none below zero, of any shape."""
    array = finite(values, name)
    if (array < 0.0).any():
        raise InputError(f"{name} holds {array.min():g}; none may be below zero; pass the modulus")
    return array


def check_solid_balls(centers: ArrayLike, radii: ArrayLike) -> tuple[Floats, Floats]:
    """Copies of the centers, shape (n, dim), and radii above zero, shape (n,), of balls."""
    points, sizes = check_balls(centers, radii)
    if (sizes <= 0.0).any():
        raise InputError(f"radii holds {sizes.min():g}; each must be above zero; drop balls that have no volume")
    return points, sizes


def check_lengths(lengths: ArrayLike, dim: int) -> Floats:
    """Periods along the axes, above zero, shape (dim,); one number stands for all."""
    periods = finite(lengths, "lengths")
    if periods.shape not in {(), (dim,)} or (periods <= 0.0).any():
        raise InputError(
            f"lengths is {lengths!r}; it must be one number above zero or {dim} of them, in metres; pass the period "
            "along each axis"
        )
    return np.broadcast_to(periods, dim).copy()


def check_counts(counts: Any, dim: int) -> tuple[int, ...]:
    """Numbers of frequencies along the axes; one stands for all."""
    numbers = np.asarray(counts)
    if numbers.shape not in {(), (dim,)} or numbers.dtype.kind not in "iu" or (numbers <= 0).any():
        raise InputError(
            f"counts is {counts!r}; it must be one whole number above zero or {dim} of them; pass how many frequencies "
            "each axis has, e.g. 256"
        )
    return tuple(int(n) for n in np.broadcast_to(numbers, dim))


def check_frequencies(frequencies: ArrayLike, dim: int) -> Floats:
    """Frequencies, shape (..., dim)."""
    return check_vectors(frequencies, "frequencies", dim, "pass cycles per metre")


def check_vectors(vectors: ArrayLike, name: str, dim: int, mend: str) -> Floats:
    """Points or frequencies, shape (..., dim)."""
    array = finite(vectors, name)
    if array.ndim == 0 or array.shape[-1] != dim:
        raise InputError(
            f"{name} has shape {array.shape}; its last axis must be {dim} long, one entry for each coordinate; {mend}"
        )
    return array


def check_axes(grid: Grid, dim: int, what: str) -> None:
    """Refuse a grid in the plane for what is in space, or the other way around."""
    if dim != grid.dim:
        raise InputError(
            f"the {what} has {dim} coordinates and the grid has {grid.dim} axes; both must be the same; pass a grid "
            f"for the {what}"
        )


def check_fits(lower: Floats, upper: Floats, lengths: Floats) -> None:
    """Refuse what does not fit into one period: its Fourier series would be that of something that overlaps itself."""
    sizes = upper - lower
    if (sizes > lengths * (1.0 + FIT_SLACK)).any():
        axis = int(np.argmax(sizes / lengths))
        raise InputError(
            f"what is transformed is {sizes[axis]:g} m long along {'xyz'[axis]} and the period is {lengths[axis]:g} m; "
            "it must fit into one period, wherever it lies, or it would wrap around onto itself; pass a longer period"
        )


def check_spectrum_memory(counts: tuple[int, ...], arrays: float) -> None:
    """Refuse a grid of frequencies that does not fit into memory.

    Parameters
    ----------
    counts : tuple of int
    arrays : float
        How many complex arrays of that size are held at once.
    """
    free = free_bytes()
    needed = COMPLEX_BYTES * arrays * float(cells_of(counts))
    if free is not None and needed > KEEP * free:
        raise InputError(
            f"a spectrum of {' x '.join(map(str, counts))} frequencies needs about {in_words(needed)} of memory, of "
            f"which {in_words(free)} are free; it must fit; pass smaller counts"
        )


def transform_threads(samples: float) -> int:
    """Threads that a non-uniform transform shall take, by its grid's samples and points together."""
    return cores() if samples >= THREADED else 1


def finufft_module() -> Any:
    """The package finufft (Barnett, Magland and af Klinteberg, 2019), of non-uniform fast Fourier transforms.

    Raises
    ------
    MissingPackageError
        If it is not installed.
    """
    try:
        import finufft
    except ImportError as error:
        raise MissingPackageError(
            "spectra at centers that lie on no lattice need the package finufft, which is not installed; "
            'install it with: pip install "cspace[spectral]"'
        ) from error
    return finufft


def tolerance_to_ask(tolerance: float) -> float:
    """What to ask of a non-uniform transform, whose errors shall stay below a part of the sum of all moduli."""
    return max(LEAST_ASKED, STRICTER * tolerance)
