"""OMPL's geometric planners by name, and what each of them can do here."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from functools import cache
from typing import Any, Final

from ompl import base as ob
from ompl import geometric as og

from cspace.errors import InputError

GRID: Final = "Grid"
"""What :func:`planners.plan` calls the map's own search, :meth:`cspace.CSpace.find_path`."""

MAX_CLEARANCE: Final = "MaxClearance"
"""What it calls :meth:`cspace.CSpace.find_widest_path`."""

BIRRT: Final = "BiRRT"
"""What it calls the arm's own search, :meth:`cspace.ArmSpace.find_path`."""

OWN: Final = (GRID, MAX_CLEARANCE, BIRRT)
"""Searches of our own."""

IGNORE_OBJECTIVES: Final = frozenset({"BKPIECE1", "KPIECE1", "LBKPIECE1", "RRT", "RRTConnect"})
"""Planners that heed no objective: they stop at the first path."""

SECOND_THREAD: Final = frozenset({"PRM", "PRMstar"})
"""Planners that look for a solution from a second thread. It would need Python to call a Python objective or stopping
rule, while the first thread holds Python and waits for the second: a deadlock, so such pairs are refused. Nor may a
callback raise in them, which would end the process."""

_FROM_BOTH: Final = ("BFMT", "BKPIECE1", "LBKPIECE1", "PRM", "PRMstar")
"""Planners that take edges from their ends too."""

UNSAFE: Final = {"AORRTC": "of OMPL 2.0.1 ends the process where paths are longer than some 90 m"}
"""Planners that are not offered, and why. AORRTC looks for the root of a tree within a distance that is rounded to
seven digits, and where the root is farther off, it reads on behind the end of its list."""

REFUSED: Final = {
    "dubins": dict.fromkeys(_FROM_BOTH, "takes edges from their ends too, which such a car does not drive")
}
"""For each drive, the planners that cannot plan with it, and why."""

BIDIRECTIONAL: Final = {"differential": frozenset(_FROM_BOTH)}
"""For each drive, the planners for which edges must be free from end to start too, since they take them so. A car's
way back is a loop, which is hardly ever free; a robot that turns on the spot has only to turn around."""

SAMPLES: Final = 300
"""Samples with which FMT and BFMT begin along curves. Within 8 s, paths were as many and as long with OMPL's 1000, but
took four times as long to find; within 2 s, those by Dubins' curves were a quarter as many."""


def planner_names() -> tuple[str, ...]:
    """Names of the geometric planners that the installed OMPL binds, in alphabetical order.

    AORRTC is not among them: in OMPL 2.0.1 it ends the process on paths longer than some 90 m.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import planners
    >>> "RRTConnect" in planners.planner_names()
    True
    """
    return tuple(sorted((name for name in _planners() if name not in UNSAFE), key=str.lower))


def planner_named(name: str | None, drive: str = "holonomic") -> str:
    """A planner's name as OMPL spells it, from one in any case; without one, the planner that mostly is quickest.

    Raises InputError if there is none of that name; the message lists them all. Or if it cannot plan with the drive.
    """
    if name is None:
        # RRTConnect's tree at the goal grows by curves that leave the goal, where Dubins' car needs those that arrive.
        return "RRT" if drive == "dubins" else "RRTConnect"
    known = {each.lower(): each for each in (*_planners(), *OWN)}
    if not isinstance(name, str) or name.lower() not in known:
        close = difflib.get_close_matches(str(name).lower().replace("*", "star"), known, n=1)
        hint = f"choose one of {', '.join(planner_names())}"
        hint = f"did you mean {known[close[0]]}? {hint}" if close else hint
        rule = f"it must be a geometric planner of the installed OMPL, {GRID} or {MAX_CLEARANCE}, or for an arm {BIRRT}"
        raise InputError("planner", f"is {name!r}", rule, hint, value=name)
    planner = known[name.lower()]
    refused = REFUSED.get(drive, {}) if isinstance(drive, str) else {}
    reason = UNSAFE.get(planner) or refused.get(planner)
    if reason:
        hint = "choose another planner, e.g. planner='RRT' or 'RRTstar'"
        raise InputError("planner", f"is {planner!r} and drive is {drive!r}", f"{planner} {reason}", hint, value=name)
    return planner


def make_planner(name: str, si: ob.SpaceInformation) -> ob.Planner:
    """A planner of OMPL, with settings that keep its steps short, so that it stops in time."""
    planner = getattr(og, name)(si)
    SETTINGS.get(name, lambda made: None)(planner)
    return planner


def _no_pruning(planner: Any) -> None:
    # To prune, BIT* takes samples out of its search tree one by one, and at every 500th makes the tree anew: minutes
    # in one step where distances are those of curves.
    planner.setPruning(False)


def _few_along_curves(planner: Any) -> None:
    # A step of FMT measures from each of its neighbours to all samples, which takes tenths of a second where distances
    # are those of curves. It draws more where these do not do.
    if isinstance(planner.getSpaceInformation().getStateSpace(), (ob.DubinsStateSpace, ob.ReedsSheppStateSpace)):
        planner.setNumSamples(SAMPLES)


SETTINGS: Final[dict[str, Callable[[ob.Planner], None]]] = {
    "BITstar": _no_pruning,
    "BFMT": _few_along_curves,
    "FMT": _few_along_curves,
}
"""What is set of a planner when it is made."""


@cache
def _planners() -> list[str]:
    # A class of which no object can be made has no constructor of its own in the bindings.
    return [
        name
        for name, kind in vars(og).items()
        if isinstance(kind, type) and issubclass(kind, ob.Planner) and "__init__" in vars(kind)
    ]
