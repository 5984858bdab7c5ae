"""
A robot that must turn to fit
=============================

Two rooms are joined by a passage of 1 m. The robot, 0.9 m by 0.6 m, fits into it lengthwise and
cannot turn there.
"""

import math

import matplotlib.pyplot as plt
import numpy as np
from shapely import box

import cspace
import planners
from cspace.plot import animate, save_plot

walls = [box(0, 0, 13, 6) - box(0.2, 0.2, 12.8, 5.8), box(6, 0, 7, 3.8), box(6, 4.8, 7, 6)]
furniture = [box(2.5, 2, 3.5, 4), box(9.5, 3, 10.3, 6)]
workspace = cspace.Workspace.from_polygons([*walls, *furniture], spacing=0.05)
space = cspace.build(workspace, cspace.Robot.rectangle(0.9, 0.6), rotations=72)
print(space)

# %% A batch of configurations is one look-up: the yaws at which the robot fits into the center of
# the passage.

yaws = np.arange(0, 180, 5)
fits = space.is_free([(6.5, 4.3, yaw) for yaw in np.radians(yaws)])
print(f"it fits at {yaws[fits].tolist()} degrees")

# %%
# A path from one room into the other. In yellow cells the robot is free at some yaws only.

plan = planners.plan(space, (1, 5, math.pi / 2), (12, 5, 0), time_limit=10, seed=1)
print(plan)
save_plot(space, "doors.png", True, path=plan)

# %%
# Slices at a few yaws, and an animation.

figure, panels = plt.subplots(3, 1, figsize=(6.5, 9.6), layout="compressed")
for ax, degrees in zip(panels, (0, 45, 90), strict=True):
    space.plot(ax=ax, rotation=math.radians(degrees), legend=False, title=f"yaw {degrees}°")
    ax.label_outer()
figure.savefig("doors_slices.png")
plt.close(figure)
animate(space, plan, "doors_film.gif", True)
