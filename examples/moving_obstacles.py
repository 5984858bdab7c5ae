"""Plan anew as the world moves: ``python examples/moving_obstacles.py [--output FOLDER]``.

A robot crosses an office while trolleys go to and fro. Each step of theirs is an update of the map, which costs less
than a millisecond; the robot asks the map whether the rest of its way is still free, and plans another one if not.
"""

import argparse
import statistics
import time
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

import cspace
import planners

H = 0.05  # side of a cell, metres
RADIUS = 0.3
START, GOAL = (0.8, 1.0), (15.2, 9.0)
SPEED, STEP = 0.9, 0.15  # metres and seconds in a step
KEEP = 0.2  # metres that trolleys keep from the robot
FRAMES = 220
COLORS = {"free": "#ffffff", "undecided": "#f0b48c", "C-obstacle": "#a6d3ee", "wall": "#262626", "trolley": "#d55e00"}


class Trolley:
    """A box that goes to and fro between two places, given by its middle, in metres."""

    def __init__(self, ends: tuple[tuple[float, float], tuple[float, float]], size: tuple[float, float], speed: float):
        self.ends, self.half, self.speed = np.array(ends), np.array(size) / 2, speed
        self.place, self.aim = self.ends[0].copy(), 1

    def next_place(self) -> np.ndarray:
        """Where it wants to be a step later."""
        away = self.ends[self.aim] - self.place
        left = float(np.hypot(*away))
        if left < 1e-9:
            self.aim = 1 - self.aim
            return self.place.copy()
        return self.place + away * min(1.0, self.speed * STEP / left)

    def gap(self, place: np.ndarray, point: np.ndarray) -> float:
        """Distance from it, at a place, to a point."""
        return float(np.hypot(*np.maximum(np.abs(point - place) - self.half, 0.0)))

    def hits(self, place: np.ndarray, other: "Trolley") -> bool:
        """Whether it would touch another one at a place."""
        return bool((np.abs(place - other.place) < self.half + other.half + H).all())

    def window(self, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First cell that it touches at a place, and the first one beyond it."""
        return np.floor((place - self.half) / H).astype(int), np.ceil((place + self.half) / H).astype(int)


def draw_office() -> np.ndarray:
    """Cells of a floor of 16 m by 10 m with rooms on both sides of a corridor."""
    walls = np.zeros((320, 200), dtype=bool)
    walls[:4], walls[-4:], walls[:, :4], walls[:, -4:] = True, True, True, True
    for low in (72, 124):  # both sides of the corridor
        walls[:, low : low + 4] = True
        for door in (24, 104, 184, 264):
            walls[door : door + 28, low : low + 4] = False
    for x in (78, 158, 238):  # walls between rooms, with a door at the outer end
        walls[x : x + 4, :76] = walls[x : x + 4, 124:] = True
        walls[x : x + 4, 12:38] = walls[x : x + 4, 162:188] = False
    return walls


def place_trolleys() -> list[Trolley]:
    """Those in the corridor, and some between the rooms."""
    return [
        Trolley(((2.0, 4.4), (14.0, 4.4)), (0.9, 0.6), 0.8),
        Trolley(((13.5, 5.5), (2.5, 5.5)), (0.9, 0.6), 0.6),
        Trolley(((8.6, 1.1), (3.0, 1.1)), (0.8, 0.6), 0.5),
        Trolley(((5.9, 3.0), (5.9, 7.5)), (0.6, 0.8), 0.4),
        Trolley(((12.9, 8.6), (14.0, 6.9)), (0.6, 0.6), 0.5),
        Trolley(((13.9, 7.2), (13.9, 2.5)), (0.6, 0.8), 0.4),
    ]


class Film:
    """Pictures of the map, one for each step, and a GIF of them."""

    def __init__(self) -> None:
        self.figure = Figure(figsize=(8.0, 5.3), dpi=72)
        self.canvas = FigureCanvasAgg(self.figure)
        axes = self.figure.add_axes((0.02, 0.02, 0.96, 0.9))
        axes.set_axis_off()
        self.image = axes.imshow(np.zeros((200, 320, 3)), origin="lower", extent=(0.0, 16.0, 0.0, 10.0))
        self.way = axes.plot([], [], color="#0072b2", linewidth=2.0)[0]
        self.robot = axes.fill([0.0], [0.0], color="#009e73", zorder=3)[0]
        axes.plot(*GOAL, marker="*", markersize=16, color="#009e73")
        self.title = self.figure.text(0.02, 0.95, "", fontsize=11)
        self.palette = np.array([to_rgb(color) for color in COLORS.values()])
        self.frames: list[Image.Image] = []

    def add(self, space: cspace.CSpace, walls: np.ndarray, q: np.ndarray, way: np.ndarray, words: str) -> None:
        """Another frame."""
        classes = space.state.copy()
        classes[space.workspace.outer] = 4
        classes[walls] = 3
        self.image.set_data(self.palette[classes.T])
        self.way.set_data(*np.vstack([q, way]).T if len(way) else ([], []))
        turn = np.linspace(0.0, 2.0 * np.pi, 40)
        self.robot.set_xy(q + RADIUS * np.column_stack([np.cos(turn), np.sin(turn)]))
        self.title.set_text(words)
        self.canvas.draw()
        pixels = np.asarray(self.canvas.buffer_rgba())[..., :3]
        self.frames.append(Image.fromarray(pixels))

    def save(self, file: Path) -> None:
        """Write the GIF, in the colours of one frame, so that none of them flickers."""
        few = self.frames[len(self.frames) // 2].quantize(64)
        first, *others = [frame.quantize(palette=few, dither=Image.Dither.NONE) for frame in self.frames]
        first.save(file, save_all=True, append_images=others, duration=70, loop=0)


def move(space: cspace.CSpace, walls: np.ndarray, trolleys: list[Trolley], q: np.ndarray) -> list[float]:
    """Let all trolleys make a step, each an update of the map; milliseconds that the updates took."""
    taken = []
    for trolley in trolleys:
        place = trolley.next_place()
        if trolley.gap(place, q) < RADIUS + KEEP:
            continue  # it waits for the robot to pass
        if any(trolley.hits(place, other) for other in trolleys if other is not trolley):
            trolley.aim = 1 - trolley.aim  # it turns back
            continue
        old, new = trolley.window(trolley.place), trolley.window(place)
        trolley.place = place
        low, high = np.minimum(old[0], new[0]), np.maximum(old[1], new[1])
        box = np.zeros(high - low, dtype=bool)
        for other in trolleys:
            first, last = np.clip(np.array(other.window(other.place)) - low, 0, high - low)
            box[first[0] : last[0], first[1] : last[1]] = True
        box |= walls[low[0] : high[0], low[1] : high[1]]
        began = time.perf_counter()
        space.update(box, low)
        taken.append(1e3 * (time.perf_counter() - began))
    return taken


def follow(q: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the robot is a step later on its way, and what is left of that."""
    left = SPEED * STEP
    while len(way) and left > 0.0:
        away = way[0] - q
        length = float(np.hypot(*away))
        if length > left:
            return q + away * (left / length), way
        q, way, left = way[0], way[1:], left - length
    return q, way


def main() -> None:
    parser = argparse.ArgumentParser(description="Plan anew as the world moves.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)

    walls = draw_office()
    space = cspace.build(cspace.Workspace.from_array(walls, H), cspace.Robot.disc(RADIUS))
    trolleys, film = place_trolleys(), Film()
    q, way, words = np.array(START), np.empty((0, 2)), "looking for a way"
    planners.plan(space, START, GOAL)  # these two compile, or load what was compiled before
    space.update(walls[:1, :1], (0, 0))
    updates, plans, waits = [], [], 0
    for step in range(FRAMES):
        updates += move(space, walls, trolleys, q)
        # The proof of the rest of the way, edge by edge, in the world as it is now.
        if not len(way) or not space.certify_path(np.vstack([q, way])).all():
            began = time.perf_counter()
            plan = planners.plan(space, q, GOAL, time_limit=0.5, seed=step)
            plans.append(1e3 * (time.perf_counter() - began))
            way = plan.path[1:]
            words = f"way number {len(plans)}, {plan.length:.1f} m" if plan.solved else "no way: waiting"
            waits += not plan.solved
        q, way = follow(q, way)
        film.add(space, walls, q, way, words)
        if np.hypot(*(q - GOAL)) < 1e-6:
            break
    else:
        raise SystemExit("the robot did not arrive in time")

    print(f"{space}")
    print(f"arrived after {(step + 1) * STEP:.1f} s, {waits} steps without a way")
    print(f"{len(updates)} updates: {statistics.median(updates):.2f} ms each in the median")
    print(f"{len(plans)} plans: {statistics.median(plans):.1f} ms each in the median")
    file = options.output / "moving_obstacles.gif"
    film.save(file)
    print(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
