"""The rasters of a robot that a map is made of, one pair for each slice."""

from __future__ import annotations

from cspace.raster.raster import Raster
from cspace.robot import Robot
from cspace.rotations import Rotations


def slice_rasters(robot: Robot, spacing: float, margin: float, rotations: Rotations) -> list[tuple[Raster, Raster]]:
    """Outer and inner raster of the robot for each slice.

    Each is rasterised afresh from the turned geometry, but for those a quarter turn from another, which are permuted.
    """
    count = int(rotations.slice_of(robot).max()) + 1
    if robot.symmetry == 0:  # the same at every rotation
        return [robot.rasters(spacing, margin)]
    quarter = rotations.quarter or count
    made = [robot.rasters(spacing, margin, turn) for turn in rotations.turns(robot.dim)[: min(count, quarter)]]
    while len(made) < count:
        outer, inner = made[len(made) - quarter]
        made.append((outer.quarter_turned(1), inner.quarter_turned(1)))
    return made
