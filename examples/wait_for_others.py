"""
Wait for others
===============

A robot crosses two roads on which others come one after the other. It keeps its path, and waits and
slows down where it must. Its motion is proven apart from all others at every instant, and a lower
bound says how early any motion along the path can arrive.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.patches import Circle, Rectangle

import cspace
import planners
from cspace.lanes import Mover, apart, time_around

# %%
# The hall, the robot, and its path from left to right.

hall = cspace.Workspace.from_array(np.zeros((120, 100), dtype=bool), 0.1)
space = cspace.build(hall, cspace.Robot.rectangle(0.7, 0.5))
plan = planners.plan(space, (1.0, 5.0), (11.0, 5.0))
free = plan.trajectory(max_velocity=1.0, max_acceleration=0.5)
robot = Mover(space.robot, free, error=0.02)

# %%
# Others drive up at x = 4 m and down at x = 8 m, one each 3.2 seconds, for 22 seconds.

others = [
    Mover("disc:0.3", (x, 5.0), at=at, velocity=(0.0, speed), error=0.02)
    for x, speed in ((4.0, 1.0), (8.0, -1.0))
    for at in np.arange(0.0, 22.0, 3.2)
]
margin, until = 0.1, 40.0
timing = time_around(robot, others, margin=margin, until=until)
timed = timing.trajectory
print(f"alone: {free.duration:.2f} s; around the others: {timed.duration:.2f} s")
print(f"no motion along the path arrives before {timing.arrival_bound:.2f} s")
moved = replace(robot, motion=timed)
separations = [apart(moved, other, margin=margin, until=until) for other in others]
print(f"nearest: {min(each.distance for each in separations):.3f} m")

# %%
# If one of them stops on the road, no motion along the path is possible, and the reason says why.

broken_down = Mover("disc:0.3", (8.0, 5.0))
print(time_around(robot, [*others, broken_down], margin=margin, until=until).reason)


# %%
# The film: on the left the hall. On the right, path and time: blue is where the robot would be too
# near to another one. The robot's motion is a curve around it.


def where(other: Mover, t: float) -> np.ndarray:
    """Return where another one is at a time."""
    return np.asarray(other.motion) + (t - other.at) * np.asarray(other.velocity)


metres, seconds = np.linspace(0.0, 10.0, 201), np.linspace(0.0, 18.0, 361)
is_near = np.zeros((len(metres), len(seconds)), dtype=bool)
for other in others:
    for k, t in enumerate(seconds):
        x, y = where(other, t)
        beside = np.maximum(np.abs(1.0 + metres - x) - 0.35, 0.0)
        gap = np.hypot(beside, max(abs(5.0 - y) - 0.25, 0.0)) - 0.3
        is_near[:, k] |= gap <= margin + robot.error + other.error

figure, (left, right) = plt.subplots(1, 2, figsize=(9.0, 4.0), layout="constrained")
left.set(xlim=(0, 12), ylim=(0, 10), aspect="equal", xlabel="x (m)", ylabel="y (m)")
left.plot([1, 11], [5, 5], color="#6a1b9a", linewidth=1.0)
discs = [left.add_patch(Circle((0, 0), 0.3, color="#262626")) for _ in others]
box = left.add_patch(Rectangle((0, 0), 0.7, 0.5, color="#009e73", zorder=3))
extent = (seconds[0], seconds[-1], metres[0], metres[-1])
right.imshow(
    np.where(is_near[..., None], (166, 211, 238), 255).astype(np.uint8),
    origin="lower",
    extent=extent,
    aspect="auto",
)
t = np.linspace(0.0, seconds[-1], 500)
right.plot(t, timed.sample(t)[0][:, 0] - 1.0, color="#6a1b9a", label="around the others")
right.plot(t, free.sample(t)[0][:, 0] - 1.0, ":", color="#888888", label="alone")
(dot,) = right.plot([], [], "o", color="#009e73")
right.set(xlabel="time (s)", ylabel="metres of the path")
right.legend(loc="lower right")
figure.draw_without_rendering()
figure.set_layout_engine("none")  # moving artists must not shift the axes


def draw(t: float) -> None:
    """Show a time."""
    place = timed.sample(t)[0]
    box.set_xy(place - (0.35, 0.25))
    dot.set_data([t], [place[0] - 1.0])
    for disc, other in zip(discs, others, strict=True):
        disc.center = where(other, t)


film = FuncAnimation(figure, draw, np.arange(0.0, 16.0, 0.2), cache_frame_data=False)
film.save("wait_for_others.gif", PillowWriter(fps=10), dpi=72)
plt.close(figure)
