# Public names. Each is imported at its first use.

from ._catalogue import Search as Search
from ._drives import Car as Car
from ._drives import Differential as Differential
from ._goals import Near as Near
from ._objectives import ClearanceObjective as ClearanceObjective
from ._objectives import WeightedLength as WeightedLength
from ._ompl_callbacks import FreeStateSampler as FreeStateSampler
from ._ompl_callbacks import MotionValidator as MotionValidator
from ._ompl_callbacks import StateValidityChecker as StateValidityChecker
from ._plan import Choices as Choices
from ._plan import Upright as Upright
from ._plan import choices as choices
from ._plan import plan as plan
from ._result import Plan as Plan
from ._result import Times as Times
from ._setup import simple_setup as simple_setup
from ._setup import state_space as state_space
from ._speed_limits import SlowNear as SlowNear
from ._speed_limits import SpeedZones as SpeedZones
from ._speed_limits import ToolSpeed as ToolSpeed
from ._trajectory import Trajectory as Trajectory
from ._warm_up import warm_up as warm_up
