"""Planning with OMPL on certified configuration-space maps.

OMPL's objects must be gone before the interpreter ends, or its bindings report leaks: create them
inside functions.
"""

from importlib import import_module

from cspace.errors import MissingPackageError

try:
    import_module("ompl.geometric")
except ImportError as error:
    raise MissingPackageError(
        "planners",
        f"needs OMPL, which cannot be imported ({error})",
        "it has wheels for Python 3.11 to 3.13 on Linux and macOS; cspace works without it",
        "run: pip install ompl",
    ) from error

from planners._callbacks import FreeStateSampler, MotionValidator, StateValidityChecker
from planners._catalogue import planner_names
from planners._objectives import ClearanceObjective, WeightedLength
from planners._plan import Choices, choices, plan
from planners._result import Plan, Times
from planners._setup import simple_setup, state_space
from planners._trajectory import Trajectory

__all__ = [
    "Choices",
    "ClearanceObjective",
    "FreeStateSampler",
    "MotionValidator",
    "Plan",
    "StateValidityChecker",
    "Times",
    "Trajectory",
    "WeightedLength",
    "choices",
    "plan",
    "planner_names",
    "simple_setup",
    "state_space",
]
