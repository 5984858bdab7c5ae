"""Rotation cells: the sets of rotations that a map distinguishes.

Each kind of rotation cells has a file here and a line below. Kernels call
:mod:`cspace._rotations.lookup`.
"""

from cspace._rotations.base import NO_ROTATION as NO_ROTATION
from cspace._rotations.base import OneRotation as OneRotation
from cspace._rotations.base import RotationCell as RotationCell
from cspace._rotations.base import Rotations as Rotations
from cspace._rotations.yaw import YawRotations


def _load_quaternions() -> type[Rotations]:
    """Return the cells of all rotations in space, which most maps do without."""
    from cspace._rotations.quaternion import QuaternionRotations

    return QuaternionRotations


Rotations._KINDS.update(
    fixed=lambda: OneRotation, yaw=lambda: YawRotations, quaternions=_load_quaternions
)
