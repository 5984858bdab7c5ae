"""Start and goal: configurations that a path can begin and end at."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from cspace.errors import ConfigurationError, InputError
from cspace.states import FREE, NAMES

if TYPE_CHECKING:
    from cspace.space import CSpace

End = tuple[float, ...]


def check_end(space: CSpace, q: ArrayLike, name: str) -> End:
    """A start or goal as floats, if a motion can be proven free there.

    Parameters
    ----------
    space : CSpace
    q : array-like, shape (dof,)
    name : str
        "start" or "goal".

    Returns
    -------
    tuple of float

    Raises
    ------
    InputError
        If it is not one configuration of finite numbers.
    ConfigurationError
        If it lies outside the map, is not FREE, or lies on the border of a cell that is not FREE.
    """
    point = space.grid.coordinates(q, name)
    if point.ndim != 1:
        raise InputError(
            f"{name} has shape {point.shape}; it must be one configuration; pass {space.grid.dim} numbers, in metres"
        )
    end = tuple(point.tolist())
    inside = all(low <= x <= high for low, x, high in zip(space.grid.lower, end, space.grid.upper, strict=True))
    if inside and space.edge_checker()(*end, *end):
        return end
    raise _unusable(space, end, name, inside)


def _unusable(space: CSpace, end: End, name: str, inside: bool) -> ConfigurationError:
    """The error that says what is wrong with a configuration, and which one is near and right."""
    state = space.classify(end)
    if not inside:
        reason = f"lies outside the map, which reaches from {_text(space.grid.lower)} to {_text(space.grid.upper)}"
        rule = "a path stays within the map"
    elif state != FREE:
        reason = f"lies in a {NAMES[state].upper()} cell"
        rule = f"the {name} must be FREE, which is to say proven collision-free"
    else:
        reason = "is FREE but lies on the border of a cell that is not"
        rule = f"a motion from or to it would touch that cell too, so the {name} must lie inside"
    try:
        nearest = tuple(space.nearest_free(end).tolist())
    except ConfigurationError:
        mend = "the map has no FREE configuration at all; use a smaller robot, margin or spacing"
        return ConfigurationError(f"{name} {_text(end)} {reason}; {rule}; {mend}")
    return ConfigurationError(f"{name} {_text(end)} {reason}; {rule}; the nearest is {_text(nearest)}", nearest)


def _text(point: End) -> str:
    return "(" + ", ".join(f"{x:.6g}" for x in point) + ")"
