"""Plans of robots with 8 and 14 joints, whose hands go from place to place on a shelf."""

from __future__ import annotations

import itertools
import tempfile
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from functools import partial
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import Timing
from cspace import Robot
from cspace._support.arrays import Floats
from cspace.arms import Arm, ArmSpace, PosedShape, build_arm_space
from cspace.errors import ConfigurationError
from planners import Search, plan
from tests.helpers.urdfs import joint, link, pose_at, write_urdf

PROBLEMS = 50
"""Problems of each robot."""

MAX_SEARCH_SECONDS = 10.0
"""Time limit of a search, seconds."""

MIN_SOLVED = 0.95
"""Target share of solved problems."""

MAX_MEDIAN_SECONDS = 0.1
"""Target: largest median time of a path, seconds."""

HAND_TOLERANCE = (0.02, np.inf)
"""Distance, metres, and angle of a hand from its place."""

PANDA_MOUNTS = {"left": (0.0, 0.3, 0.0), "right": (0.0, -0.3, 0.0)}
"""Bases of two pandas on a torso, metres."""


class Body(NamedTuple):
    """A robot and where its hands go.

    Attributes
    ----------
    arm : Arm
    hands : mapping of str to (float, float)
        Frame of each hand, and the range of its y on the shelf, metres.
    front : float
        Distance of the shelf's front from the base, metres.
    """

    arm: Arm
    hands: Mapping[str, tuple[float, float]]
    front: float


