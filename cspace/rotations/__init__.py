"""Rotation cells: the sets of rotations that a map distinguishes.

Each kind of rotation cells has a file here and a line below. :mod:`cspace.rotations.lookup` is what
kernels call.
"""

from cspace.rotations.base import NO_ROTATION as NO_ROTATION
from cspace.rotations.base import OneRotation as OneRotation
from cspace.rotations.base import RotationCell as RotationCell
from cspace.rotations.base import Rotations as Rotations
from cspace.rotations.quaternion import QuaternionRotations
from cspace.rotations.yaw import YawRotations

Rotations.KINDS.update(fixed=OneRotation, yaw=YawRotations, quaternions=QuaternionRotations)
