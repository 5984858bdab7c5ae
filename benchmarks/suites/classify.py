"""Ten million look-ups against the same look-up written in numpy."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.timing import interleave, one_core
from cspace import BLOCKED, CSpace, Robot, Workspace
from cspace.arrays import Floats
from cspace.threads import cores


def run(report: Report, seed: int) -> None:
    """Random configurations, a tenth of them outside the map, on maps that fit and do not fit a core's cache."""
    rng = np.random.default_rng(seed)
    number, runs = (10**6, 3) if report.quick else (10**7, 7)
    for size in (512, 1024) if report.quick else (1024, 4096):
        space = cspace.build(Workspace.from_array(inputs.boxes(size, 0.06, rng), 0.05), Robot.disc(0.3))
        points = rng.uniform(-0.025, 1.025, (number, 2)) * space.grid.upper
        report.section(f"{number:.0e} random configurations, map of {size} x {size} cells, {cores()} workers")
        calls = {
            "ours": partial(space.classify, points),
            "numpy": partial(_by_rows, space, points),
            "numpy, a column at a time": partial(_by_columns, space, points),
        }
        timings = interleave(calls, runs)
        with one_core() as alone:
            if alone:
                timings |= interleave({"ours, on one core": calls["ours"]}, runs)
        for name, timing in timings.items():
            report.timing(name, timing)
        for name, least in (("numpy", 8.0), ("numpy, a column at a time", 4.0)):
            report.ratio(f"{name} / ours", timings[name], timings["ours"], least=least)
            if alone:
                report.ratio(f"{name} / ours, on one core", timings[name], timings["ours, on one core"])
            report.check(bool((timings[name].value == timings["ours"].value).all()), f"{name}: equal to ours")


def _by_rows(space: CSpace, points: Floats) -> NDArray[np.uint8]:
    """The look-up as most people would write it: floor, bounds check, fancy index."""
    cells = np.floor((points - space.grid.lower) / space.grid.spacing).astype(np.int64)
    inside = ((cells >= 0) & (cells < space.grid.shape)).all(axis=-1)
    states = np.full(len(points), BLOCKED, dtype=np.uint8)
    states[inside] = space.state[cells[inside, 0], cells[inside, 1]]
    return states


def _by_columns(space: CSpace, points: Floats) -> NDArray[np.uint8]:
    """The same with contiguous temporaries and no masked copies, which is quicker."""
    (lower_x, lower_y), spacing, (nx, ny) = space.grid.lower, space.grid.spacing, space.grid.shape
    x = np.floor((points[:, 0] - lower_x) / spacing).astype(np.int64)
    y = np.floor((points[:, 1] - lower_y) / spacing).astype(np.int64)
    inside = (x >= 0) & (x < nx) & (y >= 0) & (y < ny)
    return np.where(inside, space.state[np.where(inside, x, 0), np.where(inside, y, 0)], np.uint8(BLOCKED))
