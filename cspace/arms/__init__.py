"""Arms: robots with joints, whose configurations and motions are proven free (experimental).

Words that the modules of this package share:

- *body*: links held together by fixed joints; *solid*: a body's surface, or an obstacle.
- *chain*: the bodies of an arm, each after its parent.
- *part*: a connected piece of a body's boundary.
- *tube*: the motion of the joints between two configurations, from which each may deviate.
- *slack*: by how much a distance exceeds the one that is required.
- *cone*: the directions within an angle of one that a link keeps.
- *inner ball*: a ball inside a solid, which proves collisions.
- *block*: cells of a joint map that are tested as one.
"""

from cspace.arms._arm_space import ArmSpace, build_arm_space
from cspace.arms._inverse import PoseGoal
from cspace.arms._joint_map import build_joint_map
from cspace.arms._lines import LineMotion
from cspace.arms._model import Arm, JointValues
from cspace.arms._moveit import (
    AttachedObject,
    MotionPlanRequest,
    PlanningScene,
    read_moveit_request,
    read_moveit_scene,
)
from cspace.arms._penetration import ArmPenetration
from cspace.arms._snapshots import Contact
from cspace.arms._solids import PosedShape
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
