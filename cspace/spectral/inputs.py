"""Arguments of the frequency domain, checked."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.grid import Grid, finite

Floats = NDArray[np.float64]

LEAST_TOLERANCE: Final = 1e-13
"""Below this, rounding in float64 leaves nothing to ask for."""

MOST_TOLERANCE: Final = 0.1


def check_tolerance(tolerance: Any, least: float = LEAST_TOLERANCE) -> float:
    """A relative tolerance from ``least`` to 0.1."""
    value = finite(tolerance, "tolerance")
    if value.ndim or not least <= value <= MOST_TOLERANCE:
        raise InputError(
            "tolerance",
            f"is {tolerance!r}",
            f"it must be one number from {least:g} to {MOST_TOLERANCE:g}, for it is relative to the largest value",
            "pass e.g. 1e-9",
            value=tolerance,
        )
    return float(value)


def check_dim(dim: Any) -> int:
    """2 or 3."""
    if isinstance(dim, bool) or dim not in (2, 3):
        raise InputError("dim", f"is {dim!r}", "descriptors live in the plane or in space", "pass 2 or 3", value=dim)
    return int(dim)


def check_not_negative(values: ArrayLike, name: str) -> Floats:
    """Finite numbers, none below zero, of any shape."""
    array = finite(values, name)
    if (array < 0.0).any():
        raise InputError(name, f"holds {array.min():g}", "none may be below zero", "pass the modulus", value=values)
    return array


def check_number(value: ArrayLike, name: str, mend: str) -> float:
    """One finite number, zero or above."""
    array = check_not_negative(value, name)
    if array.ndim:
        raise InputError(name, f"is {value!r}", "it must be one number, zero or above", mend, value=value)
    return float(array)


def check_vectors(vectors: ArrayLike, name: str, dim: int) -> Floats:
    """Points or frequencies, shape (..., dim)."""
    array = finite(vectors, name)
    if array.ndim == 0 or array.shape[-1] != dim:
        raise InputError(
            name,
            f"has shape {array.shape}",
            f"its last axis must be {dim} long, one entry for each coordinate",
            f"pass e.g. {(0.5,) * dim}",
            value=vectors,
        )
    return array


def check_axes(grid: Grid, dim: int, name: str) -> None:
    """Refuse a grid in the plane for what is in space, or the other way around."""
    if dim != grid.dim:
        raise InputError(
            name,
            f"has {dim} coordinates and the grid has {grid.dim} axes",
            "both must have as many",
            "pass a grid of as many axes",
        )


def check_kind(value: Any, name: str, kinds: tuple[str, ...]) -> None:
    """Refuse a word that is none of a few."""
    if not isinstance(value, str) or value not in kinds:
        words = ", ".join(map(repr, kinds))
        raise InputError(name, f"is {value!r}", f"it must be one of {words}", "pass one of them", value=value)


def check_solid_balls(centers: ArrayLike, radii: ArrayLike) -> tuple[Floats, Floats]:
    """Copies of the centers, shape (n, dim), and radii above zero, shape (n,), of balls."""
    from cspace.shapes import check_balls

    points, sizes = check_balls(centers, radii)
    if (sizes <= 0.0).any():
        raise InputError(
            "radii", f"holds {sizes.min():g}", "each must be above zero", "drop balls that have no volume", value=radii
        )
    return points, sizes
