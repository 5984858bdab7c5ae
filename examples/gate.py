"""
A gate between a policy and an arm
==================================

A policy knows nothing of the shelf, and pushes the arm towards it, with noise. ``cspace.Gate``
proves each chunk of its commands before the arm moves, with room for the error of the controller.
It lets the proven part through, and then holds.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Rectangle

import cspace
from cspace.arms import PosedShape

# %%
# Two bars of 1 m on a foot, and a shelf of three boards, seen from above.

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
boards = {
    "back": (0.9, 1.4, 0.9, 0.06),
    "left": (0.45, 1.15, 0.06, 0.5),
    "right": (1.35, 1.15, 0.06, 0.5),
}


def place(x, y, width, depth):
    pose = np.eye(4)
    pose[:2, 3] = x, y
    return PosedShape(cspace.Robot.box((width, depth, 0.5)).shape, pose)


space = cspace.build_arm_space({name: place(*board) for name, board in boards.items()}, arm)

# %%
# The policy: ten rows that lead to a configuration inside the right board, 0.05 s apart.

rng = np.random.default_rng(2)
target = np.array([0.6, 0.7])


def ask_policy(q):
    rows = [q]
    for _ in range(10):
        towards = np.clip(target - rows[-1], -0.03, 0.03)
        rows.append(rows[-1] + towards + rng.normal(0.0, 0.01, 2))
    return np.array(rows[1:])


# %%
# The loop: five of ten commands are executed, then the policy is asked again. The controller strays
# by up to 0.01 rad.

TRACKING = 0.01


def drive(gate):
    q = np.array([-0.4, 0.9])
    driven = [q]
    states = []
    for _ in range(16):
        rows = ask_policy(q)
        if gate is not None:
            passed = gate.check_rows(q, rows)
            rows = passed.commands
            states.append(passed.state)
            refusal = passed.chunk.refusal
        for row in rows[:5]:
            q = row + rng.uniform(-TRACKING, TRACKING, 2)
            driven.append(q)
    if gate is not None:
        print(f"{states}\nat the end: {refusal.message}")
    return np.array(driven)


without = drive(None)
gated = drive(cspace.Gate(space, tracking=TRACKING, dt=0.05))
distances = {"without": space.obstacle_distance(without)}
distances["with a gate"] = space.obstacle_distance(gated)
for name, values in distances.items():
    print(f"{name}: at least {values.min():.3f} m from the shelf; 0 if it is touched")

# %%
# Left: the arm every fifth command. Right: the distance from the shelf; zero is contact.

figure, (plane, time) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
for x, y, width, depth in boards.values():
    plane.add_patch(Rectangle((x - width / 2, y - depth / 2), width, depth, color="#262626"))
for path, color, name in ((without, "#d55e00", "without"), (gated, "#009e73", "with a gate")):
    for number, (first, second) in enumerate(path[::5]):
        elbow = np.array([np.cos(first), np.sin(first)])
        tip = elbow + np.array([np.cos(first + second), np.sin(first + second)])
        is_last = number == len(path) // 5
        plane.plot(
            *np.transpose([(0.0, 0.0), elbow, tip]),
            color=color,
            alpha=1.0 if is_last else 0.25,
            linewidth=12.0 if is_last else 1.5,
            solid_capstyle="butt",
        )
    time.plot(0.05 * np.arange(len(path)), distances[name], color=color, label=name)
plane.set(aspect="equal", xlabel="x (m)", ylabel="y (m)", title="the arm, and where it ends")
time.set(xlabel="time (s)", ylabel="distance (m)", title="distance from the shelf; 0 is contact")
time.axhline(0.0, color="#262626", linewidth=0.8)
time.legend()
figure.savefig("gate.png", dpi=110)
print("wrote gate.png")
