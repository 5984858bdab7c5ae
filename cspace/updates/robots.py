"""Robots: what a robot's rasters come to on a map, ready for the compiled update."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cspace.engines.dilation import Runs
from cspace.raster.raster import Raster

Ints = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Robots:
    """The offsets of a robot's slices, of one side, as rows (first offset, length); the plane has one layer.

    Attributes
    ----------
    runs, ends : ndarray of int64, shapes (n, 4) and (slices,)
        Each offset once, and where the rows of each slice end.
    fours, fours_ends : ndarray of int64, shapes (m, 4) and (slices,)
        The same by ascending length, in fours of one length, the last of them told again to fill them up.
    beyond : ndarray of bool, shape (slices,)
        Whether some offset falls beyond the map from everywhere.
    """

    runs: Ints
    ends: Ints
    fours: Ints
    fours_ends: Ints
    beyond: NDArray[np.bool_]

    @classmethod
    def of(cls, rasters: Sequence[Raster], shape: tuple[int, ...]) -> Robots:
        """Those of rasters, one for each slice, on a map of a shape of three axes."""
        runs = [Runs.of(raster, shape) for raster in rasters]
        rows = [each.table for each in runs]
        fours = [_in_fours(part) for part in rows]
        return cls(
            np.concatenate(rows),
            np.cumsum([len(part) for part in rows]),
            np.concatenate(fours),
            np.cumsum([len(part) for part in fours]),
            np.array([each.beyond for each in runs]),
        )


def _in_fours(rows: Ints) -> Ints:
    parts = [rows[:0]]
    for length in np.unique(rows[:, 3]):
        part = rows[rows[:, 3] == length]
        parts.append(np.pad(part, ((0, -len(part) % 4), (0, 0)), mode="edge"))
    return np.concatenate(parts)
