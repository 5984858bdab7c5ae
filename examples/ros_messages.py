"""
From ROS messages to a plan and a costmap, without ROS
======================================================

Any object with the fields of a message will do, so ROS is not needed. In a node, ``msg`` comes from
a topic: ``self.create_subscription(OccupancyGrid, "map", self.on_map, 1)``.
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import ListedColormap, to_rgba
from matplotlib.patches import Patch

import cspace
import planners
from cspace.plot import save_plot

# %%
# Two rooms, together 9 m by 6 m, with an unknown corner: 0 is free, 100 occupied, -1 unknown.

cells = np.zeros((120, 180), dtype=np.int8)  # rows from the lowest y, 0.05 m each
cells[[0, -1], :] = cells[:, [0, -1]] = 100
cells[:80, 88:92] = cells[60:64, 120:150] = cells[30:44, 30:44] = 100
cells[95:, :35] = -1
msg = cspace.ros.OccupancyGrid()
msg.info.resolution, (msg.info.height, msg.info.width) = 0.05, cells.shape
msg.info.origin.position.x, msg.info.origin.position.y = -4.5, -3.0
msg.data.frombytes(cells.tobytes())

# %%
# The footprint is a line of ``nav2_params.yaml``. A differential drive can follow the path.

workspace = cspace.Workspace.from_occupancy_grid(msg)
footprint = "[[0.45, 0.25], [0.45, -0.25], [-0.25, -0.25], [-0.25, 0.25]]"
space = cspace.build(workspace, cspace.Robot.from_footprint(footprint, padding=0.01), rotations=36)
plan = planners.plan(
    space, (-3.5, -2.0, 0.0), (3.5, -2.0, 0.0), drive=planners.Differential(), time_limit=5, seed=1
)
print(plan)
save_plot(space, "ros_messages.png", True, path=plan, rotation=0.0)
print(len(plan.to_path().poses), "poses")  # or to_path(nav_msgs.msg.Path())

# %%
# The costmap of that robot, in the convention of Nav2.

costmap = space.to_costmap(
    cost_scaling_factor=3.0, inflation_radius=0.8
)  # or to_costmap(nav2_msgs.msg.Costmap())
costs = np.array(costmap.data).reshape(costmap.metadata.size_y, costmap.metadata.size_x)
colors = plt.get_cmap("YlOrBr")(np.linspace(0.0, 0.8, 256))
colors[253:] = [to_rgba(color) for color in ("#a6d3ee", "#262626", "#6f5320")]
figure, ax = plt.subplots(figsize=(7.5, 5), layout="constrained")
(x0, y0), (x1, y1) = space.grid.lower, space.grid.upper
image = ax.imshow(
    costs, origin="lower", extent=(x0, x1, y0, y1), cmap=ListedColormap(colors), vmin=0, vmax=255
)
figure.colorbar(image, label="cost")
special = {253: "253, in collision", 254: "254, obstacle", 255: "255, unknown"}
handles = [Patch(color=colors[cost], label=label) for cost, label in special.items()]
figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False)
ax.set(xlabel="x (m)", ylabel="y (m)")
figure.savefig("ros_messages.png")
plt.close(figure)
print("wrote ros_messages.png")
