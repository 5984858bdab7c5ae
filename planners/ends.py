"""Start and goal: configurations that a path can begin and end at."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from cspace.errors import ConfigurationError, InputError
from cspace.grid import finite
from cspace.rotations import MAX_YAW
from cspace.states import BLOCKED, FREE, NAMES
from planners.states import TURNING, kind_of
from planners.straight import exactly, wrap

if TYPE_CHECKING:
    from cspace.space import CSpace

End = tuple[float, ...]


def check_end(space: CSpace, q: ArrayLike, name: str, exact: bool = False) -> End:
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
        Metres; and radians in [-pi, pi).

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
        raise InputError(
            f"{name} has shape {point.shape}; it must be one configuration of {space.dof} numbers; pass "
            f"{kind_of(space).units}"
        )
    end = tuple(point.tolist())
    if kind_of(space) is TURNING:
        if abs(end[2]) > MAX_YAW:
            raise InputError(f"{name} has a yaw of {end[2]:g} rad; at most {MAX_YAW:.0f} can be wrapped; wrap it first")
        end = (*end[:2], wrap(end[2]))
    inside = all(low <= x <= high for low, x, high in zip(space.grid.lower, end, space.grid.upper, strict=False))
    if inside and space.edge_checker(**exactly(exact))(*end, *end):
        return end
    raise _unusable(space, end, name, inside, exact)


def _unusable(space: CSpace, end: End, name: str, inside: bool, exact: bool) -> ConfigurationError:
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
    try:
        nearest = tuple(space.nearest_free(end).tolist())
        if kind_of(space) is TURNING:
            nearest = (*nearest[:2], wrap(nearest[2]))
    except ConfigurationError:
        mend = "the map has no FREE configuration at all; use a smaller robot, margin or spacing"
        return ConfigurationError(f"{name} {_text(end)} {reason}; {rule}; {mend}")
    return ConfigurationError(f"{name} {_text(end)} {reason}; {rule}; the nearest is {_text(nearest)}", nearest=nearest)


def _text(point: End) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in point) + ")"
