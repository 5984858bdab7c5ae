"""
A base with an arm fetches from a shelf
=======================================

A mobile manipulator drives through a door and reaches between two boards. Its base, lift and arm
move at once: the base is three more joints of the arm, two that slide and one that turns.
"""

from pathlib import Path

import numpy as np

import cspace
import planners
from cspace.arms import PosedShape
from cspace.plot import animate

# %%
# The robot: boxes for links, and a table of joints. The turn is ``continuous``, so that it has no
# end.

boxes = {
    "base": ((0.6, 0.5, 0.3), (0, 0, 0.2)),
    "mast": ((0.1, 0.1, 0.4), (0, 0, 0.2)),
    "upper": ((0.4, 0.08, 0.08), (0.25, 0, 0)),
    "fore": ((0.3, 0.06, 0.06), (0.2, 0, 0)),
}
joints = [  # name, kind, parent, child, axis, place on the parent, lower and upper limit
    ("x", "prismatic", "floor", "rail_x", "1 0 0", "0 0 0", 0, 6),
    ("y", "prismatic", "rail_x", "rail_y", "0 1 0", "0 0 0", 0, 4),
    ("turn", "continuous", "rail_y", "base", "0 0 1", "0 0 0", 0, 0),
    ("lift", "prismatic", "base", "mast", "0 0 1", "0.1 0 0.36", 0, 0.4),
    ("shoulder", "revolute", "mast", "upper", "0 0 1", "0 0 0.45", -2.5, 2.5),
    ("elbow", "revolute", "upper", "fore", "0 0 1", "0.46 0 0", -2.5, 2.5),
]
urdf = ""
for name in ("floor", "rail_x", "rail_y", *boxes):
    solid = ""
    if name in boxes:
        size, center = (" ".join(map(str, numbers)) for numbers in boxes[name])
        solid = f'<origin xyz="{center}"/><geometry><box size="{size}"/></geometry>'
        solid = f"<collision>{solid}</collision>"
    urdf += f'<link name="{name}">{solid}</link>'
for name, kind, parent, child, axis, place, lower, upper in joints:
    urdf += (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{place}"/><axis xyz="{axis}"/>'
        f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/></joint>'
    )
Path("porter.urdf").write_text(f'<robot name="porter">{urdf}</robot>')
porter = cspace.Arm.from_urdf("porter.urdf")

# %%
# The room: a wall with a door of 0.9 m, and two boards of a shelf.


def block(lower, upper):
    pose = np.eye(4)
    pose[:3, 3] = np.add(lower, upper) / 2
    return PosedShape(cspace.Robot.box(np.subtract(upper, lower)).shape, pose)


room = {
    "wall": block((2.9, 0, 0), (3.1, 1.5, 1.3)),
    "wall beyond the door": block((2.9, 2.4, 0), (3.1, 4, 1.3)),
    "board": block((5.2, 0.5, 0.7), (5.8, 1.5, 0.75)),
    "board above": block((5.2, 0.5, 1.15), (5.8, 1.5, 1.2)),
}
space = cspace.build_arm_space(room, porter)

# %%
# The goal is a place of the hand; the planner finds all six joints. The motion obeys limits, and
# is proven at every instant, not only at its rows.

start = (1.0, 1.0, 0.0, 0.0, -1.2, 2.4)
hand = np.eye(4)
hand[:3, 3] = 5.3, 1.0, 0.95
goal = cspace.PoseGoal("fore", hand, tolerance=(0.02, 0.1))
plan = planners.plan(space, start, goal, seed=1)
print(plan)
motion = plan.trajectory(max_acceleration=0.8)
print(f"{motion.duration:.1f} s, {'proven' if motion.certified else 'not proven'}")

# %%
# A picture, and the film.

space.plot(path=plan, camera=(35, -110)).figure.savefig("porter.png")
animate(space, motion, "porter_film.gif", True, seconds=8, camera=(35, -110))
print("wrote porter.png and porter_film.gif")
