"""
Park a car
==========

A car cannot move sideways. It backs out of a gap between parked cars and drives into another, along
the shortest curves of Reeds and Shepp. Each curve is proven free along its whole length, not at
samples.
"""

import math

import numpy as np
from shapely import box

import cspace
import planners
from cspace.plot import animate, save_plot

# %%
# Two rows of parked cars with a gap in each, and a lane of 5 m between them.

upper = [box(x, -5, x + 2, -0.5) for x in (0.5, 6.1, 8.9, 11.7, 14.5)]
lower = [box(x, -14.5, x + 2, -10) for x in (0.5, 3.3, 6.1, 11.7, 14.5)]
workspace = cspace.Workspace.from_polygons([*upper, *lower], 0.1, bounds=(-1, -16, 20, 2))
space = cspace.build(workspace, cspace.Robot.rectangle(4.2, 1.9), rotations=72)

# %% A search on a lattice of headings and short curves finds the way, and longer curves then
# shorten it.

start, goal = (4.3, -2.6, math.pi / 2), (9.9, -12.0, -math.pi / 2)
plan = planners.plan(space, start, goal, drive=planners.Car(turning_radius=2.5, reverse=True))
print(plan)
print(f"{np.count_nonzero(np.diff(plan.direction))} changes of direction")
save_plot(space, "parking.png", True, path=plan)
animate(space, plan, "parking_film.gif", True, seconds=8)
