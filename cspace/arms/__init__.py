"""Arms: robots with joints, whose configurations and motions are proven free of collisions."""

from cspace.arms.joint_map import build_arm_map
from cspace.arms.model import Arm
from cspace.arms.solids import Placed, read_moveit_scene
from cspace.arms.space import ArmSpace, Contact, build_arm

__all__ = ["Arm", "ArmSpace", "Contact", "Placed", "build_arm", "build_arm_map", "read_moveit_scene"]
