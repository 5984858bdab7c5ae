"""Start and goal: configurations that a path can begin and end at."""

from __future__ import annotations

from collections.abc import Sequence

from numpy.typing import ArrayLike

from cspace.errors import ConfigurationError, InputError
from cspace.grid import finite
from cspace.space import CSpace
from cspace.states import BLOCKED, FREE, NAMES
from planners.states import Configuration


def check_endpoint(space: CSpace, q: ArrayLike, name: str, exact: bool = False) -> Configuration:
    """A start or goal as floats, if a motion can be proven free there.

    Parameters
    ----------
    space : CSpace
    q : array-like, shape (dof,)
    name : str
        "start" or "goal".
    exact : bool
        Whether the geometry itself is asked where the map cannot decide.

    Returns
    -------
    tuple of float
        As OMPL holds it: a yaw in [-pi, pi), a quaternion of norm 1.

    Raises
    ------
    InputError
        If it is not one configuration of finite numbers.
    ConfigurationError
        If it lies outside the map, is not FREE, or lies on the border of a cell that is not FREE; with ``exact``, if it
        lies outside the map or is not proven free.
    """
    point = finite(q, name)
    if point.shape != (space.dof,):
        rule = f"it must be one configuration of {space.dof} numbers"
        raise InputError(
            name, f"has shape {point.shape}", rule, f"pass ({', '.join(space.axes)}), in metres and radians", value=q
        )
    end: Configuration = tuple(space.rotations.canonical(point, name).tolist())
    inside = all(low <= x <= high for low, x, high in zip(space.grid.lower, end, space.grid.upper, strict=False))
    if inside and space.motion_is_free(end, end, exact=exact):
        return end
    raise _unusable(space, end, name, inside, exact)


def _unusable(space: CSpace, end: Configuration, name: str, inside: bool, exact: bool) -> ConfigurationError:
    """The error that says what is wrong with a configuration, and which one is near and right."""
    state = space.classify(end)
    if not inside:
        reason = f"lies outside the map, which reaches from {_text(space.grid.lower)} to {_text(space.grid.upper)}"
        rule = "a path stays within the map"
    elif exact and state != BLOCKED:
        reason = "is in collision, or cannot be told from it"
        rule = f"the {name} must be proven collision-free, by the map or by the geometry"
    elif state != FREE:
        reason = f"lies in a {NAMES[state].upper()} cell"
        rule = f"the {name} must be FREE, which is to say proven collision-free"
    else:
        reason = "is FREE but lies on the border of a cell that is not"
        rule = f"a motion from or to it would touch that cell too, so the {name} must lie inside"
    nearest: Configuration | None = None
    try:
        nearest = tuple(space.rotations.canonical(space.nearest_free(end)).tolist())
        mend = f"the nearest is {_text(nearest)}"
    except ConfigurationError:
        mend = "the map has no FREE configuration at all; use a smaller robot, margin or spacing"
    return ConfigurationError(name, f"{_text(end)} {reason}", rule, mend, value=end, nearest=nearest)


def _text(point: Sequence[float]) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in point) + ")"
