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
        "everything in cspace works without it",
        "run: pip install ompl",
    ) from error

from planners.callbacks import FreeStateSampler as FreeStateSampler
from planners.callbacks import MotionValidator as MotionValidator
from planners.callbacks import StateValidityChecker as StateValidityChecker
from planners.catalogue import planner_names as planner_names
from planners.objectives import ClearanceObjective as ClearanceObjective
from planners.objectives import OverlapObjective as OverlapObjective
from planners.objectives import WeightedLength as WeightedLength
from planners.plan import Choices as Choices
from planners.plan import choices as choices
from planners.plan import plan as plan
from planners.result import Plan as Plan
from planners.result import Times as Times
from planners.setup import simple_setup as simple_setup
from planners.setup import state_space as state_space
from planners.trajectory import Trajectory as Trajectory

__all__ = [
    "Choices",
    "ClearanceObjective",
    "FreeStateSampler",
    "MotionValidator",
    "OverlapObjective",
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
