"""Arms: robots with joints, whose configurations and motions are proven free (experimental).

Four rooms hold what :class:`Arm` and :class:`ArmSpace` are built on, each with its words: readers
of files, proofs about bodies, searches of paths, and maps of joints.
"""

from cspace.arms._arm_space import ArmSpace, build_arm_space
from cspace.arms._inverse import PoseGoal
from cspace.arms._joint_maps.joint_map import build_joint_map
from cspace.arms._model import Arm, JointValues
from cspace.arms._moveit import (
    AttachedObject,
    MotionPlanRequest,
    PlanningScene,
    read_moveit_request,
    read_moveit_scene,
)
from cspace.arms._paths.lines import LineMotion
from cspace.arms._penetration import ArmPenetration
from cspace.arms._proofs.solids import PosedShape
from cspace.arms._snapshots import Contact
from cspace.arms._sphere_models import SphereModel

__all__ = [
    "Arm",
    "ArmPenetration",
    "ArmSpace",
    "AttachedObject",
    "Contact",
    "JointValues",
    "LineMotion",
    "MotionPlanRequest",
    "PlanningScene",
    "PoseGoal",
    "PosedShape",
    "SphereModel",
    "build_arm_space",
    "build_joint_map",
    "read_moveit_request",
    "read_moveit_scene",
]