def run_joints(report: Report, seed: int) -> None:
    """Plan for each robot, and check that all paths are proven."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # open meshes
        for name, body in _make_bodies(report, Path(folder)):
            _plan(report, name, body, seed)


def _make_bodies(report: Report, folder: Path) -> Iterator[tuple[str, Body]]:
    """Yield robots: two that are made here, two pandas on a torso, and Baxter, if their files are
    there."""
    yield (
        "one made arm",
        Body(Arm.from_urdf(_write_arms(folder, ("left",), 8)), {"left_hand": (-0.4, 0.4)}, 0.6),
    )
    both = {"left_hand": (0.1, 0.5), "right_hand": (-0.5, -0.1)}
    yield "two made arms", Body(Arm.from_urdf(_write_arms(folder, ("left", "right"), 7)), both, 0.6)
    data = inputs.data_folder()
    if data is None or not (data / "arms" / "panda").is_dir():
        report.note(inputs.NO_DATA)
    else:
        urdf, srdf = _write_two_pandas(data / "arms" / "panda", folder)
        hands = {
            f"{side}_panda_hand": span
            for side, span in (("left", (0.1, 0.55)), ("right", (-0.55, -0.1)))
        }
        yield (
            "two pandas on a torso",
            Body(Arm.from_urdf(urdf, srdf, package_dirs=data / "arms" / "panda"), hands, 0.5),
        )
    try:
        robots = Path(
            str(
                distribution("example-robot-data").locate_file(
                    "cmeel.prefix/share/example-robot-data/robots"
                )
            )
        )
    except PackageNotFoundError:
        report.note("Baxter skipped: pip install example-robot-data")
    else:
        files = robots / "baxter_description"
        joints = [
            f"{side}_{name}"
            for side in ("left", "right")
            for name in ("s0", "s1", "e0", "e1", "w0", "w1", "w2")
        ]
        paths = files / "urdf" / "baxter.urdf", files / "srdf" / "baxter_manipulation.srdf"
        arm = Arm.from_urdf(*paths, joints=joints, package_dirs=robots)
        yield (
            "Baxter's two arms",
            Body(arm, {"left_gripper": (0.1, 0.55), "right_gripper": (-0.55, -0.1)}, 0.75),
        )


def _write_arms(folder: Path, sides: tuple[str, ...], joints: int) -> Path:
    """Write arms of bars beside a column."""
    bar, axes = ((0.16, 0.07, 0.07), (0.1, 0, 0)), ((0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 1, 0))
    parts = [link("column", ((0.2, 0.3, 1.0), (-0.1, 0, -0.1)))]
    for side in sides:
        parent, at = (
            "column",
            (0.05, {"left": 0.25, "right": -0.25}[side] if len(sides) > 1 else 0.0, 0.4),
        )
        for n in range(joints):
            parts.append(link(f"{side}_{n}", bar))
            limits = (-3.0, 3.0) if n % 2 == 0 else (-1.9, 1.9)
            parts.append(
                joint(f"{side}_joint_{n}", parent, f"{side}_{n}", at, axes[n % 4], limits=limits)
            )
            parent, at = f"{side}_{n}", (0.2, 0.0, 0.0)
        parts += [
            link(f"{side}_hand"),
            joint(f"{side}_mount", parent, f"{side}_hand", at, kind="fixed"),
        ]
    return write_urdf(folder, *parts)


def _write_two_pandas(source: Path, folder: Path) -> tuple[Path, Path]:
    """Write a URDF and an SRDF of two pandas on a torso."""
    robot, semantic = ET.Element("robot", name="torso"), ET.Element("robot", name="torso")
    robot.append(ET.fromstring(link("torso", ((0.2, 0.8, 0.6), (0, 0, -0.31)))))
    for side, place in PANDA_MOUNTS.items():
        for tree, path in ((robot, source / "panda.urdf"), (semantic, source / "panda.srdf")):
            for element in ET.parse(path).getroot():
                if element.tag not in ("link", "joint", "disable_collisions"):
                    continue
                for part in element.iter():
                    for key in ("name", "link", "link1", "link2", "joint"):
                        if key in part.attrib and (key != "name" or part is element):
                            part.set(key, f"{side}_{part.attrib[key]}")
                tree.append(element)
        robot.append(
            ET.fromstring(
                joint(f"{side}_mount", "torso", f"{side}_panda_link0", place, kind="fixed")
            )
        )
    bases = [f"{side}_panda_link0" for side in PANDA_MOUNTS]
    for one, other in itertools.combinations(["torso", *bases], 2):
        ET.SubElement(semantic, "disable_collisions", link1=one, link2=other, reason="fixed")
    urdf, srdf = folder / "pandas.urdf", folder / "pandas.srdf"
    ET.ElementTree(robot).write(urdf)
    ET.ElementTree(semantic).write(srdf)
    return urdf, srdf


def _make_shelf(front: float) -> dict[str, PosedShape]:
    """Make a shelf of three boards, two sides and a partition, with posts on its boards."""
    depth, wide = 0.35, 1.4
    middle = front + 0.5 * depth
    boxes = {
        f"board {k}": ((depth, wide, 0.03), (middle, 0.0, z))
        for k, z in enumerate((0.05, 0.45, 0.85))
    }
    sides = {
        f"side {k}": ((depth, 0.03, 0.8), (middle, y, 0.45)) for k, y in enumerate((-0.7, 0.0, 0.7))
    }
    posts = {
        f"post {k}": ((0.06, 0.06, 0.25), (front + 0.2, y, z))
        for k, (y, z) in enumerate(itertools.product((-0.45, -0.2, 0.2, 0.45), (0.19, 0.59)))
    }
    every = (boxes | sides | posts).items()
    return {
        name: PosedShape(Robot.box(size).shape, pose_at(*place)) for name, (size, place) in every
    }


def _draw_problems(
    space: ArmSpace, body: Body, count: int, rng: np.random.Generator
) -> Iterator[tuple[Floats, Floats]]:
    """Yield free starts and goals with all hands within the shelf, without those that a straight
    motion joins."""
    before: Floats | None = None
    while count:
        q: Floats | None = rng.uniform(*body.arm._ranges())
        for hand, span in body.hands.items():
            height = rng.choice([0.15, 0.55]) + rng.uniform(0.0, 0.2)
            pose = pose_at(body.front + rng.uniform(0.0, 0.1), rng.uniform(*span), height)
            options = {"near": q, "max_solutions": 1, "seed": int(rng.integers(99))}
            try:
                q = body.arm.inverse(hand, pose, tolerance=HAND_TOLERANCE, **options)[0]
            except ConfigurationError:
                q = None
                break
        if q is None or not space.is_free(q):
            continue
        if before is not None and not space.motion_is_free(before, q):
            count -= 1
            yield before, q
        before = q


def _plan(report: Report, name: str, body: Body, seed: int) -> None:
    """Report times and solved problems of a robot."""
    count = 5 if report.quick else PROBLEMS
    report.section(
        f"{name}, {body.arm.dof} joints: {count} problems on a shelf, {MAX_SEARCH_SECONDS:g} s each"
    )
    making = Timing(None)
    space = making.take(partial(build_arm_space, _make_shelf(body.front), body.arm))
    making.forget()
    making.take(partial(build_arm_space, _make_shelf(body.front), body.arm))
    timing, solved, certified = Timing(None), 0, True
    for start, goal in _draw_problems(space, body, count, np.random.default_rng(seed)):
        options = {
            "seed": seed,
            "time_limit": MAX_SEARCH_SECONDS,
            "planner": Search(simplify=False),
        }
        search = partial(plan, space, start, goal, **options)
        if not timing.seconds:
            search()  # compiles and loads
        found = timing.take(search)
        solved += bool(found)
        certified &= bool(space.certify_path(found.waypoints).all())
    report.timing(
        "a first path", timing, solved=f"{solved} of {count}", max=f"{max(timing.seconds):.3g} s"
    )
    report.figure("share of the problems that are solved", solved / count, "", least=MIN_SOLVED)
    report.figure(
        "median CPU time of a path", 1e3 * timing.median_cpu, "ms", most=1e3 * MAX_MEDIAN_SECONDS
    )
    report.timing("a new scene", making)
    report.check(certified, f"all {solved} paths are proven")
