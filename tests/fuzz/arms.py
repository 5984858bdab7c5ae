"""Proofs of arms, against pinocchio and coal.

They include the arms of the data folder in their planning problems, near starts and goals, and
small random arms with all kinds of joints and solids.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.arm_peers import ArmProblem, Folder, Meshes, coal_solids, our_solids
from cspace import Arm, build_arm_space
from cspace._support.arrays import Bools, Floats
from cspace.arms import ArmSpace
from cspace.errors import ConfigurationError
from tests.fuzz.tally import Tally, draw_until
from tests.helpers.arm_oracle import sample_configurations
from tests.helpers.scenes import Rng
from tests.helpers.urdfs import collision, joint, link, write_urdf

REAL_ARMS = ("panda", "ur5")

CONFIGURATIONS_PER_SCENE = 200
"""Configurations drawn per scene."""

MAX_MOTIONS_PER_SCENE = 20
"""Maximum number of motions followed per scene."""

POINTS_PER_MOTION = 25
"""Points checked per motion."""

STEP_SIZES = (0.03, 0.1, 0.3, 1.0)
"""Standard deviations of random steps, in radians or metres."""


@dataclass(frozen=True)
class Scene:
    """An arm among obstacles, here and in coal."""

    name: str
    space: ArmSpace
    meshes: Meshes
    about: Floats


def check(report: Report, seed: int, points: int, motions: int) -> None:
    """Check random scenes of each kind of arm."""
    if not report.has("pinocchio", "arms skipped"):
        return
    folder = inputs.data_folder()
    kinds: dict[str, Callable[[int, int], Scene]] = {"small arms": draw_small_arm}
    for robot in REAL_ARMS:
        if folder is not None and (folder / "arms" / robot).is_dir():
            kinds[robot] = partial(draw_problem, list(Folder(folder / "arms" / robot).problems(40)))
        else:
            report.note(f"{robot} skipped: {inputs.NO_DATA}")
    for name, draw in kinds.items():

        def check_case(tally: Tally, number: int, draw: Any = draw) -> None:
            with suppress(ConfigurationError):  # something touches a link at every configuration
                _check(tally, draw(seed, number), np.random.default_rng([seed, number, 8]))

        def enough(tally: Tally) -> bool:
            drawn = tally.checks["FREE"] + tally.checks["not FREE"]
            wanted = motions * POINTS_PER_MOTION // len(kinds)
            return drawn >= points // len(kinds) and tally.checks["motion"] >= wanted

        draw_until(report, name, seed, enough, check_case)


def _check(tally: Tally, scene: Scene, rng: Rng) -> None:
    """Check configurations and motions of one scene.

    No BLOCKED one is false, because coal misses some open meshes that reach into a box, and
    obstacles inside a mesh.
    """
    arm, meshes = scene.space.arm, scene.meshes
    q = scene.about[rng.integers(len(scene.about), size=CONFIGURATIONS_PER_SCENE)]
    q = _draw_near(q, arm, rng)
    is_free = np.asarray(scene.space.is_free(q))
    free, others = q[is_free], q[~is_free]
    tally.add("FREE", scene.name, free, _are_wrong(meshes, free))
    clear = [not meshes.collides(each) for each in others]
    tally.add("not FREE", scene.name, others, np.zeros(len(others), dtype=bool), clear)
    starts = free[:MAX_MOTIONS_PER_SCENE]
    if not len(starts):
        return
    goals = _draw_near(starts, arm, rng)
    proven = np.asarray(scene.space.motion_is_free(starts, goals))
    shares = np.linspace(0.0, 1.0, POINTS_PER_MOTION)[:, np.newaxis, np.newaxis]
    q = (starts + shares * (goals - starts))[:, proven].reshape(-1, arm.dof)
    tally.add("motion", scene.name, q, _are_wrong(meshes, q))


def _are_wrong(meshes: Meshes, q: Floats) -> Bools:
    return np.array([meshes.is_wrong(each) for each in q], dtype=np.bool_)


def _draw_near(q: Floats, arm: Arm, rng: Rng) -> Floats:
    """Draw configurations around others; some differ in one joint."""
    step = rng.choice(STEP_SIZES, (len(q), 1)) * rng.normal(size=q.shape)
    single = rng.random(len(q)) < 0.2
    step[single] *= rng.integers(arm.dof, size=(int(single.sum()), 1)) == np.arange(arm.dof)
    return np.clip(q + step, arm.lower, arm.upper)


def draw_problem(problems: list[ArmProblem], seed: int, number: int) -> Scene:
    """Draw a planning problem of an arm."""
    problem = problems[np.random.default_rng([seed, number, 7]).integers(len(problems))]
    name = f"{problem.folder.robot}, {problem.name} {problem.row['index']}"
    about = np.vstack([problem.start, problem.goals])
    return Scene(name, problem.space(), problem.meshes(), about)


def draw_small_arm(seed: int, number: int) -> Scene:
    """Draw a chain or a tree of links among solids."""
    rng = np.random.default_rng([seed, number, 7])
    with tempfile.TemporaryDirectory() as folder:
        path = _write_arm(Path(folder), rng)
        arm = Arm.from_urdf(path)
        solids = []
        for block in range(rng.integers(1, 6)):
            kind, sizes = _draw_solid(rng)
            pose = np.eye(4)
            pose[:3, :3] = Rotation.random(rng=rng).as_matrix()
            pose[:3, 3] = rng.uniform(-1.0, 1.0, 3)
            solids.append((f"block{block}", kind, pose, sizes))
        allowed = [(link.name, name) for link in arm.links if not link.body for name, *_ in solids]
        space = build_arm_space(our_solids(solids), arm, allowed_collisions=allowed)
        meshes = Meshes(
            path, arm.joints, coal_solids(solids), allowed=frozenset(arm.allowed_collisions)
        )
    about = sample_configurations(arm, rng, 20)
    return Scene(f"draw_small_arm({seed}, {number})", space, meshes, about)


def _draw_solid(rng: Rng) -> tuple[str, tuple[float, ...]]:
    """Draw a kind of solid and its measures."""
    kind = str(rng.choice(["box", "cylinder", "sphere"]))
    count = {"box": 3, "cylinder": 2, "sphere": 1}[kind]
    return kind, tuple(rng.uniform(0.02, 0.4, count).round(3).tolist())


def _write_arm(folder: Path, rng: Rng) -> Path:
    """Write an arm of two to seven joints."""
    parts = [_link("l0", rng)]
    for number in range(int(rng.integers(2, 8))):
        parent = number if rng.random() < 0.8 else rng.integers(number + 1)
        kind = (
            "revolute"
            if number == 0
            else rng.choice(["revolute", "revolute", "prismatic", "continuous", "fixed"])
        )
        limits = {"prismatic": (-0.4, 0.6), "revolute": (-2.5, 2.0)}.get(str(kind))
        axis, at, rpy = rng.normal(size=3), rng.uniform(-0.5, 0.5, 3), rng.uniform(-2.0, 2.0, 3)
        mimics = number and kind == "revolute" and rng.random() < 0.3
        mimic = '<mimic joint="j0" multiplier="-0.5" offset="0.2"/>' if mimics else ""
        axis /= np.linalg.norm(axis)
        parts.append(
            joint(
                f"j{number}",
                f"l{parent}",
                f"l{number + 1}",
                at,
                axis,
                str(kind),
                limits,
                rpy,
                mimic,
            )
        )
        parts.append(_link(f"l{number + 1}", rng))
    return write_urdf(folder, *parts)


def _link(name: str, rng: Rng) -> str:
    """Draw a link of one to three solids."""
    parts = ""
    for _ in range(rng.integers(1, 4)):
        kind, sizes = _draw_solid(rng)
        parts += collision(kind, sizes, rng.uniform(-0.3, 0.3, 3), rng.uniform(-2.0, 2.0, 3))
    return link(name, extra=parts)
