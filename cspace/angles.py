"""Angles: whole turns, and how exactly they are counted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Floats
from cspace.errors import AngleWarning, warn_user

TURN: Final = 2.0 * math.pi

MAX_ANGLE: Final = 2.0**20
"""Largest angle of a configuration, in radians, that is wrapped."""

MAX_JOINT_ANGLE: Final = 256.0
"""Largest angle of a continuous joint, in radians, that is wrapped: what rounding does to more turns could reach a
cell's slack."""

ANGLE_SLACK: Final = 1e-9
"""Rounding allowance in radians: rotation cells count as that much wider on both sides."""


LARGEST_EXPECTED: Final = TURN * (1.0 + 1e-9)
"""Largest angle, in radians, that a user is expected to pass: beyond it, the angle is probably in degrees."""


def angle_axes(axes: Sequence[str], endless: Sequence[bool] = ()) -> dict[int, str]:
    """Return index and name of the numbers of a configuration that are wrapped: yaws and continuous joints."""
    joints = [*endless, *[False] * (len(axes) - len(endless))]
    return {k: name for k, (name, turns) in enumerate(zip(axes, joints, strict=True)) if name == "yaw" or turns}


def warn_of_degrees(q: Sequence[float] | Floats, angles: Mapping[int, str], name: str) -> None:
    """Warn the user about an angle of one configuration that is beyond a whole turn.

    ``angles`` are those of :func:`angle_axes`. The text leaves out the number, so that Python prints it once for each
    line of the user's program.
    """
    for k, axis in angles.items():
        if abs(q[k]) > LARGEST_EXPECTED:
            rule = "angles are in radians, and whole turns are ignored"
            warn_user(f"{name}: {axis} is beyond a whole turn; {rule}; use numpy.radians for degrees", AngleWarning)


def shorter(steps: Floats, endless: ArrayLike = True) -> Floats:
    """Steps, shape (..., dof), without whole turns of the numbers that are angles without an end: the shorter way.

    It is what :func:`math.remainder` gives, to the last bit, so that also half a turn is gone the same way everywhere.
    """
    rest = np.fmod(steps, 2.0 * TURN)  # exact, as is what follows
    return np.where(endless, rest - TURN * np.rint(rest / TURN), steps)


def wrapped(angles: Floats, endless: ArrayLike = True) -> Floats:
    """The same, with half a turn as -pi: in [-pi, pi). What is there already is unchanged."""
    near = shorter(angles, endless)
    return np.where(np.logical_and(endless, near >= math.pi), -math.pi, near)


def beside(angle: Floats, other: Floats) -> Floats:
    """Angles as many whole turns on as bring them next to others."""
    return angle + TURN * np.rint((other - angle) / TURN)
