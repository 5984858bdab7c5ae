"""Names and limits of OMPL's geometric planners and the built-in searches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, TypeAlias, cast, get_args

from ompl import geometric as og

from cspace import CSpace, Space
from cspace.errors import InputError
from cspace.inside import (
    ConfigurationMap,
    ConfigurationSpace,
    Upright,
    check_count,
    check_positive,
    suggest_name,
)
from planners._edges.local_planner import LocalPlanner

PlannerName: TypeAlias = Literal[
    "BITstar",
    "BKPIECE1",
    "FMT",
    "InformedRRTstar",
    "KPIECE1",
    "LBKPIECE1",
    "RRT",
    "RRTConnect",
    "RRTstar",
    "SORRTstar",
    "Grid",
    "MaxClearance",
    "Lattice",
    "BiRRT",
]
"""Planners of OMPL and built-in searches, as :func:`planners.plan` names them.

Not all of OMPL 2.0.1 can run from Python. The threads of PRM and PRMstar wait for Python's lock for
ever, AORRTC may read beyond the end of a list on paths of some 90 m, and BFMT with several goals.
"""

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

LENGTH: Final = "length"
CLEARANCE: Final = "clearance"
TIME: Final = "time"
COSTS: Final = "WeightedLength"
FUNCTION: Final = "a function"
"""Objectives of :func:`planners.plan`."""

NONE: Final = "None"
ANY: Final = "any"
DIFFERENTIAL: Final = "Differential"
CAR: Final = "Car"
REVERSING_CAR: Final = "Car(reverse=True)"
"""Values of ``drive`` and ``keep``, in messages."""


class Skills(NamedTuple):
    """What a planner supports; the page on planning prints these."""

    drive: tuple[str, ...] = (NONE,)
    objective: tuple[str, ...] = (LENGTH,)
    keep: tuple[str, ...] = (NONE,)
    iterations: bool = True  # whether it counts them

    @property
    def optimises(self) -> bool:
        """Whether a planner of OMPL goes on after the first path."""
        return FUNCTION in self.objective

    @property
    def is_bidirectional(self) -> bool:
        """Whether a planner of OMPL also follows edges from end to start.

        A robot that turns on the spot only has to turn around for the way back. That of a car is a
        loop, which is hardly ever free.
        """
        return CAR not in self.drive


_DRIVES: Final = (NONE, DIFFERENTIAL, REVERSING_CAR, CAR)
_WEIGHTED: Final = (LENGTH, CLEARANCE, TIME, COSTS)
_OBJECTIVES: Final = (*_WEIGHTED, FUNCTION)

SKILLS: Final[Mapping[str, Skills]] = {
    "BITstar": Skills(_DRIVES, _OBJECTIVES),
    "BKPIECE1": Skills(_DRIVES[:3]),
    "FMT": Skills(_DRIVES, _OBJECTIVES),
    "InformedRRTstar": Skills(_DRIVES, _OBJECTIVES),
    "KPIECE1": Skills(_DRIVES),
    "LBKPIECE1": Skills(_DRIVES[:3]),
    "RRT": Skills(_DRIVES),
    "RRTConnect": Skills(_DRIVES),
    "RRTstar": Skills(_DRIVES, _OBJECTIVES),
    "SORRTstar": Skills(_DRIVES, _OBJECTIVES),
    GRID: Skills(objective=_WEIGHTED, iterations=False),
    MAX_CLEARANCE: Skills(iterations=False),
    LATTICE: Skills(_DRIVES[1:], _WEIGHTED, iterations=False),
    BIRRT: Skills(keep=(NONE, ANY)),
}
"""Skills of each planner."""


@dataclass(frozen=True, slots=True)
class Search:
    """A planner with settings of its own, as the ``planner`` of :func:`planners.plan`.

    Attributes
    ----------
    name : str, optional
        Name of the planner, in upper or lower case; by default that of the space and the drive, or
        the first search of a space of your own. On a map, ``iterations`` alone are those of
        RRTConnect, or for a forward car of RRT.
    iterations : int, optional
        Largest number of iterations of a planner of OMPL, or of BiRRT's further searches.
    simplify : bool
        Whether to shorten the path.
    range : float, optional
        Longest edge of the trees of a named planner of OMPL, metres, where a radian counts half a
        metre except along curves; by default a fifth of the space's extent.

    Raises
    ------
    InputError
        If a value is of another kind, a name is unknown, or the planner has no such setting.

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
    range: float | None = None

    def __post_init__(self) -> None:
        """Check the settings."""
        if not isinstance(cast(object, self.simplify), bool):
            raise InputError("simplify", f"is {self.simplify!r}", "it must be True or False")
        name = None if self.name is None else planner_named(self.name)
        object.__setattr__(self, "name", name)
        if self.iterations is not None:
            count = check_count(self.iterations, "iterations", 1, 2**62)
            object.__setattr__(self, "iterations", count)
            self._require("iterations", name is None or SKILLS[name].iterations)
        if self.range is not None:
            object.__setattr__(self, "range", check_positive(self.range, "range"))
            self._require("range", has_range(name))

    def _require(self, setting: str, is_there: bool) -> None:
        """Raise InputError for a setting that the planner does not have."""
        if not is_there:
            problem = f"is {getattr(self, setting)!r} and name is {self.name!r}"
            raise InputError(
                setting, problem, f"{self.name or 'the default planner'} has no {setting}"
            )


def has_range(name: str | None) -> bool:
    """Return whether a planner is one of OMPL whose trees have a longest edge."""
    return hasattr(getattr(og, str(name), None), "setRange")


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
    if not isinstance(space, ConfigurationMap):
        return ARMS if isinstance(space, ConfigurationSpace) else OWN_SPACES
    if not isinstance(space, CSpace):
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


def planner_names() -> tuple[PlannerName, ...]:
    """List the planners of OMPL that :func:`planners.plan` runs, in alphabetical order."""
    return get_args(PlannerName)[: -len(BUILT_IN_SEARCHES)]


def planner_named(name: str, searches: Sequence[str] = ()) -> PlannerName:
    """Return a planner's or search's name as it is spelled.

    The given name may be in any case. Raises InputError if it is unknown.
    """
    known = {word.lower(): word for word in (*SKILLS, *searches)}
    if not isinstance(name, str) or name.lower() not in known:
        # Users of OMPL's documentation may write RRT*.
        hint = suggest_name(str(name).replace("*", "star"), known.values())
        rule = f"it must be {', '.join(known.values())}"
        raise InputError("planner", f"is {name!r}", rule, hint)
    return cast(PlannerName, known[name.lower()])


def check_skills(
    planner: PlannerName,
    edges: LocalPlanner,
    objective: object,
    kind: str,
    keep: Sequence[Upright],
    is_named: bool,
) -> None:
    """Raise InputError if a planner lacks the skills for the options of a plan.

    ``kind`` is that of the objective, and ``is_named`` says that the user chose the planner.
    """
    skills = SKILLS.get(planner, Skills())
    asked = (
        ("drive", edges.drive, edges.name, skills.drive),
        ("objective", objective, kind, skills.objective),
        ("keep", keep, ANY if keep else NONE, skills.keep),
    )
    for option, value, asked_kind, possible in asked:
        if asked_kind not in possible:
            problem = f"is {value!r} and planner is {planner!r}"
            if not is_named:
                problem += f", the default for objective={objective!r}"
            raise InputError(option, problem, f"{planner} takes {option}: {', '.join(possible)}")
