"""The outer map of a robot that turns, against a loop of convolutions, the bare transforms, and stamping."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites import turning_planning
from benchmarks.suites.stamping import border_cells, stamp
from benchmarks.suites.ways import convolved
from benchmarks.timing import Timing, interleave
from cspace import Robot, Workspace
from cspace.raster.raster import Raster
from cspace.rotations import Rotations
from cspace.threads import cores

Bools = NDArray[np.bool_]

ROOT = Path(__file__).resolve().parents[2]

SIZE = 1024
ROTATIONS = 72
LENGTH, WIDTH = 33, 21
"""Cells of the map and of the robot for which the targets are meant."""

REAL = {"maps/depot.yaml": (18, 12), "maps/100by100_10.yaml": (18, 12), "movingai/Berlin_1_1024.map": (LENGTH, WIDTH)}
"""Real maps, and how long and wide the robot is there, in cells; on the first two 0.9 m x 0.6 m."""


def run(report: Report, seed: int) -> None:
    """Time, memory, stamping on real maps, and planning."""
    rng = np.random.default_rng(seed)
    size, rotations, runs = (256, 12, 2) if report.quick else (SIZE, ROTATIONS, 5)
    for name, robot in (("rectangle", rectangle()), ("without symmetry", asymmetric())):
        _against_transforms(report, name, inputs.boxes(size, 0.06, rng), robot, rotations, runs)
    _memory(report, size, rotations)
    _stamping(
        report, "boxes", Workspace.from_array(inputs.boxes(size, 0.06, rng), 1.0), (LENGTH, WIDTH), rotations, runs
    )
    for name, across in REAL.items():
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(inputs.NO_DATA)
            break
        _stamping(report, name, workspace, across, rotations, min(runs, 3))
    turning_planning.run(report, seed)


def rectangle(length: float = LENGTH, width: float = WIDTH) -> Robot:
    """A robot that a half turn maps to itself, so that half of its slices are stored."""
    return Robot.rectangle(length, width)


def asymmetric(length: float = LENGTH, width: float = WIDTH) -> Robot:
    """The rectangle with a small piece cut off one corner: no turn maps it to itself."""
    a, b, cut = length / 2, width / 2, min(length, width) / 20
    return Robot.polygon([(-a, -b), (a, -b), (a, b - cut), (a - cut, b), (-a, b)])


def _against_transforms(report: Report, name: str, occupied: Bools, robot: Robot, rotations: int, runs: int) -> None:
    """Ours against a loop of convolutions over bitmaps made beforehand, and against bare inverse transforms."""
    from scipy import fft, signal

    judged = occupied.shape == (SIZE, SIZE)
    workspace = Workspace.from_array(occupied, 1.0)
    rasters = rasters_of(robot, 1.0, rotations)
    stored = len(cspace.build(workspace, robot, rotations=rotations, inner=False).stack)
    length = fft.next_fast_len(len(occupied) + max(robot.rasters(1.0)[0].cells.shape) - 1, real=True)
    report.section(
        f"{name}: {len(occupied)} x {len(occupied)} cells x {rotations} yaw cells ({stored} slices stored), "
        f"{occupied.mean():.1%} occupied, robot {LENGTH} x {WIDTH} cells; bare transforms {length} x {length}"
    )
    map64, kernels = occupied.astype(np.float64), [raster.cells[::-1, ::-1].astype(np.float64) for raster in rasters]
    spectrum = np.ones((length, length // 2 + 1), np.complex64)

    def convolutions(workers: int) -> list[Bools]:
        with fft.set_workers(workers):
            return [
                convolved(signal.fftconvolve, map64, kernel, raster)
                for kernel, raster in zip(kernels, rasters, strict=True)
            ]

    def inverses(workers: int) -> None:
        for _ in range(rotations):
            fft.irfft2(spectrum, s=(length, length), workers=workers)

    options: dict[str, Any] = {"rotations": rotations, "outside": "free"}
    calls: dict[str, Callable[[], Any]] = {}
    for workers in sorted({1, min(2, cores())}):
        many = f", {workers} workers"
        calls[f"ours{many}"] = partial(cspace.build, workspace, robot, inner=False, workers=workers, **options)
        calls[f"loop of fftconvolve float64{many}"] = partial(convolutions, workers)
        calls[f"{rotations} bare float32 inverse transforms{many}"] = partial(inverses, workers)
    most = f"{max(sorted({1, min(2, cores())}))} workers"
    calls[f"ours with BLOCKED cells, {most}"] = partial(cspace.build, workspace, robot, **options)
    timings = interleave(calls, runs)
    for call, timing in timings.items():
        report.timing(call, timing)
    ours = timings[f"ours, {most}"]
    peer, floor = "loop of fftconvolve float64", f"{rotations} bare float32 inverse transforms"
    least, highest = (10.0, 2.0) if judged else (None, None)
    report.ratio(f"{peer}, its default of 1 worker / ours, {most}", timings[f"{peer}, 1 workers"], ours, least=least)
    report.ratio(f"{peer} / ours, {most} each", timings[f"{peer}, {most}"], ours)
    report.ratio(f"{peer} / ours, 1 worker each", timings[f"{peer}, 1 workers"], timings["ours, 1 workers"])
    report.ratio(f"ours / {floor}, {most} each", ours, timings[f"{floor}, {most}"], most=highest)
    wanted = np.stack(timings[f"{peer}, 1 workers"].value)
    for call in calls:
        if call.startswith("ours"):
            found = timings[call].value.state != cspace.FREE
            report.check(bool((found == wanted).all()), f"{call}: equal to fftconvolve, cell for cell")


def _memory(report: Report, size: int, rotations: int) -> None:
    """Peak memory of one build, each in a process of its own."""
    report.section(f"memory: {size} x {size} cells x {rotations} yaw cells, {cores()} workers")
    for name in ("rectangle", "asymmetric"):
        code = f"from benchmarks.suites.turning import rise; print(*rise({name!r}, {size}, {rotations}))"
        path = os.pathsep.join(filter(None, [str(ROOT), os.environ.get("PYTHONPATH")]))
        done = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            check=True,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": path},
        )
        risen, stored = map(float, done.stdout.split())
        judged = 3.0 if size == SIZE else None
        if risen < 0.0:
            report.note("memory skipped: the system does not tell a process's peak in /proc/self/status")
            return
        report.figure(f"{name}: stored result", stored / 2**20, "MB")
        report.figure(f"{name}: rise of peak resident memory / stored result", risen / stored, most=judged)


def rise(name: str, size: int, rotations: int) -> tuple[float, float]:
    """Bytes by which a build raises this process's peak, and bytes that its result stores; the first -1 if unknown."""
    workspace = Workspace.from_array(inputs.boxes(size, 0.06, np.random.default_rng(0)), 1.0)
    robot = {"rectangle": rectangle, "asymmetric": asymmetric}[name]()
    small = Workspace.from_array(np.eye(60, dtype=np.bool_), 1.0)
    cspace.build(small, robot, rotations=rotations, inner=False)  # loads and compiles what a build takes
    status = Path("/proc/self/status")
    if not status.is_file():
        return -1.0, 1.0
    before = _kilobytes(status, "VmRSS")
    space = cspace.build(workspace, robot, rotations=rotations, inner=False)
    return 1024.0 * (_kilobytes(status, "VmHWM") - before), float(space.stack.nbytes)


