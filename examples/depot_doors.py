"""A robot that must turn to fit: ``python examples/depot_doors.py [--map DEPOT.yaml] [--output FOLDER]``.

It drives into an aisle that it fits lengthwise alone. The map is ``maps/depot.yaml`` below the folder that
``CSPACE_TEST_DATA`` names; where there is none, two rooms are drawn with a door between them.
"""

import argparse
import os
from pathlib import Path

import numpy as np
from shapely import box

import cspace
import planners
from cspace.plot import animate, save_plot

ROBOT = cspace.Robot.rectangle(0.9, 0.6)


def draw_rooms() -> cspace.Workspace:
    """Rooms of 6 m by 6 m with a wall of 1 m between them, and in it a passage of 1 m: too narrow to turn in."""
    walls = [box(0, 0, 13, 6) - box(0.2, 0.2, 12.8, 5.8), box(6, 0, 7, 3.8), box(6, 4.8, 7, 6)]
    return cspace.Workspace.from_polygons([*walls, box(2.5, 2, 3.5, 4), box(9.5, 3, 10.3, 6)], 0.05)


def find_map() -> Path | None:
    """The depot's map, where there is one."""
    file = Path(os.environ.get("CSPACE_TEST_DATA", "."), "maps", "depot.yaml")
    return file if file.exists() else None


def main() -> None:
    parser = argparse.ArgumentParser(description="A robot that must turn to fit.")
    parser.add_argument("--map", type=Path, default=find_map(), help="maps/depot.yaml")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    if options.map:
        workspace, start, narrow, goal = cspace.Workspace.from_ros_map(options.map), (2, 2), (18.4, 4.33), (18.4, 4.33)
    else:
        workspace, start, narrow, goal = draw_rooms(), (1, 5), (6.5, 4.3), (12, 5)

    space = cspace.build(workspace, ROBOT, rotations=72)
    yaws = np.arange(0, 180, 5)
    fits = yaws[space.is_free([(*narrow, yaw) for yaw in np.radians(yaws)])]
    print(f"{space}")
    print(f"at {narrow} the robot fits at {fits.tolist()} of {len(yaws)} yaws from 0 to 175 degrees")

    plan = planners.plan(space, (*start, np.pi / 2), (*goal, 0.0), time_limit=10, seed=1)
    print(f"{plan.status}: {plan.length:.2f} m, certified: {plan.certified}, {1e3 * plan.times.planning:.0f} ms")
    if not plan.solved:
        raise SystemExit("no path was found in the time given")
    name = options.output / "depot_doors.png"
    pictures = [
        save_plot(space, name, True, path=plan),
        save_plot(space, name.with_name("depot_doors_slices.png"), True, path=plan, view="panels"),
        animate(space, plan.path, name.with_suffix(".gif"), True),
    ]
    for file in pictures:
        print(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
