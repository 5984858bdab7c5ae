"""Thickness of the MIXED band, in cells.

* *depth*: the largest chessboard distance of a MIXED cell from a BLOCKED one.
* *width*: the largest number of MIXED cells in a row, for each cell in its narrowest direction
  (axes and diagonals). It is measured around a single box, because no two bands merge there; the
  depth is measured on all maps.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import shapely
from scipy import ndimage

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from cspace import BLOCKED, MIXED, Robot, Workspace
from cspace.support.arrays import Floats, States
from tests.soak.scenes import Rng

MAX_BAND = 3
"""Maximum depth and width of the band, in cells."""

ROBOTS: dict[str, Callable[[Floats, Rng], Robot]] = {
    "disc": lambda sides, rng: Robot.disc(sides[0] / 2, rng.choice([0.0, 0.5], 2)),
    "rectangle": lambda sides, rng: Robot.rectangle(sides[0], sides[1], rng.choice([0.0, 0.5], 2)),
    "polygon": lambda sides, rng: Robot.polygon(
        shapely.MultiPoint(sides * rng.normal(size=(12, 2)) / 2).convex_hull
    ),
}


def check(report: Report, seed: int, number: int) -> None:
    """Measure random grids with convex robots, and a real map."""
    rng = np.random.default_rng([seed, 2])
    for kind, make in ROBOTS.items():
        depth = width = 0
        for turn in range(number):
            sides = 4.0 * 10.0 ** rng.random(2)
            robot = make(sides if turn % 3 else np.round(sides), rng)
            cells = rng.random((80, 80)) < 0.01
            if turn % 2:
                cells = np.ones(rng.integers(1, 12, 2), dtype=np.bool_)
            occupied = np.pad(cells, int(2.0 * sides.max()) + 3)
            workspace = Workspace.from_array(occupied, 1.0)
            states = cspace.build(workspace, robot, outside="free").cell_states
            depth = max(depth, measure_depth(states))
            width = max(width, measure_width(states)) if turn % 2 else width
        report.section(f"MIXED band: {number} random grids, {kind}")
        _check_at_most(report, "depth", depth)
        _check_at_most(report, "width around a box", width)
    workspace = inputs.real_map("maps/depot.yaml")
    if workspace is not None:
        space = cspace.build(workspace, Robot.disc(6.0 * workspace.grid.spacing))
        _check_at_most(report, "depth in depot", measure_depth(space.cell_states))


def _check_at_most(report: Report, name: str, cells: int) -> None:
    report.check(cells <= MAX_BAND, f"{name}: {cells} cells (at most {MAX_BAND})")


def measure_depth(states: States) -> int:
    """Return the largest chessboard distance from MIXED to BLOCKED."""
    if not (states == BLOCKED).any():
        return 0
    apart = ndimage.distance_transform_cdt(states != BLOCKED, metric="chessboard")
    return int(apart[states == MIXED].max(initial=0))


def measure_width(states: States) -> int:
    """Return the width of the band."""
    mixed, width = states == MIXED, 0
    left = mixed
    while left.any():
        width += 1
        line, diagonal = np.ones((1, width + 1)), np.eye(width + 1)
        lines = (line, line.T, diagonal, diagonal[::-1])
        left = np.logical_and.reduce([ndimage.binary_opening(mixed, each) for each in lines])
    return width
