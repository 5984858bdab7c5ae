"""A robot on two wheels among shelves: ``python examples/warehouse_robot.py [--output FOLDER]``.

It turns on the spot and drives straight on, as most mobile robots do, and every turn and every straight is proven.
"""

import argparse
from pathlib import Path

import numpy as np
from shapely import box

import cspace
import planners
from cspace.plot import animate, save_plot

START, GOAL = (1.2, 1.2, 0.0), (12.9, 7.3, np.pi / 2)


def draw_hall() -> cspace.Workspace:
    """A hall of 16 m by 10 m with shelves, pallets between them, and a pillar."""
    shelves = [box(x, y, x + 1.2, y + 2.6) for x in (2.6, 5.4, 8.2, 11.0, 13.6) for y in (1.6, 5.8)]
    pallets = [box(4.2, 3.4, 5.0, 4.2), box(7.0, 6.6, 7.8, 7.4), box(9.8, 2.2, 10.6, 3.0), box(9.4, 0.0, 10.2, 1.8)]
    return cspace.Workspace.from_polygons([*shelves, *pallets, box(7.4, 4.7, 7.8, 5.1)], 0.05, bounds=(0, 0, 16, 10))


def main() -> None:
    parser = argparse.ArgumentParser(description="Plan for a robot on two wheels.")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)

    space = cspace.build(draw_hall(), cspace.Robot.rectangle(0.9, 0.6), rotations=72)
    plan = planners.plan(space, START, GOAL, drive="differential", time_limit=5, seed=2)
    print(space, plan, sep="\n")
    if not plan.solved:
        raise SystemExit("no path was found in the time given")
    for q, way in zip(plan.waypoints[1:], np.diff(plan.waypoints, axis=0), strict=True):
        turn = (np.degrees(way[2]) + 180) % 360 - 180
        print(
            f"turn by {turn:.0f} degrees" if way[2] else f"drive {np.hypot(*way[:2]):.2f} m",
            f"to ({q[0]:.2f}, {q[1]:.2f})",
        )
    # The waypoints are joined by straight edges of the map, which proves them once more.
    print("every turn and every straight proven:", space.certify_path(plan.waypoints).all())

    name = options.output / "warehouse_robot.png"
    for file in (
        save_plot(space, name, True, path=plan),
        animate(space, plan.path, name.with_suffix(".gif"), True, seconds=8),
    ):
        print(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
