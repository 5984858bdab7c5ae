"""
Under racks and tables
======================

A base with a mast drives through a store. Its map knows the heights of robot and world: the base passes
under the racks where its mast fits, which the map of its projection cannot show.
"""

import numpy as np
import trimesh

import cspace
import planners
from cspace.plot import save_plot

# %%
# Racks on legs, with a lowest shelf at 0.45 m, and a gantry at 1.1 m. The cells are 5 cm wide.

cells = np.zeros((160, 100, 30), dtype=bool)
for x in (40, 95):
    cells[x : x + 25, 28:92, 9:11] = True
    cells[x : x + 25, 28:92, 20:22] = True
    for leg in range(28, 92, 20):
        cells[x : x + 2, leg : leg + 2, :22] = cells[x + 23 : x + 25, leg : leg + 2, :22] = True
cells[75:80, :, 22:24] = True
store = cspace.Workspace.from_array(cells, 0.05)


def make_box(sides, center):
    """Return a box, metres."""
    return trimesh.creation.box(sides).apply_translation(center)


base = make_box((0.8, 0.6, 0.35), (0.0, 0.0, 0.2))
mast = make_box((0.1, 0.1, 0.7), (-0.3, 0.0, 0.7))
low = cspace.Robot.from_mesh(base)
high = cspace.Robot.from_mesh(trimesh.util.concatenate([base, mast]))

# %%
# The base alone drives below the racks. With its mast, it drives around them, and below the gantry.

start, goal = (0.8, 2.5, 0.0), (7.2, 2.5, 0.0)
for name, robot in (("base", low), ("base_with_a_mast", high)):
    space = cspace.build(store, robot, rotations=72, floor=0.0)
    plan = planners.plan(space, start, goal, drive=planners.Differential(), seed=1)
    print(f"{name}: {plan.length:.2f} m")
    save_plot(space, f"{name}.png", True, path=plan)

# %%
# Seen from above, as a costmap has it, racks and gantry are walls.

ground = cspace.Workspace.from_array(cells.any(axis=2), 0.05)
flat = cspace.build(ground, high.footprint(), rotations=72)
print("projected, no path exists:", flat.is_disconnected(start, goal))
save_plot(flat, "projected.png", True, start=start, goal=goal)
