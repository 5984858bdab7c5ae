"""
OMPL's planners on one map, side by side
========================================

Every geometric planner that the installed OMPL binds is called by its name. The map answers them
all, and proves each path anew when it is there.
"""

import matplotlib.pyplot as plt
import numpy as np

import cspace
import planners

# %%
# A cart of 0.5 m by 0.3 m in a room of 10 m by 6 m with two walls and some pillars.

occupied = np.zeros((200, 120), dtype=bool)  # [x, y], 0.05 m each
occupied[60:66, :90] = True
occupied[130:136, 40:] = True
for x in (20, 85, 110, 155):
    for y in (35, 65, 95):
        occupied[x : x + 6, y : y + 6] = True
space = cspace.build(cspace.Workspace.from_array(occupied, 0.05), cspace.Robot.rectangle(0.5, 0.3))

# %% Planners that keep improving their path use the whole time limit. The first plan also compiles;
# that time is not counted.

start, goal = (0.7, 0.7), (9.3, 5.3)
planners.plan(space, start, goal)
plans = [
    planners.plan(space, start, goal, planner=name, time_limit=0.3)
    for name in planners.planner_names()
]
print(f"{'planner':16} {'length':>8} {'clearance':>10} {'planning':>11}")
for plan in sorted(plans, key=lambda plan: plan.length):
    print(
        f"{plan.planner:16} {plan.length:6.2f} m {plan.clearance:8.3f} m {1e3 * plan.times.planning:8.1f} ms  "
        + ("certified" if plan.certified else plan.status)
    )

# %%
# The paths; white cells are free, grey cells are not.

rows = -(-len(plans) // 4)
figure, axes = plt.subplots(
    rows, 4, figsize=(12, 2.1 * rows), sharex=True, sharey=True, layout="constrained"
)
for ax in axes.flat[len(plans) :]:
    ax.set_visible(False)
for ax, plan in zip(axes.flat, plans, strict=False):
    ax.imshow(space.cell_states.T > 0, origin="lower", extent=(0, 10, 0, 6), cmap="Greys", vmax=2)
    ax.plot(*plan.path.T, color="#0072b2", linewidth=2)
    ax.plot(*start, "o", color="#009e73")
    ax.plot(*goal, "*", color="#d55e00", markersize=10)
    ax.set_title(f"{plan.planner}: {plan.length:.2f} m", fontsize=10)
figure.supxlabel("x (m)")
figure.supylabel("y (m)")
figure.savefig("compare_planners.png")
plt.close(figure)
print("wrote compare_planners.png")
