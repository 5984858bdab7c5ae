"""The outer map of 256^3 cells and a ball 21 cells across, against other ways to the same booleans; and memory."""

from __future__ import annotations

import math
import time
from functools import partial

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites.map import transforms
from benchmarks.suites.ways import across, binary_dilation, our_map
from benchmarks.timing import Timing, interleave, memory_rise
from cspace import Robot, Workspace

Bools = NDArray[np.bool_]

ACROSS = 21
LARGE = 33
"""Cells that the robots are across."""

LEAST = {"fftconvolve float64": 4.0}
"""How many times slower than ours each peer should be with its default."""

LEAST_DILATION = 300.0
MOST_MEMORY = 8.0
"""GiB."""

ASKED = 2000
"""Cells of the large map that are computed again, one by one."""


def run(report: Report, seed: int) -> None:
    """Measure the memory of a large map; compare on a map of boxes, and with dilation."""
    rng = np.random.default_rng(seed)
    # First, while the process is small: what others have given back could hide what is taken here.
    _memory(report, 128 if report.quick else 512, rng)
    size, runs = (64, 3) if report.quick else (256, 5)
    occupied = inputs.boxes(size, 0.06, rng, dim=3)
    workspace, robot = Workspace.from_array(occupied, 1.0), Robot.ball(ACROSS / 2)
    report.section(f"6 % in boxes, ball {ACROSS} cells across")
    default = transforms(report, workspace, robot, LEAST, runs, judged=not report.quick)
    _dilation(report, occupied, robot, default)


def _dilation(report: Report, occupied: Bools, robot: Robot, default: Timing) -> None:
    """Ours against the morphology that people use for this; once, since it takes minutes."""
    raster = robot.rasters(1.0)[0]
    report.section(f"dilation: {across(occupied)} cells in boxes, ball {ACROSS} cells across")
    peer = Timing(None)
    peer.value = peer.take(partial(binary_dilation, occupied, raster))
    report.timing("scipy.ndimage.binary_dilation", peer)
    report.timing("ours, correlate", default)
    least = None if report.quick else LEAST_DILATION
    report.ratio("scipy.ndimage.binary_dilation / ours", peer, default, least=least)
    report.check(bool((peer.value == default.value).all()), "scipy.ndimage.binary_dilation: equal to ours")
    small = occupied[:32, :32, :32]
    timings = interleave(
        {"ours": partial(our_map, small, raster, None), "peer": partial(binary_dilation, small, raster)}, 3
    )
    report.ratio("the same for 32 x 32 x 32 cells", timings["peer"], timings["ours"])
    report.check(bool((timings["peer"].value == timings["ours"].value).all()), "32 x 32 x 32 cells: equal to ours")


def _memory(report: Report, size: int, rng: np.random.Generator) -> None:
    """Peak memory and time of a large map, both sides of the certificate, workspace included."""
    occupied = inputs.boxes(size, 0.06, rng, dim=3)
    robot = Robot.ball(LARGE / 2)
    report.section(f"{across(occupied)} cells, ball {LARGE} cells across, outer and inner map")
    spaces: list[cspace.CSpace] = []
    taken: list[float] = []

    def build() -> None:
        began = time.perf_counter()
        spaces.append(cspace.build(Workspace.from_array(occupied, 1.0), robot))
        taken.append(time.perf_counter() - began)

    rise = memory_rise(build)
    report.figure("build", taken[0], "s")
    if rise is None:
        report.note("memory not measured: psutil is not installed; pip install psutil")
    else:
        most = None if report.quick else MOST_MEMORY
        report.figure("peak memory, above what there was", rise / 2**30, "GiB", most=most)
    _check_cells(report, occupied, robot, spaces[0], rng)


def _check_cells(report: Report, occupied: Bools, robot: Robot, space: cspace.CSpace, rng: np.random.Generator) -> None:
    """Cells anywhere and next to other states, by looking at all that the robot covers there."""
    state = space.state
    change = np.argwhere(state[1:] != state[:-1])
    cells = np.concatenate([rng.integers(0, state.shape, (ASKED, 3)), change[rng.integers(0, len(change), ASKED)]])
    rasters = robot.rasters(1.0)
    wrong = 0
    for cell in cells:
        meets = [bool(_covered(occupied, cell + raster.lower, raster.cells).any()) for raster in rasters]
        wrong += int(state[tuple(cell)]) != (cspace.BLOCKED if meets[1] else cspace.MIXED if meets[0] else cspace.FREE)
    report.check(not wrong, f"{wrong} of {len(cells)} cells differ from what is computed one by one")


def _covered(occupied: Bools, first: NDArray[np.int64], cells: Bools) -> Bools:
    """Obstacle cells under a raster, where all beyond the map is obstacle."""
    stop = first + cells.shape
    low, high = np.clip(first, 0, occupied.shape), np.clip(stop, 0, occupied.shape)
    there = tuple(slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
    here = tuple(slice(int(a), int(b)) for a, b in zip(low - first, high - first, strict=True))
    inside = cells[here]
    beyond = cells.sum() - inside.sum() if inside.size < math.prod(cells.shape) else 0
    return np.append(occupied[there][inside], bool(beyond))
