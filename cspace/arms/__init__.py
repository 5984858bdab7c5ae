"""Arms: robots with joints, whose configurations and motions are proven free of collisions."""

from cspace.arms.inverse import PoseGoal
from cspace.arms.joint_map import JointMap, build_joint_map, undecided_pairs
from cspace.arms.lines import LineMotion
from cspace.arms.model import Arm, JointValues
from cspace.arms.moveit import (
    AttachedObject,
    JointGoal,
    MotionPlanRequest,
    PlanningScene,
    read_moveit_request,
    read_moveit_scene,
)
from cspace.arms.penetration import ArmPenetration
from cspace.arms.snapshots import Contact
from cspace.arms.solids import PosedShape
from cspace.arms.space import ArmSpace, build_arm_space

__all__ = [
    "Arm",
    "ArmPenetration",
    "ArmSpace",
    "AttachedObject",
    "Contact",
    "JointGoal",
    "JointMap",
    "JointValues",
    "LineMotion",
    "MotionPlanRequest",
    "PlanningScene",
    "PoseGoal",
    "PosedShape",
    "build_arm_space",
    "build_joint_map",
    "read_moveit_request",
    "read_moveit_scene",
    "undecided_pairs",
]
