"""
A cube through a winding tunnel
===============================

Robot and obstacles are meshes. The map's own search, ``planner="Grid"``, finds the path without
sampling, so a narrow passage takes no longer than a wide one.
"""

import trimesh

import cspace
import planners
from cspace.plot import save_plot

# %%
# A wall of 2 m between two rooms, with a hole of 0.2 m that bends twice.

boxes = [
    ((-2, -2, -1), (2, -0.1, 1)),  # beside the hole
    ((-2, 0.1, -1), (2, 2, 1)),
    ((-2, -0.1, 0.1), (0.3, 0.1, 1)),  # it enters above, at x = 0.3 to 0.5 ...
    ((0.5, -0.1, -0.1), (2, 0.1, 1)),
    ((-2, -0.1, -1), (-0.5, 0.1, 0.1)),  # ... goes along x, and leaves below, at x = -0.5 to -0.3
    ((-0.3, -0.1, -1), (2, 0.1, -0.1)),
]
wall = trimesh.util.concatenate([trimesh.creation.box(bounds=box) for box in boxes])
workspace = cspace.Workspace.from_mesh(wall, 0.025, bounds=(-2, -2, -2, 2, 2, 2))
cube = cspace.Robot.from_mesh(trimesh.creation.box((0.06, 0.06, 0.06)), name="cube")
space = cspace.build(workspace, cube)
plan = planners.plan(space, (0, 0, 1.5), (0, 0, -1.5), planner="Grid")
print(plan)

# %%
# Three sections through the center of the path.

save_plot(space, "z_tunnel.png", True, path=plan)
