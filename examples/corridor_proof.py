"""
Who can pass a corridor, and who cannot at any yaw
==================================================

A planner that finds no path proves nothing. The map does: if no chain of cells that might be free
joins two configurations, no path exists, however the robot turns on its way.
"""

from shapely import box

import cspace
import planners
from cspace.plot import save_plot

# %%
# Two rooms of 3 m by 4 m, joined by a corridor of 1 m by 4 m.

walls = box(0, 0, 10, 4) - box(0.1, 0.1, 3, 3.9) - box(7, 0.1, 9.9, 3.9) - box(3, 1.5, 7, 2.5)
workspace = cspace.Workspace.from_polygons([walls], spacing=0.05)
start, goal = (1.5, 2.0, 0.0), (8.5, 2.0, 0.0)

# %% Three robots, each 1.3 m long. The first passes. For the second, 2 cm narrower than the
# corridor, the cells cannot decide; with ``space.exact`` the geometry decides, and the proof is as
# strong. The third is proven to be too wide.

for width in (0.6, 0.98, 1.2):
    space = cspace.build(workspace, cspace.Robot.rectangle(1.3, width), rotations=72)
    plan = planners.plan(space.exact, start, goal, time_limit=5, seed=1)
    print(f"robot {width:g} m wide, corridor 1 m")
    print(f"  a path is proven to exist: {space.is_connected(start, goal)}")
    print(f"  no path is proven to exist, at any yaw: {space.is_disconnected(start, goal)}")
    print(f"  {plan.status}; certified: {plan.certified}")
    save_plot(
        space,
        f"corridor_{width:g}.png",
        True,
        path=plan if plan else None,
        start=start,
        goal=goal,
    )
