# Public names and packages. Each is imported at its first use, so that the import costs nothing.

from . import arms as arms
from . import errors as errors
from . import plot as plot
from . import reasons as reasons
from . import shapes as shapes
from . import spectral as spectral
from . import view as view
from .arms import Arm as Arm
from .arms import ArmSpace as ArmSpace
from .arms import PoseGoal as PoseGoal
from .arms import build_arm_space as build_arm_space
from .arms import build_joint_map as build_joint_map
from .arms import undecided_pairs as undecided_pairs
from .builder import Suggestion as Suggestion
from .builder import build as build
from .builder import suggest as suggest
from .errors import AngleWarning as AngleWarning
from .errors import ConfigurationError as ConfigurationError
from .errors import CspaceError as CspaceError
from .errors import FileError as FileError
from .errors import GeometryError as GeometryError
from .errors import InputError as InputError
from .errors import MissingPackageError as MissingPackageError
from .errors import UnitWarning as UnitWarning
from .files import ros as ros
from .grid import Grid as Grid
from .interface import Goal as Goal
from .interface import Space as Space
from .limits import raised_limits as raised_limits
from .opening import open as open  # noqa: A004
from .raster import Raster as Raster
from .record.update import Update as Update
from .robot import Robot as Robot
from .rotations import Rotations as Rotations
from .shapes.mesh import Mesh as Mesh
from .shapes.mesh import MeshWarning as MeshWarning
from .space import CSpace as CSpace
from .spectral import BallDecomposition as BallDecomposition
from .support.arrays import BLOCKED as BLOCKED
from .support.arrays import FREE as FREE
from .support.arrays import MIXED as MIXED
from .support.headers import get_cmake_dir as get_cmake_dir
from .support.headers import get_include as get_include
from .tiles.space import TiledCSpace as TiledCSpace
from .workspace import LazyWorkspace as LazyWorkspace
from .workspace import Workspace as Workspace

__version__: str
