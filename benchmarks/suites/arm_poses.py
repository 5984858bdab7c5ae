"""Inverse kinematics of arms: reached poses, and times."""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

import numpy as np

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import Timing
from cspace._support.arrays import Floats
from cspace.arms import Arm
from cspace.errors import ConfigurationError
from tests.helpers.urdfs import pose_of, random_chain

MIN_REACHED_SHARE = 0.99
"""Target share of reachable poses that are reached."""

MAX_POSE_SECONDS = 5e-3
"""Target: largest median time of a pose, seconds."""

POSE_TOLERANCE = 1e-4, 1e-3
"""Largest distance and angle of solutions from a pose, metres and radians."""

DATA_ARMS = {"panda": "panda_hand", "ur5": "tool0"}
"""Arms of the data folder, and their frames."""

EXAMPLE_ARMS = {
    "kinova_description/robots/kinova.urdf": "j2s6s200_link_6",
    "tiago_description/robots/tiago.urdf": "arm_tool_link",
}
"""Robots of the package example-robot-data, and their frames."""

MADE_JOINTS = (6, 7, 8)
"""Joints of the arms that are made at random."""


def run_poses(report: Report, seed: int) -> None:
    """Reach poses of random configurations, then poses that are too far away."""
    count = 100 if report.quick else 1000
    with tempfile.TemporaryDirectory() as folder:
        for name, path, frame in _list_arms(report, Path(folder), seed):
            arm = Arm.from_urdf(path, tip=frame)
            report.section(f"{name}, {arm.dof} joints: {count} poses of random configurations")
            rng = np.random.default_rng(seed)
            poses = [
                pose_of(path, frame, dict(zip(arm.joints, q, strict=True)))
                for q in rng.uniform(*arm._ranges(), (count, arm.dof)).tolist()
            ]
            _reach(report, arm, path, frame, poses, 1)
            _reach(report, arm, path, frame, poses[: count // 10], 16)
            for pose in poses:
                pose[:3, 3] *= 10.0 / np.linalg.norm(pose[:3, 3])
            refused = Timing(None)
            found = [refused.take(partial(_solve, arm, frame, pose, 16)) for pose in poses[:50]]
            report.timing("poses 10 m away, refused", refused)
            report.check(
                not any(each is not None for each in found), "no pose 10 m away is reached"
            )


def _list_arms(report: Report, folder: Path, seed: int) -> Iterator[tuple[str, Path, str]]:
    """Yield names, URDF files without meshes, and frames."""
    data = inputs.data_folder()
    if data is None or not (data / "arms").is_dir():
        report.note(inputs.NO_DATA)
    else:
        for name, frame in DATA_ARMS.items():
            yield name, _without_geometry(data / "arms" / name / f"{name}.urdf", folder), frame
    try:
        robots = Path(
            str(
                distribution("example-robot-data").locate_file(
                    "cmeel.prefix/share/example-robot-data/robots"
                )
            )
        )
    except PackageNotFoundError:
        report.note("more robots skipped: pip install example-robot-data")
    else:
        for name, frame in EXAMPLE_ARMS.items():
            yield Path(name).stem, _without_geometry(robots / name, folder), frame
    for joints in MADE_JOINTS:
        yield f"random {joints}", random_chain(folder, seed + joints, joints), "tool0"


def _without_geometry(path: Path, folder: Path) -> Path:
    """Write a copy of a URDF with one box instead of its meshes, because inverse kinematics needs
    none."""
    tree = ET.parse(path)
    links = list(tree.iter("link"))
    for link in links:
        for each in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(each)
    links[0].append(
        ET.fromstring('<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>')
    )
    copy = folder / path.name
    tree.write(copy)
    return copy


def _solve(arm: Arm, frame: str, pose: Floats, number: int) -> Floats | None:
    try:
        return arm.inverse(frame, pose, tolerance=POSE_TOLERANCE, max_solutions=number)
    except ConfigurationError:
        return None


def _reach(
    report: Report, arm: Arm, path: Path, frame: str, poses: list[Floats], number: int
) -> None:
    """Report times and the share of poses reached, and check every solution."""
    timing, reached, solutions, right = Timing(None), 0, 0, True
    _solve(arm, frame, poses[0], number)  # compiles and loads
    for pose in poses:
        found = timing.take(partial(_solve, arm, frame, pose, number))
        if found is None:
            continue
        reached, solutions = reached + 1, solutions + len(found)
        for q in found.tolist():
            theirs = pose_of(path, frame, dict(zip(arm.joints, q, strict=True)))
            cosine = 0.5 * (float(np.trace(theirs[:3, :3].T @ pose[:3, :3])) - 1.0)
            right &= bool(np.linalg.norm(theirs[:3, 3] - pose[:3, 3]) <= POSE_TOLERANCE[0] + 1e-9)
            right &= cosine >= np.cos(POSE_TOLERANCE[1]) - 1e-9
        right &= bool(((found >= arm.lower) & (found <= arm.upper)).all())
    name = "one configuration" if number == 1 else f"up to {number} configurations"
    report.timing(name, timing, p99=f"{1e3 * np.quantile(timing.seconds, 0.99):.3g} ms")
    if number > 1:
        report.figure("configurations found for a pose, mean", solutions / max(reached, 1), "")
    else:
        report.figure("share of poses reached", reached / len(poses), "", least=MIN_REACHED_SHARE)
        report.figure(
            "median time of a pose", 1e3 * timing.median, "ms", most=1e3 * MAX_POSE_SECONDS
        )
    report.check(
        right,
        f"all {solutions} configurations are within limits and tolerance, by another computation",
    )
