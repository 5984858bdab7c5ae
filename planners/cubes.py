"""The map's own search, as a planner among OMPL's."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Final

from cspace.errors import InputError
from planners.search import Found

if TYPE_CHECKING:
    from cspace.space import CSpace
    from planners.ends import End

NAME: Final = "Cubes"
"""What :func:`planners.plan` calls this search."""


def is_cubes(planner: Any) -> bool:
    """Whether a planner's name, in upper or lower case, is that of this search."""
    return isinstance(planner, str) and planner.lower() == NAME.lower()


def check_cubes(space: CSpace, **options: Any) -> None:
    """Refuse what this search cannot do.

    Raises
    ------
    InputError
        If the robot turns, or an option is given that it does not know.
    """
    if space.rotations is not None:
        raise InputError(
            f"planner is {NAME!r} on a map with rotations; it is for robots that only translate; use e.g. RRTConnect"
        )
    for name, value in options.items():
        raise InputError(
            f"{name} is {value!r} and planner is {NAME!r}, which joins FREE cells along straight edges, by length, in "
            f"one go; leave {name} out, or choose a planner of OMPL, e.g. RRTConnect"
        )


def run_cubes(space: CSpace, start: End, goal: End, simplify: bool) -> Found:
    """Search a path between two configurations at which motions can be proven free."""
    began = time.perf_counter()
    path = space.free_path(start, goal, straight=simplify)
    status = "Exact solution" if len(path) else "undecided (no chain of FREE cells)"
    return Found(path, status, time.perf_counter() - began)
