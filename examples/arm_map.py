"""
The joints of an arm as a map, and a proof that there is no path
================================================================

``cspace.build_joint_map`` maps all positions of two or three joints of an arm: cells of angles,
FREE or BLOCKED as a whole. The result is a map like any other: paths, clearances, pictures, files,
and the proof that no path exists, which no planner that samples can give.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cspace
import planners
from cspace.arms import PosedShape

# %%
# Two bars of 1 m on a foot, and four posts around it.

bar = '<collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>'
joint = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)
Path("two.urdf").write_text(
    f'<robot name="two bars"><link name="foot"/><link name="upper">{bar}</link><link name="fore">{bar}</link>'
    + joint.format("shoulder", "foot", "upper", 0)
    + joint.format("elbow", "upper", "fore", 1)
    + "</robot>"
)
arm = cspace.Arm.from_urdf("two.urdf")
posts = [(0.55, 0.8, 0.12), (1.35, -0.55, 0.2), (-1.1, 1.1, 0.25), (-0.9, -0.9, 0.15)]


def at(x, y):
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return pose


obstacles = {
    f"post {k}": PosedShape(cspace.Robot.cylinder(r, 1.0).shape, at(x, y))
    for k, (x, y, r) in enumerate(posts)
}
space = cspace.build_arm_space(obstacles, arm)

# %%
# Cells of 0.75 degrees, all proven.

joints = cspace.build_joint_map(space, 6.0 / 450)
print(joints)

# %% The upper bar cannot pass a post in its reach, so FREE and MIXED cells fall into components
# without a motion between them. Within a component, any planner finds a path, and the map proves
# it.

start, goal, behind = np.array([0.2, 0.9]), np.array([-1.2, -1.0]), np.array([1.7, -0.9])
print("is there a path to the goal?", joints.is_connected(start, goal))
print("is it proven that none leads behind the post?", joints.is_disconnected(start, behind))
plan = planners.plan(joints, start, goal, objective="clearance")
print(plan)
print("also proven by the arm space:", bool(np.all(space.certify_path(plan.path))))

# %%
# Left: the arm among its posts. Right: the map of its joints.

figure, (world, angles) = plt.subplots(
    1, 2, figsize=(13, 5.6), width_ratios=(1.0, 1.15), layout="constrained"
)
for x, y, r in posts:
    world.add_patch(plt.Circle((x, y), r, color="#262626"))
turns = np.linspace(0, len(plan.path) - 1, 9)[1:-1]
between = np.stack(
    [np.interp(turns, np.arange(len(plan.path)), column) for column in plan.path.T], axis=1
)
arms = [(q, "#009e73", 2.0) for q in between]
arms += [(start, "#0072b2", 5.0), (goal, "#cc79a7", 5.0), (behind, "#d55e00", 5.0)]
for (shoulder, elbow), color, width in arms:
    tip = np.cumsum(
        [[0, 0], *([[np.cos(a), np.sin(a)] for a in (shoulder, shoulder + elbow)])], axis=0
    )
    world.plot(
        *tip.T,
        "-o",
        color=color,
        linewidth=width,
        markersize=width + 1,
        alpha=1.0 if width > 2 else 0.5,
    )
world.set(aspect="equal", xlim=(-2.1, 2.1), ylim=(-2.1, 2.1), xlabel="x (m)", ylabel="y (m)")
world.set_title("from blue to pink; nothing leads to the orange one", fontsize=10)
joints.plot(ax=angles, path=plan.path, title="proof: the orange one is in another part")
angles.plot(*behind, "X", color="#d55e00", markeredgecolor="black", markersize=11)
figure.savefig("arm_map.png", dpi=110)
plt.close(figure)
print("wrote arm_map.png")
