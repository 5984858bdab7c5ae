"""Rotation cells so narrow that a map would prove a configuration FREE."""

from __future__ import annotations

import itertools
from typing import Final

import numpy as np

from cspace.arrays import Floats
from cspace.engines.slices import narrower_rotations
from cspace.raster import Raster
from cspace.rotations.base import ANGLE_SLACK
from cspace.space import CSpace
from planners.states import Configuration

MIN_MOVE: Final = 0.5
"""Move of the robot within a rotation cell, in cells, below which more rotations hardly matter."""

BORDER_SHARE: Final = 1e-6
"""Distance from a cell's border within which the next cell counts too, as a share of its side."""


def find_needed_rotations(space: CSpace, q: Configuration) -> str:
    """Return the argument for the fewest rotation cells that prove a configuration FREE.

    The cells at the configuration are tested as a build tests them. Numbers of rotation cells are
    tried by doubling. The text is empty if none of them suffices.
    """
    point, robot, spacing = np.array(q), space.robot, space.grid.spacing
    for argument, rotations in narrower_rotations(robot, space.rotations, MIN_MOVE * spacing):
        _, numbers = rotations.find_cells_within(point[np.newaxis], np.array([2.0 * ANGLE_SLACK]))
        cells = rotations.make_shape_cells(space.grid.dim)
        rasters = (robot.rasters(spacing, space.margin, cells[number]) for number in numbers)
        if all(_is_free(space, point, outer) for outer, _ in rasters):
            return argument
    return ""


def _is_free(space: CSpace, point: Floats, outer: Raster) -> bool:
    """Return True if no cell at a configuration's position has an overlap of outer cells."""
    grid, occupied = space.grid, space.workspace.outer
    offsets = np.argwhere(outer.cells) + outer.lower
    local = (point[: grid.dim] - grid.lower) / grid.spacing
    sides = np.floor(local - BORDER_SHARE), np.floor(local + BORDER_SHARE)
    for position in set(itertools.product(*np.transpose(sides).astype(np.int64).tolist())):
        reached = offsets + position
        inside = ((reached >= 0) & (reached < grid.shape)).all(axis=1)
        if space.outside != "free" and not inside.all():
            return False
        if occupied[tuple(reached[inside].T)].any():
            return False
    return True
