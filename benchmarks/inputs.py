"""Random and real input maps, and slots for parking."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import shapely

from cspace import Workspace
from cspace._support.arrays import Bools, Ints


def boxes(
    size: int, density: float, rng: np.random.Generator, dim: int = 2, each: int = 16
) -> Bools:
    """Draw boxes of 5 to 100 cells a side until a share of the cells is occupied.

    The map has ``size`` cells along each axis. The share is computed after every ``each`` boxes, so
    small maps may be denser.
    """
    occupied = np.zeros((size,) * dim, dtype=np.bool_)
    longest = min(100, size // 4)
    while occupied.mean() < density:
        for _ in range(each):
            first, sides = rng.integers(0, size - longest, dim), rng.integers(5, longest, dim)
            occupied[
                tuple(slice(int(i), int(i + n)) for i, n in zip(first, sides, strict=True))
            ] = True
    return occupied


def rooms(size: int, rng: np.random.Generator, side: int = 80) -> Bools:
    """Draw square rooms of ``side`` cells, with doors of 24 to 40 cells in all walls and furniture."""
    occupied = boxes(size, 0.03, rng, each=1)
    for wall in range(0, size, side):
        occupied[wall : wall + 4] = occupied[:, wall : wall + 4] = True
    for wall, room in np.ndindex(size // side, size // side):
        for cells in (occupied, occupied.T):
            first, width = side * room + rng.integers(10, side - 50), rng.integers(24, 41)
            cells[side * wall - 8 : side * wall + 12, first : first + width] = False
    return occupied


CAR = shapely.box(-0.9, -0.9, 3.6, 0.9)
"""A car of 4.5 m by 1.8 m, with its reference point in the middle of the rear axle."""

PARKING_BOUNDS = (-0.5, -5.6, 18.5, 7.5)
"""Bounds of the maps of slots, metres."""

Pose = tuple[float, float, float]
Slot = tuple[list[shapely.Polygon], tuple[Pose, Pose]]
"""Obstacles, and start and goal of a car."""


def make_parallel_slot(share: float) -> Slot:
    """Make a slot along the curb, ``share`` times as long as the car."""
    stop = 6.0 + 4.5 * share
    cars = [shapely.box(0.5, 0.2, 6.0, 2.0), shapely.box(stop, 0.2, stop + 5.5, 2.0)]
    curbs = [shapely.box(-1, -1, 19, 0), shapely.box(-1, 7, 19, 8)]
    middle = 0.5 * (6.0 + stop)
    return [*cars, *curbs], ((stop + 1.0, 3.4, 0.0), (middle - 1.35, 1.1, 0.0))


def make_perpendicular_slot(share: float) -> Slot:
    """Make a slot across the lane, ``share`` times as wide as the car."""
    stop = 8.0 + 1.8 * share
    cars = [shapely.box(x, -4.5, x + 1.8, 0) for x in (3.7, 6.2, stop, stop + 2.5)]
    curbs = [shapely.box(-1, -6, 20, -5.2), shapely.box(-1, 6, 20, 7)]
    middle = 0.5 * (8.0 + stop)
    return [*cars, *curbs], ((1.5, 2.5, 0.0), (middle, -1.1, -0.5 * math.pi))


def data_folder() -> Path | None:
    """Return the folder ``CSPACE_TEST_DATA`` of real maps, or None."""
    folder = Path(os.environ.get("CSPACE_TEST_DATA", ""))
    return folder if os.environ.get("CSPACE_TEST_DATA") and folder.is_dir() else None


def real_map(name: str) -> Workspace | None:
    """Open a real map of the data folder, or return None."""
    folder = data_folder()
    if folder is None or not (folder / name).is_file():
        return None
    return Workspace.open(folder / name)


NO_DATA = "real maps skipped: CSPACE_TEST_DATA does not name the folder that holds them"


def merge_cells(occupied: Bools) -> Ints:
    """Merge cells into boxes (first, stop), shape (n, 2, 3)."""
    steps = np.diff(np.pad(occupied.astype(np.int8), ((0, 0), (0, 0), (1, 1))), axis=2)
    boxes = np.column_stack([np.argwhere(steps > 0), np.argwhere(steps < 0)])
    boxes[:, 3:5] += 1
    for axis in (1, 0):
        # Merge boxes that are equal on the other axes and follow one another along this one.
        others = [column for column in range(6) if column not in (axis, axis + 3)]
        boxes = boxes[np.lexsort([boxes[:, axis], *(boxes[:, column] for column in others)])]
        new = np.ones(len(boxes), dtype=np.bool_)
        new[1:] = (boxes[1:, others] != boxes[:-1, others]).any(axis=1) | (
            boxes[1:, axis] != boxes[:-1, axis + 3]
        )
        last = (
            np.append(np.flatnonzero(new)[1:], len(boxes)) - 1
            if len(boxes)
            else np.empty(0, dtype=np.int64)
        )
        upper = boxes[last, axis + 3]
        boxes = boxes[new]
        boxes[:, axis + 3] = upper
    return boxes.reshape(-1, 2, 3)
