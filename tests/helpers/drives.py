"""Drives by the words of the command line, which name the cases of tests."""

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
