"""Warnings at the caller's line, and imports of optional packages."""

from __future__ import annotations

import inspect
import sys
import warnings
from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any, Final

from cspace._support.arrays import Floats
from cspace.errors import MissingPackageError

_INTERNAL_PACKAGES: Final = frozenset({"cspace", "planners", *sys.stdlib_module_names})
"""Names of packages whose frames are no callers: this library, and the standard library, which
calls back into it."""


def import_optional(package: str, use: str, extra: str) -> Any:
    """Import an optional package.

    Raises MissingPackageError if it is not installed. The message gives its ``use`` and the
    command that installs it by an ``extra``, because no index has cspace.
    """
    try:
        return import_module(package)
    except ImportError as error:
        raise MissingPackageError(
            package,
            "is not installed",
            f'{use}; in the clone, type: pip install -c constraints.txt ".[{extra}]"',
        ) from error


def warn_user(message: str, category: type[Warning] = UserWarning) -> None:
    """Issue a warning at the user's line that called us."""
    # Go up the stack to the first frame outside this library; ``warnings`` counts frames from 1.
    frame = inspect.currentframe()
    level = 1
    while frame is not None:
        package = frame.f_globals.get("__name__", "").partition(".")[0]
        if package not in _INTERNAL_PACKAGES:
            break
        frame = frame.f_back
        level += 1
    warnings.warn(message, category, stacklevel=level)


def write_number(number: float, digits: int) -> str:
    """Format a number with some significant digits."""
    return f"{number:.{digits}g}"


def tell_apart(
    value: float,
    limit: float,
    digits: int = 6,
    write: Callable[[float, int], str] = write_number,
) -> tuple[str, str]:
    """Format a value and its limit with as many digits as they need to differ.

    ``digits`` are the fewest significant ones; ``write`` formats a number with some.
    """
    texts = write(value, digits), write(limit, digits)
    # With 17 digits, different numbers have different texts.
    if texts[0] == texts[1] and digits < 17 and value != limit:
        return tell_apart(value, limit, digits + 1, write)
    return texts


def format_point(point: Iterable[float]) -> str:
    """Return coordinates in brackets, of six digits: (0, 30.2)."""
    return f"({', '.join(f'{value:.6g}' for value in point)})"


def format_sides(sides: Floats) -> str:
    """Format the sides of a box, such as "2 m x 3 m"."""
    return " x ".join(f"{side:.6g} m" for side in sides)
