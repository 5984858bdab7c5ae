"""Random and real input maps."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from cspace import Workspace
from cspace.support.arrays import Bools


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
