"""
First hour: a controller
========================

A differential drive follows a planned path without stops at its corners. Each corner is a curve that
is proven free, and the controller keeps a simulated robot within 1 cm of that curve at 20 Hz.
"""

import math

import numpy as np

import cspace
import planners
from cspace.plot import animate

# %%
# A room with two walls, and the fastest motion around these.

occupied = np.zeros((160, 100), dtype=bool)
occupied[50:54, :65] = True
occupied[105:109, 35:] = True
workspace = cspace.Workspace.from_array(occupied, 0.1)
space = cspace.build(workspace, cspace.Robot.rectangle(0.9, 0.6), rotations=72)
plan = planners.plan(space, (2.0, 2.0, 0.0), (14.0, 8.0, 0.0), drive=planners.Differential())
limits = {
    "max_velocity": 1.0,
    "max_acceleration": 0.5,
    "max_angular_velocity": 1.0,
    "max_angular_acceleration": 1.5,
}
trajectory = plan.trajectory(**limits)
stopping = plan.trajectory(**limits, blend=False)
print(f"{trajectory.duration:.1f} s, and {stopping.duration:.1f} s with stops at corners")
print("proven free" if trajectory.certified else "not proven")

# %%
# The robot starts 5 mm beside the path and its wheels slip by 2 %. The controller adds to `v` and
# `omega` what brings the error back to zero (Y. Kanayama and others, 1990). A real robot gets
# `v` and `omega` from the same six lines.

PERIOD = 0.05
wanted = trajectory.sample_uniform(1.0 / PERIOD)
x, y, yaw = wanted.positions[0] + (0.0, 0.005, 0.0)
driven = []
for (x_wanted, y_wanted, yaw_wanted), v, omega in zip(
    wanted.positions, wanted.v, wanted.omega, strict=True
):
    dx, dy = x_wanted - x, y_wanted - y
    ahead = math.cos(yaw) * dx + math.sin(yaw) * dy
    beside = math.cos(yaw) * dy - math.sin(yaw) * dx
    turn = math.remainder(yaw_wanted - yaw, 2.0 * math.pi)
    v = v * math.cos(turn) + 2.0 * ahead
    omega += 8.0 * v * beside + 4.0 * math.sin(turn)
    driven.append((x, y, yaw))
    for _ in range(10):  # the robot, 2 % slower than it should be
        x += 0.98 * v * math.cos(yaw) * PERIOD / 10.0
        y += 0.98 * v * math.sin(yaw) * PERIOD / 10.0
        yaw += omega * PERIOD / 10.0

# %%
# Distances from the proven path, along which the robot may lag behind.

path = trajectory.sample(np.linspace(0.0, trajectory.duration, 20_000))[0]
errors = [np.hypot(*(path[:, :2] - (x, y)).T).min() for x, y, _ in driven]
print(f"at most {1e3 * max(errors):.1f} mm from the path")
animate(space, trajectory, "controllers.gif", True, seconds=8)
