"""
A drone that must bank to pass a slit
=====================================

The slit stands upright and is narrower than the drone is wide. At no yaw does the level drone pass,
which the map of (x, y, z, yaw) proves; free to turn about any axis, it passes on its side, and
every edge of its path is proven free.
"""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace.plot import save_plot

# %% Two rooms, and a wall of 0.2 m between them with an upright slit of 0.5 m by 1.8 m. The drone
# is 0.8 m wide.

parts = [
    ((3.4, 0.0, 0.0), (3.6, 1.25, 2.6)),
    ((3.4, 1.75, 0.0), (3.6, 3.0, 2.6)),
    ((3.4, 1.25, 0.0), (3.6, 1.75, 0.4)),
    ((3.4, 1.25, 2.2), (3.6, 1.75, 2.6)),
]
wall = trimesh.util.concatenate([trimesh.creation.box(bounds=part) for part in parts])
bounds = (0, 0, 0, 7, 3, 2.6)
drone = cspace.Robot.box((0.8, 0.8, 0.2))
start, goal = (0.9, 1.0, 1.0), (6.1, 2.0, 1.0)

# %%
# Level, at any yaw:

level = cspace.build(cspace.Workspace.from_mesh(wall, 0.05, bounds), drone, rotations=72)
print("no path exists, proven:", level.is_disconnected((*start, 0.0), (*goal, 0.0)))

# %% At any rotation, in SE(3). The cells leave the slit undecided, so an exact check of the
# geometry decides there; the proof is as strong.

space = cspace.build(
    cspace.Workspace.from_mesh(wall, 0.1, bounds), drone, rotations=cspace.Rotations.quaternions(8)
)
still = (0.0, 0.0, 0.0, 1.0)
plan = planners.plan(
    space.exact,
    (*start, *still),
    (*goal, *still),
    planner=planners.Search(iterations=100_000),
    time_limit=600,
    seed=1,
)
print(plan)
up = Rotation.from_quat(plan.path[:, 3:]).apply((0.0, 0.0, 1.0))[:, 2]
print(f"it banks by up to {np.degrees(np.arccos(np.abs(up).min())):.0f} degrees")
save_plot(space, "drone_slit.png", True, path=plan, view="3d", camera=(28, -115))
