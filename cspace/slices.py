"""Slices: which turned robots a map is made of."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cspace.raster.raster import Raster
from cspace.rotations import Rotations, Turn

if TYPE_CHECKING:
    from cspace.robot import Robot


def slice_of_rotation(robot: Robot, rotations: Rotations | None) -> NDArray[np.int64]:
    """Number of the slice that each rotation cell has, shape (n,).

    Cells whose turns differ by one that maps the robot to itself share a slice. Slices are numbered from 0, in the
    order of the first cells that have them; a robot that only translates has one.
    """
    if rotations is None or robot.symmetry == 0:
        return np.zeros(1 if rotations is None else rotations.count, dtype=np.int64)
    cells = np.arange(rotations.count, dtype=np.int64)
    if rotations.count % robot.symmetry == 0 and rotations.is_uniform():
        return cells % (rotations.count // robot.symmetry)
    return cells


def slice_rasters(
    robot: Robot, spacing: float, margin: float, rotations: Rotations | None
) -> list[tuple[Raster, Raster]]:
    """Outer and inner raster of the robot for each slice.

    Each is rasterised afresh from the turned geometry, but for those a quarter turn from another, which are permuted.
    """
    if rotations is None:
        return [robot.rasters(spacing, margin)]
    if robot.symmetry == 0:  # a disc around its reference point, at every yaw
        return [robot.rasters(spacing, margin)]
    count = int(slice_of_rotation(robot, rotations).max()) + 1
    quarter = rotations.count // 4 if rotations.count % 4 == 0 and rotations.is_uniform() else count
    turned = zip(rotations.representatives.tolist(), rotations.covering_angles.tolist(), strict=True)
    made = [
        robot.rasters(spacing, margin, _turn(yaw, sweep))
        for _, (yaw, sweep) in zip(range(min(count, quarter)), turned, strict=False)
    ]
    while len(made) < count:
        outer, inner = made[len(made) - quarter]
        made.append((outer.quarter_turned(1), inner.quarter_turned(1)))
    return made


def _turn(yaw: float, sweep: float) -> Turn:
    cosine, sine = math.cos(yaw), math.sin(yaw)
    return Turn(np.array([[cosine, -sine], [sine, cosine]]), sweep, about_z=True)
