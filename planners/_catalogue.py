"""Names and limits of OMPL's geometric planners and the built-in searches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Final, Literal, NamedTuple, TypeAlias, cast, get_args

from ompl import base as ob
from ompl import geometric as og

from cspace import Space
from cspace.errors import InputError
from cspace.inside import Car, ConfigurationSpace, Differential, check_count, suggest_name
from planners._local_planner import Drive

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
"""Name by which :func:`planners.plan` searches a short or cheap chain of cells of a map."""

MAX_CLEARANCE: Final = "MaxClearance"
"""Name by which :func:`planners.plan` searches a chain of largest clearance of a map in memory."""

LATTICE: Final = "Lattice"
"""Name by which :func:`planners.plan` searches a lattice of headings, for drives that are not
holonomic."""

BIRRT: Final = "BiRRT"
"""Name by which :func:`planners.plan` runs :meth:`cspace.ArmSpace.search`."""

BUILT_IN_SEARCHES: Final = (GRID, MAX_CLEARANCE, LATTICE, BIRRT)
"""Names of the searches that run without OMPL."""

PLANNERS_OF_OMPL: Final[tuple[PlannerName, ...]] = get_args(PlannerName)[: -len(BUILT_IN_SEARCHES)]
"""Names of the planners that OMPL runs."""

PLANNERS_WITHOUT_OBJECTIVE: Final = ("BKPIECE1", "KPIECE1", "LBKPIECE1", "RRT", "RRTConnect")
"""Planners that stop at the first path and minimise nothing."""

THREADED_PLANNERS: Final = ("PRM", "PRMstar")
"""Planners that look for a solution from a second thread.

The second thread needs Python's lock to call a Python objective or stopping rule, while the first
thread holds the lock and waits for it: a deadlock. So these planners are refused with such
callbacks. An exception of a callback would end the process, so a plan raises it after the search.
"""

BIDIRECTIONAL_PLANNERS: Final = ("BFMT", "BKPIECE1", "LBKPIECE1", "PRM", "PRMstar")
"""Planners that also follow edges from end to start.

A robot that turns on the spot only has to turn around for the way back, so its edges must be free
both ways. The way back of a car is a loop, which is hardly ever free, so these planners are refused
for Dubins curves.
"""

UNSAFE_PLANNER: Final = "AORRTC"
"""Planner that is not offered.

