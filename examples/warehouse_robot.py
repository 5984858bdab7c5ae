"""
A differential drive among shelves
==================================

Like most mobile robots, it rotates in place and drives straight. Every rotation and every straight
line is proven free.
"""

import math

import numpy as np
from shapely import box

import cspace
import planners
from cspace.plot import animate, save_plot

# %%
# A hall of 16 m by 10 m with shelves, pallets between them, and a pillar.

shelves = [box(x, y, x + 1.2, y + 2.6) for x in (2.6, 5.4, 8.2, 11.0, 13.6) for y in (1.6, 5.8)]
pallets = [
    box(4.2, 3.4, 5.0, 4.2),
    box(7.0, 6.6, 7.8, 7.4),
    box(9.8, 2.2, 10.6, 3.0),
    box(9.4, 0.0, 10.2, 1.8),
]
pillar = box(7.4, 4.7, 7.8, 5.1)
workspace = cspace.Workspace.from_polygons(
    [*shelves, *pallets, pillar], 0.05, bounds=(0, 0, 16, 10)
)
space = cspace.build(workspace, cspace.Robot.rectangle(0.9, 0.6), rotations=72)

# %%
# Without ``drive``, the robot would move sideways between the shelves.

plan = planners.plan(
    space,
    (1.2, 1.2, 0.0),
    (12.9, 7.3, math.pi / 2),
    drive=planners.Differential(),
    time_limit=5,
    seed=2,
)
print(plan)
save_plot(space, "warehouse_robot.png", True, path=plan)

# %% The waypoints are the ends of each rotation and each straight line. The map connects them by
# straight edges, so it proves them once more.

for q, way in zip(plan.waypoints[1:], np.diff(plan.waypoints, axis=0), strict=True):
    turn = (np.degrees(way[2]) + 180) % 360 - 180
    print(
        f"turn by {turn:.0f} degrees"
        if way[2]
        else f"drive {np.hypot(*way[:2]):.2f} m to ({q[0]:.2f}, {q[1]:.2f})"
    )
print("every turn and every straight proven:", space.certify_path(plan.waypoints).all())
animate(space, plan, "warehouse_robot_film.gif", True, seconds=8)
