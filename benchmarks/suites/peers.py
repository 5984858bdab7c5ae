"""Everything against its peers: the lines that are promised, and cost over sizes of maps and robots."""

from __future__ import annotations

import numpy as np

from benchmarks import inputs
from benchmarks.report import Report
from benchmarks.suites import promises, sweeps
from benchmarks.suites.outer_maps import METHODS, ours, peers
from cspace import Robot, Workspace


def run(report: Report, seed: int) -> None:
    """Warm up, then compare; results must be equal."""
    rng = np.random.default_rng(seed)
    report.has("cv2", "OpenCV's functions are left out")
    _warm_up(rng)
    promises.run(report, rng)
    sweeps.run(report, rng)


def _warm_up(rng: np.random.Generator) -> None:
    """Call every way once, so that none is compiled or loaded while it is timed."""
    for dim, robot in ((2, Robot.disc(3.0)), (3, Robot.ball(3.0))):
        workspace = Workspace.from_array(inputs.boxes(32, 0.06, rng, dim), 1.0)
        raster = robot.rasters(1.0)[0]
        for method in METHODS:
            ours(workspace, robot, method)
        for way in peers(dim):
            way.ready(workspace.outer, raster)()
