"""Drives: how robots on wheels move."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields
from typing import TypeAlias

from cspace._support.check import check_flag, check_positive
from cspace.errors import InputError


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Differential:
    """A robot on two driven wheels, which turns on the spot.

    Pass it as ``drive=`` of :func:`planners.plan` or :class:`cspace.Gate`. Along an edge of a path
    it turns on the spot, drives straight on, and turns again. The reference point is in the middle
    between the wheels, and x points ahead.

    Attributes
    ----------
    reverse : bool
        Whether it also drives backwards, where that takes less turning.
    max_lateral_acceleration : float or None
        Largest acceleration across its way, speed times yaw rate, m/s^2; for trajectories and
        twists at a gate. If None, trajectories take their ``max_acceleration``, and a gate has no
        such limit.

    Raises
    ------
    InputError
        If ``reverse`` is neither True nor False, or the acceleration is not above zero or not
        finite.

    Examples
    --------
    >>> import planners
    >>> planners.Differential(reverse=True)
    Differential(reverse=True)
    """

    reverse: bool = False
    max_lateral_acceleration: float | None = None

    def __post_init__(self) -> None:
        """Check the fields, and replace them by a flag and floats."""
        _check_fields(self)

    def __repr__(self) -> str:
        """Return the call that makes it."""
        return _format(self)


@dataclass(frozen=True, slots=True, repr=False)
class Car:
    """A car, which follows curves no tighter than its turning radius.

    Pass it as ``drive=`` of :func:`planners.plan` or :class:`cspace.Gate`. Along an edge of a path
    it drives the shortest curve: L. E. Dubins', or if it reverses J. A. Reeds and L. A. Shepp's.
    The reference point is in the middle of the axle that does not steer, and x points ahead.

    Attributes
    ----------
    turning_radius : float
        Radius of the tightest curve of the reference point, metres.
    reverse : bool
        Whether it also drives backwards.
    max_lateral_acceleration : float or None
        As of :class:`planners.Differential`, m/s^2.

    Raises
    ------
    InputError
        If the radius or the acceleration is not above zero or not finite, or ``reverse`` is neither
        True nor False.

    Examples
    --------
    >>> import planners
    >>> planners.Car(turning_radius=0.5, reverse=True)
    Car(turning_radius=0.5, reverse=True)
    """

    turning_radius: float
    _: KW_ONLY
    reverse: bool = False
    max_lateral_acceleration: float | None = None

    def __post_init__(self) -> None:
        """Check the fields, and replace them by a flag and floats."""
        radius = check_positive(self.turning_radius, "turning_radius", "metres")
        object.__setattr__(self, "turning_radius", radius)
        _check_fields(self)

    def __repr__(self) -> str:
        """Return the call that makes it."""
        return _format(self)


Drive: TypeAlias = Car | Differential
"""A robot that drives along its x axis; others move in any direction."""


def check_drive(drive: object) -> Drive | None:
    """Return a drive, or None for a robot that moves in any direction; else raise InputError."""
    if drive is not None and not isinstance(drive, Drive):
        rule = "it must be a planners.Car(...), a planners.Differential(...) or None"
        raise InputError("drive", f"is {drive!r}", rule)
    return drive


def _check_fields(drive: Drive) -> None:
    """Check the fields that drives share, and replace them by a flag and a float."""
    check_flag(drive.reverse, "reverse")
    object.__setattr__(drive, "reverse", bool(drive.reverse))
    if drive.max_lateral_acceleration is not None:
        name = "max_lateral_acceleration"
        rate = check_positive(drive.max_lateral_acceleration, name, "metres, seconds")
        object.__setattr__(drive, name, rate)


def _format(drive: Drive) -> str:
    """Return a drive as a call with the fields that are not None."""
    values = {field.name: getattr(drive, field.name) for field in fields(drive)}
    given = [f"{name}={value!r}" for name, value in values.items() if value is not None]
    return f"{type(drive).__name__}({', '.join(given)})"
