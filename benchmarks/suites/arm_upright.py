"""Plans of arms that carry an upright tool between shelves, checked by pinocchio and coal."""

from __future__ import annotations

import math
import statistics
import time
import warnings
from typing import NamedTuple

import numpy as np

import planners
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.arm_peers import Folder, Meshes, Solid, coal_solids, our_solids
from cspace import PoseGoal, build_arm_space
from cspace._support.arrays import Floats
from cspace.arms import ArmSpace
from cspace.errors import ConfigurationError
from planners import Plan, Upright

PROBLEMS_PER_ARM = 20
"""Number of problems of each arm."""

TOLERANCE = 0.1
"""Largest tilt of the tool, radians."""

UPRIGHT_SECONDS = 5.0
"""Time limit of a plan, seconds."""

MAX_ACCELERATION = 2.0
"""Largest acceleration of the joints, rad/s^2."""

INSTANTS = 5000
"""Instants of a trajectory that are checked."""

MIN_SOLVED, MAX_MEDIAN_SECONDS = 38, 0.5
"""Targets: problems solved of 40, and the median CPU time of a plan, seconds."""

MAX_DRAWS = 1000
"""Scenes and poses drawn for a problem before it counts as impossible."""

BOARD = 0.02
"""Thickness of the boards of a shelf, metres."""


class Carrier(NamedTuple):
    """An arm that carries a tool.

    Attributes
    ----------
    frame : str
        Its z axis points at the shelf.
    up : int
        Axis of the frame that points up.
    reach : float
        Metres from the frame to the end of the gripper.
    distance : float
        Metres from the base to the fronts of the shelves.
    height : float
        Metres from the base to the middle of the shelves.
    """

    frame: str
    up: int
    reach: float
    distance: float
    height: float


CARRIERS = {
    "panda": Carrier("panda_hand", 0, 0.1, 0.5, 0.4),
    "ur5": Carrier("tool0", 1, 0.15, 0.55, 1.0),
}
"""Arms of the data folder."""


class UprightProblem(NamedTuple):
    """A start, a goal and obstacles."""

    space: ArmSpace
    solids: list[Solid]
    start: Floats
    goal: PoseGoal
    keep: Upright


def run_upright(report: Report, seed: int) -> None:
    """Plan between shelves with each arm, and check trajectories in small steps."""
    folder = inputs.data_folder()
    if folder is None or not (folder / "arms").is_dir() or not report.has("pinocchio"):
        report.note(inputs.NO_DATA)
        return
    count = 2 if report.quick else PROBLEMS_PER_ARM
    seconds: list[float] = []
    first_seconds: list[float] = []
    solved = 0
    report.section(
        f"{count} problems between shelves of each arm, a tool tilted by {TOLERANCE} rad"
    )
    for name, carrier in CARRIERS.items():
        files = Folder(folder / "arms" / name)
        rng = np.random.default_rng(seed)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # open meshes
            problems = [draw_problem(files, carrier, rng) for _ in range(count)]
        _solve(problems[0], True)  # compiles
        for number, problem in enumerate(problems):
            first_seconds.append(_solve(problem, False)[1])
            plan, plan_seconds = _solve(problem, True)
            seconds.append(plan_seconds)
            solved += plan.certified
            if plan.certified:
                _check(report, f"{name} {number}", files, problem, plan)
            else:
                report.note(f"{name} {number}: {plan.status}")
    total = len(seconds)
    report.figure("problems solved", solved, "", least=MIN_SOLVED * total / 40)
    report.figure(
        "median CPU time of a plan", statistics.median(seconds), "s", most=MAX_MEDIAN_SECONDS
    )
    report.figure("largest CPU time of a plan", max(seconds), "s")
    report.figure("median CPU time of a first path", statistics.median(first_seconds), "s")


def _solve(problem: UprightProblem, simplify: bool) -> tuple[Plan, float]:
    """Plan, and return the CPU seconds that it took with the configurations at the goal."""
    began = time.process_time()
    plan = planners.plan(
        problem.space,
        problem.start,
        problem.goal,
        keep=problem.keep,
        time_limit=UPRIGHT_SECONDS,
        planner=planners.Search(simplify=simplify),
        seed=1,
    )
    return plan, time.process_time() - began


