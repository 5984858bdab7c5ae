"""
Plan anew at speed
==================

A differential drive crosses an office among trolleys. Ten times a second it plans anew and goes on
at speed. Every motion that it drives is proven, and so is a stop at any time.
"""

import matplotlib.pyplot as plt
import numpy as np
from shapely import box, union_all

import cspace
import planners

# %%
# Two rooms with a wide door, 12 m by 6 m. Trolleys swing across, each at an x and with a phase.

walls = [box(0, 0, 12, 6) - box(0.2, 0.2, 11.8, 5.8), box(5.9, 0, 6.1, 1.6), box(5.9, 4.4, 6.1, 6)]
office = cspace.Workspace.from_polygons([union_all(walls)], spacing=0.05)
space = cspace.build(office, cspace.Robot.rectangle(0.6, 0.4), rotations=72)
trolleys = {"left": (3.5, 0.0), "right": (8.5, 2.0)}
limits = {"max_velocity": 0.8, "max_acceleration": 0.6}
limits |= {"max_angular_velocity": 1.2, "max_angular_acceleration": 2.0}
start, goal, period = (1.0, 3.0, 0.0), (11.0, 3.0, 0.0), 0.1

# %%
# The loop. The new motion begins at the end of this cycle: at once, or from the end of a stop.

plan = planners.plan(space, start, start, drive=planners.Differential())
motion, clock, driven, stops = plan.trajectory(**limits), 0.0, [], 0
seen = {}
while len(driven) < 400 and np.linalg.norm(motion.sample(clock)[0][:2] - goal[:2]) > 0.01:
    places = {
        name: (x, 3.0 + 1.8 * np.sin(0.02 * len(driven) + phase))
        for name, (x, phase) in trolleys.items()
    }
    space.update({name: box(x - 0.3, y - 0.3, x + 0.3, y + 0.3) for name, (x, y) in places.items()})
    at = clock + period
    for q in motion.starts_after(at):
        try:
            plan = planners.plan(space, q, goal, drive=plan.drive, previous=plan, time_limit=0.05)
        except cspace.ConfigurationError:  # a trolley is near that place
            continue
        new = plan.trajectory(**limits, after=motion, at=at)
        if not new.stop_reason:
            break
    else:
        new, stops = motion.braked(at), stops + 1
    driven.append(motion.sample(clock + np.linspace(0.0, period, 5)))  # here the robot drives
    seen |= {name: place for name, place in places.items() if driven[-1][0][0, 0] < place[0]}
    motion, clock = new, 0.0

rows, velocities = (np.concatenate(part) for part in zip(*[d[:2] for d in driven], strict=True))
speeds = np.linalg.norm(velocities[:, :2], axis=1)
print(f"{len(driven)} cycles, {stops} stops by proof, {speeds.mean():.2f} m/s in the mean")

# %%
# The way that the robot drove, coloured by its speed. Each trolley stands where the robot passed it.

space.update({name: box(x - 0.3, y - 0.3, x + 0.3, y + 0.3) for name, (x, y) in seen.items()})
ax = space.plot(start=start, goal=goal, title=f"planned anew {len(driven)} times")
dots = ax.scatter(*rows[:, :2].T, c=speeds, s=8, zorder=4)
ax.figure.colorbar(dots, label="speed (m/s)", shrink=0.8)
ax.figure.savefig("replan_at_speed.png", dpi=100)
plt.close(ax.figure)
