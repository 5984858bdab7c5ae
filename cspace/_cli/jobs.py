"""Small jobs that call the functions that most scripts need, to compile them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

import planners
from cspace import CSpace, Gate, Robot, Workspace, build
from cspace import open as open_map

if TYPE_CHECKING:
    from cspace.arms import ArmSpace

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


_CAR: Final = planners.Car(turning_radius=0.5, reverse=True)
_DIFFERENTIAL: Final = planners.Differential()


def map_flat(folder: Path, rotations: int | None = None) -> CSpace:
    """Build the map of a rectangular robot in the demo's floor plan."""
    workspace = Workspace.open(folder / "flat.geojson", spacing=0.05)
    return build(workspace, Robot.rectangle(0.7, 0.5), rotations=rotations)


def map_house(folder: Path) -> CSpace:
    """Build the map of a box-shaped robot in the demo's house."""
    workspace = Workspace.open(folder / "house.stl", spacing=0.1)
    return build(workspace, Robot.box((0.6, 0.6, 0.2)))


def plan_in_plane(folder: Path) -> planners.Plan:
    """Plan in the plane with a fixed yaw."""
    return planners.plan(map_flat(folder), (1.4, 8.6), (14.6, 1.2))


def plan_with_yaw(folder: Path, tight: bool = False, **options: Any) -> planners.Plan:
    """Plan a path in the plane for a robot that rotates, by geometry if places are tight."""
    space = map_flat(folder, 72)
    return planners.plan(space.exact if tight else space, (2, 3, 0), (9, 1, 0), **options)


def plan_around_crate(folder: Path) -> planners.Plan:
    """Plan around an added obstacle, by a search with so many nodes that their table grows."""
    space = map_flat(folder, 72)
    space.add_obstacle("crate", shapely.box(6, 1, 6.5, 1.5))
    return planners.plan(space, (2, 3, 0), (9, 1, 0), drive=_DIFFERENTIAL)


def plan_in_space(folder: Path) -> planners.Plan:
    """Plan a path in space for a robot with a fixed rotation."""
    return planners.plan(map_house(folder), (1, 2, 0.5), (5, 3, 0.5))


def time_drives(folder: Path) -> None:
    """Time motions in the plane, with and without limited jerk, and prove their commands."""
    holonomic = {"max_velocity": 1.0, "max_acceleration": 0.5}
    limits = {**holonomic, "max_angular_velocity": 1.0, "max_angular_acceleration": 1.5}
    _time_motion(plan_in_plane(folder), **holonomic)
    _time_motion(plan_with_yaw(folder), **limits)
    _time_motion(plan_with_yaw(folder, drive=_CAR), **holonomic)
    plan = plan_with_yaw(folder, drive=_DIFFERENTIAL)
    _time_motion(plan, **limits)
    space = map_flat(folder, 72)
    rows = Gate(space, dt=0.05, max_velocity=1.0, tracking=0.02)
    rows.check_rows(plan.start, plan.path[1:20])
    gate = Gate(space, dt=0.05, max_deceleration=(1.0, 2.0), tracking=0.02)
    twists = np.tile((0.2, 0.1), (20, 1))
    gate.check_twists(plan.start, twists)
    gate.slow_down(plan.start, twists[0], twist_now=(0.0, 0.0))


def _time_motion(plan: planners.Plan, **limits: Any) -> None:
    """Time a path, without and with limited jerk; prove it again, and a stop on it."""
    for own_limits in (limits, limits | {"max_jerk": 2.5}):
        motion = plan.trajectory(**own_limits)
        motion.sample_uniform(20.0)
        motion.braked(0.5 * motion.duration)
        if plan.space is not None:
            motion.recheck(plan.space)


def plan_for_arm(folder: Path) -> planners.Plan:
    """Plan for a planar arm beside a post."""
    space = build_arm(folder)
    return planners.plan(space, (-0.6, 0.3), (1.4, -0.2), seed=1)


