"""The rasters of a robot that a map is made of, one pair for each slice."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from cspace.raster.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations
from cspace.threads import cores, in_threads

FEW = 16
"""Slices that are made in one thread; and those of outlines in the plane, which take more of Python than of compiled
code."""

AT_ONCE = 64
"""Slices, at most, that are made together, but for those that are another one with the world's axes permuted."""

Pair = tuple[Raster, Raster]


def slice_rasters(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[Pair]:
    """Outer and inner raster of the robot for each slice."""
    made = dict(itertools.chain.from_iterable(raster_batches(robot, spacing, margin, rotations)))
    return [made[number] for number in range(len(made))]


def raster_batches(
    robot: Robot, spacing: float, margin: float, rotations: Rotations
) -> Iterator[list[tuple[int, Pair]]]:
    """Outer and inner raster of the robot for each slice, with its number, some slices at a time.

    Each is rasterised afresh from the turned geometry, but for those that are another one with the world's axes
    permuted, which come in the same batch as that.
    """
    if rotations.keep(robot):
        yield [(0, robot.rasters(spacing, margin))]
        return
    slice_of = rotations.slice_of(robot)
    first, turns = np.unique(slice_of, return_index=True)[1], rotations.turns(robot.dim)
    # For each slice the least one of which it is an image, and the matrix that makes it so.
    source, made_by = np.arange(len(first)), np.full(len(first), -1)
    images = rotations.images(robot.dim)
    for number, (_, cells) in enumerate(images):
        image = slice_of[cells[first]]
        less = np.flatnonzero(np.arange(len(first)) < source[image])
        source[image[less]], made_by[image[less]] = less, number
    alike: dict[int, list[int]] = {}
    for number in np.flatnonzero(made_by >= 0).tolist():
        alike.setdefault(int(source[number]), []).append(number)

    def make(number: int) -> list[tuple[int, Pair]]:
        made = [(number, robot.rasters(spacing, margin, turns[first[number]]))]
        for known, (outer, inner) in made:  # which grows meanwhile
            for other in alike.get(known, ()):
                matrix = images[made_by[other]][0]
                made.append((other, (outer.turned(matrix), inner.turned(matrix))))
        return made

    fresh = np.flatnonzero(made_by < 0).tolist()
    threads = cores() if len(fresh) > FEW and robot.dim == 3 else 1
    for start in range(0, len(fresh), AT_ONCE):
        yield list(itertools.chain.from_iterable(in_threads(make, fresh[start : start + AT_ONCE], threads)))
