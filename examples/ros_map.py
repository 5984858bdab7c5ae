"""Plan on a ROS map: ``python examples/ros_map.py [MAP.yaml]``. Without a map, the script draws a small one itself."""

import sys
import tempfile
from pathlib import Path

import numpy as np
from PIL import Image

import cspace
import planners


def draw_map(folder: Path) -> Path:
    """Write a room of 8 m by 6 m with a wall across it, as a ROS map; return its YAML file."""
    pixels = np.full((120, 160), 254, np.uint8)  # rows from the top, 0.05 m each; 254 is free and 0 is occupied
    pixels[[0, -1], :] = pixels[:, [0, -1]] = 0
    pixels[30:, 78:82] = 0
    Image.fromarray(pixels).save(folder / "room.pgm")
    file = folder / "room.yaml"
    file.write_text(
        "image: room.pgm\nmode: trinary\nresolution: 0.05\norigin: [-4.0, -3.0, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    return file


def farthest_pair(space: cspace.CSpace) -> tuple[np.ndarray, np.ndarray]:
    """Of some FREE configurations, the two farthest from each other that a chain of FREE cells joins."""
    some = space.sample_free(100, np.random.default_rng(1))
    first, second = np.broadcast_arrays(some[:, np.newaxis], some)
    joined = space.path_exists(first, second) == True  # noqa: E712 - each answer is True, False or None
    apart = np.where(joined, np.linalg.norm(first - second, axis=-1), -1.0)
    i, j = np.unravel_index(apart.argmax(), apart.shape)
    return some[i], some[j]


def main(arguments: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(arguments[0]) if arguments else draw_map(Path(folder))
        workspace = cspace.Workspace.from_ros_map(file)
    space = cspace.build(workspace, cspace.Robot.disc(0.25))
    start, goal = farthest_pair(space)
    plan = planners.plan(space, start, goal, seed=1)
    print(f"{file.name}: {workspace.grid.shape[0]} x {workspace.grid.shape[1]} cells of {workspace.grid.spacing} m")
    print(f"path of {plan.length:.2f} m, never closer than {plan.clearance:.2f} m to leaving the free cells:")
    for x, y in plan.path:
        print(f"  {x:7.2f} {y:7.2f}")


if __name__ == "__main__":
    main(sys.argv[1:])
