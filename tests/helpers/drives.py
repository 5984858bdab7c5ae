"""Drives by the words of the command line, which name the cases of tests."""

import numpy as np

import planners

CURVES = ("dubins", "reeds-shepp")
WORDS = ("holonomic", "differential", "differential-reverse", *CURVES)


def make_drive(word, radius=0.4, **fields):
    """Return the drive that a word names, with a turning radius in metres for cars."""
    if word in (None, "holonomic"):
        return None
    reverse = word in ("differential-reverse", "reeds-shepp")
    if word in CURVES:
        return planners.Car(turning_radius=radius, reverse=reverse, **fields)
    return planners.Differential(reverse=reverse, **fields)


def is_car(plan):
    """Return True if a plan, or the route of a trajectory, is of a car."""
    return isinstance(plan.drive, planners.Car)


def drive_pieces(q, turns, lengths, radius):
    """Drive cars from configurations (n, 3) along circles and lines.

    ``turns`` and ``lengths`` have shape (n, pieces): 1 (left), -1 (right) or 0 (straight), and
    metres, negative in reverse.
    """
    x, y, yaw = q.T.copy()
    for turn, length in zip(np.transpose(turns), lengths.T, strict=True):
        half = 0.5 * turn * length / radius
        chord = length * np.sinc(half / np.pi)
        x, y, yaw = x + chord * np.cos(yaw + half), y + chord * np.sin(yaw + half), yaw + 2.0 * half
    return np.column_stack([x, y, yaw])
