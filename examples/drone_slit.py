"""A drone that must bank to pass a slit: ``python examples/drone_slit.py [--output FOLDER]``.

The slit stands upright and is narrower than the drone is wide. At no yaw does the level drone pass, which the map of
(x, y, z, yaw) proves; free to turn about any axis, it passes on its side, and every edge of its path is proven free.
"""

import argparse
import time
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import cspace
import planners
from cspace.plot import save_plot

LENGTH, WIDTH, HEIGHT = 7.0, 3.0, 2.6
SLIT = 0.5
DRONE = (0.8, 0.8, 0.2)
START, GOAL = (0.9, 1.0, 1.0), (6.1, 2.0, 1.0)


def draw_wall(spacing: float) -> cspace.Workspace:
    """Two rooms, and a wall of 0.2 m between them with an upright slit of 0.5 m by 1.8 m."""
    x0, x1, low, high = 3.4, 3.6, 0.4, 2.2
    left, right = (WIDTH - SLIT) / 2, (WIDTH + SLIT) / 2
    parts = [
        ((x0, 0, 0), (x1, left, HEIGHT)),
        ((x0, right, 0), (x1, WIDTH, HEIGHT)),
        ((x0, left, 0), (x1, right, low)),
        ((x0, left, high), (x1, right, HEIGHT)),
    ]
    wall = trimesh.util.concatenate([trimesh.creation.box(bounds=part) for part in parts])
    return cspace.Workspace.from_mesh(wall, spacing, (0, 0, 0, LENGTH, WIDTH, HEIGHT))


def main() -> None:
    parser = argparse.ArgumentParser(description="A drone that must bank to pass a slit.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    drone = cspace.Robot.box(DRONE)
    answers = {True: "a path exists", False: "proven: no path exists", None: "the cells cannot decide"}

    level = cspace.build(draw_wall(0.05), drone, rotations=72)
    answer = answers[level.path_exists((*START, 0.0), (*GOAL, 0.0))]
    print(f"a drone {DRONE[1]:g} m wide, level at any yaw, through a slit of {SLIT:g} m: {answer}")

    began = time.perf_counter()
    space = cspace.build(draw_wall(0.1), drone, rotations=cspace.Rotations.quaternions(8))
    print(f"turning as it likes: {space}: {time.perf_counter() - began:.1f} s")
    start, goal = (*START, 0.0, 0.0, 0.0, 1.0), (*GOAL, 0.0, 0.0, 0.0, 1.0)
    # The cells leave the slit undecided, and the geometry itself decides there: the path is no less proven.
    plan = planners.plan(space, start, goal, exact=True, time_limit=20, seed=1)
    print(f"{plan.status}: {plan.length:.2f} m, certified: {plan.certified}")
    if not plan.solved:
        raise SystemExit("no path was found in the time given")
    up = Rotation.from_quat(plan.path[:, 3:]).apply((0.0, 0.0, 1.0))[:, 2]
    print(f"it banks by up to {np.degrees(np.arccos(np.abs(up).min())):.0f} degrees")
    file = options.output / "drone_slit.png"
    save_plot(
        space, file, True, path=plan, view="3d", camera=(28, -115), robot_every=1.3, title="on its side through a slit"
    )
    print(f"picture: {file}")


if __name__ == "__main__":
    main()
