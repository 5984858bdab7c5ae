"""Units: their names, and the largest number that is expected in each."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from cspace._support.arrays import MAX_EXPECTED_ANGLE
from cspace._support.column_names import list_columns
from cspace._support.reporting import warn_user
from cspace.errors import AngleWarning, InputError, UnitWarning

METRES: Final = ("", "m", "metre", "metres", "meter", "meters")
"""Names of the metre, and no name."""

_SI_UNIT: Final = re.compile(
    r"(\b(m|met(re|er)s?|rad(ian)?s?|s|seconds?|kg|n|per|dimensionless|unitless)\b|[-\s/*^.()\d])*"
)
"""Names of units that numbers are in, and of their quotients, in lower case."""


_FAST_TURN: Final = (8.0 * MAX_EXPECTED_ANGLE, "8 turns a second", AngleWarning)

_EXPECTATIONS: Final[Mapping[str, tuple[float, str, type[UserWarning]]]] = {
    "rad": (MAX_EXPECTED_ANGLE, "a whole turn", AngleWarning),
    "rad/s": _FAST_TURN,
    "rad/s^2": _FAST_TURN,
    "m/s": (100.0, "100 m/s", UnitWarning),
}
"""Largest number that is not suspected to be in another unit, as number and words, by unit."""


def is_expected(values: ArrayLike, unit: str) -> bool:
    """Return False if a number is larger than its unit suggests."""
    return unit not in _EXPECTATIONS or not (np.abs(values) > _EXPECTATIONS[unit][0]).any()


def warn_of_large(
    values: ArrayLike, unit: str, name: str, columns: Mapping[int, str] | None = None
) -> None:
    """Warn if a number is larger than its unit suggests.

    ``columns`` are the names of the coordinates in this unit, by index; by default, all numbers are
    in it. The text has the value of a single number, and of rows an example, so that Python prints
    it once for each line of the user's program.
    """
    parts = {name: values}
    if columns is not None:
        parts = {f"{name}: {each}": np.asarray(values)[..., k] for k, each in columns.items()}
    for part, numbers in parts.items():
        if is_expected(numbers, unit):
            continue
        _, words, category = _EXPECTATIONS[unit]
        rule = f"it is in {unit}"
        if category is AngleWarning:
            degrees = 90.0 if np.ndim(numbers) else float(np.asarray(numbers))
            rule += f", and {degrees:g} degrees are {math.radians(degrees):.6g} rad"
        warn_user(f"{part} is beyond {words}; {rule}", category)


def suggest_radians(value: float) -> str:
    """Return a hint for an angle outside [0, pi], radians, which may be in degrees."""
    if math.pi < value <= 180.0:
        return f"pass {math.radians(value):.6g} for {value:g} degrees"
    return ""


def check_unit(values: Any, name: str) -> None:
    """Raise InputError for values in another unit, as of pint; units of plans are tuples."""
    attributes = getattr(values, "attrs", None)
    entries = attributes if isinstance(attributes, Mapping) else {}
    # A column of a table may be called unit.
    owners = () if list_columns(values) else (values, getattr(values, "dtype", None))
    units = [entries.get(key) for key in ("units", "unit")]
    units += [getattr(owner, key, None) for owner in owners for key in ("units", "unit")]
    unit = next(filter(None, units), None)
    has_unit = not (unit is None or callable(unit) or isinstance(unit, tuple))
    if has_unit and not _SI_UNIT.fullmatch(str(unit).lower()):
        rule = "numbers are in metres, radians and seconds"
        raise InputError(name, f"has the unit {unit}", rule)
