"""Arguments of the frequency domain, checked; what is refused raises InputError."""

from __future__ import annotations

from typing import Any, Final

from numpy.typing import ArrayLike

from cspace.arrays import Floats
from cspace.errors import InputError
from cspace.grid import finite
from cspace.shapes.balls import check_balls

LEAST_TOLERANCE: Final = 1e-13  # below this, rounding in float64 leaves nothing to ask for

MOST_TOLERANCE: Final = 0.1


def check_tolerance(tolerance: Any, least: float = LEAST_TOLERANCE) -> float:
    """A relative tolerance from ``least`` to 0.1."""
    value = finite(tolerance, "tolerance")
    if value.ndim or not least <= value <= MOST_TOLERANCE:
        rule = f"it must be one number from {least:g} to {MOST_TOLERANCE:g}, for it is relative to the largest value"
        raise InputError("tolerance", f"is {tolerance!r}", rule, "pass e.g. 1e-9", value=tolerance)
    return float(value)


def check_not_negative(values: ArrayLike, name: str) -> Floats:
    """Finite numbers, none below zero, of any shape."""
    array = finite(values, name)
    if (array < 0.0).any():
        raise InputError(name, f"holds {array.min():g}", "none may be below zero", "pass the modulus", value=values)
    return array


def check_dims(name: str, dim: int, other: int) -> None:
    """Refuse what is in the plane beside what is in space, or the other way around."""
    if dim != other:
        fault, rule = f"has {dim} coordinates and what it goes with {other}", "both must have as many"
        raise InputError(name, fault, rule, "pass all in the plane or all in space", value=dim)


def check_solid_balls(centers: ArrayLike, radii: ArrayLike) -> tuple[Floats, Floats]:
    """Copies of the centers, shape (n, dim), and radii above zero, shape (n,), of balls."""
    points, sizes = check_balls(centers, radii)
    if (sizes <= 0.0).any():
        mend = "drop balls that have no volume"
        raise InputError("radii", f"holds {sizes.min():g}", "each must be above zero", mend, value=radii)
    return points, sizes
