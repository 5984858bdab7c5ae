# Public names and packages. Each is imported at its first use, so that the import costs nothing.

from . import arms as arms
from . import errors as errors
from . import exact as exact
from . import export as export
from . import files as files
from . import limits as limits
from . import plot as plot
from . import raster as raster
from . import shapes as shapes
from . import spectral as spectral
from . import update as update
from . import view as view
from . import workspace as workspace
from .arms import Arm as Arm
from .arms import ArmSpace as ArmSpace
from .arms import PoseGoal as PoseGoal
from .arms import build_arm_space as build_arm_space
from .arms import build_joint_map as build_joint_map
from .arms import undecided_pairs as undecided_pairs
from .arrays import BLOCKED as BLOCKED
from .arrays import FREE as FREE
from .arrays import MIXED as MIXED
from .builder import build as build
from .configuration_space import Goal as Goal
from .configuration_space import Space as Space
from .errors import AngleWarning as AngleWarning
from .errors import ConfigurationError as ConfigurationError
from .errors import CspaceError as CspaceError
from .errors import FileError as FileError
from .errors import GeometryError as GeometryError
from .errors import InputError as InputError
from .errors import MissingPackageError as MissingPackageError
from .errors import UnitWarning as UnitWarning
from .grid import Grid as Grid
from .opening import open as open  # noqa: A004
from .robot import Robot as Robot
from .rotations import Rotations as Rotations
from .shapes.mesh import Mesh as Mesh
from .shapes.mesh import MeshWarning as MeshWarning
from .space import CSpace as CSpace
from .spectral import BallDecomposition as BallDecomposition
from .tiles.space import TiledCSpace as TiledCSpace
from .workspace import Workspace as Workspace

__version__: str
