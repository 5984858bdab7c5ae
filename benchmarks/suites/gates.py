"""Chunks of commands: CPU time of their proofs, and checks of poses at a step beside them."""

from __future__ import annotations

import itertools
import math
import time
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import interleave
from cspace import Robot, Workspace
from cspace._support.arrays import Floats
from cspace.arms import Arm, ArmSpace, PosedShape, build_arm_space

ROLL_OUTS, POSES = 1000, 56
"""Roll-outs of a sampler, and poses of each."""

MAX_BATCH_SECONDS = 0.010
"""Target: CPU time of a batch of roll-outs."""

JOINT_ROWS, BOXES = 50, 13
"""Rows of an arm's chunk, and boxes around the arm."""

MAX_MEDIAN_SECONDS, MAX_SLOW_SECONDS = 0.8e-3, 2e-3
"""Targets: CPU time of an arm's chunk, in the median and at 95 %."""

STEPS = (math.inf, 0.2, 0.1, 0.05)
"""Steps between checked poses, metres; infinite for the rows alone."""

DISC_RADIUS, POST_RADIUS = 0.15, 0.02
"""Sizes of the robot and of thin posts, metres."""


def run(report: Report, seed: int) -> None:
    """Time batches on a map and chunks of an arm, then count chunks that touch between poses."""
    _time_batches(report, seed)
    _time_arm(report, seed)
    _count_missed(report, 100 if report.quick else 1000, seed)


def _time_batches(report: Report, seed: int) -> None:
    """Time roll-outs of a sampler on a map with yaw."""
    report.section(f"{ROLL_OUTS} roll-outs of {POSES} poses, 200 x 200 cells, 72 yaws")
    rng = np.random.default_rng(seed)
    occupied = rng.random((200, 200)) < 0.004
    space = cspace.build(
        Workspace.from_array(occupied, 0.05), Robot.rectangle(0.4, 0.25), rotations=72
    )
    start = space.nearest_free((5.0, 5.0, 0.3))
    speeds = np.clip(0.4 + 0.1 * rng.standard_normal((ROLL_OUTS, POSES)), 0.0, 1.0)
    turns = 0.6 * rng.standard_normal((ROLL_OUTS, 1)) + 0.3 * rng.standard_normal(
        (ROLL_OUTS, POSES)
    )
    twists = np.stack([speeds, turns], axis=-1)
    gate = cspace.Gate(space, dt=0.05)
    rows = gate.check_twists(start, twists).chunk.rows
    path = np.concatenate([np.broadcast_to(start, (ROLL_OUTS, 1, 3)), rows], axis=1)
    calls = {
        "rows": partial(cspace.Gate(space).check_rows, start, rows),
        "rows, tracking 5 cm and 0.05 rad": partial(
            cspace.Gate(space, tracking=0.05).check_rows, start, rows
        ),
        "twists": partial(gate.check_twists, start, twists),
        "all edges, certify_path": partial(space.certify_path, path),
    }
    timings = interleave(calls, 3 if report.quick else 25)
    report.timings(timings)
    report.figure(
        "CPU time of rows", 1e3 * timings["rows"].median_cpu, "ms", most=1e3 * MAX_BATCH_SECONDS
    )


def _time_arm(report: Report, seed: int) -> None:
    """Time chunks of a Panda among boxes."""
    data = inputs.data_folder()
    if data is None or not (data / "arms" / "panda").is_dir():
        report.note(inputs.NO_DATA)
        return
    folder = data / "arms" / "panda"
    report.section(f"panda, {JOINT_ROWS} rows among {BOXES} boxes")
    rng = np.random.default_rng(seed)
    arm = Arm.from_urdf(folder / "panda.urdf", folder / "panda.srdf", package_dirs=folder)
    boxes = {f"box {k}": _draw_box(rng) for k in range(BOXES)}
    space = build_arm_space(boxes, arm)
    chunks = [_draw_chunk(space, rng) for _ in range(20 if report.quick else 300)]
    for tracking in (0.0, 0.01):
        gate = cspace.Gate(space, tracking=tracking)
        gate.check_rows(*chunks[0])
        seconds = []
        proven = 0
        for q, rows in chunks:
            began = time.process_time()
            chunk = gate.check_rows(q, rows).chunk
            seconds.append(time.process_time() - began)
            proven += bool(chunk.is_proven)
        report.note(f"tracking {tracking:g} rad: {proven} of {len(chunks)} chunks are proven")
        median, slow = np.quantile(seconds, [0.5, 0.95])
        name = f"CPU time with tracking {tracking:g} rad"
        report.figure(f"{name}, median", 1e3 * median, "ms", most=1e3 * MAX_MEDIAN_SECONDS)
        report.figure(f"{name}, 95 %", 1e3 * slow, "ms", most=1e3 * MAX_SLOW_SECONDS)


