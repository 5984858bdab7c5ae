"""
First hour: a mobile robot
==========================

From a floor plan to a path whose every edge is proven free, and to the proof that some rooms cannot
be reached.
"""

import math
import tempfile

import matplotlib.pyplot as plt
from shapely import Point, box

import cspace
import planners
from cspace.plot import save_plot

# %%
# The map
# -------
#
# A workspace holds the obstacles: here the floor plan of a flat, 16 m by 10 m, as polygons of
# shapely. With your own map, write ``cspace.Workspace.open("map.yaml")``, or
# ``Workspace.open`` for any supported file. A robot is a shape whose reference point is the origin.
# ``build`` returns the map of its configurations.

walls = [  # x, y, width, height; a gap between two walls is a door
    (0.2, 5.0, 3.0, 0.15),
    (4.3, 5.0, 0.9, 0.15),
    (5.05, 0.2, 0.15, 1.4),
    (5.05, 2.8, 0.15, 7.0),
    (11.0, 0.2, 0.15, 4.4),
    (11.0, 5.7, 0.15, 4.1),
    (11.15, 6.5, 1.6, 0.15),
    (13.2, 6.5, 2.6, 0.15),
]
furniture = [
    Point(8.0, 6.6).buffer(0.9),
    Point(13.2, 3.4).buffer(0.7),
    box(0.2, 0.2, 2.4, 1.8),
    box(14.2, 4.6, 15.8, 5.4),
]
outside = box(0.0, 0.0, 16.0, 10.0) - box(0.2, 0.2, 15.8, 9.8)
obstacles = [outside, *(box(x, y, x + w, y + h) for x, y, w, h in walls), *furniture]
workspace = cspace.Workspace.from_polygons(obstacles, 0.025)
space = cspace.build(workspace, cspace.Robot.disc(0.3))
print(space)
save_plot(space, "mobile_robots_1.png", True)

# %% White cells are FREE: the robot touches nothing if its reference point is anywhere in such a
# cell. Blue cells are BLOCKED: the robot collides. The thin orange band, MIXED, is undecided;
# smaller cells make it thinner. Planners avoid it, unless an exact check of the geometry decides
# there (``space.exact``).
#
# Query the map
# -------------
#
# All look-ups take one configuration or an array, in metres and radians.

print(space.is_free((3.0, 8.0)))
print(space.is_free([(3.0, 8.0), (8.0, 6.6)]))

# %% An edge is proven as a whole, not at samples. ``clearance`` is the distance to the nearest
# configuration that is not FREE.

print(space.motion_is_free((3.0, 8.0), (3.0, 6.0)))
print(space.clearance((3.0, 8.0)))

# %% The map can prove before any search that a path exists, or that none does. If both answers are
# False, cells of this size cannot decide. The store room, upper right, has a door of 0.45 m, and
# the robot is 0.6 m wide.

start, goal, store_room = (1.4, 8.6), (14.6, 1.2), (13.5, 8.4)
print(space.is_connected(start, goal))
print(space.is_disconnected(start, store_room))

# %%
# Plan
# ----
#
# By default the map itself is searched; ``planner`` names another search, or a geometric planner of
# OMPL. The map checks the finished plan again: ``certified`` means that it proved each edge free.

plan = planners.plan(space, start, goal, seed=4)
print(plan)
save_plot(space, "mobile_robots_2.png", True, path=plan)

# %% ``plan.path`` is an array of configurations, and ``plan.to_csv`` writes it. A path along the
# border of the C-obstacle is free, but close. ``margin`` grows the robot, so that FREE keeps that
# distance:

roomy = cspace.build(workspace, cspace.Robot.disc(0.3), margin=0.1)
plan = planners.plan(roomy, start, goal, seed=1)
print(plan.status, "- no obstacle is nearer than 0.1 m")

# %%
# A robot that is not round
# -------------------------
#
# Such a robot rotates: ``rotations=72`` divides the circle into cells of 5 degrees, and
# configurations are ``(x, y, yaw)``. FREE then means free at every position and every yaw of the
# cell. **A path in SE(2) is holonomic unless you pass** ``drive=``: the robot may move sideways,
# and rotates evenly along each edge. A robot on two wheels needs
# ``drive=planners.Differential()``: it rotates in place and drives straight. For cars, read the
# next tutorial.

space = cspace.build(workspace, cspace.Robot.rectangle(1.1, 0.5), rotations=72)
plan = planners.plan(
    space,
    (1.4, 8.6, 0.0),
    (14.6, 1.2, math.pi / 2),
    drive=planners.Differential(),
    time_limit=5,
    seed=3,
)
print(plan)
save_plot(space, "mobile_robots_3.png", True, path=plan)

# %%
# In yellow cells the robot fits at some yaws only. These are the slices at a few yaws:

figure, panels = plt.subplots(3, 1, figsize=(6.5, 12.5), layout="compressed")
for ax, degrees in zip(panels, (0, 45, 90), strict=True):
    space.plot(ax=ax, rotation=math.radians(degrees), legend=False, title=f"yaw {degrees}°")
    ax.label_outer()
figure.savefig("mobile_robots_4.png")
plt.close(figure)

# %%
# Moving obstacles
# ----------------
#
# Add an obstacle by name, add it again to move it, and remove it. The map follows, and so do the
# checkers that planners hold.

space = cspace.build(workspace, cspace.Robot.disc(0.3))
before = planners.plan(space, start, goal, seed=4)
x, y = before.path[len(before.path) // 2]
print(space.add_obstacle("crate", box(x - 0.4, y - 0.4, x + 0.4, y + 0.4)))
print("still free:", space.certify_path(before.path).all())
after = planners.plan(space, start, goal, seed=4)
save_plot(space, "mobile_robots_5.png", True, path=after)
space.remove_obstacle("crate")
print("free again:", space.certify_path(before.path).all())

# %%
# Save the map
# ------------
#
# A map is saved as a folder, and checked by digest when it is opened. The same on the command line:
# ``cspace build flat.geojson --spacing 0.025 --robot disc:0.3`` and ``cspace plan flat.zarr --start
# ... --goal ...``.

with tempfile.TemporaryDirectory() as folder:
    space.save(f"{folder}/flat.zarr")
    again = cspace.open(f"{folder}/flat.zarr")
print(again.count() == space.count())
