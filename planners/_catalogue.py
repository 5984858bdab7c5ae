"""The planners by their names, and their settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Final, Literal, TypeAlias, cast, get_args

from cspace import Space
from cspace.errors import InputError, MissingPackageError
from cspace.inside import (
    check_count,
    check_positive,
    names_options,
    suggest_name,
)

if TYPE_CHECKING:
    from planners._task import Planner

OmplName: TypeAlias = Literal[
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
]
"""Planners of OMPL.

Not all of OMPL 2.0.1 can run from Python. The threads of PRM and PRMstar wait for Python's lock for
ever, AORRTC may read beyond the end of a list on paths of some 90 m, and BFMT with several goals.
"""

PlannerName: TypeAlias = Literal[OmplName, "Grid", "Lattice", "BiRRT"]
"""Planners of OMPL and built-in searches, as :func:`planners.plan` names them."""

MODULES: Final[Mapping[str, str]] = {
    **dict.fromkeys(get_args(OmplName), "planners._ompl.search"),
    "Grid": "planners._searches.shortest",
    "Lattice": "planners._searches.lattice",
}
"""Module of each planner, whose ``PLANNERS`` holds it; spaces may bring further searches."""


def find_planner(name: str) -> Planner:
    """Load a planner by its name.

    Raises MissingPackageError for a planner of OMPL if OMPL cannot be imported.
    """
    if name not in MODULES:
        from planners._searches.built_in import SpaceSearch

        return SpaceSearch(name)
    try:
        planner: Planner = import_module(MODULES[name]).PLANNERS[name]
    except ImportError:
        check_ompl()
        raise
    return planner


def check_ompl() -> None:
    """Raise MissingPackageError if OMPL cannot be imported."""
    try:
        import_module("ompl.geometric")
    except ImportError as error:
        raise MissingPackageError(
            "ompl",
            f"cannot be imported ({error})",
            "it has wheels for Python 3.11 to 3.13 on Linux and macOS; "
            "planners that are not of OMPL work without it",
        ) from error


def list_searches(space: Space) -> tuple[PlannerName, ...]:
    """List the built-in searches for a space."""
    own = get_args(OmplName)
    names = [name for name in MODULES if name not in own and find_planner(name).takes_space(space)]
    return cast(tuple[PlannerName, ...], (*space.searches, *names))


@names_options
@dataclass(frozen=True, slots=True)
class Search:
    """A planner with settings, as the ``planner`` of :func:`planners.plan`.

    Attributes
    ----------
    name : str, optional
        Name of the planner, in upper or lower case; by default chosen by the space and the drive,
        or the first search of a space of your own. On a map, ``iterations`` without a name select
        RRTConnect, or RRT for a forward car.
    iterations : int, optional
        Largest number of iterations of a planner of OMPL, or of BiRRT's further searches.
    simplify : bool
        Whether to shorten the path.
    range : float, optional
        Longest edge of the trees of a named planner of OMPL, metres; a radian counts half a metre
        except along curves. By default a fifth of the space's extent.

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
        name = None if self.name is None else planner_named(self.name)
        object.__setattr__(self, "name", name)
        if self.iterations is not None:
            count = check_count(self.iterations, "iterations", 1, 2**62)
            object.__setattr__(self, "iterations", count)
            counts = name is None or find_planner(name).counts_iterations
            self._require("iterations", counts)
        if self.range is not None:
            object.__setattr__(self, "range", check_positive(self.range, "range"))
            self._require("range", name is not None and find_planner(name).has_range)

    def _require(self, setting: str, is_there: bool) -> None:
        """Raise InputError for a setting that the planner lacks."""
        if not is_there:
            problem = f"is {getattr(self, setting)!r} and name is {self.name!r}"
            raise InputError(
                setting, problem, f"{self.name or 'the default planner'} has no {setting}"
            )


def planner_names() -> tuple[PlannerName, ...]:
    """List OMPL's planners that :func:`planners.plan` runs, in alphabetical order."""
    return get_args(OmplName)


def planner_named(name: str, searches: Sequence[str] = ()) -> PlannerName:
    """Return the correct spelling of a planner's or search's name.

    The given name may be in any case. Raises InputError if it is unknown.
    """
    known = {word.lower(): word for word in (*get_args(PlannerName), *searches)}
    if not isinstance(name, str) or name.lower() not in known:
        hint = suggest_name(name, known.values())
        rule = f"it must be {', '.join(known.values())}"
        raise InputError("planner", f"is {name!r}", rule, hint)
    return cast(PlannerName, known[name.lower()])
