# Public names. Each is imported at its first use, so that importing the package costs next to nothing.

from .arms import Arm as Arm
from .arms import ArmSpace as ArmSpace
from .arms import build_arm as build_arm
from .arms import build_arm_map as build_arm_map
from .builder import build as build
from .errors import AngleWarning as AngleWarning
from .errors import ConfigurationError as ConfigurationError
from .errors import CspaceError as CspaceError
from .errors import FileError as FileError
from .errors import GeometryError as GeometryError
from .errors import InputError as InputError
from .errors import MissingPackageError as MissingPackageError
from .grid import Grid as Grid
from .opening import open as open  # noqa: A004
from .opening import open_slice as open_slice
from .robot import Robot as Robot
from .rotations import Rotations as Rotations
from .shapes.mesh import Mesh as Mesh
from .shapes.mesh import MeshWarning as MeshWarning
from .space import CSpace as CSpace
from .spectral import Spheres as Spheres
from .states import BLOCKED as BLOCKED
from .states import FREE as FREE
from .states import MIXED as MIXED
from .tiles.space import TiledCSpace as TiledCSpace
from .version import __version__ as __version__
from .workspace import Workspace as Workspace
