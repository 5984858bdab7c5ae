"""The algebra of descriptors: union, intersection, Minkowski sum, and the shapes that they stand for.

With ``U_t(f) = {x : f(x) > t}`` and descriptors that are nowhere below zero, ``U_0(f + g) = U_0(f) | U_0(g)``,
``U_0(f g) = U_0(f) & U_0(g)``, and ``U_0(f * g)`` is the Minkowski sum of ``U_0(f)`` and ``U_0(g)`` (Lysenko, 2013).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.errors import InputError
from cspace.grid import Grid, finite
from cspace.spectral.descriptors.balls import BallDescriptor
from cspace.spectral.descriptors.descriptor import Descriptor, check_sampled

Floats = NDArray[np.float64]

SAME: Final = 1e-9
"""Part of a cell or of the spacing by which grids may differ, from rounding, and still be the same."""

MOST_WHOLE: Final = 2.0**40
"""Product of 2-norms up to which transforms in float64 leave whole sums whole: their error is below 1000 rounding units
of it (:mod:`cspace.fourier.precision`), so below an eighth."""

_TINY: Final = float(np.finfo(np.float64).tiny)


def union(first: Descriptor | BallDescriptor, *others: Descriptor | BallDescriptor) -> Descriptor | BallDescriptor:
    """The sum of descriptors.

    Parameters
    ----------
    first, *others : Descriptor, all on one grid; or BallDescriptor, all of one bump

    Returns
    -------
    Descriptor or BallDescriptor
        Of the kind of the arguments: the sum of balls' bumps is that of all balls.

    Raises
    ------
    InputError
        If the kinds, grids, bumps or dimensions differ.
    """
    given = (first, *others)
    balls = [each for each in given if isinstance(each, BallDescriptor)]
    if len(balls) != len(given):
        sampled = _on_one_grid(given)
        return Descriptor(sampled[0].grid, reduce(np.add, [each.values for each in sampled]))
    for each in balls[1:]:
        if each.bump != balls[0].bump or each.dim != balls[0].dim:
            raise InputError(
                f"the union is of {balls[0].bump} in {balls[0].dim} dimensions and {each.bump} in {each.dim}; both "
                "must be the same; sample them on one grid first"
            )
    return BallDescriptor(
        np.concatenate([each.centers for each in balls]), np.concatenate([each.radii for each in balls]), balls[0].bump
    )


def intersection(first: Descriptor, *others: Descriptor) -> Descriptor:
    """The product of descriptors on one grid.

    Raises
    ------
    InputError
        If one is not sampled (the product of two bumps is no bump), or the grids differ.
    """
    sampled = _on_one_grid((first, *others))
    return Descriptor(sampled[0].grid, reduce(np.multiply, [each.values for each in sampled]))


def superlevel(descriptor: Descriptor, threshold: float = 0.0) -> NDArray[np.bool_]:
    """``U_t``: the cells at whose middle a descriptor is above a threshold, which itself does not count.

    Parameters
    ----------
    descriptor : Descriptor
    threshold : float

    Returns
    -------
    ndarray of bool, shape descriptor.grid.shape

    Raises
    ------
    InputError
        If the descriptor is not sampled, or the threshold is not one finite number.
    """
    (sampled,) = _on_one_grid((descriptor,))
    level = finite(threshold, "threshold")
    if level.ndim:
        raise InputError(f"threshold is {threshold!r}; it must be one number; pass e.g. 0.0")
    return np.asarray(sampled.values > level)


def minkowski_sum(first: Descriptor, second: Descriptor, method: str = "fft") -> Descriptor:
    """The convolution ``h(x) = integral f(y) g(x - y) dy`` of descriptors on grids of one spacing.

    The integral is the sum over cells, times their measure. The grid of the result is larger: it holds every sum of a
    cell of one and a cell of the other, and the middles of its cells are sums of theirs.

    Where all values are whole numbers (indicators), the sums are whole numbers too and are rounded to them: exact, also
    by FFT, for ``|f|_2 |g|_2`` below 2^40. Where no value is below zero, the cells in which the sum is above zero are
    exactly the Minkowski sum of those of ``first`` and ``second``: FFT's rounding, about 1e-16 of ``|f|_2 |g|_2``,
    neither adds cells nor loses any.

    Parameters
    ----------
    first, second : Descriptor
    method : {"fft", "direct"}
        "direct" sums one product after the other, which pays where both are small, or one is a few cells large.

    Returns
    -------
    Descriptor

    Raises
    ------
    InputError
        If a descriptor is not sampled, the dimensions or spacings differ, or ``method`` is neither word.
    """
    f, g = (check_sampled(each).grid for each in (first, second))
    if f.dim != g.dim or abs(f.spacing - g.spacing) * max(f.shape + g.shape) > SAME * f.spacing:
        raise InputError(
            f"one grid has {f.dim} axes and a spacing of {f.spacing:g} m, the other {g.dim} and {g.spacing:g} m; both "
            "must be the same; sample the descriptors alike"
        )
    if method not in _METHODS:
        raise InputError(f"method is {method!r}; it must be one of {', '.join(map(repr, _METHODS))}; pass 'fft'")
    lower = np.add(f.lower, g.lower) + 0.5 * f.spacing
    grid = Grid(lower, f.spacing, [n + m - 1 for n, m in zip(f.shape, g.shape, strict=True)])
    return Descriptor(grid, _convolution(first.values, second.values, _METHODS[method]) * f.spacing**f.dim)


def _convolution(f: Floats, g: Floats, convolve: Callable[[Any, Any], Any]) -> Floats:
    """Sums over cells, rounded and cut as :func:`minkowski_sum` tells."""
    sums = np.asarray(convolve(f, g))
    if _are_whole(f) and _are_whole(g) and np.linalg.norm(f) * np.linalg.norm(g) < MOST_WHOLE:
        return np.asarray(np.rint(sums))
    if (f < 0.0).any() or (g < 0.0).any():
        return sums
    pairs = _by_fft((f > 0.0).astype(np.float64), (g > 0.0).astype(np.float64))
    return np.asarray(np.where(pairs > 0.5, np.maximum(sums, _TINY), 0.0))


def _by_fft(f: Floats, g: Floats) -> Any:
    from scipy.signal import fftconvolve

    return fftconvolve(f, g)


def _by_sums(f: Floats, g: Floats) -> Any:
    from scipy.signal import convolve, convolve2d

    # In the plane there is a quicker loop than the one for all dimensions.
    return convolve2d(f, g) if f.ndim == 2 else convolve(f, g, method="direct")


_METHODS: Final[dict[str, Callable[[Any, Any], Any]]] = {"fft": _by_fft, "direct": _by_sums}


def _are_whole(values: Floats) -> bool:
    return bool(np.array_equal(values, np.rint(values)))


def _on_one_grid(given: tuple[Any, ...]) -> list[Descriptor]:
    """The descriptors, all sampled on the grid of the first."""
    sampled = [check_sampled(each) for each in given]
    grid = sampled[0].grid
    for other in (each.grid for each in sampled):
        if grid.shape != other.shape or not (
            np.allclose(grid.lower, other.lower, rtol=0.0, atol=SAME * grid.spacing)
            and abs(grid.spacing - other.spacing) * max(grid.shape) <= SAME * grid.spacing
        ):
            raise InputError(
                f"a descriptor is on {other} and another on {grid}; all must be on one grid; sample them alike"
            )
    return sampled
