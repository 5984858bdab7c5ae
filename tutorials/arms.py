"""
First hour: an arm
==================

``cspace.Arm`` reads a robot with joints from a URDF, and ``cspace.build_arm_space`` puts it among
obstacles. Configurations are then FREE, BLOCKED or MIXED, and a whole motion of the joints is
proven free in one call. Planners of OMPL take the space of an arm as they take a map.
``space.view()`` shows it in the browser, with a slider for each joint.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap

import cspace
import planners
from cspace.arms import PosedShape

# %%
# Two bars of 1 m on a foot. Both joints rotate about z.

bar = '<collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>'
joint = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)
Path("two.urdf").write_text(
    f'<robot name="two"><link name="foot"/><link name="upper">{bar}</link><link name="fore">{bar}</link>'
    + joint.format("shoulder", "foot", "upper", 0)
    + joint.format("elbow", "upper", "fore", 1)
    + "</robot>"
)
arm = cspace.Arm.from_urdf("two.urdf")


# %%
# Two posts and a wall. ``closest`` names the closest pair.


def at(x, y):
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return pose


obstacles = {
    "left post": PosedShape(cspace.Robot.cylinder(0.15, 1.0).shape, at(0.3, 1.3)),
    "right post": PosedShape(cspace.Robot.cylinder(0.2, 1.0).shape, at(1.3, 0.9)),
    "wall": PosedShape(cspace.Robot.box((4.0, 0.1, 1.0)).shape, at(0.0, -1.4)),
}
space = cspace.build_arm_space(obstacles, arm)
start, goal = np.array([-0.2, 0.4]), np.array([2.6, -0.4])
contact = space.closest(start)
print(f"at the start, {contact.link!r} is nearest to {contact.other!r}: {contact.distance:.2f} m")
print(
    f"straight from start to goal: {'proven free' if space.motion_is_free(start, goal) else 'not free'}"
)

# %%
# The configuration space, sampled every 1.5 degrees.

angles = np.linspace(-3.0, 3.0, 240)
states = np.asarray(space.classify(np.stack(np.meshgrid(angles, angles, indexing="ij"), axis=-1)))

# %%
# A plan: every motion of its path is proven free along its whole length.

plan = planners.plan(space, start, goal, time_limit=5.0, seed=1)
path = plan.path
print(plan)

# %%
# Left: the arm along its path. Right: the same path in the configuration space.

figure = plt.figure(figsize=(11, 5.2), layout="constrained")
space.plot(
    path=plan,
    ax=figure.add_subplot(1, 2, 1, projection="3d"),
    camera=(50, -70),
    legend=False,
    title="on its way",
)
joints = figure.add_subplot(1, 2, 2)
colors = ListedColormap(["#ffffff", "#d55e00", "#a6d3ee"])  # FREE, MIXED, BLOCKED
joints.pcolormesh(angles, angles, states.T, cmap=colors, vmin=0, vmax=2)
joints.plot(*path.T, color="#6a1b9a", linewidth=2.0)
joints.plot(*start, "o", color="white", mec="black")
joints.plot(*goal, "*", color="#cc79a7", mec="black", markersize=12)
joints.set(
    aspect="equal",
    xlabel="shoulder (rad)",
    ylabel="elbow (rad)",
    title="FREE white, BLOCKED blue, MIXED orange",
)
figure.savefig("arms.png", dpi=110)
plt.close(figure)
print("wrote arms.png")
