"""
A drone through a building
==========================

The drone is a box that does not turn. Two storeys of 10 m x 6 m are joined by an opening in the
floor between them. A real building comes from an OctoMap: ``cspace.Workspace.open("building.bt")``.
"""

import numpy as np

import cspace
import planners
from cspace.plot import save_plot

occupied = np.zeros((100, 60, 52), dtype=bool)  # [x, y, z], 0.1 m each
occupied[[0, -1]] = occupied[:, [0, -1]] = occupied[:, :, [0, -1]] = True
occupied[:, :, 25:27] = True
occupied[80:96, 40:56, 25:27] = False  # the opening, 1.6 m wide
occupied[40:42, :40, :25] = occupied[60:62, 20:, 27:] = True  # walls
space = cspace.build(cspace.Workspace.from_array(occupied, 0.1), cspace.Robot.box((0.6, 0.6, 0.2)))
print(space)

# %%
# From the lower storey to the upper one. Without a view, a map in space is drawn as three sections.

plan = planners.plan(space, (1.0, 1.0, 1.0), (1.0, 1.0, 4.0), time_limit=10, seed=1)
print(plan)
save_plot(space, "drone_building.png", True, path=plan)

# %%
# In three dimensions, cut open above the path.

# sphinx_gallery_thumbnail_number = 2
save_plot(space, "drone_building_3d.png", True, path=plan, view="3d")

# %%
# Exports for other programs: the cells for ParaView, and the border of the free space as a mesh.

space.export("drone_building.vti", overwrite=True)
space.export("drone_building.ply", overwrite=True)
