"""How thick the MIXED band is.

Two measures of it, in cells, for maps that are grids and convex robots:

* *depth*: the largest chessboard distance of a MIXED cell from a BLOCKED one. With a depth of n, whatever lies more
  than n cells from all that is proven to collide is proven free.
* *width*: how many MIXED cells in a row one crosses. Of the four directions through a MIXED cell, axes and diagonals,
  the one with the shortest run counts, so that walking along the band does not. It is measured around a single box,
  where no two bands run into each other; the depth is measured on all maps.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

import cspace
from benchmarks import inputs
from benchmarks.report import Report
from cspace import BLOCKED, MIXED, Robot, Workspace
from cspace.arrays import Bools, Floats, Ints, States

MOST = 3
GAP = 255
REAL = ("maps/depot.yaml", "maps/willow-full-0.05.yaml", "movingai/Berlin_1_1024.map", "movingai/random512-10-0.map")


def measure(report: Report, seed: int, number: int) -> None:
    """The thickest band over random grids and convex robots from 4 to 40 cells across, and on real maps."""
    rng = np.random.default_rng([seed, 2])
    for kind, draw in ROBOTS.items():
        depth = width = cells = 0
        for turn in range(number):
            across = 4.0 * 10.0 ** rng.random()
            robot = draw(rng, across)
            occupied = np.pad(_occupied(rng, turn), int(across) + 3)
            state = cspace.build(Workspace.from_array(occupied, 1.0), robot, outside="free").state
            depth = max(depth, depth_of(state))
            width = width if turn % 3 else max(width, width_of(state))
            cells += int((state == MIXED).sum())
        report.section(f"MIXED band: {number} random grids, {kind} from 4 to 40 cells across, {cells} MIXED cells")
        report.figure("width around a single box", width, "cells", most=MOST)
        _tell(report, depth)
        report.check(width <= MOST, f"around a box, the band is at most {MOST} cells wide")
    for name in REAL:
        workspace = inputs.real_map(name)
        if workspace is None:
            report.note(inputs.NO_DATA)
            return
        state = cspace.build(workspace, Robot.disc(6.0 * workspace.grid.spacing)).state
        report.section(f"MIXED band: {name}, disc 12 cells across: {(state == MIXED).mean():.1%} of the map is MIXED")
        _tell(report, depth_of(state))


def _tell(report: Report, depth: int) -> None:
    report.figure("depth", depth, "cells", most=MOST)
    report.check(depth <= MOST, f"no MIXED cell is more than {MOST} cells from a BLOCKED one")


def depth_of(state: States) -> int:
    """Largest chessboard distance of a MIXED cell from a BLOCKED one, in cells; 0 where there are none of either."""
    from scipy import ndimage

    if not (state == BLOCKED).any():
        return 0
    apart = ndimage.distance_transform_cdt(state != BLOCKED, metric="chessboard")
    return int(apart[state == MIXED].max(initial=0))


def width_of(state: States) -> int:
    """Most MIXED cells in a row, in the direction through each cell in which they are fewest."""
    cells = np.arange(state.size).reshape(state.shape)
    never = np.iinfo(np.int64).max
    fewest = np.full(state.size, never)
    for lines in (cells, cells.T, _diagonals(cells), _diagonals(cells[:, ::-1])):
        # One long line, with a gap after each part, so that a run which leaves the grid ends in a gap.
        line = np.concatenate([[-1], *(part for each in lines for part in (each, [-1]))])
        values = np.where(line >= 0, state.ravel()[line], GAP)
        steps = np.diff((values == MIXED).astype(np.int8))
        first, stop = np.flatnonzero(steps > 0) + 1, np.flatnonzero(steps < 0) + 1
        inside = (values[first - 1] != GAP) & (values[stop] != GAP)
        widths = np.where(inside, stop - first, never)
        members = line[values == MIXED]
        fewest[members] = np.minimum(fewest[members], np.repeat(widths, stop - first))
    return int(fewest[fewest < never].max(initial=0))


def _diagonals(cells: Ints) -> Iterator[Ints]:
    return (cells.diagonal(k) for k in range(1 - cells.shape[0], cells.shape[1]))


def _occupied(rng: np.random.Generator, turn: int) -> Bools:
    """One box, single cells, or many boxes, by turns."""
    if turn % 3 == 0:
        return np.ones(rng.integers(1, 12, 2), dtype=np.bool_)
    return inputs.noise(80, 0.01, rng) if turn % 3 == 1 else inputs.boxes(80, 0.2, rng)


def _disc(rng: np.random.Generator, across: float) -> Robot:
    return Robot.disc(_perhaps_whole(rng, across) / 2, _center(rng))


def _rectangle(rng: np.random.Generator, across: float) -> Robot:
    length, width = _perhaps_whole(rng, across), _perhaps_whole(rng, rng.uniform(min(4.0, across), across))
    return Robot.rectangle(length, width, _center(rng))


def _regular(rng: np.random.Generator, across: float) -> Robot:
    turns = rng.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, int(rng.integers(3, 13)), endpoint=False)
    return Robot.polygon(across / 2 * np.column_stack([np.cos(turns), np.sin(turns)]) + _center(rng))


def _perhaps_whole(rng: np.random.Generator, length: float) -> float:
    """Half of the lengths are whole numbers of cells, where borders fall on the lattice."""
    return float(round(length)) if rng.random() < 0.5 else length


def _center(rng: np.random.Generator) -> Floats:
    return rng.uniform(-0.5, 0.5, 2) if rng.random() < 0.5 else np.zeros(2)


ROBOTS: dict[str, Callable[[np.random.Generator, float], Robot]] = {
    "disc": _disc,
    "rectangle": _rectangle,
    "regular polygon": _regular,
}
