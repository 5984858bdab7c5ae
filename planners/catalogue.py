"""OMPL's geometric planners and the built-in searches, by name, with the limits of each."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from functools import cache
from typing import Any, Final

from ompl import base as ob
from ompl import geometric as og

from cspace.errors import InputError

GRID: Final = "Grid"
"""Name by which :func:`planners.plan` runs :meth:`cspace.CSpace.find_path`."""

MAX_CLEARANCE: Final = "MaxClearance"
"""Name by which :func:`planners.plan` runs :meth:`cspace.CSpace.find_widest_path`."""

LATTICE: Final = "Lattice"
"""Name by which :func:`planners.plan` searches a lattice of headings, for drives that are not holonomic."""

BIRRT: Final = "BiRRT"
"""Name by which :func:`planners.plan` runs :meth:`cspace.ArmSpace.find_path`."""

BUILT_IN_SEARCHES: Final = (GRID, MAX_CLEARANCE, LATTICE, BIRRT)
"""Searches of maps and arms themselves, without OMPL."""

PLANNERS_WITHOUT_OBJECTIVE: Final = frozenset({"BKPIECE1", "KPIECE1", "LBKPIECE1", "RRT", "RRTConnect"})
"""Planners that stop at the first path, whatever the objective."""

THREADED_PLANNERS: Final = frozenset({"PRM", "PRMstar"})
"""Planners that look for a solution from a second thread.

That thread needs Python to call a Python objective or stopping rule, while the first thread holds Python and waits for
it: a deadlock, so such pairs are refused. Nor may a callback raise in them, because that ends the process.
"""

_BIDIRECTIONAL_PLANNERS: Final = ("BFMT", "BKPIECE1", "LBKPIECE1", "PRM", "PRMstar")
"""Planners that also follow edges from end to start."""

UNSAFE_PLANNERS: Final = {"AORRTC": "of OMPL 2.0.1 ends the process if a path is longer than some 90 m"}
"""Planners that are not offered, and why.

AORRTC looks for the root of a tree within a distance rounded to seven digits. If the root is farther off, AORRTC reads
beyond the end of its list.
"""

PLANNERS_REFUSED_BY_DRIVE: Final = {
    "dubins": dict.fromkeys(_BIDIRECTIONAL_PLANNERS, "also follows edges from end to start, which no such car drives")
}
"""Planners that cannot plan with a drive, and why, by drive."""

BIDIRECTIONAL_BY_DRIVE: Final = {"differential": frozenset(_BIDIRECTIONAL_PLANNERS)}
"""Planners whose edges must be free from end to start too, by drive.

The way back of a robot that turns on the spot only needs it to turn around. A car's way back is a loop, which is hardly
ever free, so :data:`PLANNERS_REFUSED_BY_DRIVE` has cars.
"""

FMT_SAMPLES_ALONG_CURVES: Final = 300
"""Samples with which FMT and BFMT begin along curves.

Within 8 s, OMPL's 1000 samples gave as many paths of the same length, but took four times as long. Within 2 s, they
gave a quarter as many paths along Dubins curves.
"""


def planner_names() -> tuple[str, ...]:
    """List the geometric planners that the installed OMPL binds, in alphabetical order.

    AORRTC is left out: in OMPL 2.0.1 it ends the process on paths longer than some 90 m.

    Returns
    -------
    tuple of str

    Examples
    --------
    >>> import planners
    >>> "RRTConnect" in planners.planner_names()
    True
    """
    return tuple(sorted((name for name in _planners() if name not in UNSAFE_PLANNERS), key=str.lower))


def planner_named(name: str | None, drive: str = "holonomic") -> str:
    """Return a planner's name as OMPL spells it, from a name in any case.

    None gives the planner that is mostly the quickest for the drive.

    Raises InputError if the name is unknown (the message lists all names), or the planner cannot plan with the drive.
    """
    if name is None:
        # RRTConnect's tree at the goal grows by curves that leave the goal; a Dubins car needs curves that arrive.
        return "RRT" if drive == "dubins" else "RRTConnect"
    known = {each.lower(): each for each in (*_planners(), *BUILT_IN_SEARCHES)}
    if not isinstance(name, str) or name.lower() not in known:
        close = difflib.get_close_matches(str(name).lower().replace("*", "star"), known, n=1)
        hint = f"choose one of {', '.join(planner_names())}"
        hint = f"did you mean {known[close[0]]}? {hint}" if close else hint
        searches = f"{GRID}, {MAX_CLEARANCE}, {LATTICE}, or for an arm {BIRRT}"
        rule = f"it must be a geometric planner of the installed OMPL, {searches}"
        raise InputError("planner", f"is {name!r}", rule, hint, value=name)
    planner = known[name.lower()]
    refused = PLANNERS_REFUSED_BY_DRIVE.get(drive, {}) if isinstance(drive, str) else {}
    reason = UNSAFE_PLANNERS.get(planner) or refused.get(planner)
    if reason:
        hint = "choose another planner, e.g. planner='RRT' or 'RRTstar'"
        raise InputError("planner", f"is {planner!r} and drive is {drive!r}", f"{planner} {reason}", hint, value=name)
    return planner


def make_planner(name: str, si: ob.SpaceInformation) -> ob.Planner:
    """Make a planner of OMPL, set to take short steps, so that it stops in time."""
    planner = getattr(og, name)(si)
    PLANNER_SETTINGS.get(name, lambda made: None)(planner)
    return planner


def _disable_pruning(planner: Any) -> None:
    # To prune, BIT* takes samples out of its search tree one by one, and rebuilds the tree at every 500th: minutes in
    # one step if distances are those of curves.
    planner.setPruning(False)


def _reduce_samples_along_curves(planner: Any) -> None:
    # A step of FMT measures from each of its neighbours to all samples, which takes tenths of a second along curves.
    # FMT draws more samples if these do not suffice.
    if isinstance(planner.getSpaceInformation().getStateSpace(), (ob.DubinsStateSpace, ob.ReedsSheppStateSpace)):
        planner.setNumSamples(FMT_SAMPLES_ALONG_CURVES)


PLANNER_SETTINGS: Final[dict[str, Callable[[ob.Planner], None]]] = {
    "BITstar": _disable_pruning,
    "BFMT": _reduce_samples_along_curves,
    "FMT": _reduce_samples_along_curves,
}
"""Functions that set up a newly made planner, by its name."""


@cache
def _planners() -> list[str]:
    # The bindings give a class without objects no constructor of its own.
    return [
        name
        for name, kind in vars(og).items()
        if isinstance(kind, type) and issubclass(kind, ob.Planner) and "__init__" in vars(kind)
    ]