def _kilobytes(status: Path, name: str) -> float:
    return next(float(line.split()[1]) for line in status.read_text().splitlines() if line.startswith(name))


def _stamping(
    report: Report, name: str, workspace: Workspace, across: tuple[int, int], rotations: int, runs: int
) -> None:
    """Ours against compiled stamping, on robots without symmetry; neither has a say in how the bitmaps are made."""
    spacing = workspace.grid.spacing
    robot = asymmetric(across[0] * spacing, across[1] * spacing)
    rasters = rasters_of(robot, spacing, rotations)
    border = len(border_cells(workspace.outer))
    report.section(
        f"stamping, {name}: {' x '.join(map(str, workspace.grid.shape))} cells x {rotations} yaw cells, "
        f"{workspace.outer.mean():.1%} occupied, {border} obstacle cells on a border; robot {across[0]} x {across[1]} "
        f"cells, {cores()} workers each"
    )
    build = partial(cspace.build, workspace, robot, rotations=rotations, outside="free")
    timings = interleave(
        {
            "ours": partial(build, inner=False),
            "ours with BLOCKED cells": build,
            "stamping, compiled, bitmaps made beforehand": partial(stamp, workspace.outer, rasters),
        },
        runs,
    )
    for call, timing in timings.items():
        report.timing(call, timing)
    peer: Timing = timings["stamping, compiled, bitmaps made beforehand"]
    report.ratio("stamping / ours", peer, timings["ours"])
    stack = timings["ours"].value.stack != cspace.FREE
    equal = all((ours == hits).all() for ours, hits in zip(stack, peer.value, strict=True))
    report.check(equal, "stamping: equal to ours, cell for cell")


def rasters_of(robot: Robot, spacing: float, rotations: int) -> list[Raster]:
    """Outer raster of each yaw cell."""
    cells = Rotations.of(rotations)
    turned = zip(cells.representatives.tolist(), cells.covering_angles.tolist(), strict=True)
    return [robot.rasters(spacing, yaw=yaw, sweep=sweep)[0] for yaw, sweep in turned]
