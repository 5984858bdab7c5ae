"""The plugin for Nav2, over stubs, beside the planner of the node in Python, in rooms with crates."""

from __future__ import annotations

import math
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import shapely

import cspace
import planners
from benchmarks.report import Report
from tests.helpers.cpp import why_no_compiler
from tests.helpers.drives import make_drive
from tests.helpers.nav2 import (
    DRIVES,
    WALLS,
    Nav2,
    build_room,
    build_server,
    make_room,
    place_body,
)

TIME_LIMIT_S = 5.0
"""Time limit of a request of either planner, seconds."""

Rng = np.random.Generator
Request = tuple[list[tuple[float, float]], list[float], list[float]]
"""Lower corners of crates of 0.3 m, which the saved map lacks; start and goal."""


def run(report: Report, seed: int) -> None:
    """Plan the same requests with both, for each drive."""
    if why_no_compiler():
        report.note(f"skipped: {why_no_compiler()}")
        return
    robot = cspace.Robot.rectangle(0.6, 0.4)
    requests = draw_requests(np.random.default_rng(seed), 8 if report.quick else 60)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        build_room(robot, 72).save(folder / "map")
        program = build_server(folder / "program", "jazzy", "-O2")
        for drive, radius in {"holonomic": 0.0, **DRIVES}.items():
            report.section(f"{drive}, {len(requests)} requests, time limit {TIME_LIMIT_S:.0f} s")
            nav2 = Nav2(program, folder / "log")
            nav2.configure(
                folder / "map", drive=drive, turning_radius=radius, time_limit=TIME_LIMIT_S
            )
            compare(report, nav2, robot, drive, requests)
            nav2.process.communicate()


def draw_requests(rng: Rng, number: int) -> list[Request]:
    """Draw requests from one side of the wall to the other, whose ends are free."""
    requests: list[Request] = []
    while len(requests) < number:
        crates = [
            tuple(np.round(rng.uniform((0.3, 0.3), (5.4, 3.3)), 1).tolist()) for _ in range(4)
        ]
        start = [*rng.uniform((0.5, 0.5), (2.3, 3.3)).tolist(), rng.uniform(-math.pi, math.pi)]
        goal = [*rng.uniform((3.7, 0.5), (5.5, 3.3)).tolist(), rng.uniform(-math.pi, math.pi)]
        # Away from obstacles by two cells, so that maps prove the ends free.
        bodies = [place_body(pose).buffer(0.2) for pose in (start, goal)]
        if not any(body.intersects(place_obstacles(crates)) for body in bodies):
            requests.append((crates, start, goal))
    return requests


def place_obstacles(crates: list[tuple[float, float]]) -> shapely.Geometry:
    """Return walls and crates."""
    return shapely.union_all([WALLS, *(shapely.box(x, y, x + 0.3, y + 0.3) for x, y in crates)])


def compare(
    report: Report, nav2: Nav2, robot: cspace.Robot, drive: str, requests: list[Request]
) -> None:
    """Report requests solved, poses that touch, lengths where both solve, and CPU time."""
    process = psutil.Process(nav2.process.pid)
    lengths = np.full((2, len(requests)), math.nan)
    seconds = np.zeros(2)
    touches = 0
    for k, (crates, start, goal) in enumerate(requests):
        for x, y in crates:
            nav2.add_cost((x, y), (x + 0.3, y + 0.3))
        before = sum(process.cpu_times()[:2])
        answer = nav2.plan(start, goal)
        seconds[0] += sum(process.cpu_times()[:2]) - before
        for x, y in crates:
            nav2.add_cost((x, y), (x + 0.3, y + 0.3), 0)
        if answer["code"] == 0:
            path = np.array(answer["path"])
            lengths[0, k] = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1).sum()
            obstacles = place_obstacles(crates)
            touches += sum(place_body(pose).intersects(obstacles) for pose in path)
        cells = make_room()
        for x, y in crates:
            i, j = round(10 * x), round(10 * y)
            cells[i : i + 3, j : j + 3] = True
        space = cspace.build(cspace.Workspace.from_array(cells, 0.1), robot, rotations=72)
        options = {"drive": make_drive(drive, DRIVES.get(drive))}
        if k == 0:
            planners.plan(space, start, goal, **options, time_limit=TIME_LIMIT_S)  # compiles
        before = time.process_time()
        plan = planners.plan(space, start, goal, **options, time_limit=TIME_LIMIT_S)
        seconds[1] += time.process_time() - before
        if plan:
            lengths[1, k] = plan.length
    both = np.isfinite(lengths).all(axis=0)
    solved = np.isfinite(lengths).sum(axis=1)
    report.check(touches == 0, f"poses of the plugin that touch: {touches}")
    report.figure("solved by the plugin", float(solved[0]), "")
    report.figure("solved by the node's planner", float(solved[1]), "")
    ratio = lengths[0, both].sum() / lengths[1, both].sum()
    report.figure("length, plugin over node, where both solve", float(ratio), "")
    for name, sum_ in zip(("plugin", "node's planner, map built"), seconds, strict=True):
        report.figure(f"CPU a request, {name}", 1e3 * float(sum_) / len(requests), "ms")
