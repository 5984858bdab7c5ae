"""
Replan as obstacles move
========================

A robot crosses an office while trolleys move to and fro. Each step of a trolley moves an obstacle
of the map. The robot queries the map for the rest of its path, and plans another path if an edge is
no longer free.
"""

import statistics
import time

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.colors import ListedColormap
from matplotlib.patches import Circle
from shapely import Polygon, box, union_all

import cspace
import planners

# %%
# Rooms on both sides of a corridor, 16 m by 10 m, and a round robot.

doors = [box(x, y, x + 1.4, y + 0.2) for x in (1.2, 5.2, 9.2, 13.2) for y in (3.6, 6.2)]
doors += [box(x, y, x + 0.2, y + 1.3) for x in (3.9, 7.9, 11.9) for y in (0.6, 8.1)]
walls = [box(0, 0, 16, 10) - box(0.2, 0.2, 15.8, 9.8), box(0, 3.6, 16, 3.8), box(0, 6.2, 16, 6.4)]
walls += [box(x, y, x + 0.2, y + 3.8) for x in (3.9, 7.9, 11.9) for y in (0, 6.2)]
office = cspace.Workspace.from_polygons([union_all(walls) - union_all(doors)], spacing=0.05)
radius = 0.3
space = cspace.build(office, cspace.Robot.disc(radius))

# %% Trolleys, each with two end points, the lengths of its sides and its speed. ``add_obstacle``
# moves an obstacle to a new position, metres, and frees its old position.

trolleys = [
    ((2.0, 4.4), (14.0, 4.4), (0.9, 0.6), 0.8),
    ((13.5, 5.5), (2.5, 5.5), (0.9, 0.6), 0.6),
    ((7.2, 1.1), (1.0, 1.1), (0.8, 0.6), 0.5),
    ((5.9, 3.0), (5.9, 7.5), (0.6, 0.8), 0.4),
    ((12.9, 8.6), (14.0, 6.9), (0.6, 0.6), 0.5),
    ((13.9, 7.2), (13.9, 2.5), (0.6, 0.8), 0.4),
]
gone = np.zeros(len(trolleys))  # distance covered by each, metres


def where(number: int, distance: float) -> Polygon:
    """Return the shape of a trolley after a distance, metres."""
    first, last, sides, _ = map(np.array, trolleys[number])
    length = np.linalg.norm(last - first)
    share = 1 - abs(1 - distance / length % 2)
    low = first + share * (last - first) - sides / 2
    return box(*low, *(low + sides))


# %%
# The robot moves until it reaches the goal. A trolley waits if the robot blocks it.

start, goal, step = (
    np.array((0.8, 1.0)),
    np.array((15.2, 9.0)),
    0.15,
)  # metres; the step is in seconds
planners.plan(space, start, goal)  # compile before the loop
q, path, frames, updates, plans = start, np.empty((0, 2)), [], [], []
while not np.array_equal(q, goal) and len(frames) < 400:
    disc = Polygon(
        [*q + radius * np.array([(np.cos(t), np.sin(t)) for t in np.linspace(0, 6, 20)])]
    )
    for number, (*_, speed) in enumerate(trolleys):
        trolley = where(number, gone[number] + speed * step)
        if trolley.distance(disc) > 0.2:
            gone[number] += speed * step
            began = time.perf_counter()
            space.add_obstacle(f"trolley {number}", trolley)
            updates.append(time.perf_counter() - began)
    if not len(path) or not space.certify_path([q, *path]).all():  # each remaining edge
        plan = planners.plan(space, q, goal, time_limit=0.5, seed=len(frames))
        plans.append(plan.times.planning)
        path = plan.path[1:]
    left = 0.9 * step
    while len(path) and left > 0:
        length = np.linalg.norm(path[0] - q)
        q = path[0] if length <= left else q + (path[0] - q) * left / length
        path, left = path[int(length <= left) :], left - length
    frames.append((space.cell_states + 3 * space.workspace.outer, q, path))

print(f"arrived after {len(frames) * step:.1f} s, with {len(plans)} plans on the way")
print(
    f"{len(updates)} moves of trolleys: {1e3 * statistics.median(updates):.2f} ms each in the median"
)
print(f"a plan: {1e3 * statistics.median(plans):.1f} ms in the median")

# %%
# The animation: white is free, blue the C-obstacle, orange undecided, and black are obstacles.

figure, ax = plt.subplots(figsize=(8, 5.2), layout="constrained")
colors = ListedColormap(["#ffffff", "#d55e00", "#a6d3ee", "#262626"])
image = ax.imshow(
    np.zeros((200, 320)), origin="lower", extent=(0, 16, 0, 10), cmap=colors, vmin=0, vmax=3
)
(line,) = ax.plot([], [], color="#6a1b9a")
robot = ax.add_patch(Circle(start, radius, color="#009e73", zorder=3))
ax.plot(*goal, "*", color="#009e73", markersize=16)
ax.set(xlabel="x (m)", ylabel="y (m)")
figure.draw_without_rendering()
figure.set_layout_engine("none")  # moving artists must not shift the axes


def draw(frame: tuple[np.ndarray, np.ndarray, np.ndarray]) -> None:
    states, robot.center, rest = np.minimum(frame[0], 3), frame[1], frame[2]
    image.set_data(states.T)
    line.set_data(*np.vstack([frame[1], *rest]).T)


film = FuncAnimation(figure, draw, frames[::2], cache_frame_data=False)
film.save("moving_obstacles.gif", PillowWriter(fps=8), dpi=72)
plt.close(figure)
