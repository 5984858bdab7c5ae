"""
First hour: a fleet
===================

Two kinds of robots share a hall. Each pair of lanes and nodes is proven apart, or has two poses that
touch, or is undecided. Then two motions on one crossing are proven apart in time, or one waits for the other. For Nav2's depot, give its file:
``python fleets.py depot.yaml``.
"""

import sys
from dataclasses import replace

import numpy as np

import cspace
import planners
from cspace.lanes import RouteGraph

if len(sys.argv) > 1:
    hall = cspace.Workspace.open(sys.argv[1], unknown="free")
else:
    hall = cspace.Workspace.from_array(np.zeros((604, 307), dtype=bool), 0.05)
space = cspace.build(hall, cspace.Robot.rectangle(1.2, 0.8), rotations=72)
small = cspace.build(hall, cspace.Robot.disc(0.3))

# %%
# A road of two lanes, 1.1 m apart, two lanes that cross without a node, and a road of the others.

nodes = [(3, 2), (3, 13.8), (4.1, 12.6), (4.1, 2.9), (5.5, 6), (10.5, 12.4), (5.5, 12), (10.5, 6)]
graph = RouteGraph.from_arrays(nodes, [(0, 1), (2, 3), (4, 5), (6, 7)])
road = RouteGraph.from_arrays([(12, 1.4), (12, 9.2), (6.3, 9.2)], [(0, 1), (1, 2)], "any")
conflicts = cspace.lanes.conflicts(space, graph, others={"small": (small, road)}, margin=0.1)
print(conflicts)
for number, names in enumerate(conflicts.zones().elements):
    print(f"zone {number}: one robot at a time of {', '.join(names)}")

# %%
# Both drive across, the second 8 s later, and may be 5 cm off.

limits = {"max_velocity": 1.0, "max_acceleration": 0.5}
turns = {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.0}
movers = []
for begin, (start, goal) in ((0.0, nodes[4:6]), (8.0, nodes[6:8])):
    yaw = float(np.arctan2(goal[1] - start[1], goal[0] - start[0]))
    plan = planners.plan(space, (*start, yaw), (*goal, yaw))
    trajectory = plan.trajectory(**limits, **turns)
    movers.append(cspace.lanes.Mover(space.robot, trajectory, at=begin, error=0.05))
print(cspace.lanes.apart(*movers, margin=0.1))

# %%
# If the second one begins at once, both meet. It waits, and slows down, until the first one has passed; no motion
# along its path arrives before the bound. The how-to "Wait for others" has more.

hurried = replace(movers[1], at=0.0)
print(cspace.lanes.apart(movers[0], hurried, margin=0.1))
timing = cspace.lanes.time_around(hurried, [movers[0]], margin=0.1)
if timing:
    print(
        f"arrives at {timing.trajectory.duration:.1f} s; none before {timing.arrival_bound:.1f} s"
    )
else:
    print(timing.reason)
conflicts.plot().figure.savefig("fleets.png", dpi=90)
print("wrote fleets.png")
