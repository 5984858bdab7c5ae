"""The errors that this library raises on purpose, under one base class.

Each carries its parts as fields: the argument, its fault, the rule that it breaks and the mend. The message is made of
them, and so is what the command line says in its own words.
"""

from __future__ import annotations

import sys
import warnings
from importlib import import_module
from typing import Any, ClassVar, Final

LONGEST: Final = 240
"""Characters of a fault, at most, in a message."""


_NOT_THE_USERS: Final = frozenset({"cspace", "planners", *sys.stdlib_module_names})
"""Top-level modules of this library, and of the standard library, which calls back into it."""


class CspaceError(Exception):
    """Base class of all errors raised by ``cspace`` and ``planners``.

    Parameters
    ----------
    argument : str
        What is at fault: the name of an argument, or a file's path; or, where it stands alone, the whole message.
    fault : str, optional
        What it is, as it follows the name: ``"is -1"``, ``"has shape (3,)"``.
    rule : str
        ``"it must be above zero"``.
    mend : str
        ``"pass it in metres, e.g. 0.05"``.
    value : object
        The offending value itself, for programs.

    Examples
    --------
    >>> raise InputError("spacing", "is -1", "it must be above zero", "pass it in metres", value=-1)
    Traceback (most recent call last):
    cspace.errors.InputError: spacing is -1; it must be above zero; pass it in metres
    """

    gap: ClassVar[str] = " "

    def __init__(
        self, argument: str, problem: str | None = None, rule: str = "", hint: str = "", *, value: object = None
    ) -> None:
        text = argument
        if problem is not None:
            problem = " ".join(problem.split())  # arrays print themselves in many lines
            problem = problem if len(problem) <= LONGEST else f"{problem[:LONGEST]} ..."
            text = "; ".join(part for part in (f"{argument}{self.gap}{problem}", rule, hint) if part)
        super().__init__(text)
        self.argument = argument
        self.problem = problem
        self.rule = rule
        self.hint = hint
        self.value = value


class InputError(CspaceError, ValueError):
    """A value passed by the caller breaks a stated rule."""


class GeometryError(InputError):
    """A robot or obstacle shape is empty, self-crossing, not finite or of the wrong dimension."""


class FileError(CspaceError, OSError):
    """A file is missing, unreadable, malformed, truncated, or may not be written; ``argument`` is its path."""

    gap: ClassVar[str] = ": "


class MissingPackageError(CspaceError, ImportError):
    """An optional package is needed and is not installed; the message names the command that installs it."""


def optional(package: str, use: str, extra: str) -> Any:
    """An optional package, imported.

    Raises MissingPackageError if it is not installed, with what it is of use for and the extra that has it.
    """
    try:
        return import_module(package)
    except ImportError as error:
        hint = f'run: pip install "cspace[{extra}]"'
        raise MissingPackageError(package, "is not installed", use, hint) from error


class AngleWarning(UserWarning):
    """An angle is beyond a whole turn, as if it were in degrees; it is used as radians."""


def warn_user(message: str, category: type[Warning] = UserWarning) -> None:
    """Warn at the line outside this library that called it."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _NOT_THE_USERS:
        frame, level = frame.f_back, level + 1
    warnings.warn(message, category, stacklevel=level)


class ConfigurationError(InputError):
    """A start or goal configuration cannot be used.

    Attributes
    ----------
    nearest : tuple of float or None
        The nearest FREE configuration, where the map has one.
    """

    def __init__(
        self,
        argument: str,
        problem: str | None = None,
        rule: str = "",
        hint: str = "",
        *,
        value: object = None,
        nearest: tuple[float, ...] | None = None,
    ) -> None:
        super().__init__(argument, problem, rule, hint, value=value)
        self.nearest = nearest
