"""Park a car with Reeds-Shepp curves: ``python examples/parking.py [--data FOLDER] [--output FOLDER]``.

The folder holds ``parking1.geojson`` and ``car.geojson``; by default it is ``polygons`` below the folder that
``CSPACE_TEST_DATA`` names. Where there is none, a parking lot is drawn.
"""

import argparse
import itertools
import math
import os
from pathlib import Path

from shapely import box

import cspace
import planners
from cspace.plot import animate, save_plot

UP = math.pi / 2


def find_data() -> Path | None:
    """The folder of the lot and the car, where there is one."""
    folder = Path(os.environ.get("CSPACE_TEST_DATA", "."), "polygons")
    return folder if (folder / "parking1.geojson").exists() else None


def draw_lot() -> cspace.Workspace:
    """Two rows of parked cars with a gap in each, and a lane of 5 m between them."""
    upper = [box(x, -5, x + 2, -0.5) for x in (0.5, 6.1, 8.9, 11.7, 14.5)]
    lower = [box(x, -14.5, x + 2, -10) for x in (0.5, 3.3, 6.1, 11.7, 14.5)]
    return cspace.Workspace.from_polygons([*upper, *lower], 0.1, bounds=(-1, -16, 20, 2))


def main() -> None:
    parser = argparse.ArgumentParser(description="Park a car with Reeds-Shepp curves.")
    parser.add_argument("--data", type=Path, default=find_data(), help="folder of parking1.geojson and car.geojson")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    if options.data:
        lot = options.data / "parking1.geojson"
        workspace = cspace.Workspace.from_polygons(lot, 0.1, bounds=(-1, -16, 20, 2))
        car = cspace.Robot.open(options.data / "car.geojson")
        start, goal = (4.03, -2.6, UP), (9.9, -12.0, -UP)
    else:
        workspace, car = draw_lot(), cspace.Robot.rectangle(4.2, 1.9)
        start, goal = (4.3, -2.6, UP), (9.9, -12.0, -UP)

    space = cspace.build(workspace, car, rotations=72)
    # Of OMPL's planners, those that cover the map from both ends get out of a gap and into another soonest.
    plan = planners.plan(
        space, start, goal, planner="BKPIECE1", drive="reeds-shepp", turning_radius=2.5, time_limit=15, seed=3
    )
    print(f"{space}\n{plan.status}: {plan.length:.2f} m, certified: {plan.certified}")
    if not plan.solved:
        raise SystemExit("no path was found in the time given")
    ahead = [
        math.cos(yaw) * (x1 - x0) + math.sin(yaw) * (y1 - y0) >= 0
        for (x0, y0, yaw), (x1, y1, _) in zip(plan.path[:-1].tolist(), plan.path[1:].tolist(), strict=True)
    ]
    print(f"{len(plan.path)} configurations, {sum(a != b for a, b in itertools.pairwise(ahead))} cusps")
    name = options.output / "parking.png"
    for file in (
        save_plot(space, name, True, path=plan),
        animate(space, plan.path, name.with_suffix(".gif"), True, seconds=8),
    ):
        print(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
