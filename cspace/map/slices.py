"""The rasters of a robot that a map is made of, one pair for each slice."""

from __future__ import annotations

import numpy as np

from cspace.raster.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations


def slice_rasters(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[tuple[Raster, Raster]]:
    """Outer and inner raster of the robot for each slice.

    Each is rasterised afresh from the turned geometry, but for those a quarter turn from another, which are permuted.
    """
    if rotations.keep(robot):
        return [robot.rasters(spacing, margin)]
    first, turns = np.unique(rotations.slice_of(robot), return_index=True)[1], rotations.turns(robot.dim)
    quarter = rotations.quarter or len(first)
    made = [robot.rasters(spacing, margin, turns[cell]) for cell in first[:quarter]]
    while len(made) < len(first):
        outer, inner = made[len(made) - quarter]
        made.append((outer.quarter_turned(1), inner.quarter_turned(1)))
    return made
