"""Plan: what a search found, and how sure it is."""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import IO, TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from cspace.io.output import replacing

if TYPE_CHECKING:
    from cspace.space import CSpace

Floats = NDArray[np.float64]

AXES: Final = ("x", "y", "z")
"""Names of the coordinates, in the order of the columns of a path."""


@dataclass(frozen=True, slots=True)
class Times:
    """How long the steps of :func:`planners.plan` took, in seconds.

    Attributes
    ----------
    setup : float
        Checks of the input, the question whether a path exists, and OMPL's set-up.
    planning : float
        OMPL's search.
    simplification : float
        OMPL's simplification of the path.
    checking : float
        The final check of every edge and of the clearance.
    """

    setup: float = 0.0
    planning: float = 0.0
    simplification: float = 0.0
    checking: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What a search found.

    Attributes
    ----------
    path : ndarray of float64, shape (n, dof), read-only
        Configurations from start to goal, joined by straight edges, in metres; shape (0, dof) where not solved.
    solved : bool
        Whether the path reaches the goal. What OMPL calls an approximate solution does not, and is not kept.
    certified : bool
        Whether every edge of the path was proven free by the map, checked again after OMPL was done.
    status : str
        What the planner reported, or why none was run.
    length : float
        Length of the path, in metres; NaN where not solved.
    clearance : float
        Lower bound, proven, of the distance in metres from any configuration on the path to the nearest one that is not
        FREE; NaN where not solved. See :func:`least_clearance`.
    path_exists : bool or None
        What the map proves of these ends: a path exists, none does, or None for undecided at this resolution.
    planner : str
        Name of the planner.
    objective : str
        What was optimised.
    seed : int or None
    times : Times
    """

    path: Floats
    solved: bool
    certified: bool
    status: str
    length: float
    clearance: float
    path_exists: bool | None
    planner: str
    objective: str
    seed: int | None
    times: Times

    def to_csv(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the path as CSV: a row of names, then a row for each configuration, in metres and in full precision.

        Parameters
        ----------
        path : path-like
        overwrite : bool
            Whether an existing file may be replaced.

        Raises
        ------
        FileError
            If the file exists and may not be replaced, or cannot be written.
        """

        def write(file: IO[str]) -> None:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(AXES[: self.path.shape[1]])
            writer.writerows(self.path.tolist())

        _write(path, overwrite, write)

    def to_json(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write everything as JSON, one key for each attribute; NaN and infinity become null.

        Parameters
        ----------
        path : path-like
        overwrite : bool
            Whether an existing file may be replaced.

        Raises
        ------
        FileError
            If the file exists and may not be replaced, or cannot be written.
        """
        _write(path, overwrite, lambda file: file.write(json.dumps(self._record(), indent=2, allow_nan=False) + "\n"))

    def _record(self) -> dict[str, Any]:
        """The attributes as JSON knows them."""
        record = {name: getattr(self, name) for name in self.__dataclass_fields__}
        record |= {"path": self.path.tolist(), "times": asdict(self.times)}
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in record.items()
        }


def least_clearance(space: CSpace, path: Floats) -> float:
    """Lower bound of the clearance all along a path of straight edges.

    Each edge is cut into pieces of at most half a cell. No point of a piece is further than half a piece from
    its middle, and distance changes by no more than the way moved; so the clearance at the middle less half the piece
    holds for the whole piece.

    Parameters
    ----------
    space : CSpace
    path : ndarray, shape (n, 2), n >= 1

    Returns
    -------
    float
        Metres; never below zero, infinite where every configuration is FREE.
    """
    starts, ways = path[:-1], np.diff(path, axis=0)
    lengths = np.hypot(ways[:, 0], ways[:, 1])
    pieces = np.maximum(np.ceil(lengths / (0.5 * space.grid.spacing)), 1.0).astype(np.int64)
    if not len(pieces):
        return float(space.clearance(path[0]))
    edge = np.repeat(np.arange(len(pieces)), pieces)
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    middle = (np.arange(len(edge)) - first + 0.5) / pieces[edge]
    points = starts[edge] + middle[:, None] * ways[edge]
    return max(0.0, float(np.min(space.clearance(points) - 0.5 * (lengths / pieces)[edge])))


def _write(path: str | os.PathLike[str], overwrite: bool, write: Callable[[IO[str]], object]) -> None:
    with replacing(path, overwrite) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        write(file)
