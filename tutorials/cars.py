"""
First hour: a car
=================

A car cannot move sideways and cannot turn on the spot. Its paths are curves, and each curve is
proven free along its whole length.
"""

import math

import numpy as np
from shapely import box

import cspace
import planners
from cspace.plot import animate, save_plot

# %%
# The car and its reference point
# -------------------------------
#
# The curves are those of the center of the axle that does not steer, so put this point at the
# origin. Here it is the center of the rear axle of a car of 4.2 m by 1.8 m; 0.9 m of the car is
# behind the axle.

car = cspace.Robot.rectangle(4.2, 1.8, center=(1.2, 0.0))
street = [box(-5, -4, 45, -2.2), box(-5, 12, 45, 14)]  # kerbs
parked = [box(x, -2.0, x + 4.4, -0.2) for x in (0, 5, 17.5, 22.5, 27.5)]
van = [box(15, 3.2, 21, 5.4)]
workspace = cspace.Workspace.from_polygons([*street, *parked, *van], 0.1, bounds=(-5, -4, 45, 14))
space = cspace.build(workspace, car, rotations=72)
print(space)

# %%
# Forwards only
# -------------
#
# ``planners.Car`` is a car, which does not reverse by default. Without ``drive``, a path in SE(2) is
# holonomic: fine for a robot on omni wheels, but no car can drive it.

start = (-2.0, 2.0, 0.0)
plan = planners.plan(
    space, start, (38.0, 2.0, 0.0), drive=planners.Car(turning_radius=4.0), time_limit=5
)
print(plan)
save_plot(space, "cars_1.png", True, path=plan)

# %%
# Forwards and backwards
# ----------------------
#
# With ``reverse=True`` it may reverse, here into the gap between two parked cars:

gap = (12.0, -0.8, 0.0)
plan = planners.plan(
    space, start, gap, drive=planners.Car(turning_radius=4.0, reverse=True), time_limit=5
)
print(plan)
save_plot(space, "cars_2.png", True, path=plan)

# %% ``plan.path`` is dense enough to drive: its rows are at most a cell and 5 degrees apart.
# ``plan.direction`` says for each row whether the car drives forwards or backwards, and
# ``plan.to_csv`` writes both.

print(f"{len(plan.path)} rows, {np.count_nonzero(np.diff(plan.direction))} changes of direction")
animate(space, plan, "cars_film.gif", True, seconds=8)

# %%
# The limits of the proof
# -----------------------
#
# Every curve of a certified plan is free along its whole length. ``is_connected`` is about a robot
# that moves in any direction, so it need not hold for a car; ``is_disconnected`` holds for cars too.
# A smaller turning radius allows more paths:

for radius in (3.0, 4.0, 7.0):
    plan = planners.plan(
        space,
        start,
        (0.0, 9.0, math.pi),
        drive=planners.Car(turning_radius=radius),
        time_limit=3,
        seed=1,
    )
    print(f"to turn round with a radius of {radius:g} m: {plan.status}")
