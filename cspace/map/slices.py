"""The rasters of a robot that a map is made of, one pair for each slice."""

from __future__ import annotations

import numpy as np

from cspace.raster.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.threads import cores, in_threads

FEW = 16
"""Slices that are made in one thread."""


def slice_rasters(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[tuple[Raster, Raster]]:
    """Outer and inner raster of the robot for each slice.

    Each is rasterised afresh from the turned geometry, but for those that are another one with the world's axes
    permuted.
    """
    if rotations.keep(robot):
        return [robot.rasters(spacing, margin)]
    slice_of = rotations.slice_of(robot)
    first, turns = np.unique(slice_of, return_index=True)[1], rotations.turns(robot.dim)
    # For each slice the least one of which it is an image, and the matrix that makes it so.
    source, made_by = np.arange(len(first)), np.full(len(first), -1)
    images = rotations.images(robot.dim)
    for number, (_, cells) in enumerate(images):
        image = slice_of[cells[first]]
        less = np.flatnonzero(np.arange(len(first)) < source[image])
        source[image[less]], made_by[image[less]] = less, number
    fresh = np.flatnonzero(made_by < 0)
    work = [turns[first[number]] for number in fresh]
    made = in_threads(lambda turn: robot.rasters(spacing, margin, turn), work, cores() if len(work) > FEW else 1)
    rasters = dict(zip(fresh.tolist(), made, strict=True))
    for number in np.flatnonzero(made_by >= 0).tolist():
        matrix = images[made_by[number]][0]
        outer, inner = rasters[source[number]]
        rasters[number] = outer.turned(matrix), inner.turned(matrix)
    return [rasters[number] for number in range(len(first))]
