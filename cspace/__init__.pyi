# Public names and packages. Each is imported at its first use, so that the import costs nothing.

from . import arms as arms
from . import errors as errors
from . import lanes as lanes
from . import plot as plot
from . import reasons as reasons
from . import regions as regions
from . import ros as ros
from . import spectral as spectral
from . import view as view
from ._builder import Suggestion as Suggestion
from ._builder import build as build
from ._builder import open as open  # noqa: A004
from ._builder import suggest as suggest
from ._exact.proofs import Closest as Closest
from ._gates.chunks import Chunk as Chunk
from ._gates.gate import Gate as Gate
from ._grid import Grid as Grid
from ._interface import Goal as Goal
from ._interface import Space as Space
from ._record.update import Update as Update
from ._robot import Robot as Robot
from ._rotations import Rotations as Rotations
from ._shapes.mesh import MeshWarning as MeshWarning
from ._shapes.mesh import make_mesh as make_mesh
from ._space import CSpace as CSpace
from ._support.arrays import BLOCKED as BLOCKED
from ._support.arrays import FREE as FREE
from ._support.arrays import MIXED as MIXED
from ._support.headers import get_cmake_dir as get_cmake_dir
from ._support.headers import get_include as get_include
from ._support.limits import raised_limits as raised_limits
from ._tiles.tiled_space import TiledCSpace as TiledCSpace
from ._workspace import Workspace as Workspace
from .arms import Arm as Arm
from .arms import ArmSpace as ArmSpace
from .arms import PoseGoal as PoseGoal
from .arms import build_arm_space as build_arm_space
from .arms import build_joint_map as build_joint_map
from .errors import AngleWarning as AngleWarning
from .errors import ConfigurationError as ConfigurationError
from .errors import CspaceError as CspaceError
from .errors import FileError as FileError
from .errors import GeometryError as GeometryError
from .errors import InputError as InputError
from .errors import MissingPackageError as MissingPackageError
from .errors import UnitWarning as UnitWarning
from .spectral import BallDecomposition as BallDecomposition

__version__: str
