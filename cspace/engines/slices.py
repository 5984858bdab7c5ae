"""The rasters of a robot that a map is made of, one pair for each slice."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import partial

import numpy as np

from cspace.limits import RASTER_CELL_BYTES, SLICE_BYTES
from cspace.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.threads import cores, in_threads

SAMPLED_ROTATIONS = 32
"""Rotations, about, at which the size of a robot's rasters is estimated."""

CELLS_A_THREAD = 50_000
"""Cells of the robot's box, over all slices, below which a second thread costs more than it saves."""

Pair = tuple[Raster, Raster]
Rasters = Callable[[], list[tuple[int, Pair]]]
"""Makes the outer and the inner raster of some slices, with their numbers."""


def slice_rasters(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[Pair]:
    """Outer and inner raster of the robot for each slice."""
    parts = raster_parts(robot, spacing, margin, rotations)
    cells = float(np.prod(np.ptp(robot.shape.outer.bounds, axis=0) / spacing + 1.0))
    threads = cores() if len(parts) * cells > CELLS_A_THREAD else 1
    made = dict(itertools.chain.from_iterable(in_threads(lambda part: part(), parts, threads)))
    return [made[number] for number in range(len(made))]


def raster_bytes(robot: Robot, spacing: float, margin: float, rotations: Rotations, slices: int) -> float:
    """Estimate the memory for the rasters of so many slices, from the robot's bounds at some rotations, in bytes."""
    if slices == 1:
        return 0.0
    centers = rotations.centers[:: max(1, rotations.count // SAMPLED_ROTATIONS)]
    matrices = rotations.matrices(np.hstack([np.zeros((len(centers), robot.dim)), centers]))
    corners = np.array(list(itertools.product(*zip(*robot.shape.outer.bounds, strict=True))))
    sides = np.ptp(corners @ matrices.swapaxes(1, 2), axis=1) + 2.0 * margin
    cells = 2.0 * float(np.prod(sides / spacing + 2.0, axis=1).mean())  # of the outer and the inner raster
    return slices * (SLICE_BYTES + RASTER_CELL_BYTES[robot.dim] * cells)


def raster_parts(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[Rasters]:
    """What makes the rasters of the robot for all slices.

    Each is rasterised afresh from the turned geometry, but for those that are another one turned by quarters or
    mirrored, which come in the same part as that.
    """
    if rotations.preserve(robot.shape):
        return [lambda: [(0, robot.rasters(spacing, margin))]]
    slice_of = rotations.slices_for(robot.shape)
    first, turns = np.unique(slice_of, return_index=True)[1], rotations.turns(robot.dim)
    # Of the slices that each one becomes, the least, and what makes it so; the way back is the transposed matrix.
    images = rotations.images(robot.shape)
    becomes = np.array([slice_of[cells[first]] for _, cells in images])
    made_by, source, own = becomes.argmin(axis=0), becomes.min(axis=0), np.arange(len(first))
    alike: dict[int, list[int]] = {}
    for number in np.flatnonzero(source < own).tolist():
        alike.setdefault(int(source[number]), []).append(number)

    def make(number: int) -> list[tuple[int, Pair]]:
        made = [(number, robot.rasters(spacing, margin, turns[first[number]]))]
        for known, (outer, inner) in made:  # which grows meanwhile
            for other in alike.get(known, ()):
                matrix = images[made_by[other]][0].T
                made.append((other, (outer.turned(matrix), inner.turned(matrix))))
        return made

    return [partial(make, number) for number in np.flatnonzero(source == own).tolist()]
