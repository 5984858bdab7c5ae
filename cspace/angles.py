"""Angles: whole turns, and how exactly they are counted."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from cspace.arrays import Floats

TURN: Final = 2.0 * math.pi

MAX_ANGLE: Final = 2.0**20
"""Largest angle of a configuration, in radians, that is wrapped."""

MAX_JOINT_ANGLE: Final = 256.0
"""Largest angle of a continuous joint, in radians, that is wrapped: what rounding does to more turns could reach a
cell's slack."""

ANGLE_SLACK: Final = 1e-9
"""Rounding allowance in radians: rotation cells count as that much wider on both sides."""


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
