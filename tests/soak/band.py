"""Thickness of the MIXED band, in cells.

* *depth*: the largest chessboard distance of a MIXED cell from a BLOCKED one.
* *width*: the largest number of MIXED cells in a row, for each cell in its narrowest direction
  (axes and diagonals). It is measured around a single box, because no two bands merge there; the
  depth is measured on all maps.
"""

from __future__ import annotations

import numpy as np
from scipy import ndimage

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from cspace import BLOCKED, MIXED, Robot, Workspace
from cspace.support.arrays import Bools, States
from tests.soak.tally import Rng

MAX_BAND = 3
"""Maximum depth and width of the band, in cells."""

CONVEX = ("disc", "rectangle", "regular polygon")
REAL = (
    "maps/depot.yaml",
    "maps/willow-full-0.05.yaml",
    "movingai/Berlin_1_1024.map",
    "movingai/random512-10-0.map",
)


def check(report: Report, seed: int, number: int) -> None:
    """Measure random grids with convex robots, and real maps."""
    rng = np.random.default_rng([seed, 2])
    for kind in CONVEX:
        depth = width = cells = 0
        for turn in range(number):
            robot, across = _draw_robot(rng, kind)
            occupied = np.pad(_draw_cells(rng, turn), int(across) + 3)
            state = cspace.build(
                Workspace.from_array(occupied, 1.0), robot, outside="free"
            ).cell_states
            depth = max(depth, measure_depth(state))
            width = width if turn % 3 else max(width, measure_width(state))
            cells += int((state == MIXED).sum())
        report.section(
            f"MIXED band: {number} random grids, {kind} from 4 to 40 cells across, {cells} MIXED cells"
        )
        _check_depth(report, depth)
        report.check(
            width <= MAX_BAND, f"around a box, the band is {width} cells wide (at most {MAX_BAND})"
        )
    for name in REAL:
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(inputs.NO_DATA)
            return
        state = cspace.build(workspace, Robot.disc(6.0 * workspace.grid.spacing)).cell_states
        report.section(
            f"MIXED band: {name}, disc 12 cells across: {(state == MIXED).mean():.1%} of the map is MIXED"
        )
        _check_depth(report, measure_depth(state))


def _check_depth(report: Report, depth: int) -> None:
    report.check(
        depth <= MAX_BAND,
        f"no MIXED cell is more than {depth} cells from a BLOCKED one (at most {MAX_BAND})",
    )


def measure_depth(state: States) -> int:
    """Return the largest chessboard distance from MIXED to BLOCKED."""
    if not (state == BLOCKED).any():
        return 0
    apart = ndimage.distance_transform_cdt(state != BLOCKED, metric="chessboard")
    return int(apart[state == MIXED].max(initial=0))


def measure_width(state: States) -> int:
    """Return the width of the band."""
    mixed, width = state == MIXED, 0
    left = mixed
    while left.any():
        width += 1
        line = np.ones((1, width + 1), dtype=np.bool_)
        lines = (
            line,
            line.T,
            np.eye(width + 1, dtype=np.bool_),
            np.eye(width + 1, dtype=np.bool_)[::-1],
        )
        left = np.logical_and.reduce([ndimage.binary_opening(mixed, each) for each in lines])
    return width


def _draw_cells(rng: Rng, turn: int) -> Bools:
    """Draw one box, single cells, or many boxes, in turns."""
    if turn % 3 == 0:
        return np.ones(rng.integers(1, 12, 2), dtype=np.bool_)
    return rng.random((80, 80)) < 0.01 if turn % 3 == 1 else inputs.boxes(80, 0.2, rng)


def _draw_robot(rng: Rng, kind: str) -> tuple[Robot, float]:
    """Draw a robot of 4 to 40 cells, and its size."""
    across = 4.0 * 10.0 ** rng.random()
    length, width = (
        round(n) if rng.random() < 0.5 else n for n in (across, rng.uniform(4.0, across))
    )
    center = rng.choice([0.0, 0.5]) * rng.uniform(-1.0, 1.0, 2)
    if kind == "disc":
        return Robot.disc(length / 2, center), across
    if kind == "rectangle":
        return Robot.rectangle(length, width, center), across
    turns = rng.uniform(0, 2 * np.pi) + np.linspace(
        0, 2 * np.pi, int(rng.integers(3, 13)), endpoint=False
    )
    return Robot.polygon(
        across / 2 * np.column_stack([np.cos(turns), np.sin(turns)]) + center
    ), across
