"""A drone through a building: ``python examples/drone_building.py [--map BUILDING.bt] [--output FOLDER]``.

The drone is a box that does not turn. The map is the OctoMap ``voxels/geb079.bt`` below the folder that
``CSPACE_TEST_DATA`` names; where there is none, two storeys are drawn with an opening between them.
"""

import argparse
import os
import time
from pathlib import Path

import numpy as np

import cspace
import planners
from cspace.plot import save_plot

DRONE = cspace.Robot.box((0.6, 0.6, 0.2))


def draw_storeys() -> cspace.Workspace:
    """Two storeys of 10 m x 6 m, each of 2.4 m, joined by an opening of 1.6 m in the floor between them."""
    occupied = np.zeros((100, 60, 52), dtype=bool)  # [x, y, z], 0.1 m each
    for axis in range(3):
        for end in (0, -1):
            np.moveaxis(occupied, axis, 0)[end] = True
    occupied[:, :, 25:27] = True
    occupied[80:96, 40:56, 25:27] = False
    occupied[40:42, :40, :25] = occupied[60:62, 20:, 27:] = True  # walls
    return cspace.Workspace.from_array(occupied, 0.1)


def find_map() -> Path | None:
    """The building, where it is there."""
    file = Path(os.environ.get("CSPACE_TEST_DATA", "."), "voxels", "geb079.bt")
    return file if file.exists() else None


def main() -> None:
    parser = argparse.ArgumentParser(description="A drone through a building.")
    parser.add_argument("--map", type=Path, default=find_map(), help="voxels/geb079.bt")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    if options.map:
        workspace, start, goal = cspace.Workspace.open(options.map), (-5.9, 0.1, 1.2), (27.4, 0.25, 2.2)
    else:
        workspace, start, goal = draw_storeys(), (1.0, 1.0, 1.0), (1.0, 1.0, 4.0)

    began = time.perf_counter()
    space = cspace.build(workspace, DRONE)
    print(f"{space}: {1e3 * (time.perf_counter() - began):.0f} ms")
    print(f"unknown cells count as occupied; a path exists: {space.path_exists(start, goal)}")
    plan = planners.plan(space, start, goal, time_limit=10, seed=1)
    print(f"{plan.status}: {plan.length:.2f} m, certified: {plan.certified}, {1e3 * plan.times.planning:.0f} ms")
    if not plan.solved:
        raise SystemExit("no path was found in the time given")
    name = options.output / "drone_building.png"
    pictures = [
        save_plot(space, name, True, path=plan),
        save_plot(space, name.with_name("drone_building_3d.png"), True, path=plan, view="3d"),
    ]
    space.export(name.with_suffix(".vti"), overwrite=True)  # for ParaView
    space.export(name.with_suffix(".ply"), overwrite=True)  # the border of the free space
    for file in (*pictures, name.with_suffix(".vti"), name.with_suffix(".ply")):
        print(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
