"""Certified configuration-space maps for motion planning.

Every name is imported at its first use, so that importing the package costs next to nothing.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from cspace.states import BLOCKED as BLOCKED
from cspace.states import FREE as FREE
from cspace.states import MIXED as MIXED
from cspace.version import __version__ as __version__

if TYPE_CHECKING:
    from cspace.arms import Arm as Arm
    from cspace.arms import ArmSpace as ArmSpace
    from cspace.arms import build_arm as build_arm
    from cspace.arms import build_arm_map as build_arm_map
    from cspace.builder import build as build
    from cspace.errors import AngleWarning as AngleWarning
    from cspace.errors import ConfigurationError as ConfigurationError
    from cspace.errors import CspaceError as CspaceError
    from cspace.errors import FileError as FileError
    from cspace.errors import GeometryError as GeometryError
    from cspace.errors import InputError as InputError
    from cspace.errors import MissingPackageError as MissingPackageError
    from cspace.grid import Grid as Grid
    from cspace.opening import open_map
    from cspace.opening import open_slice as open_slice
    from cspace.robot import Robot as Robot
    from cspace.rotations import Rotations as Rotations
    from cspace.shapes.mesh import Mesh as Mesh
    from cspace.shapes.mesh import MeshWarning as MeshWarning
    from cspace.space import CSpace as CSpace
    from cspace.spectral import Spheres as Spheres
    from cspace.tiles.space import TiledCSpace as TiledCSpace
    from cspace.workspace import Workspace as Workspace

    open = open_map  # noqa: A001 - the public name

_HOME = {
    "Arm": ("cspace.arms", "Arm"),
    "ArmSpace": ("cspace.arms", "ArmSpace"),
    "build_arm": ("cspace.arms", "build_arm"),
    "build_arm_map": ("cspace.arms", "build_arm_map"),
    "build": ("cspace.builder", "build"),
    "AngleWarning": ("cspace.errors", "AngleWarning"),
    "ConfigurationError": ("cspace.errors", "ConfigurationError"),
    "CspaceError": ("cspace.errors", "CspaceError"),
    "FileError": ("cspace.errors", "FileError"),
    "GeometryError": ("cspace.errors", "GeometryError"),
    "InputError": ("cspace.errors", "InputError"),
    "MissingPackageError": ("cspace.errors", "MissingPackageError"),
    "Grid": ("cspace.grid", "Grid"),
    "open": ("cspace.opening", "open_map"),
    "open_slice": ("cspace.opening", "open_slice"),
    "Mesh": ("cspace.shapes", "Mesh"),
    "MeshWarning": ("cspace.shapes", "MeshWarning"),
    "Robot": ("cspace.robot", "Robot"),
    "Rotations": ("cspace.rotations", "Rotations"),
    "CSpace": ("cspace.space", "CSpace"),
    "Spheres": ("cspace.spectral", "Spheres"),
    "TiledCSpace": ("cspace.tiles.space", "TiledCSpace"),
    "Workspace": ("cspace.workspace", "Workspace"),
}

__all__ = ["BLOCKED", "FREE", "MIXED", "__version__", *_HOME]


if not TYPE_CHECKING:

    def __getattr__(name: str) -> object:
        try:
            module, attribute = _HOME[name]
        except KeyError:
            raise AttributeError(f"module 'cspace' has no attribute {name!r}") from None
        value = getattr(import_module(module), attribute)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
