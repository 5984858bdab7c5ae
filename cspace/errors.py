"""Errors that this library raises on purpose, under one base class.

Each carries its parts as fields: the argument, its problem, the rule that it breaks and a hint.
Messages consist of them; the command line puts them in its own words.
"""

from __future__ import annotations

from typing import ClassVar, Literal

__all__ = [
    "AngleWarning",
    "ConfigurationError",
    "CspaceError",
    "FileError",
    "GeometryError",
    "InputError",
    "MissingPackageError",
    "UnitWarning",
]


class CspaceError(Exception):
    """Base class of all errors raised by ``cspace`` and ``planners``.

    Parameters
    ----------
    argument : str
        Name of the argument, or path of the file; the whole message if it stands alone.
    problem : str, optional
        Problem, as it follows the name: ``"is -1"``, ``"has shape (3,)"``.
    rule : str
        ``"it must be above zero"``.
    hint : str
        ``"pass it in metres, e.g. 0.05"``.

    Examples
    --------
    >>> raise InputError("spacing", "is -1", "it must be above zero", "pass it in metres")
    Traceback (most recent call last):
    cspace.errors.InputError: spacing is -1; it must be above zero; pass it in metres
    """

    _GAP: ClassVar[str] = " "

    def __init__(
        self,
        argument: str,
        problem: str | None = None,
        rule: str = "",
        hint: str = "",
    ) -> None:
        """Join argument, problem, rule and hint to the message."""
        message = argument
        # Maximum number of characters of a problem in a message.
        max_problem_characters = 240
        if problem is not None:
            problem = " ".join(problem.split())  # arrays print in several lines
            if len(problem) > max_problem_characters:
                problem = f"{problem[:max_problem_characters]} ..."
            clauses = f"{argument}{self._GAP}{problem}", rule, hint
            message = "; ".join(filter(None, clauses))
        super().__init__(message)
        self.argument = argument
        self.problem = problem
        self.rule = rule
        self.hint = hint


class InputError(CspaceError, ValueError):
    """A value passed by the caller breaks a stated rule."""


class GeometryError(InputError):
    """A shape is empty, self-crossing, not finite or of the wrong dimension."""


class FileError(CspaceError, OSError):
    """A file cannot be read or written; ``argument`` is its path."""

    _GAP: ClassVar[str] = ": "


class MissingPackageError(CspaceError, ImportError):
    """An optional package is missing; the message says how to install it."""


class AngleWarning(UserWarning):
    """An angle is beyond a whole turn, or a rate too large, so probably in degrees.

    It is used as radians.
    """


class UnitWarning(UserWarning):
    """A size or speed suggests another unit than the metre, or a frame with another origin.

    It is used in metres, as given.
    """


EndReason = Literal["outside", "blocked", "mixed"]
"""Reasons why a start or goal cannot be used."""


class ConfigurationError(InputError):
    """A start or goal configuration cannot be used.

    Attributes
    ----------
    nearest : tuple of float or None
        Nearest FREE configuration, if the map has one; for a pose out of reach, the configuration
        with the nearest pose reached.
    end : {"start", "goal"} or None
        Which of the two it is; None if neither.
    reason : {"outside", "blocked", "mixed"} or None
        Whether it lies outside the map, collides, or is not decided; None for other reasons, such
        as a pose out of reach.
    """

    def __init__(
        self,
        *clauses: str,
        nearest: tuple[float, ...] | None = None,
        reason: EndReason | None = None,
    ) -> None:
        """Make the message as :class:`CspaceError` does."""
        super().__init__(*clauses)
        self.nearest = nearest
        self.end = next((end for end in ("start", "goal") if self.argument.startswith(end)), None)
        self.reason = reason
