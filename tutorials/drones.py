"""
First hour: a drone
===================

The same map in three dimensions: from meshes, OctoMaps, voxels or point clouds. The body
translates, turns about the vertical, or turns about any axis.
"""

import trimesh

import cspace
import planners
from cspace.plot import save_plot

# %%
# A house as a mesh
# -----------------
#
# Two rooms, a window between them, and no roof, so that pictures show the inside.
# ``Workspace.open`` reads STL, OBJ, PLY, glTF and others. It opens an OctoMap as well, which brings
# its own spacing.

boxes = [
    ((0.0, 0.0, 0.0), (6.0, 4.0, 0.15)),  # the floor
    ((0.0, 0.0, 0.15), (0.25, 4.0, 2.5)),
    ((5.75, 0.0, 0.15), (6.0, 4.0, 2.5)),
    ((0.25, 0.0, 0.15), (5.75, 0.25, 2.5)),
    ((0.25, 3.75, 0.15), (5.75, 4.0, 2.5)),
    ((2.85, 0.25, 0.15), (3.15, 3.75, 1.05)),  # the wall between the rooms, around its window
    ((2.85, 0.25, 2.15), (3.15, 3.75, 2.5)),
    ((2.85, 0.25, 1.05), (3.15, 1.25, 2.15)),
    ((2.85, 2.75, 1.05), (3.15, 3.75, 2.15)),
    ((4.2, 0.25, 0.15), (5.75, 1.15, 0.95)),  # a table
]
mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=corners) for corners in boxes])
house = cspace.Workspace.from_mesh(mesh, 0.08)
drone = cspace.Robot.box((0.6, 0.6, 0.2))
space = cspace.build(house, drone)
print(space)

# %%
# Plan
# ----
#
# Configurations are ``(x, y, z)``. All outside the workspace counts as obstacle, so the drone
# does not leave through the roof, unless you build with ``outside="free"``.

start, goal = (1.0, 2.0, 0.5), (5.0, 2.5, 0.5)
print("a path exists:", space.is_connected(start, goal))
plan = planners.plan(space, start, goal, seed=1)
print(plan)
save_plot(space, "drones_1.png", True, path=plan, view="3d")

# %% Three sections through a point show more than a view: FREE cells, and places where the path is
# close to obstacles.

save_plot(space, "drones_2.png", True, path=plan)

# %%
# A drone that yaws
# -----------------
#
# A drone of 2 m by 0.3 m passes the window only lengthwise. With ``rotations=72``, configurations
# are ``(x, y, z, yaw)``. Without a rotation there is no path to the goal, and the map proves it:

slender = cspace.Robot.box((0.3, 2.0, 0.3))
still = cspace.build(house, slender)
print("without a turn none exists:", still.is_disconnected(start, goal))
turning = cspace.build(house, slender, rotations=72)
plan = planners.plan(turning, (*start, 0.0), (*goal, 0.0), time_limit=10, seed=1)
print(plan)
save_plot(turning, "drones_3.png", True, path=plan, view="3d")

# %%
# A drone that rotates about any axis
# -----------------------------------
#
# For SE(3), ``rotations=cspace.Rotations.quaternions(n)``: configurations are ``(x, y, z, qx, qy,
# qz, qw)``, w last. Such maps are coarse, because a rotation cell is large. With ``space.exact``, an
# exact check of the geometry decides MIXED cells, and the proof is as strong. The page on rotations
# says which ``n`` to choose. In the gallery, a drone banks to pass a slit.

free = cspace.build(house, drone, rotations=cspace.Rotations.quaternions(4))
print(free)
level = (0.0, 0.0, 0.0, 1.0)
plan = planners.plan(free.exact, (*start, *level), (*goal, *level), time_limit=20, seed=1)
print(plan)
