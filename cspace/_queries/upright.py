"""Upright: a direction that a link of an arm keeps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from cspace._support.arrays import AXES
from cspace._support.check import (
    check_finite,
    check_number,
    check_positive,
    check_text,
    names_options,
)
from cspace._support.units import suggest_radians
from cspace.errors import InputError


@names_options
@dataclass(frozen=True, slots=True)
class Upright:
    """A constraint of an arm: an axis of a frame keeps its angle to a direction.

    Pass it as ``keep=`` of :func:`planners.plan`. All along the motion, the angle between the axis
    and the direction is within ``tolerance`` of ``angle``. With the default ``angle`` of 0, the
    axis stays in a cone about the direction, as that of a glass of water. With an ``angle`` of pi /
    2, it stays near the plane across the direction. Turns about the direction are free.

    Attributes
    ----------
    frame : str
        One of :attr:`cspace.Arm.frames`, such as ``"tool0"``.
    axis : tuple of float
        Direction in the frame; given with any length, kept with length 1.
    direction : tuple of float
        Direction in the frame of the arm's base, likewise; by default its z axis.
    tolerance : float
        Largest deviation from ``angle``, radians, above 0 and at most pi.
    angle : float
        Angle between axis and direction, radians, from 0 to pi.

    Raises
    ------
    InputError
        If the frame is no string, a direction is not three finite numbers or has length 0, or an
        angle is out of range.

    Examples
    --------
    >>> import planners
    >>> planners.Upright("tool0", axis=(0, 0, -2), tolerance=0.1).axis
    (0.0, 0.0, -1.0)
    """

    frame: str
    axis: ArrayLike = (0.0, 0.0, 1.0)
    direction: ArrayLike = (0.0, 0.0, 1.0)
    tolerance: float = 0.1
    angle: float = 0.0

    def __post_init__(self) -> None:
        """Check the fields, and replace them by floats."""
        check_text(self.frame, "frame")
        for name in ("axis", "direction"):
            object.__setattr__(self, name, _check_direction(getattr(self, name), name))
        tolerance = check_positive(self.tolerance, "tolerance", "radians")
        angle = check_number(self.angle, "angle")
        for name, value in (("tolerance", tolerance), ("angle", angle)):
            if not 0.0 <= value <= math.pi:
                rule = "an angle between two directions is from 0 to pi radians"
                raise InputError(name, f"is {value!r}", rule, suggest_radians(value))
            object.__setattr__(self, name, value)


def _check_direction(value: ArrayLike, name: str) -> tuple[float, ...]:
    """Return a direction with length 1; raise InputError if it has none."""
    vector = check_finite(value, name, AXES)
    if vector.shape != (3,):
        raise InputError(name, f"is {value!r}", "a direction has three numbers")
    largest = np.abs(vector).max()
    if largest == 0.0:
        raise InputError(name, f"is {value!r}", "its length is 0")
    scaled = vector / largest  # squares of very large or small numbers overflow
    unit = scaled / np.linalg.norm(scaled)
    return tuple((unit + 0.0).tolist())
