"""Plan: what a search found, and how sure it is."""

from __future__ import annotations

import csv
import json
import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import IO, TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cspace.io.output import replacing
from cspace.rotations import YAW_SLACK
from planners.straight import Straight
from planners.ways import Way

if TYPE_CHECKING:
    from cspace.space import CSpace

Floats = NDArray[np.float64]


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
        Configurations from start to goal, in metres; shape (0, dof) where not solved. Of a robot that turns, they are
        dense enough to drive and to draw: rows lie at most a cell and 5 degrees apart, on the edges between the
        waypoints. Yaw is in radians, in [-pi, pi): it jumps by a turn where it passes pi.
    waypoints : ndarray of float64, shape (m, dof), read-only
        The configurations that edges join, which are rows of the path: all of them, where the robot does not turn.
    axes : tuple of str
        Names of the columns of the path: x and y, with z in space, or with yaw where the robot turns.
    direction : ndarray of int8, shape (n,), read-only, or None
        For curves, how the car gets to each row from the one before: 1 ahead, -1 in reverse; the first row has that of
        the second. None for straight edges.
    solved : bool
        Whether the path reaches the goal. What OMPL calls an approximate solution does not, and is not kept.
    certified : bool
        Whether every edge between the waypoints was proven free by the map, or with ``exact`` by the map and the
        geometry, checked again after OMPL was done; curves are proven along the real curve.
    status : str
        What the planner reported, or why none was run.
    length : float
        Metres that the reference point moves, along curves too; turning on the spot counts nothing. NaN where not
        solved.
    clearance : float
        Lower bound, proven, of the distance in metres from any configuration on the path to the nearest one that is not
        FREE; NaN where not solved. Of a robot that turns, the distance is that of its position, at the yaw it has
        there. Zero along a path through MIXED cells. See :func:`least_clearance`.
    path_exists : bool or None
        What the map proves of these ends: a path exists, none does, or None for undecided at this resolution.
    planner : str
        Name of the planner.
    objective : str
        What was optimised.
    curve : str or None
        Name of the curves that the edges are; None for straight ones.
    turning_radius : float or None
        Of the curves, in metres.
    exact : bool
        Whether the geometry itself was asked where the map cannot decide.
    exact_counts : dict of str to int
        How often it was; empty where it was not to be asked. See :attr:`cspace.CSpace.exact_counts`.
    seed : int or None
    times : Times
    """

    path: Floats
    waypoints: Floats
    axes: tuple[str, ...]
    direction: NDArray[np.int8] | None
    solved: bool
    certified: bool
    status: str
    length: float
    clearance: float
    path_exists: bool | None
    planner: str
    objective: str
    curve: str | None
    turning_radius: float | None
    exact: bool
    exact_counts: dict[str, int]
    seed: int | None
    times: Times

    def to_csv(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the path as CSV: a row of names, then a row for each configuration, in full precision.

        The columns are x and y, and in space z, in metres; yaw in radians where the robot turns; and for curves
        direction, 1 or -1.

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
            names, rows = self.axes, self.path.tolist()
            if self.direction is not None:
                names, rows = (
                    (*names, "direction"),
                    [[*q, way] for q, way in zip(rows, self.direction.tolist(), strict=True)],
                )
            writer.writerow(names)
            writer.writerows(rows)

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
        arrays = {name: value.tolist() for name, value in record.items() if isinstance(value, np.ndarray)}
        record |= arrays | {"times": asdict(self.times)}
        return {
            name: None if isinstance(value, float) and not math.isfinite(value) else value
            for name, value in record.items()
        }


def least_clearance(space: CSpace, path: Floats, way: Way | None = None) -> float:
    """Lower bound of the clearance all along a path.

    Each edge is cut into pieces of at most half a cell. No point of a piece is further than half a piece from
    its middle, and distance changes by no more than the way moved; so the clearance at the middle less half the piece
    holds for the whole piece. Where yaw changes, a piece turns by less than the narrowest rotation cell is wide; so it
    meets at most the two cells at the ends of its turn, and the smaller clearance counts.

    Parameters
    ----------
    space : CSpace
    path : ndarray, shape (n, dof), n >= 1
        Waypoints.
    way : Way, optional
        How they are joined; by straight edges, if left out.

    Returns
    -------
    float
        Metres; never below zero, infinite where every configuration is FREE.
    """
    if len(path) < 2:
        return float(space.clearance(path[0]))
    narrowest = math.inf if space.rotations is None else min(np.diff(space.rotations.borders))
    pieces = (way or Straight(space)).pieces(path, 0.5 * space.grid.spacing, 0.5 * narrowest)
    clearance = space.clearance(pieces.middles)
    if space.rotations is not None:
        swing = np.zeros_like(pieces.middles)
        swing[:, 2] = 0.5 * pieces.turns + 2.0 * YAW_SLACK
        clearance = np.minimum(space.clearance(pieces.middles - swing), space.clearance(pieces.middles + swing))
    return max(0.0, float(np.min(clearance - 0.5 * pieces.lengths)))


def _write(path: str | os.PathLike[str], overwrite: bool, write: Callable[[IO[str]], object]) -> None:
    with replacing(path, overwrite) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        write(file)
