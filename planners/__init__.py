"""Planning with OMPL on certified configuration-space maps.

OMPL's objects must be gone before the interpreter ends, or its bindings report leaks: create them inside functions.
"""

from importlib import import_module

from cspace.errors import MissingPackageError

try:
    import_module("ompl.geometric")
except ImportError as error:
    raise MissingPackageError(
        f"planners needs OMPL, which cannot be imported ({error}); everything in cspace works without it; "
        "run: pip install ompl"
    ) from error

from planners.motion import MotionValidator as MotionValidator
from planners.objectives import ClearanceObjective as ClearanceObjective
from planners.objectives import OverlapObjective as OverlapObjective
from planners.plan import plan as plan
from planners.registry import planner_names as planner_names
from planners.result import Plan as Plan
from planners.result import Times as Times
from planners.sampling import FreeStateSampler as FreeStateSampler
from planners.spaces import simple_setup as simple_setup
from planners.spaces import state_space as state_space
from planners.validity import StateValidityChecker as StateValidityChecker

__all__ = [
    "ClearanceObjective",
    "FreeStateSampler",
    "MotionValidator",
    "OverlapObjective",
    "Plan",
    "StateValidityChecker",
    "Times",
    "plan",
    "planner_names",
    "simple_setup",
    "state_space",
]