def _draw_box(rng: np.random.Generator) -> PosedShape:
    """Draw a box around the base of an arm."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_rotvec(rng.normal(size=3)).as_matrix()
    angle, radius = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.45, 0.8)
    pose[:3, 3] = radius * math.cos(angle), radius * math.sin(angle), rng.uniform(0.05, 0.9)
    return PosedShape(Robot.box(rng.uniform(0.05, 0.25, 3)).shape, pose)


def _draw_chunk(space: ArmSpace, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draw a configuration and the rows of one second of a noisy policy."""
    q = space.sample_free(rng=rng)
    speeds = rng.normal(0.0, 0.5, space.dof) + rng.normal(0.0, 0.1, (JOINT_ROWS, space.dof))
    rows = q + np.cumsum(0.02 * speeds, axis=0)
    return q, rows.clip(space.arm.lower, space.arm.upper)


def _count_missed(report: Report, wanted: int, seed: int) -> None:
    """Count chunks that touch between free rows, and are let through.

    The oracle is the distance of posts from segments.
    """
    report.section(f"{wanted} chunks of a disc that touch a thin post between two free rows")
    rng = np.random.default_rng(seed)
    posts = rng.uniform(1.0, 9.0, (40, 2))
    space = cspace.build(
        Workspace.from_array(np.zeros((500, 500), dtype=bool), 0.02), Robot.disc(DISC_RADIUS)
    )
    space.add_obstacle("posts", posts, radius=POST_RADIUS)
    let_through = dict.fromkeys(STEPS, 0)
    by_gate = found = free = proven = 0
    while found < wanted:
        start = rng.uniform(1.0, 9.0, 2)
        path = np.vstack([start, start + np.cumsum(rng.normal(0.0, 0.25, (10, 2)), axis=0)])
        if (_measure(path, posts) <= DISC_RADIUS + POST_RADIUS).any():
            continue
        chunk = cspace.Gate(space).check_rows(path[0], path[1:]).chunk
        if (_sweep(path, posts) > DISC_RADIUS + POST_RADIUS).all():
            free += 1
            proven += bool(chunk.is_proven)
            continue
        found += 1
        by_gate += bool(chunk.is_proven)
        for step in STEPS:
            poses = _split(path, step)
            let_through[step] += bool((_measure(poses, posts) > DISC_RADIUS + POST_RADIUS).all())
    for step, count in let_through.items():
        text = "checks of the rows" if step == math.inf else f"checks of poses every {step:g} m"
        report.figure(f"{text} let through", count, "chunks")
    report.figure("the gate lets through", by_gate, "chunks", most=0)
    report.figure("free chunks that the gate proves", 100.0 * proven / max(free, 1), "%")
    report.check(by_gate == 0, "the gate lets no chunk through that touches")


def _measure(points: Floats, posts: Floats) -> Floats:
    """Return the distance of each point from the nearest post, shape (n,)."""
    gaps = np.linalg.norm(points[:, np.newaxis] - posts, axis=-1)
    return np.asarray(gaps.min(axis=1))


def _sweep(path: Floats, posts: Floats) -> Floats:
    """Return the distance of each segment of a path from the nearest post, shape (n - 1,)."""
    steps = np.diff(path, axis=0)[:, np.newaxis]
    offsets = posts - path[:-1, np.newaxis]
    shares = (offsets * steps).sum(axis=-1) / (steps**2).sum(axis=-1)
    nearest = shares.clip(0.0, 1.0)[..., np.newaxis] * steps
    return np.asarray(np.linalg.norm(offsets - nearest, axis=-1).min(axis=1))


def _split(path: Floats, step: float) -> Floats:
    """Return poses along a path, at most a step apart, with its rows."""
    rows = [path[:1]]
    for first, last in itertools.pairwise(path):
        count = max(math.ceil(float(np.linalg.norm(last - first)) / step), 1)
        shares = np.arange(1, count + 1)[:, np.newaxis] / count
        rows.append(first + shares * (last - first))
    return np.concatenate(rows)
