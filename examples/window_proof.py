"""What passes a window, and what can not however it turns: ``python examples/window_proof.py [--output FOLDER]``.

A plank that lies across a window passes once it is turned, in all three dimensions of rotation. A cube passes at no
rotation: no chain of cells that might be free leads through, which is a proof that no planner can give.
"""

import argparse
import time
from pathlib import Path

import trimesh

import cspace
import planners
from cspace.plot import save_plot

LENGTH, WIDTH, SPACING = 6.0, 4.0, 0.1
WINDOW = 0.9
ACROSS, AHEAD = (0.0, 0.0, 0.5**0.5, 0.5**0.5), (0.0, 0.0, 0.0, 1.0)  # along y, and along x
START, GOAL = (1.2, 2.0, 2.0), (4.8, 2.0, 2.0)


def draw_window() -> cspace.Workspace:
    """Two rooms of 4 m by 4 m, and a wall of 0.46 m between them with a square window in its middle."""
    x0, x1 = LENGTH / 2 - 0.23, LENGTH / 2 + 0.23
    low, high = (WIDTH - WINDOW) / 2, (WIDTH + WINDOW) / 2
    parts = [
        ((x0, 0, 0), (x1, low, WIDTH)),
        ((x0, high, 0), (x1, WIDTH, WIDTH)),
        ((x0, low, 0), (x1, high, low)),
        ((x0, low, high), (x1, high, WIDTH)),
    ]
    wall = trimesh.util.concatenate([trimesh.creation.box(bounds=part) for part in parts])
    return cspace.Workspace.from_mesh(wall, SPACING, (0, 0, 0, LENGTH, WIDTH, WIDTH))


def main() -> None:
    parser = argparse.ArgumentParser(description="What passes a window, and what can not however it turns.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    workspace = draw_window()
    answers = {True: "a path exists", False: "proven: no path exists", None: "the cells cannot decide"}

    still = cspace.build(workspace, cspace.Robot.box((0.3, 1.4, 0.3)))
    print(f"a plank across the window of {WINDOW:g} m, not turned: {answers[still.path_exists(START, GOAL)]}")

    rotations = cspace.Rotations.quaternions(8)
    for name, sides in (("plank", (1.4, 0.3, 0.3)), ("cube", (1.2, 1.2, 1.2))):
        begun = time.perf_counter()
        space = cspace.build(workspace, cspace.Robot.box(sides), rotations=rotations)
        start, goal = (*START, *ACROSS), (*GOAL, *ACROSS)
        answer = space.path_exists(start, goal)
        print(f"{name}, at any rotation: {answers[answer]} ({time.perf_counter() - begun:.1f} s, {space})")
        plan = None
        if answer is not False:
            # Where the cells cannot decide, the geometry itself can: the path is no less proven.
            plan = planners.plan(space, start, goal, exact=True, time_limit=20, seed=1)
            print(f"  path: {plan.status}, certified: {plan.certified}")
        file = options.output / f"window_{name}.png"
        save_plot(space, file, True, path=plan, start=start, goal=goal, view="3d")
        print(f"  picture: {file}")


if __name__ == "__main__":
    main()