def move_arm(folder: Path) -> None:
    """Time motions of an arm, keep its link upright, and follow a line."""
    space = build_arm(folder)
    start, goal = (-0.6, 0.3), (1.4, -0.2)
    keep = planners.Upright("fore", axis=(1, 0, 0), direction=(1.0, 0.5, 0.0), tolerance=1.2)
    for kept in (None, keep):
        plan = planners.plan(space, start, goal, seed=1, keep=kept)
        _time_motion(plan, max_acceleration=2.0)
        str(plan)
    pose = space.arm.pose((-0.5, 0.3), "fore")
    space.arm.inverse("fore", pose)
    space.follow_line(start, "fore", [pose], tolerance=(1e-2, 0.2))


def build_arm(folder: Path) -> ArmSpace:
    """Build the space of a planar arm beside a post."""
    from cspace.arms import Arm, PosedShape, build_arm_space

    urdf = folder / "two.urdf"
    urdf.write_text(_TWO_LINKS, encoding="utf-8")
    pose = np.eye(4)
    pose[:3, 3] = 1.5, 1.0, 0.0
    post = PosedShape(Robot.cylinder(0.1, 1.0).shape, pose)
    return build_arm_space({"post": post}, Arm.from_urdf(urdf))


def query_maps(folder: Path) -> None:
    """Query and update maps in the plane, with yaw and in space."""
    square = shapely.box(6, 4, 6.5, 4.5)
    cube = Robot.box((0.5, 0.5, 0.5)).shape
    file = folder / "map.zarr"
    _query_map(map_flat(folder), (3.0, 4.0), (5.0, 4.5), square, file)
    _query_map(map_flat(folder, 72), (3.0, 4.0, 0.0), (5.0, 4.5, 0.5), square, file)
    _query_map(map_house(folder), (1.0, 2.0, 0.5), (2.0, 2.0, 0.5), cube, file)


def _query_map(
    space: CSpace, first: tuple[float, ...], last: tuple[float, ...], crate: Any, file: Path
) -> None:
    """Query a map, save it, and add an obstacle."""
    # Functions for one configuration and for a batch are compiled separately.
    for q in (first, [first, last]):
        space.is_free(q)
        space.clearance(q)
        space.is_connected(q, last)
        space.is_disconnected(q, last)
        for asked in (space, space.exact):
            asked.motion_is_free(q, last)
    space.certify_path([first, last])
    space.sample_free(10)
    space.save(file, overwrite=True)
    open_map(file).is_free(first)
    space.add_obstacle("crate", crate)


def audit_lanes(folder: Path) -> object:
    """Audit lanes through the doors of the demo's floor plan, and count overlaps there."""
    from cspace.lanes import RouteGraph, audit

    workspace = Workspace.open(folder / "flat.geojson", spacing=0.05)
    build(workspace, Robot.rectangle(0.7, 0.5), counts=True)
    lanes = RouteGraph.from_arrays([(3.5, 2.2), (6.0, 2.2), (10.4, 5.15)], [(0, 1), (1, 2)])
    return audit(map_flat(folder, 72), lanes)


JOBS: Final[dict[str, Callable[[Path], object]]] = {
    "plan in the plane": plan_in_plane,
    "plan with a yaw": plan_with_yaw,
    "plan with a differential drive": partial(plan_with_yaw, drive=_DIFFERENTIAL),
    "plan around a crate": plan_around_crate,
    "plan for a car": partial(plan_with_yaw, drive=_CAR),
    "plan for a car in a tight place": partial(plan_with_yaw, tight=True, drive=_CAR),
    "plan in space": plan_in_space,
    "queries and updates": query_maps,
    "trajectories and gates": time_drives,
    "lanes and overlaps": audit_lanes,
    "plan for an arm": plan_for_arm,
    "motions of an arm": move_arm,
}
"""Jobs by name; each takes the folder in which :func:`cspace._cli.demo.write_inputs` wrote."""
