"""
OMPL's planners on one map, side by side
========================================

Each geometric planner of OMPL that the library runs is called by its name. The map answers
them all, and proves each path anew when it is there.
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
    for name in planners.choices(space).planners
]
print(f"{'planner':16} {'length':>8} {'clearance':>10} {'planning':>11}")
for plan in sorted(plans, key=lambda plan: plan.length):
    print(
        f"{plan.planner:16} {plan.length:6.2f} m {plan.clearance:8.3f} m {1e3 * plan.times.planning:8.1f} ms  "
        + ("certified" if plan.certified else plan.status)
    )

# %%
# Above: the shortest and the longest path. Below: how long each planner's path is, and how long the
# planner took.

plans.sort(key=lambda plan: plan.length)
figure = plt.figure(figsize=(8, 8), layout="constrained")
grid = figure.add_gridspec(2, 2, height_ratios=(5, 3))
room = figure.add_subplot(grid[0, :])
lengths, times = (figure.add_subplot(grid[1, column]) for column in (0, 1))
space.plot(ax=room, legend=False, title="")
for plan, color in ((plans[-1], "#d55e00"), (plans[0], "#6a1b9a")):
    room.plot(*plan.path.T, color=color, label=f"{plan.planner}, {plan.length:.2f} m")
room.plot(*start, "o", color="white", mec="black")
room.plot(*goal, "*", color="#cc79a7", mec="black", markersize=12)
room.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2, frameon=False)
names = [plan.planner for plan in plans]
lengths.plot([plan.length for plan in plans], names, "o", color="#6a1b9a")
times.plot([1e3 * plan.times.planning for plan in plans], names, "o", color="#6a1b9a")
lengths.set(xlabel="length of the path (m)")
times.set(xlabel="planning time (ms)", xscale="log", yticklabels=[])
times.set_xticks((1, 10, 100), ("1", "10", "100"))
for ax in (lengths, times):
    ax.grid(color="0.9")
    ax.invert_yaxis()
figure.savefig("compare_planners.png")
plt.close(figure)
print("wrote compare_planners.png")
