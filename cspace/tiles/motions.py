"""Motions cut at the borders of tiles.

**Statement.** *A motion is free if the part of a tile proves each of its pieces free.*

**Proof.** Positions are in cells. The motion leads from p to q, straight in position, while the
rotation takes the shorter arc. It is cut where it crosses the border between two tiles, and one cell
outside the grid, at parameters 0 = t_0 <= t_1 <= ... = 1. Piece i is the
motion between the configurations that are computed for t_i and t_(i+1).

1. *Each point of the motion is near a point of a piece.* A coordinate at t_i is ``p + t (q - p)``,
   rounded three times. Coordinates are below 2^23 cells, so its error is below 2^-28 cells, and
   that of its rotation is below 1e-14 rad. A piece and the motion between the same parameters are
   both straight, so they differ by no more anywhere. It does not matter that t_i is rounded.
2. *A part proves more than the piece.* It proves that all closed cells within SLACK of the piece
   are FREE, at all rotations within ANGLE_SLACK, except for the rounding of its look-up. That
   rounding, that of the part's lower corner, and the error of 1. are together below SLACK, 2^-26
   cells, and below ANGLE_SLACK, 1e-9 rad.
3. *The part has those cells.* A piece lies in the interior of its tile, or up to one cell outside
   the grid, except for the error of 1. The part has a halo of two cells or more. If it lacks a cell
   that the piece touches, the cell is unknown there, and the piece is not proven. Only a motion
   in the closed grid ignores the cells outside, as in memory: the cells in the grid contain it.
4. *Arcs.* The rotation of a piece is part of that of the motion and less than half a turn, so the
   shorter arc of the piece follows it. If the motion turns by half a turn, up to rounding, both arcs
   are the shorter one. Then it is two motions, one along each arc, each cut in its middle too.

The frame, which is the map of the space outside the grid, proves pieces farther outside. ∎
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from cspace.arrays import Bools, Floats, Ints
from cspace.grid import Grid
from cspace.rotations import Rotations
from cspace.rotations.base import ANGLE_SLACK

HALF_TURN: Final = math.pi - 4.0 * ANGLE_SLACK
"""Angle of a rotation, in radians, from which on both arcs are tested."""


class Pieces(NamedTuple):
    """Pieces of motions, in any order.

    Attributes
    ----------
    motions : ndarray of int64, shape (n,)
        Index of the motion that a piece belongs to.
    tiles : ndarray of int64, shape (n, d)
        Tile of a piece, or the nearest one if the piece lies outside the grid.
    is_far : ndarray of bool, shape (n,)
        True for pieces more than one cell outside the grid.
    starts, ends : ndarray of float64, shape (n, size)
    """

    motions: Ints
    tiles: Ints
    is_far: Bools
    starts: Floats
    ends: Floats


def cut_motions(grid: Grid, tile: Sequence[int], rotations: Rotations, starts: Floats, ends: Floats) -> Pieces:
    """Cut motions, from ``starts`` to ``ends`` of shape (n, size), at the borders of tiles."""
    dim = grid.dim
    starts, ends = rotations._make_canonical(starts), rotations._make_canonical(ends)
    motions, starts, ends = _split_half_turns(rotations, dim, starts, ends)
    first, last = ((q[:, :dim] - grid.lower) / grid.spacing for q in (starts, ends))
    rows, times = _find_cuts(grid, tile, first, last)
    order = np.lexsort((times, rows))
    rows, times = rows[order], times[order]
    # Neighbors in this order are the ends of a piece if they belong to one motion.
    pairs = np.flatnonzero(rows[1:] == rows[:-1])
    rows, begin, end = rows[pairs], times[pairs], times[pairs + 1]
    middles = first[rows] + (0.5 * (begin + end))[:, None] * (last - first)[rows]
    cells = np.clip(np.floor(middles), 0, np.subtract(grid.shape, 1)).astype(np.int64)
    is_far = np.any((middles < -1.0) | (middles > np.add(grid.shape, 1)), axis=1)
    steps = rotations._steps_between(starts, ends)
    points = []
    for time in (begin, end):
        q = rotations._add_steps(starts[rows], steps[rows] * time[:, None])
        q = np.where((time == 0.0)[:, None], starts[rows], q)
        points.append(np.where((time == 1.0)[:, None], ends[rows], q))
    return Pieces(motions[rows], cells // tile, is_far, *points)


def _split_half_turns(rotations: Rotations, dim: int, starts: Floats, ends: Floats) -> tuple[Ints, Floats, Floats]:
    """Replace each motion by half a turn by its two arcs, each in two halves.

    Returns the index of the motion of each part, and the ends of the parts.
    """
    steps = rotations._steps_between(starts, ends)
    angles = np.linalg.norm(steps[:, dim:], axis=1)
    half, rest = np.flatnonzero(angles >= HALF_TURN), np.flatnonzero(angles < HALF_TURN)
    motions, begin, end = [rest], [starts[rest]], [ends[rest]]
    other = steps[half].copy()
    other[:, dim:] *= (1.0 - 2.0 * math.pi / angles[half])[:, None]
    for arc in (steps[half], other):
        middle = rotations._add_steps(starts[half], 0.5 * arc)
        motions += [half, half]
        begin += [starts[half], middle]
        end += [middle, ends[half]]
    return np.concatenate(motions), np.concatenate(begin), np.concatenate(end)


def _find_cuts(grid: Grid, tile: Sequence[int], first: Floats, last: Floats) -> tuple[Ints, Floats]:
    """Return the row and the parameter of each cut of motions, with those of their two ends.

    Motions lead from ``first`` to ``last``, positions in cells of shape (n, d).
    """
    every = np.arange(len(first))
    rows, times = [every, every], [np.zeros(len(first)), np.ones(len(first))]
    for axis, (side, n) in enumerate(zip(tile, grid.shape, strict=True)):
        borders = np.array([-1.0, *range(side, n, side), n + 1.0])
        start, stop = first[:, axis], last[:, axis]
        passed = [np.searchsorted(borders, position, side="right") for position in (start, stop)]
        low, count = np.minimum(*passed), np.abs(np.subtract(*passed))
        row = np.repeat(every, count)
        border = np.arange(len(row)) + np.repeat(low - np.cumsum(count) + count, count)
        rows.append(row)
        times.append(np.clip((borders[border] - start[row]) / (stop - start)[row], 0.0, 1.0))
    return np.concatenate(rows), np.concatenate(times)
