"""
A straight line of a tool, and how near it stays
================================================

``space.follow_line`` brings a frame of an arm along straight lines from pose to pose. The motion is
proven free, and its distance from the line has a proven bound. Here a hand goes around three sides
of a rectangle, beside a post, and keeps its rotation.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import cspace
import planners
from cspace.arms import PosedShape

# %%
# Two bars of 1 m and a hand of 0.3 m. All joints rotate about z.

bar = '<collision><origin xyz="{} 0 0"/><geometry><box size="{} 0.08 0.08"/></geometry></collision>'
joint = (
    '<joint name="{}" type="revolute"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/>'
    '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)
Path("three.urdf").write_text(
    f'<robot name="three"><link name="foot"/><link name="upper">{bar.format(0.5, 1)}</link>'
    f'<link name="fore">{bar.format(0.5, 1)}</link><link name="hand">{bar.format(0.15, 0.3)}</link>'
    + joint.format("shoulder", "foot", "upper", 0)
    + joint.format("elbow", "upper", "fore", 1)
    + joint.format("wrist", "fore", "hand", 1)
    + "</robot>"
)
arm = cspace.Arm.from_urdf("three.urdf")


def at(x, y):
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return pose


space = cspace.build_arm_space(
    {"post": PosedShape(cspace.Robot.cylinder(0.12, 0.6).shape, at(1.35, 0.0))}, arm
)

# %%
# The corners of the line. Poses without a rotation keep the hand along x.

corners = [at(0.9, 0.7), at(1.4, 0.7), at(1.4, 0.35), at(0.7, 0.35)]
tolerance = 2e-3, 0.01  # metres and radians

# %%
# Try each configuration at the first corner, until one reaches the last corner. Then plan to it.

candidates = arm.inverse("hand", corners[0])
for start in candidates[space.is_free(candidates)]:
    motion = space.follow_line(start, "hand", corners[1:], tolerance=tolerance)
    print(motion)
    if motion.certified:
        break
plan = planners.plan(space, (-1.5, 1.0, 0.0), motion.path[0], time_limit=5.0, seed=1)
print(plan)

# %% Left: the arm from above, at the waypoints. Right: the distance from the line, sampled, below
# its proven bound.

times = np.linspace(0.0, 1.0, 40)[:, np.newaxis]
steps = np.diff(motion.path, axis=0)
q = (motion.path[:-1, np.newaxis] + times * steps[:, np.newaxis]).reshape(-1, arm.dof)
parameters = (motion.parameters[:-1] + times * np.diff(motion.parameters)).T.ravel()
number = np.minimum(parameters.astype(int), len(motion.poses) - 2)
first, last = motion.poses[number, :3, 3], motion.poses[number + 1, :3, 3]
targets = first + (parameters - number)[:, np.newaxis] * (last - first)
distances = np.linalg.norm(arm.pose(q, "hand")[:, :3, 3] - targets, axis=1)

figure = plt.figure(figsize=(11, 4.6), layout="constrained")
drawing = figure.add_subplot(1, 2, 1)
poses = arm.poses(motion.path)
joints = np.stack([poses[link][:, :2, 3] for link in ("upper", "fore", "hand")], axis=1)
tips = (poses["hand"] @ (0.3, 0.0, 0.0, 1.0))[:, np.newaxis, :2]
for chain in np.concatenate([joints, tips], axis=1):
    drawing.plot(*chain.T, "o-", color="#7fb8a4", linewidth=1.0, markersize=3.0)
drawing.plot(
    *motion.poses[:, :2, 3].T, color="#d55e00", linewidth=3.0, label="line of the hand's frame"
)
drawing.add_patch(plt.Circle((1.35, 0.0), 0.12, color="#6b6b6b"))
drawing.set(
    aspect="equal", xlabel="x (m)", ylabel="y (m)", title="around three sides, the hand along x"
)
drawing.legend(loc="lower center")
graph = figure.add_subplot(1, 2, 2)
graph.plot(parameters, 1e3 * distances, color="#6a1b9a", label="sampled distance from the target")
graph.axhline(1e3 * motion.deviation, color="#009e73", label="proven bound")
graph.axhline(1e3 * tolerance[0], color="#262626", linestyle=":", label="tolerance")
graph.plot(
    motion.parameters, np.zeros(len(motion.parameters)), "|", color="#d55e00", label="waypoints"
)
graph.set(xlabel="parameter on the line", ylabel="mm", ylim=(-0.05, 3.0))
graph.legend(loc="upper right")
figure.savefig("arm_line.png", dpi=110)
plt.close(figure)
print("wrote arm_line.png")
