"""Command that compiles ahead, by small jobs that use what most scripts use."""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from cspace.cli.options import Json
from cspace.cli.report import ByName, progress_line, show
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace.space import CSpace
    from planners import Plan

_BAR: Final = (
    '<collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.1 0.1"/></geometry></collision>'
)
_AXIS: Final = '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/>'
_TWO_LINKS: Final = (
    '<robot name="two"><link name="base"/>'
    f'<link name="upper">{_BAR}</link><link name="fore">{_BAR}</link>'
    '<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>'
    f"{_AXIS}</joint>"
    '<joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>'
    f'<origin xyz="1 0 0"/>{_AXIS}'
    "</joint></robot>"
)
"""URDF of an arm with two links in a plane."""


def compile_ahead(as_json: Json = False) -> None:
    """Compile ahead what maps, plans and arms need.

    Without it, each function is compiled at its first call. Run it while you make the image of a
    container, as the user of the container.
    """
    from cspace.cli.demo import write_inputs
    from cspace.support import compiling

    folder = compiling.cache_folder()
    if folder is None:
        hint = "set NUMBA_CACHE_DIR to a folder that only you can write to"
        raise InputError(
            "NUMBA_CACHE_DIR",
            "names no safe folder",
            "compiled code is kept in one",
            hint,
            value=None,
        )
    level = compiling.LOGGER.level
    compiling.LOGGER.setLevel(logging.ERROR)  # a long wait is what this command is for
    seconds = ByName()
    try:
        with tempfile.TemporaryDirectory() as inputs:
            write_inputs(Path(inputs))
            for name, job in JOBS.items():
                began = time.perf_counter()
                with progress_line(name):
                    str(job(Path(inputs)))  # the text of a plan has its proven distances
                seconds[name] = round(time.perf_counter() - began, 2)
    finally:
        compiling.LOGGER.setLevel(level)
    functions = sum(1 for _ in folder.rglob("*.nbc"))
    show({"folder": str(folder), "compiled_functions": functions, "seconds": seconds}, as_json)


def plan_in_plane(folder: Path) -> Plan:
    """Plan for a robot that keeps its yaw."""
    import planners

    return planners.plan(_map_flat(folder), (1.4, 8.6), (14.6, 1.2))


def plan_with_yaw(folder: Path, **options: Any) -> Plan:
    """Plan for a robot that turns."""
    import planners

    return planners.plan(_map_flat(folder, 72), (2, 3, 0), (9, 1, 0), **options)


def plan_with_differential_drive(folder: Path) -> Plan:
    """Plan for a robot that turns on the spot."""
    return plan_with_yaw(folder, drive="differential")


def plan_with_car(folder: Path) -> Plan:
    """Plan for a car."""
    return plan_with_yaw(folder, drive="reeds-shepp", turning_radius=0.5, time_limit=5)


def plan_in_space(folder: Path) -> Plan:
    """Plan for a drone."""
    import planners

    return planners.plan(_map_house(folder), (1, 2, 0.5), (5, 3, 0.5))


def plan_for_arm(folder: Path) -> Plan:
    """Plan for an arm beside a post."""
    import numpy as np

    import planners
    from cspace.arms import Arm, PosedShape, build_arm_space
    from cspace.robot import Robot

    urdf = folder / "two.urdf"
    urdf.write_text(_TWO_LINKS, encoding="utf-8")
    pose = np.eye(4)
    pose[:3, 3] = 1.5, 1.0, 0.0
    post = PosedShape(Robot.cylinder(0.1, 1.0).shape, pose)
    space = build_arm_space({"post": post}, Arm.from_urdf(urdf))
    return planners.plan(space, (-0.6, 0.3), (1.4, -0.2), time_limit=5.0, seed=1)


def ask_maps(folder: Path) -> None:
    """Ask each kind of map each common question, and change the map."""
    import shapely

    from cspace.opening import open_map
    from cspace.robot import Robot

    for name, space, first, last in (
        ("plane", _map_flat(folder), (3.0, 4.0), (5.0, 4.5)),
        ("turning", _map_flat(folder, 72), (3.0, 4.0, 0.0), (5.0, 4.5, 0.5)),
        ("space", _map_house(folder), (1.0, 2.0, 0.5), (2.0, 2.0, 0.5)),
    ):
        for q in (first, [first, last]):
            space.is_free(q)
            space.clearance(q)
            space.is_connected(q, last)
            space.is_disconnected(q, last)
            for exact in (False, True):
                space.motion_is_free(q, last, exact=exact)
        space.certify_path([first, last])
        space.sample_free(10)
        space.save(folder / f"{name}.zarr", overwrite=True)
        open_map(folder / f"{name}.zarr").is_free(first)
        crate = Robot.box((0.5, 0.5, 0.5)).shape if name == "space" else shapely.box(6, 4, 6.5, 4.5)
        space.add_obstacle("crate", crate)


def _map_flat(folder: Path, rotations: int | None = None) -> CSpace:
    """Map the floor plan of the demo for a cart."""
    from cspace.builder import build
    from cspace.robot import Robot
    from cspace.workspace import Workspace

    workspace = Workspace.open(folder / "flat.geojson", spacing=0.05)
    return build(workspace, Robot.rectangle(0.7, 0.5), rotations=rotations)


def _map_house(folder: Path) -> CSpace:
    """Map the house of the demo for a drone."""
    from cspace.builder import build
    from cspace.robot import Robot
    from cspace.workspace import Workspace

    workspace = Workspace.open(folder / "house.stl", spacing=0.1)
    return build(workspace, Robot.box((0.6, 0.6, 0.2)))


JOBS: Final[dict[str, Callable[[Path], object]]] = {
    "plan in the plane": plan_in_plane,
    "plan with a yaw": plan_with_yaw,
    "plan with a differential drive": plan_with_differential_drive,
    "plan for a car": plan_with_car,
    "plan in space": plan_in_space,
    "queries and updates": ask_maps,
    **({"plan for an arm": plan_for_arm} if find_spec("yourdfpy") else {}),
}
"""Jobs by what they do; each takes the folder of the inputs of the demo."""
