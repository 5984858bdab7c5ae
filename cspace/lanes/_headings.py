"""Lanes, and the yaws that a robot may have on them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, Final, Literal, NamedTuple, TypeAlias

import numpy as np

from cspace.errors import InputError
from cspace.inside import check_finite, warn_of_large, wrap_angles
from cspace.lanes._curves import Leg, reverse_legs

Heading: TypeAlias = Literal["forward", "backward", "both", "any"] | float
"""Yaw of a robot on a lane: that of travel, its opposite, either one, any, or a fixed one."""


class HeadingRule(NamedTuple):
    """All yaws that a robot may have on a lane.

    Attributes
    ----------
    frame : str
        "lane" if yaws count from the direction of travel, "map" if they are fixed, "any" if every
        yaw is allowed.
    yaws : tuple of float
        Radians.
    """

    frame: str
    yaws: tuple[float, ...] = ()


HEADINGS: Final = {
    "forward": HeadingRule("lane", (0.0,)),
    "backward": HeadingRule("lane", (math.pi,)),
    "both": HeadingRule("lane", (0.0, math.pi)),
    "any": HeadingRule("any"),
}
"""Rules by the words that users write."""


def parse_heading(value: Any, name: str = "heading") -> HeadingRule:
    """Return a word's or a yaw's rule, or raise InputError."""
    if isinstance(value, HeadingRule):
        yaws = check_finite(value.yaws, name).reshape(-1)
        warn_of_large(yaws, "rad", f"{name}: its yaw")
        return value._replace(yaws=tuple(wrap_angles(yaws).tolist()))
    if isinstance(value, str) and value in HEADINGS:
        return HEADINGS[value]
    is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value):
        rule = f"it must be {', '.join(map(repr, HEADINGS))} or a yaw of the map"
        raise InputError(name, f"is {value!r}", rule)
    return parse_heading(HeadingRule("map", (float(value),)), name)


class Lane(NamedTuple):
    """An edge of a route graph, in one direction.

    Attributes
    ----------
    name : str
    start, end : int
        Indices of its nodes.
    heading : HeadingRule
    legs : tuple of Leg
        Its pieces if it is not straight.
    deviation : float
        Distance, metres, up to which the robot may leave the lane.
    mutex : str
        Mutex group, whose lanes and nodes one robot at a time may use; empty without one.
    turns : tuple of bool
        Whether a robot may turn on the spot at the start before the lane, and at the end after it.
    """

    name: str
    start: int
    end: int
    heading: HeadingRule = HEADINGS["forward"]
    legs: tuple[Leg, ...] = ()
    deviation: float = 0.0
    mutex: str = ""
    turns: tuple[bool, ...] = (True, True)


def reverse_lane(lane: Lane) -> Lane:
    """Return a lane in the other direction, with the same rule."""
    legs, turns = reverse_legs(lane.legs), lane.turns[::-1]
    return lane._replace(start=lane.end, end=lane.start, legs=legs, turns=turns)


def find_repeated(values: Iterable[Any]) -> Any:
    """Return the first value that occurs again, or None."""
    known = set()
    for value in values:
        if value in known:
            return value
        known.add(value)
    return None
