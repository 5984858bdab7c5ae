"""Who can pass a corridor, and who can not at any yaw: ``python examples/corridor_proof.py [--output FOLDER]``.

A planner that finds no path proves nothing. The map does: where no chain of cells that might be free joins two
configurations, no path exists, however the robot turns on its way.
"""

import argparse
from pathlib import Path

from shapely import box

import cspace
import planners
from cspace.plot import save_plot

START, GOAL = (1.5, 2.0, 0.0), (8.5, 2.0, 0.0)
WIDTH = 1.0


def draw_corridor() -> cspace.Workspace:
    """Two rooms of 3 m by 4 m, joined by a corridor of 1 m by 4 m."""
    walls = box(0, 0, 10, 4) - box(0.1, 0.1, 3, 3.9) - box(7, 0.1, 9.9, 3.9) - box(3, 1.5, 7, 1.5 + WIDTH)
    return cspace.Workspace.from_polygons([walls], 0.05)


def main() -> None:
    parser = argparse.ArgumentParser(description="Who can pass a corridor, and who can not at any yaw.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    workspace = draw_corridor()
    answers = {True: "a path exists", False: "proven: no path exists, at any yaw", None: "the cells cannot decide"}
    for width in (0.6, 0.98, 1.2):
        space = cspace.build(workspace, cspace.Robot.rectangle(1.3, width), rotations=72)
        print(f"robot {width:g} m wide, corridor {WIDTH:g} m: {answers[space.path_exists(START, GOAL)]}")
        # Where the cells cannot decide, the geometry itself can: the path is no less proven.
        plan = planners.plan(space, START, GOAL, exact=True, time_limit=5, seed=1)
        found = f"{plan.length:.2f} m, certified: {plan.certified}" if plan.solved else "none"
        print(f"  path: {found} ({plan.status})")
        file = options.output / f"corridor_{width:g}.png"
        save_plot(space, file, True, path=plan if plan.solved else None, start=START, goal=GOAL)
        print(f"  picture: {file}")


if __name__ == "__main__":
    main()
