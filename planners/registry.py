"""OMPL's geometric planners, by name."""

from __future__ import annotations

import difflib
from typing import Any, Final

from ompl import base as ob
from ompl import geometric as og

from cspace.errors import InputError

IGNORE_OBJECTIVES: Final = frozenset({"AORRTC", "BKPIECE1", "KPIECE1", "LBKPIECE1", "RRT", "RRTConnect"})
"""Planners that heed no objective: they stop at the first path, or optimise the length whatever they are told."""

SECOND_THREAD: Final = frozenset({"PRM", "PRMstar"})
"""Planners that look for a solution from a second thread. It would need Python to ask a Python objective or stopping
rule, while the first thread holds Python and waits for the second: a deadlock, so such pairs are refused."""

_BOTH_WAYS: Final = "takes edges from their ends too, which a car that cannot reverse does not drive"

NO_CURVES: Final[dict[str, dict[str, str]]] = {
    "dubins": {
        "AORRTC": "crashes where the way back is another",
        **dict.fromkeys(("BFMT", "BKPIECE1", "LBKPIECE1", "PRM", "PRMstar"), _BOTH_WAYS),
    }
}
"""For each curve, the planners that cannot plan along it, and why: their paths were found not to be proven."""


def default_planner(curve: str | None) -> str:
    """The planner where none is named."""
    return "RRT" if curve == "dubins" else "RRTConnect"


def check_curve(planner: str, curve: str | None) -> None:
    """Refuse planners that cannot plan along curves.

    Raises
    ------
    InputError
        If the planner cannot.
    """
    reason = NO_CURVES.get(curve or "", {}).get(planner)
    if reason:
        raise InputError(
            f"curve is {curve!r} and planner is {planner!r}; {planner} {reason}; choose another planner, e.g. RRT"
        )


def planner_names() -> tuple[str, ...]:
    """Names of the geometric planners that the installed OMPL binds, in alphabetical order.

    Returns
    -------
    tuple of str
    """
    return tuple(sorted(_planners(), key=str.lower))


def find_planner(name: str) -> Any:
    """A planner's class, by its name.

    Parameters
    ----------
    name : str
        Upper and lower case are the same.

    Returns
    -------
    type
        Subclass of ``ompl.base.Planner``.

    Raises
    ------
    InputError
        If there is none of that name; the message lists them all.
    """
    known = {each.lower(): each for each in _planners()}
    if isinstance(name, str) and name.lower() in known:
        return getattr(og, known[name.lower()])
    close = difflib.get_close_matches(str(name).lower().replace("*", "star"), known, n=1)
    hint = f"did you mean {known[close[0]]}? " if close else ""
    raise InputError(
        f"planner is {name!r}; it must be a geometric planner of the installed OMPL, or Cubes; {hint}choose one of "
        f"{', '.join(planner_names())}"
    )


def _planners() -> list[str]:
    # A class of which no object can be made has no constructor of its own in the bindings.
    return [
        name
        for name, kind in vars(og).items()
        if isinstance(kind, type) and issubclass(kind, ob.Planner) and "__init__" in vars(kind)
    ]
