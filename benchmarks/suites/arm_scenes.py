"""Changes of an arm's scene, against building the scene anew."""

from __future__ import annotations

import warnings
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.arm_peers import Folder
from benchmarks.timing import Timing
from cspace import Robot
from cspace._shapes import Balls
from cspace._support.arrays import Floats
from cspace.arms import Arm, ArmSpace, PosedShape, build_arm_space

ARMS = ("panda", "ur5")
"""Arms of the data folder."""

CLOUD_POINTS = 50_000
"""Points of a point cloud."""

POINT_RADIUS = 0.01
"""Radius of a point, metres."""

MAX_BOX_SECONDS = 2e-3
"""Target: largest median CPU time of a change by a box."""

MAX_CLOUD_SECONDS = 0.1
"""Target: largest median CPU time of a replaced point cloud; at 10 Hz."""

COMPARED_CONFIGURATIONS = 200
"""Random configurations at which changed and new scenes are compared."""


def run_scenes(report: Report, seed: int) -> None:
    """Change the scene of each arm, and compare it with new scenes."""
    folder = inputs.data_folder()
    for name in ARMS:
        files = None if folder is None else Folder(folder / "arms" / name)
        if files is None or not files.path.is_dir():
            report.note(f"scenes of {name} skipped: not in the folder of data")
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # open meshes
            _change(report, name, files.arm, np.random.default_rng(seed))


class Change(NamedTuple):
    """A change of a scene, and the new scene that it must equal."""

    name: str
    apply: Callable[[], None]
    build: Callable[[], ArmSpace]


def _change(report: Report, name: str, arm: Arm, rng: np.random.Generator) -> None:
    """Add, remove, attach and replace objects of one arm's scene."""
    report.section(f"{name}: a scene of eight boxes that changes; a change, and a new scene")
    base = {
        f"box {k}": PosedShape(Robot.box((0.1, 0.1, 0.1)).shape, _draw_pose(rng)) for k in range(8)
    }
    space, link, pose = build_arm_space(base, arm), arm.links[-1].name, _draw_pose(rng)
    box, small = Robot.box((0.1, 0.1, 0.2)).shape, Robot.box((0.05, 0.05, 0.05)).shape
    new, clouds = {"new": PosedShape(box, pose)}, deque(_draw_clouds(rng))

    def replace_cloud() -> None:
        clouds.rotate()
        space.add_obstacle("cloud", clouds[0], radius=POINT_RADIUS)

    def build(**more: PosedShape) -> ArmSpace:
        return build_arm_space(base | {"cloud": Balls.of(clouds[0], POINT_RADIUS)} | more, arm)

    def add_box() -> None:
        space.add_obstacle("new", box, pose)

    def remove_box() -> None:
        space.remove_obstacle("new")

    boxes = [
        Change("add a box", add_box, lambda: build_arm_space(base | new, arm)),
        Change("remove a box", remove_box, lambda: build_arm_space(base, arm)),
        Change(
            "attach a box",
            lambda: space.attach("held", small, link),
            lambda: build_arm_space(base, arm.attach("held", small, link)),
        ),
        Change("detach a box", lambda: space.detach("held"), lambda: build_arm_space(base, arm)),
    ]
    _compare(report, space, boxes, 3 if report.quick else 30, MAX_BOX_SECONDS, rng)
    cloud = [Change(f"replace a cloud of {CLOUD_POINTS} points", replace_cloud, build)]
    _compare(report, space, cloud, 2 if report.quick else 10, MAX_CLOUD_SECONDS, rng)
    beside = [
        Change("add a box beside the cloud", add_box, lambda: build(**new)),
        Change("remove a box beside the cloud", remove_box, build),
    ]
    _compare(report, space, beside, 2 if report.quick else 10, MAX_BOX_SECONDS, rng)


def _compare(
    report: Report,
    space: ArmSpace,
    changes: list[Change],
    runs: int,
    most: float,
    rng: np.random.Generator,
) -> None:
    """Time changes and new scenes in turn, and compare their answers."""
    for change in changes:  # compiles, and fills caches
        change.apply()
    timings = [(Timing(None), Timing(None)) for _ in changes]
    equal = True
    for _ in range(runs):
        for change, (changing, building) in zip(changes, timings, strict=True):
            changing.take(change.apply)
            anew = building.take(change.build)
            equal &= _are_equal(space, anew, rng)
    for change, (changing, building) in zip(changes, timings, strict=True):
        report.timing(change.name, changing)
        report.timing(f"{change.name}: a new scene", building)
        report.figure(f"{change.name}, CPU time", changing.median_cpu * 1e3, "ms", most=most * 1e3)
    claim = f"{', '.join(change.name for change in changes)}: the answers are those of new scenes"
    report.check(equal, claim)


def _are_equal(space: ArmSpace, anew: ArmSpace, rng: np.random.Generator) -> bool:
    """Return whether two spaces answer alike at random configurations and motions."""
    lower, upper = anew.arm.lower.clip(-np.pi), anew.arm.upper.clip(None, np.pi)
    points = rng.uniform(lower, upper, (COMPARED_CONFIGURATIONS, len(lower)))
    near = np.clip(points + rng.normal(scale=0.1, size=points.shape), lower, upper)
    return (
        np.array_equal(space.classify(points), anew.classify(points))
        and np.array_equal(space.motion_is_free(points, near), anew.motion_is_free(points, near))
        and space.obstacle_distance(points[0]) == anew.obstacle_distance(points[0])
        and space.closest(points[0])[:3] == anew.closest(points[0])[:3]
    )


def _draw_pose(rng: np.random.Generator) -> Floats:
    """Draw a position before the arm."""
    pose = np.eye(4)
    pose[:3, 3] = rng.uniform((0.5, -0.3, 0.6), (1.1, 0.3, 1.2))
    return pose


def _draw_clouds(rng: np.random.Generator) -> list[Floats]:
    """Draw point clouds, shape (CLOUD_POINTS, 3)."""
    return [rng.uniform((0.6, -1.0, -0.5), (2.6, 1.0, 1.5), (CLOUD_POINTS, 3)) for _ in range(3)]