def draw_problem(files: Folder, carrier: Carrier, rng: np.random.Generator) -> UprightProblem:
    """Draw two shelves, and poses of the tool in a bay of each, that some configuration reaches."""
    axis = tuple(np.eye(3)[carrier.up].tolist())
    keep = Upright(carrier.frame, axis, tolerance=TOLERANCE)
    for _ in range(MAX_DRAWS):
        azimuth = rng.uniform(-1.5, -0.3)
        azimuths = azimuth, azimuth + rng.uniform(1.0, 1.6)
        solids: list[Solid] = []
        poses: list[Floats] = []
        for number, angle in enumerate(azimuths):
            spacing = rng.uniform(0.27, 0.33)
            heights = carrier.height + spacing * (np.arange(4) - 1.5) + rng.uniform(-0.1, 0.1)
            solids += _make_shelf(f"shelf {number}", angle, carrier.distance, heights)
            bay = int(rng.integers(3))
            height = heights[bay] + rng.uniform(0.4, 0.6) * spacing
            side = rng.uniform(-0.12, 0.12)
            poses.append(_make_pose(carrier, angle, side, height))
        space = build_arm_space(our_solids(solids), files.arm)
        goals = [PoseGoal(carrier.frame, pose, (1e-3, 0.01)) for pose in poses]
        try:
            kept = space.keep([keep])
            near = tuple(kept.sample_free(rng=rng).tolist())
            start = kept.find_goals(goals[0], near, seed=0)[0]
            kept.find_goals(goals[1], start, seed=0)
        except ConfigurationError:
            continue
        return UprightProblem(space, solids, np.array(start), goals[1], keep)
    raise RuntimeError("no problem is possible")


def _make_shelf(name: str, angle: float, distance: float, heights: Floats) -> list[Solid]:
    """Make a shelf with boards at several heights, open towards the base."""
    turn = np.eye(4)
    turn[:2, :2] = (math.cos(angle), -math.sin(angle)), (math.sin(angle), math.cos(angle))
    low, high = heights[[0, -1]].tolist()
    middle, height = 0.5 * (low + high), high - low
    depth, width = 0.3, 0.5
    parts = [((distance + 0.5 * depth, 0.0, each), (depth, width, BOARD)) for each in heights]
    parts += [
        ((distance + 0.5 * depth, side * 0.5 * width, middle), (depth, BOARD, height))
        for side in (-1.0, 1.0)
    ]
    parts.append(((distance + depth, 0.0, middle), (BOARD, width, height)))
    solids: list[Solid] = []
    for number, (center, sides) in enumerate(parts):
        pose = np.eye(4)
        pose[:3, 3] = center
        solids.append((f"{name}.{number}", "box", turn @ pose, sides))
    return solids


def _make_pose(carrier: Carrier, angle: float, side: float, height: float) -> Floats:
    """Make a pose of the frame before a bay, with the end of the gripper 8 cm inside."""
    forward = np.array([math.cos(angle), math.sin(angle), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    across = np.cross(up, forward)
    pose = np.eye(4)
    pose[:3, 2] = forward
    pose[:3, carrier.up] = up
    other = 1 - carrier.up
    pose[:3, other] = np.cross(pose[:3, 1], forward) if other == 0 else np.cross(forward, up)
    pose[:3, 3] = (carrier.distance + 0.08 - carrier.reach) * forward + side * across + height * up
    return pose


def _check(report: Report, name: str, files: Folder, problem: UprightProblem, plan: Plan) -> None:
    """Check the trajectory of a plan in small steps."""
    trajectory = plan.trajectory(max_acceleration=MAX_ACCELERATION)
    instants = np.linspace(0.0, trajectory.duration, INSTANTS // (10 if report.quick else 1))
    rows = trajectory.sample(instants)[0]
    meshes = Meshes(files.urdf, files.arm.joints, coal_solids(problem.solids), files.srdf)
    axes = np.array([meshes.rotation(q, problem.keep.frame) for q in rows]) @ problem.keep.axis
    tilts = np.arctan2(np.linalg.norm(axes[:, :2], axis=1), axes[:, 2])
    report.check(
        trajectory.certified and float(tilts.max()) <= TOLERANCE,
        f"{name}: {trajectory.duration:.1f} s, tilted by at most {tilts.max():.4f} rad",
    )
    report.check(not any(map(meshes.is_wrong, rows)), f"{name}: free at {len(rows)} instants")
