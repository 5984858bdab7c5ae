"""Names and limits of OMPL's geometric planners and the built-in searches."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from functools import cache
from typing import Final, Literal, TypeAlias, cast

from ompl import base as ob
from ompl import geometric as og

from cspace._support.words import Drive
from cspace.errors import InputError

PlannerName: TypeAlias = Literal[
    "BFMT",
    "BITstar",
    "BKPIECE1",
    "FMT",
    "InformedRRTstar",
    "KPIECE1",
    "LBKPIECE1",
    "PRM",
    "PRMstar",
    "RRT",
    "RRTConnect",
    "RRTstar",
    "SORRTstar",
    "Grid",
    "MaxClearance",
    "Lattice",
    "BiRRT",
]
"""Planners of OMPL 2.0.1 and built-in searches, as :func:`planners.plan` names them."""

GRID: Final = "Grid"
"""Name by which :func:`planners.plan` runs :meth:`cspace.CSpace.find_path`."""

MAX_CLEARANCE: Final = "MaxClearance"
"""Name by which :func:`planners.plan` runs :meth:`cspace.CSpace.find_widest_path`."""

LATTICE: Final = "Lattice"
"""Name by which :func:`planners.plan` searches a lattice of headings, for drives that are not
holonomic."""

BIRRT: Final = "BiRRT"
"""Name by which :func:`planners.plan` runs :meth:`cspace.ArmSpace.find_path`."""

BUILT_IN_SEARCHES: Final = (GRID, MAX_CLEARANCE, LATTICE, BIRRT)
"""Names of the searches that run without OMPL."""

PLANNERS_WITHOUT_OBJECTIVE: Final = frozenset(
    {"BKPIECE1", "KPIECE1", "LBKPIECE1", "RRT", "RRTConnect"}
)
"""Planners that stop at the first path and minimise nothing."""

THREADED_PLANNERS: Final = frozenset({"PRM", "PRMstar"})
"""Planners that look for a solution from a second thread.

The second thread needs Python's lock to call a Python objective or stopping rule, while the first
thread holds the lock and waits for it: a deadlock. So these planners are refused with such
callbacks. A callback must not raise in them either, because an exception ends the process.
"""

BIDIRECTIONAL_PLANNERS: Final = frozenset({"BFMT", "BKPIECE1", "LBKPIECE1", "PRM", "PRMstar"})
"""Planners that also follow edges from end to start.

A robot that turns on the spot only has to turn around for the way back, so its edges must be free
both ways. The way back of a car is a loop, which is hardly ever free, so these planners are refused
for Dubins curves.
"""

UNSAFE_PLANNERS: Final = {
    "AORRTC": "of OMPL 2.0.1 ends the process if a path is longer than some 90 m"
}
"""Planners that are not offered, with the reason.

AORRTC looks for the root of a tree within a distance rounded to seven digits. If the root is
farther away, AORRTC reads beyond the end of its list.
"""

FMT_SAMPLES_ALONG_CURVES: Final = 300
"""Initial number of samples of FMT and BFMT if edges are curves.

OMPL's default is 1000. Within 8 s, both numbers gave as many paths of the same length, but 1000
samples took four times as long. Within 2 s, 1000 samples gave a quarter as many paths along Dubins
curves.
"""


def planner_names() -> tuple[PlannerName, ...]:
    """List the geometric planners of the installed OMPL.

    The order is alphabetical. AORRTC is left out, because OMPL 2.0.1 ends the process on paths
    longer than about 90 m.

    Returns
    -------
    tuple of PlannerName

    Examples
    --------
    >>> import planners
    >>> "RRTConnect" in planners.planner_names()
    True
    """
    safe = [name for name in _list_planners() if name not in UNSAFE_PLANNERS]
    return cast(tuple[PlannerName, ...], tuple(sorted(safe, key=str.lower)))


def planner_named(
    name: PlannerName | None, drive: Drive = "holonomic", searches: Sequence[str] = ()
) -> PlannerName:
    """Return the name of a planner of OMPL, or of a search of a space, as it is spelled.

    The given name may be in any case; None gives the default. Raises InputError if the name is
    unknown, or if the planner cannot plan with the drive.
    """
    if name is None:
        # RRTConnect's tree at the goal grows by curves that leave the goal; a Dubins car needs
        # curves that arrive.
        return "RRT" if drive == "dubins" else "RRTConnect"
    known = {word.lower(): word for word in (*_list_planners(), *BUILT_IN_SEARCHES, *searches)}
    if not isinstance(name, str) or name.lower() not in known:
        # Users of OMPL's documentation may write RRT*.
        hint = f"choose one of {', '.join(planner_names())}"
        spelling = str(name).lower().replace("*", "star")
        for similar in difflib.get_close_matches(spelling, known, n=1):
            hint = f"did you mean {known[similar]}? {hint}"
        others = [word for word in searches if word not in BUILT_IN_SEARCHES]
        choices = [*others, GRID, MAX_CLEARANCE, LATTICE, f"or for an arm {BIRRT}"]
        raise InputError(
            "planner",
            f"is {name!r}",
            f"it must be a geometric planner of the installed OMPL, {', '.join(choices)}",
            hint,
        )
    planner = cast(PlannerName, known[name.lower()])
    problem = f"is {planner!r}"
    reason = UNSAFE_PLANNERS.get(planner)
    if drive == "dubins" and planner in BIDIRECTIONAL_PLANNERS:
        problem = f"{problem} and drive is {drive!r}"
        reason = "also follows edges from end to start, which no such car drives"
    if reason:
        raise InputError(
            "planner",
            problem,
            f"{planner} {reason}",
            "choose another planner, e.g. planner='RRT' or 'RRTstar'",
        )
    return planner


def make_planner(name: str, si: ob.SpaceInformation) -> ob.Planner:
    """Create an OMPL planner by name, with settings that keep its steps short."""
    planner = getattr(og, name)(si)
    if name == "BITstar":
        # Pruning rebuilds the search tree at every 500th sample. Along curves, one such step takes
        # minutes, so the planner would exceed its time limit.
        planner.setPruning(False)
    has_curves = isinstance(si.getStateSpace(), (ob.DubinsStateSpace, ob.ReedsSheppStateSpace))
    if name in ("FMT", "BFMT") and has_curves:
        # More are drawn if needed. A step measures from each neighbor to all samples, which takes
        # tenths of a second along curves.
        planner.setNumSamples(FMT_SAMPLES_ALONG_CURVES)
    return planner


@cache
def _list_planners() -> list[str]:
    """List the names of OMPL's concrete geometric planners."""
    # The bindings define no constructor for an abstract class.
    return [
        name
        for name, kind in vars(og).items()
        if isinstance(kind, type) and issubclass(kind, ob.Planner) and "__init__" in vars(kind)
    ]