AORRTC looks for the root of a tree within a distance rounded to seven digits. If the root is
farther away, AORRTC reads beyond the end of its list.
"""

LENGTH: Final = "length"
CLEARANCE: Final = "clearance"
FUNCTION: Final = "a function"
"""Objectives of :func:`planners.plan`."""

SEVERAL: Final = "several"
OWN_SEARCH: Final = "a search of your own space"
GIVEN: Final = "given"
"""Values of ``goal``, ``planner`` and ``keep`` in :data:`REFUSALS`."""

NO_DRIVE: Final = "None"
DIFFERENTIAL: Final = "Differential"
CAR: Final = "Car"
FORWARD_CAR: Final = "Car(reverse=False)"
"""Values of ``drive`` in :data:`REFUSALS`."""

WITHOUT_ITERATIONS: Final = (GRID, MAX_CLEARANCE, LATTICE, *THREADED_PLANNERS)
"""Planners that count no iterations, or cannot call Python from their threads."""

_NO_SECOND_THREAD: Final = "cannot call Python from its second thread"
"""What planners with threads must not do: it would wait for the first thread for ever."""


class Refusal(NamedTuple):
    """Options that :func:`planners.plan` refuses together."""

    options: Mapping[str, Sequence[object]]  # their values; errors are about the first one
    reason: str  # after the name of the planner


REFUSALS: Final = (
    Refusal(
        {"planner": (UNSAFE_PLANNER,)},
        "of OMPL 2.0.1 ends the process if a path is longer than some 90 m",
    ),
    Refusal(
        {"planner": BIDIRECTIONAL_PLANNERS, "drive": (FORWARD_CAR,)},
        "also follows edges from end to start, which no such car drives",
    ),
    Refusal(
        {"planner": (LATTICE,), "drive": (NO_DRIVE,)},
        "is for all other drives",
    ),
    Refusal(
        {"drive": (FORWARD_CAR, CAR, DIFFERENTIAL), "planner": (GRID, MAX_CLEARANCE)},
        "is for holonomic robots",
    ),
    Refusal(
        {"objective": (CLEARANCE, FUNCTION), "planner": PLANNERS_WITHOUT_OBJECTIVE},
        "ignores objectives",
    ),
    Refusal({"objective": (CLEARANCE, FUNCTION), "planner": THREADED_PLANNERS}, _NO_SECOND_THREAD),
    Refusal({"objective": (FUNCTION,), "planner": (GRID,)}, "minimises length or clearance"),
    Refusal(
        {
            "objective": (CLEARANCE, FUNCTION),
            "planner": (MAX_CLEARANCE, LATTICE, BIRRT, OWN_SEARCH),
        },
        "minimises the length",
    ),
    Refusal(
        {"exact": (True,), "planner": (GRID,), "objective": (CLEARANCE,)},
        f"uses FREE cells for objective={CLEARANCE!r}",
    ),
    Refusal({"exact": (True,), "planner": (MAX_CLEARANCE,)}, "uses FREE cells"),
    Refusal(
        {
            "exact": (True,),
            "planner": (LATTICE,),
            "drive": (DIFFERENTIAL,),
        },
        "uses FREE cells",
    ),
    Refusal({"goal": (SEVERAL,), "planner": THREADED_PLANNERS}, _NO_SECOND_THREAD),
    Refusal(
        {"goal": (SEVERAL,), "planner": ("BFMT",)},
        "of OMPL 2.0.1 may end the process if it has several",
    ),
    Refusal(
        {"keep": (GIVEN,), "planner": PLANNERS_OF_OMPL},
        "samples configurations that are not upright",
    ),
)
"""What :func:`planners.plan` refuses; the page on planning prints this table."""


@dataclass(frozen=True, slots=True)
class Search:
    """A planner with settings of its own, as the ``planner`` of :func:`planners.plan`.

    Attributes
    ----------
    name : str, optional
        Name of the planner, in upper or lower case; by default that of the space and the drive. On
        a map, ``iterations`` alone are those of RRTConnect, or for a forward car of RRT.
    iterations : int, optional
        Largest number of iterations of a planner of OMPL, or of BiRRT's further searches.
    simplify : bool
        Whether to shorten the path.

    Raises
    ------
    InputError
        If a value is of another kind, or the planner counts no iterations.

    Examples
    --------
    >>> import numpy as np, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
    >>> search = planners.Search("RRTstar", iterations=500)
    >>> planners.plan(space, (1.0, 1.5), (3.5, 1.5), planner=search, seed=1).length
    2.5
    """

    name: PlannerName | None = None
    iterations: int | None = None
    simplify: bool = True

    def __post_init__(self) -> None:
        """Check the settings."""
        if not isinstance(cast(object, self.simplify), bool):
            raise InputError("simplify", f"is {self.simplify!r}", "it must be True or False")
        if self.iterations is None:
            return
        object.__setattr__(self, "iterations", check_count(self.iterations, "iterations", 1, 2**62))
        if str(self.name).lower() in map(str.lower, WITHOUT_ITERATIONS):
            problem = f"is {self.iterations} and name is {self.name!r}"
            raise InputError("iterations", problem, f"{self.name} counts none")


MAPS: Final = "maps of poses"
TILED_MAPS: Final = "tiled maps"
JOINT_MAPS: Final = "maps of joints"
ARMS: Final = "arms"
OWN_SPACES: Final = "your own spaces"
SPACE_KINDS: Final = (MAPS, TILED_MAPS, JOINT_MAPS, ARMS, OWN_SPACES)
"""Kinds of spaces."""

ANY_ROTATION: Final = "a place with any rotation"
REGION: Final = "a place that is a region"
NEAR: Final = "`planners.Near`"
NEAR_START: Final = "`planners.Near` as the start"
"""Places in :data:`SUPPORTED`."""

SUPPORTED: Final[Mapping[str, tuple[str, ...]]] = {
    "a list of alternatives": SPACE_KINDS,
    "`cspace.PoseGoal`": (ARMS,),
    ANY_ROTATION: (MAPS, TILED_MAPS),
    REGION: (MAPS, TILED_MAPS),
    NEAR: (MAPS, TILED_MAPS),
    NEAR_START: (MAPS, TILED_MAPS, JOINT_MAPS),
    "`via`": SPACE_KINDS,
    "`keep`": (ARMS,),
}
"""Kinds of spaces that each goal and option is for; the page on planning prints this table."""


def find_space_kind(space: Space) -> str:
    """Return the kind of a space, one of :data:`SPACE_KINDS`."""
    if not space.has_cells:
        return ARMS if isinstance(space, ConfigurationSpace) else OWN_SPACES
    if not space.in_memory:
        return TILED_MAPS
    return MAPS if space.has_poses else JOINT_MAPS


def check_support(option: str, argument: str, value: object, space: Space) -> None:
    """Raise InputError for a goal or option outside :data:`SUPPORTED`."""
    kinds = SUPPORTED[option]
    if find_space_kind(space) not in kinds:
        problem = f"is {value!r} and space is {space!r}"
        raise InputError(argument, problem, f"it is for {' and '.join(kinds)}")
    if option == REGION and space.dim != 2:
        raise InputError(argument, f"is {value!r}", "a region is for maps of the plane")
    if option == ANY_ROTATION and not space.rotations.names:
        problem = f"is {value!r} and the axes are ({', '.join(space.axes)})"
        raise InputError(argument, problem, "the robot does not turn")


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
    safe = [name for name in _list_planners() if name != UNSAFE_PLANNER]
    return cast(tuple[PlannerName, ...], tuple(sorted(safe, key=str.lower)))


def default_planner(drive: Drive | None) -> PlannerName:
    """Return the planner of OMPL that runs by default."""
    # RRTConnect's tree at the goal grows by curves that leave the goal; a Dubins car needs curves
    # that arrive.
    return "RRT" if _name_drive(drive) == FORWARD_CAR else "RRTConnect"


def _name_drive(drive: object) -> str:
    """Return the value of a drive in :data:`REFUSALS`."""
    if isinstance(drive, Car):
        return CAR if drive.reverse else FORWARD_CAR
    return DIFFERENTIAL if isinstance(drive, Differential) else NO_DRIVE


def planner_named(name: str, searches: Sequence[str] = ()) -> PlannerName:
    """Return a planner's or search's name as it is spelled.

    The given name may be in any case. Raises InputError if it is unknown.
    """
    known = {word.lower(): word for word in (*_list_planners(), *BUILT_IN_SEARCHES, *searches)}
    if not isinstance(name, str) or name.lower() not in known:
        # Users of OMPL's documentation may write RRT*.
        hint = suggest_name(str(name).replace("*", "star"), known.values())
        others = [word for word in searches if word not in BUILT_IN_SEARCHES]
        choices = [*others, GRID, MAX_CLEARANCE, LATTICE, f"or for an arm {BIRRT}"]
        raise InputError(
            "planner",
            f"is {name!r}",
            f"it must be a geometric planner of the installed OMPL, {', '.join(choices)}",
            hint,
        )
    return cast(PlannerName, known[name.lower()])


def check_options(values: Mapping[str, object], is_named: bool, n_goals: int = 1) -> None:
    """Raise InputError if options do not go together, by :data:`REFUSALS`.

    ``values`` are those of planner, objective, drive, exact and keep; ``is_named`` says that the
    user chose the planner.
    """
    planner = values["planner"]
    kinds = {**values, "goal": SEVERAL if n_goals > 1 else None}
    kinds["drive"] = _name_drive(values["drive"])
    if planner not in (*_list_planners(), *BUILT_IN_SEARCHES):
        kinds["planner"] = OWN_SEARCH
    if callable(values["objective"]):
        kinds["objective"] = FUNCTION
    kinds["keep"] = GIVEN if values.get("keep") else None
    for options, reason in REFUSALS:
        if not all(kinds[option] in refused for option, refused in options.items()):
            continue
        option, *others = options
        problem = f"is {values.get(option)!r}"
        if option == "goal":
            problem = f"has {n_goals} configurations"
        elif option == "exact":
            option, problem = "space", "is space.exact"
        if others:
            problem += f" and {others[0]} is {values[others[0]]!r}"
        if not is_named:
            problem += f", the default for objective={values['objective']!r}"
        raise InputError(option, problem, f"{planner} {reason}")


def make_planner(name: str, si: ob.SpaceInformation) -> ob.Planner:
    """Create an OMPL planner by name, with short steps."""
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
