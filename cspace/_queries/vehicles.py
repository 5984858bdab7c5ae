"""Drives: how robots on wheels move."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Final

from cspace._support.arrays import Floats
from cspace._support.check import (
    check_flag,
    check_not_negative,
    check_positive,
    names_options,
)
from cspace.errors import InputError

MAX_REVERSE_COST: Final = 20.0
"""Largest cost of a metre in reverse, in metres ahead. At 24, no edge of a car would lead back,
because a short arc back would cost more than a whole loop ahead."""


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Drive:
    """A robot that drives along its x axis; others move in any direction.

    Attributes
    ----------
    reverse : bool
        Whether it also drives backwards.
    reverse_cost : float
        Cost of a metre in reverse, in metres ahead.
    max_lateral_acceleration : float or None
        Largest acceleration across its way, speed times yaw rate, m/s^2.
    """

    reverse: bool = False
    reverse_cost: float = 1.0
    max_lateral_acceleration: float | None = None

    def __post_init__(self) -> None:
        """Check the fields, and replace them by a flag and a float."""
        check_flag(self.reverse, "reverse")
        object.__setattr__(self, "reverse", bool(self.reverse))
        cost = check_not_negative(self.reverse_cost, "reverse_cost", "")
        if not 1.0 <= cost <= MAX_REVERSE_COST:
            rule = f"a metre in reverse costs as much as 1 to {MAX_REVERSE_COST:g} ahead"
            raise InputError("reverse_cost", f"is {self.reverse_cost!r}", rule)
        self._set_cost("reverse_cost", cost)
        if self.max_lateral_acceleration is not None:
            name = "max_lateral_acceleration"
            rate = check_positive(self.max_lateral_acceleration, name, "metres, seconds")
            object.__setattr__(self, name, rate)

    def _set_cost(self, name: str, cost: float) -> None:
        """Set a cost of driving backwards; raise InputError if the robot does not reverse."""
        (default,) = (each.default for each in fields(self) if each.name == name)
        if cost != default and not self.reverse:
            raise InputError(name, f"is {cost:g}, and reverse is False", "it is for reverse=True")
        object.__setattr__(self, name, cost)

    def _limit_yaw_rates(self, speeds: Floats) -> Floats | None:
        """Return the largest yaw rates at speeds; None if any are possible."""
        return None

    def __repr__(self) -> str:
        """Return the call that makes it, without numbers that are defaults."""
        # Fields of a base class come first, and in a call those without names.
        in_order = sorted(fields(self), key=lambda each: bool(each.kw_only))
        values = ((each, getattr(self, each.name)) for each in in_order)
        given = [
            f"{each.name}={value!r}"
            for each, value in values
            if isinstance(value, bool) or value != each.default
        ]
        return f"{type(self).__name__}({', '.join(given)})"


@names_options
@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Differential(Drive):
    """A robot on two driven wheels, which turns on the spot.

    Pass it as ``drive=`` of :func:`planners.plan` or :class:`cspace.Gate`. Along an edge of a path
    it turns on the spot, drives straight on, and turns again. The reference point is in the middle
    between the wheels, and x points ahead.

    Attributes
    ----------
    reverse : bool
        Whether it also drives backwards, where that takes less turning.
    reverse_cost : float
        Metres ahead that a metre in reverse costs a plan, 1 to 20.
    max_lateral_acceleration : float or None
        Largest acceleration across its way, speed times yaw rate, m/s^2; for trajectories and
        twists at a gate. If None, trajectories take their ``max_acceleration``, and a gate has no
        such limit.

    Raises
    ------
    InputError
        If ``reverse`` is neither True nor False, a cost is out of range or without ``reverse``, or
        the acceleration is not above zero or not finite.

    Examples
    --------
    >>> import planners
    >>> planners.Differential(reverse=True)
    Differential(reverse=True)
    """


@names_options
@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Car(Drive):
    """A car, which follows curves no tighter than its turning radius.

    Pass it as ``drive=`` of :func:`planners.plan` or :class:`cspace.Gate`. Along an edge of a path
    it drives the shortest curve: L. E. Dubins', or if it reverses J. A. Reeds and L. A. Shepp's;
    with a cost, the cheapest of all these. The reference point is in the middle of the axle that
    does not steer, and x points ahead.

    Attributes
    ----------
    turning_radius : float
        Radius of the tightest curve of the reference point, metres.
    reverse : bool
        Whether it also drives backwards.
    reverse_cost : float
        Metres ahead that a metre in reverse costs a plan, 1 to 20.
    max_lateral_acceleration : float or None
        As of :class:`planners.Differential`, m/s^2.
    switch_cost : float
        Cost of each change between ahead and reverse, metres.

    Raises
    ------
    InputError
        If the radius or the acceleration is not above zero or not finite, ``reverse`` is neither
        True nor False, or a cost is out of range or without ``reverse``.

    Examples
    --------
    >>> import planners
    >>> planners.Car(turning_radius=0.5, reverse=True)
    Car(turning_radius=0.5, reverse=True)
    """

    turning_radius: float = field(kw_only=False)
    switch_cost: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields, and replace them by a flag and floats."""
        radius = check_positive(self.turning_radius, "turning_radius", "metres")
        object.__setattr__(self, "turning_radius", radius)
        Drive.__post_init__(self)
        self._set_cost("switch_cost", check_not_negative(self.switch_cost, "switch_cost"))

    def _limit_yaw_rates(self, speeds: Floats) -> Floats | None:
        """Return the largest yaw rates at speeds."""
        return speeds / self.turning_radius


def check_drive(drive: object) -> Drive | None:
    """Return a drive, or None for a robot that moves in any direction; else raise InputError."""
    if drive is not None and not isinstance(drive, Drive):
        rule = "it must be a planners.Car(...), a planners.Differential(...) or None"
        raise InputError("drive", f"is {drive!r}", rule)
    return drive
