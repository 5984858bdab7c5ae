"""
A waiter that keeps a glass upright
===================================

An arm carries a glass from under a board to above it, over a place to pass on its way. ``keep``
proves the tilt of the glass along with the path; ``max_jerk`` starts and stops it softly.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

import cspace
import planners
from cspace.arms import PosedShape

# %%
# Two bars and a hand, which turn about y. The hand carries the glass.

sizes = {"upper": (0.5, 0.06), "fore": (0.45, 0.06), "tool0": (0.12, 0.03)}
solid = (
    '<collision><origin xyz="{} 0 {}"/><geometry><box size="{} 0.05 {}"/></geometry></collision>'
)
links = {name: solid.format(x / 2, 0, x, z) for name, (x, z) in sizes.items()}
links["tool0"] += solid.format(0.1, 0.07, 0.05, 0.12)
urdf = "".join(f'<link name="{name}">{parts}</link>' for name, parts in links.items())
for parent, child, x, z in (
    ("base", "upper", 0, 0.3),
    ("upper", "fore", 0.5, 0),
    ("fore", "tool0", 0.45, 0),
):
    urdf += (
        f'<joint name="{child}_joint" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{x} 0 {z}"/><axis xyz="0 1 0"/>'
        '<limit lower="-2.8" upper="2.8" effort="1" velocity="1"/></joint>'
    )
Path("waiter.urdf").write_text(f'<robot name="waiter"><link name="base"/>{urdf}</robot>')
arm = cspace.Arm.from_urdf("waiter.urdf")

# %%
# A board, and the three places of the glass: under it, in front of it, and above it.


def at(x, z):
    pose = np.eye(4)
    pose[0, 3], pose[2, 3] = x, z
    return pose


board = PosedShape(cspace.Robot.box((0.6, 0.3, 0.03)).shape, at(0.95, 0.45))
space = cspace.build_arm_space({"board": board}, arm)
start, middle, goal = (
    arm.inverse("tool0", pose, near=(-1.0, 1.5, -0.5))[0]
    for pose in (at(0.72, 0.18), at(0.4, 0.35), at(0.72, 0.52))
)

# %%
# The glass tilts by at most 0.1 rad with ``keep``. Both paths pass the middle place.

glass = planners.Upright("tool0", tolerance=0.1)
plans = {
    "without keep": planners.plan(space, start, goal, via=[middle], seed=1),
    "with keep": planners.plan(space, start, goal, via=[middle], keep=glass, seed=1),
}
limits = {"max_acceleration": 2.0, "max_jerk": 20.0}
motions = {name: plan.trajectory(**limits) for name, plan in plans.items()}
for name, motion in motions.items():
    print(f"{name}: {motion.duration:.2f} s, {'proven' if motion.certified else 'not proven'}")
hasty = plans["with keep"].trajectory(max_acceleration=2.0)
print(f"without a limit of jerk: {hasty.duration:.2f} s")

# %%
# Left: the arm on its way, seen from the side. Middle: the tilt. Right: how softly it moves.

figure, (side, tilt, soft) = plt.subplots(1, 3, figsize=(13, 4), layout="constrained")
for name, color in (("without keep", "#d55e00"), ("with keep", "#6a1b9a")):
    times = np.linspace(0.0, motions[name].duration, 400)
    rows = motions[name].sample(times)[0]
    up = arm.pose(rows, "tool0")[:, 2, 2]
    tilt.plot(times, np.degrees(np.arccos(np.clip(up, -1.0, 1.0))), color=color, label=name)
outline = np.array([(0.06, 0.13), (0.075, 0.01), (0.125, 0.01), (0.14, 0.13)])  # of the glass
for q in rows[::40]:
    hand = arm.pose(q, "tool0")
    joints = [arm.pose(q, frame)[:3, 3] for frame in sizes]
    bars = np.array([*joints, hand[:3, 3] + 0.12 * hand[:3, 0]])
    cup = hand[:3, 3] + outline @ hand[:3, [0, 2]].T
    side.plot(*bars[:, [0, 2]].T, color="#a9dccd", linewidth=5)
    side.plot(*cup[:, [0, 2]].T, color="#6a1b9a")
side.add_patch(Rectangle((0.65, 0.435), 0.6, 0.03, facecolor="#262626"))
side.set(xlim=(-0.1, 1.1), ylim=(0.0, 0.85), aspect="equal", xlabel="x (m)", ylabel="z (m)")
tilt.axhline(np.degrees(0.1), color="#262626", linestyle="--", label="tolerance")
tilt.set(xlabel="time (s)", ylabel="tilt of the glass (degrees)")
tilt.legend(frameon=False)
for motion, color, name in (
    (hasty, "#d55e00", "any jerk"),
    (motions["with keep"], "#6a1b9a", "max_jerk=20"),
):
    times = np.linspace(0.0, motion.duration, 2000)
    soft.plot(times, motion.sample(times)[2][:, 1], color=color, label=name, linewidth=1.0)
soft.set(xlabel="time (s)", ylabel="acceleration of the elbow (rad/s²)")
soft.legend(frameon=False)
figure.savefig("waiter.png", dpi=110)
plt.close(figure)
print("wrote waiter.png")
