"""A cube through a winding tunnel: ``python examples/z_tunnel.py [--scene FOLDER] [--output FOLDER]``.

Robot and obstacles are meshes. The scene is ``solids/ZTunnel`` below the folder that ``CSPACE_TEST_DATA`` names; where
there is none, a wall with a bent hole is made of boxes.
"""

import argparse
import os
from pathlib import Path

import trimesh

import cspace
import planners
from cspace.plot import save_plot

Scene = tuple[cspace.Workspace, cspace.Robot, tuple[float, ...], tuple[float, ...]]


def make_scene() -> Scene:
    """A wall of 2 m between two rooms, with a hole of 0.2 m that turns twice."""
    boxes = [
        ((-2, -2, -1), (2, -0.1, 1)),  # beside the hole
        ((-2, 0.1, -1), (2, 2, 1)),
        ((-2, -0.1, 0.1), (0.3, 0.1, 1)),  # it enters above, at x = 0.3 to 0.5 ...
        ((0.5, -0.1, -0.1), (2, 0.1, 1)),
        ((-2, -0.1, -1), (-0.5, 0.1, 0.1)),  # ... goes along x, and leaves below, at x = -0.5 to -0.3
        ((-0.3, -0.1, -1), (2, 0.1, -0.1)),
    ]
    wall = trimesh.util.concatenate([trimesh.creation.box(bounds=box) for box in boxes])
    bounds = (-2, -2, -2, 2, 2, 2)
    robot = cspace.Robot.mesh(trimesh.creation.box((0.06, 0.06, 0.06)), name="cube")
    return cspace.Workspace.from_mesh(wall, 0.025, bounds), robot, (0, 0, 1.5), (0, 0, -1.5)


def read_scene(folder: Path) -> Scene:
    """The scene of a folder; ends and bounds are those of its ``problem.yaml``."""
    bounds = (-4, -3.75, -10, 3, 3.25, 10)
    workspace = cspace.Workspace.from_mesh(folder / "obstacles.obj", 0.05, bounds)
    return workspace, cspace.Robot.mesh(folder / "robot.obj"), (0, 0, 8), (-2, 0, -8)


def find_scene() -> Path | None:
    """The scene, where it is there."""
    folder = Path(os.environ.get("CSPACE_TEST_DATA", "."), "solids", "ZTunnel")
    return folder if folder.is_dir() else None


def main() -> None:
    parser = argparse.ArgumentParser(description="A cube through a winding tunnel.")
    parser.add_argument("--scene", type=Path, default=find_scene(), help="solids/ZTunnel")
    parser.add_argument("--output", type=Path, default=Path(__file__).parent / "output")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    workspace, robot, start, goal = read_scene(options.scene) if options.scene else make_scene()
    space = cspace.build(workspace, robot)
    print(f"{space}; a path exists: {space.path_exists(start, goal)}")
    plan = planners.plan(space, start, goal, planner="Cubes")  # the map's own search: no samples to draw
    print(f"{plan.status}: {plan.length:.2f} m, certified: {plan.certified}")
    if not plan.solved:
        raise SystemExit("no path was found")
    name = options.output / "z_tunnel.png"
    for file in (
        save_plot(space, name, True, path=plan),
        save_plot(space, name.with_name("z_tunnel_3d.png"), True, path=plan, view="3d"),
    ):
        print(f"{file}: {file.stat().st_size / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
