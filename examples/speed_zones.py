"""
Slow in zones and near shelves
==============================

A robot on two wheels drives through a store. It has to be slow at a crossing, as long as any part of
it is in there, and wherever a shelf is near. Both limits are proven for every instant. The quickest
way leads around the crossing, and is longer than the shortest one.
"""

import matplotlib.pyplot as plt
import numpy as np
import shapely

import cspace
import planners

# %%
# Shelves, and a zone at the crossing of two aisles.

shelves = [shapely.box(x, y, x + 5, y + 1.2) for x in (1.5, 9.5) for y in (2.5, 5.8, 9.1)]
store = cspace.Workspace.from_polygons(shelves, spacing=0.05, bounds=(0, 0, 16, 13))
robot = cspace.Robot.rectangle(1.0, 0.6, center=(0.3, 0.0))
space = cspace.build(store, robot, rotations=72)
crossing = shapely.box(6.7, 4.0, 9.3, 8.5)
zones = planners.SpeedZones([(crossing, 0.3)])
near = planners.SlowNear(space, 0.9, 0.4)
ends = (1.0, 4.6, 0.0), (14.5, 11.6, 0.0)
drive = planners.Differential()
plan = planners.plan(space, *ends, drive=drive)
quick_plan = planners.plan(space, *ends, drive=drive, objective="time", speed=[1.5, zones, near])

# %%
# Trajectories with and without the limits, and of the quickest way. The speed in the zone never
# exceeds its limit.

limits = {"max_velocity": 1.5, "max_acceleration": 0.7, "max_jerk": 3.0}
limits |= {"max_angular_velocity": 1.0, "max_angular_acceleration": 1.5}
trajectory = plan.trajectory(**limits, speed=[zones, near])
free = plan.trajectory(**limits)
quick = quick_plan.trajectory(**limits, speed=[zones, near])
print(f"{trajectory.duration:.1f} s; without limits {free.duration:.1f} s")
print(
    f"the quickest way: {quick.duration:.1f} s, {quick_plan.length:.1f} m, not {plan.length:.1f} m"
)

times = np.linspace(0.0, trajectory.duration, 4001)
q, velocities, _ = trajectory.sample(times)
speeds = np.linalg.norm(velocities[:, :2], axis=1)
outline = np.array(robot.geometry.exterior.coords)
cos, sin = np.cos(q[:, 2]), np.sin(q[:, 2])
turns = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=1)
bodies = shapely.polygons(outline @ turns.swapaxes(1, 2) + q[:, None, :2])
inside = shapely.intersects(crossing, bodies)
print(f"in the zone: {inside.mean():.0%} of the time, at most {speeds[inside].max():.3f} m/s")

# %%
# The shortest way of its reference point beside the quickest one, coloured by speed.

figure, axes = plt.subplots(1, 2, figsize=(13, 5), layout="constrained")
for ax, driven, name in zip(axes, (trajectory, quick), ("shortest", "quickest"), strict=True):
    space.plot(ax=ax, title=f"the {name} way: {driven.duration:.1f} s", legend=False)
    ax.fill(*crossing.exterior.xy, color="#d55e00", alpha=0.2)
    q, velocities, _ = driven.sample(np.linspace(0.0, driven.duration, 4001))
    speeds = np.linalg.norm(velocities[:, :2], axis=1)
    dots = ax.scatter(*q[:, :2].T, c=speeds, s=6, cmap="viridis", vmin=0.0, vmax=1.5, zorder=4)
figure.colorbar(dots, ax=axes, label="speed (m/s)", shrink=0.8)
figure.savefig("speed_zones.png", dpi=100)
plt.close(figure)
