# Public names. Each is imported at its first use.

from ._catalogue import Search as Search
from ._edges.drives import Car as Car
from ._edges.drives import Differential as Differential
from ._goals import Near as Near
from ._motion.speed_limits import SlowNear as SlowNear
from ._motion.speed_limits import SpeedZones as SpeedZones
from ._motion.speed_limits import ToolSpeed as ToolSpeed
from ._motion.trajectory import Trajectory as Trajectory
from ._ompl.checkers import FreeStateSampler as FreeStateSampler
from ._ompl.checkers import MotionValidator as MotionValidator
from ._ompl.checkers import StateValidityChecker as StateValidityChecker
from ._ompl.setup import simple_setup as simple_setup
from ._ompl.setup import state_space as state_space
from ._plan import Choices as Choices
from ._plan import Upright as Upright
from ._plan import choices as choices
from ._plan import plan as plan
from ._result import Plan as Plan
from ._result import Times as Times
from ._searches.objectives import ClearanceObjective as ClearanceObjective
from ._searches.objectives import WeightedLength as WeightedLength
from ._warm_up import warm_up as warm_up
