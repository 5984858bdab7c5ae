"""The C++ header on a saved map: times of look-ups and motions, and answers equal to Python's."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path

import numpy as np

import cspace
from benchmarks.report import Report
from benchmarks.suites.lookups import EDGE_CELLS, edges_inside
from benchmarks.timing import interleave
from cspace import Robot, Workspace
from tests.helpers.cpp import build_program, count_differences, why_no_compiler

SHAPE = (600, 400)
"""Cells of the map."""

TARGETS_NS = {"state at random": 100.0, "state in cache": 20.0, "motion of 50 cells": 300.0}
"""Largest CPU times in the plane, nanoseconds."""


def run(report: Report, seed: int) -> None:
    """Time states and motions in the plane and in SE(2), beside Python's batches."""
    if why_no_compiler():
        report.note(f"skipped: {why_no_compiler()}")
        return
    rng = np.random.default_rng(seed)
    number = 20_000 if report.quick else 400_000
    workspace = Workspace.from_array(rng.random(SHAPE) < 0.0005, 0.05)
    robot = Robot.polygon([(0.0, 0.0), (0.4, 0.0), (0.0, 0.2)])
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        program = build_program(folder / "program", "-O2")
        for rotations in (None, 72):
            space = cspace.build(workspace, robot, rotations=rotations)
            report.section(f"{space}, {number} motions of {EDGE_CELLS:.0f} cells")
            path = folder / f"map{rotations or ''}"
            space.save(path, compress=False)
            starts, ends = edges_inside(space, number, EDGE_CELLS, rng)
            queries = np.hstack([starts, ends])
            found = count_differences(space, program, path, queries)
            found.pop("motions that are free")
            report.check(not any(found.values()), f"answers equal Python's: {found}")
            (folder / "queries").write_bytes(queries.tobytes())
            command = [str(program), "time", str(path), str(folder / "queries")]
            done = subprocess.run(command, text=True, capture_output=True, check=True)
            times = done.stdout.split()[:3]
            for (what, most), nanoseconds in zip(TARGETS_NS.items(), times, strict=True):
                target = None if rotations else most
                report.figure(f"C++, {what}", float(nanoseconds), "ns", most=target)
            batch = interleave(
                {"Python": lambda s=space, a=starts, b=ends: s.motion_is_free(a, b)}, 3
            )
            cpu = batch["Python"].median_cpu
            report.figure("Python, motion in a batch", 1e9 * cpu / number, "ns")
        time_gate(report, program, path, space, rng)


def time_gate(
    report: Report, program: Path, path: Path, space: cspace.CSpace, rng: np.random.Generator
) -> None:
    """Time the cycles of a gate that leaves, in the map of a robot with yaw."""
    number = 200 if report.quick else 2000
    rows = np.zeros((number, 7))
    rows[:, :3] = space.sample_free(number, rng) + rng.normal(0.0, 0.05, (number, 3))
    rows[:, 3:] = rng.normal((0.4, 0.0, 0.0, 0.0), (0.3, 0.5, 0.01, 0.01), (number, 4))
    (path.parent / "rows").write_bytes(rows.tobytes())
    numbers = map(str, (0.05, 1.0, 2.0, 0.02, 0.02, 0.02, 0.02))
    robot = "0 0 0 0.4 0 0 0.2"
    command = [str(program), "cycles", str(path), str(path.parent / "rows"), robot, *numbers]
    done = subprocess.run(command, text=True, capture_output=True, check=True)
    alone, seeing = map(float, done.stdout.split())
    report.section(f"{number} cycles of a gate that leaves")
    report.figure("C++, a cycle", 1e-3 * alone, "ms", most=1.0)
    report.figure("C++, a cycle with 360 points", 1e-3 * seeing, "ms", most=4.0)
