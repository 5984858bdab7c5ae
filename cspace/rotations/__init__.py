"""Rotation cells: the sets of rotations that a map distinguishes.

Each kind of rotation cells has a file here and a line below: its class, and a record whose methods numba compiles into
look-ups. No look-up knows which kind it uses.
"""

from cspace.rotations.base import NO_ROTATION as NO_ROTATION
from cspace.rotations.base import CompiledRotations as CompiledRotations
from cspace.rotations.base import OneRotation as OneRotation
from cspace.rotations.base import RotationCell as RotationCell
from cspace.rotations.base import Rotations as Rotations
from cspace.rotations.quaternion import QuaternionRotations
from cspace.rotations.yaw import YawRotations

Rotations.KINDS.update(fixed=OneRotation, yaw=YawRotations, quaternions=QuaternionRotations)
