"""Rotation cells: the sets of rotations that a map distinguishes, and the numbers that configurations have of them.

A kind of rotation cells is one file here, and one line below: its class, and the record that compiled look-ups get of
it, whose methods numba compiles into them. No look-up knows which kind it has.
"""

from cspace.rotations.base import NO_ROTATION as NO_ROTATION
from cspace.rotations.base import CompiledRotations as CompiledRotations
from cspace.rotations.base import OneRotation as OneRotation
from cspace.rotations.base import RotationCell as RotationCell
from cspace.rotations.base import Rotations as Rotations
from cspace.rotations.quaternion import QuaternionRotations
from cspace.rotations.yaw import YawRotations

Rotations.KINDS.update(fixed=OneRotation, yaw=YawRotations, quaternions=QuaternionRotations)
