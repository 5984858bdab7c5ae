"""
Paths that keep away
====================

The shortest path runs along the border of the C-obstacle. Two others leave room: one weighs the
clearance in the map against length, and one avoids costs of your own on the cells, here a floor
that is slippery around the pillar.
"""

import matplotlib.pyplot as plt
import numpy as np
import shapely

import cspace
import planners
from cspace.plot import save_plot

# %%
# A shelf, a pillar, and a cart that does not rotate.

shelf = shapely.Polygon([(2, 1), (6, 1), (6, 2), (3, 2), (3, 4), (2, 4)])
pillar = shapely.Point(6.2, 3.6).buffer(0.4)
cart = shapely.box(-0.3, -0.2, 0.3, 0.2)
workspace = cspace.Workspace.from_polygons([shelf, pillar], spacing=0.05, bounds=(0, 0, 8, 5))
space = cspace.build(workspace, cspace.Robot.polygon(cart))

# %%
# Costs are an array beside the map, with a value for each cell; the map still decides which cells
# are FREE.

x, y = np.meshgrid(space.grid.centers(0), space.grid.centers(1), indexing="ij")
costs = 10.0 * np.exp(-((x - 6.2) ** 2 + (y - 3.6) ** 2) / 0.4)
by_costs = planners.WeightedLength(costs)

# %% The map's own search takes milliseconds, whatever it minimises.

start, goal = (1.0, 4.3), (7.3, 0.6)
plans = {
    "length": planners.plan(space, start, goal),
    "clearance": planners.plan(space, start, goal, objective="clearance"),
    "costs": planners.plan(space, start, goal, objective=by_costs),
}
for name, plan in plans.items():
    room = f"clearance {plan.clearance:.2f} m, obstacle distance {plan.obstacle_distance:.2f} m"
    print(f"{name:10} {plan.length:6.2f} m, {room}, certified: {plan.certified}")
    save_plot(space, f"keep_away_{name}.png", True, path=plan, title=name)

# %%
# All three beside each other.

figure, axes = plt.subplots(1, 3, figsize=(14, 4), layout="constrained")
for ax, (name, plan) in zip(axes.flat, plans.items(), strict=True):
    space.plot(
        ax=ax,
        path=plan,
        legend=False,
        title=f"{name}: {plan.length:.2f} m, clearance {plan.clearance:.2f} m",
    )
figure.savefig("keep_away.png", dpi=110)
