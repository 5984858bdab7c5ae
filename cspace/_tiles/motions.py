"""Motions cut into pieces that the tiles of a map prove.

**Statement.** *A motion is free if each of its pieces is proven free, by the part of the tile that
the piece begins in.*

**Proof.** Positions are in cells. The motion leads from p to q, straight in position, while the
rotation takes the shorter arc. It is cut at evenly spaced parameters 0 = t_0 < t_1 < ... = 1. Piece
i is the motion between the configurations that are computed for t_i and t_(i+1).

1. *Each point of the motion is near a point of a piece.* A coordinate at t_i is ``p + t (q - p)``,
   rounded three times. Coordinates are below 2^23 cells, so its error is below 2^-28 cells, and
   that of its rotation is below 1e-14 rad. A piece and the motion between the same parameters are
   both straight, so they differ by no more anywhere. It does not matter that t_i is rounded.
2. *A part proves more than the piece.* It proves that all closed cells within SLACK of the piece
   are FREE, at all rotations within ANGLE_SLACK, except for the rounding of its look-up. That
   rounding, that of the part's lower corner, and the error of 1. are together below SLACK, 2^-26
   cells, and below ANGLE_SLACK, 1e-9 rad.
3. *The part has those cells.* A piece begins in the interior of its tile, and is shorter than the
   halo by a cell or more along each axis. So it stays a cell away from the border of the part,
   except where that is the border of the grid. There, a motion in the closed grid ignores the cells
   outside, as in memory: the cells in the grid contain it. A motion that leaves the grid is proven
   by windows that have two more cells on every side of its pieces, or by the frame, which is the
   map of the space outside, if a piece begins more than a halo outside and so touches no cell of
   the grid.
4. *Arcs.* The rotation of a piece is part of that of the motion and less than half a turn, so the
   shorter arc of the piece follows it. If the motion turns by half a turn, up to rounding, both
   arcs are the shorter one. Then it is two motions, one along each arc, each in two pieces or more.
   ∎
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from cspace import Grid, Rotations
from cspace.inside import ANGLE_SLACK, Floats, Ints, number_parts

HALF_TURN: Final = math.pi - 4.0 * ANGLE_SLACK
"""Smallest angle, radians, at which rounding may decide which arc is shorter, so that a motion must
be free along both arcs."""

TINY_ARC_SLACK: Final = 3.9e-9
"""If 1 less the cosine of two quaternions is below this, the look-up of edges treats them as equal,
in spite of rounding: it does so up to 4e-9."""


def cut_motions(
    grid: Grid, rotations: Rotations, longest: float, starts: Floats, ends: Floats
) -> tuple[Ints, Floats, Floats]:
    """Cut motions into pieces of at most ``longest`` cells along each axis.

    Motions lead from ``starts`` to ``ends``, shape (n, size). Returns the index of the motion that
    each piece belongs to, and the starts and ends of the pieces.
    """
    dim = grid.dim
    starts = rotations.make_canonical(starts)
    ends = rotations.make_canonical(ends)
    steps = rotations.steps_between(starts, ends)
    angles = np.linalg.norm(steps[:, dim:], axis=1)
    half_turns = np.flatnonzero(angles >= HALF_TURN)
    # A half turn has a second arc, in the opposite direction by 2 pi less its angle.
    other_arcs = steps[half_turns]
    other_arcs[:, dim:] *= (1.0 - 2.0 * math.pi / angles[half_turns])[:, np.newaxis]
    # An arc for each motion, then the second arcs of half turns.
    motion_of_arc = np.concatenate([np.arange(len(starts)), half_turns])
    steps = np.concatenate([steps, other_arcs])
    cells = np.abs(steps[:, :dim]).max(axis=1) / grid.spacing
    counts = np.maximum(np.ceil(cells / longest), 1).astype(np.int64)
    counts[np.isin(motion_of_arc, half_turns)] += 1  # so that a piece turns by less than pi
    # For each piece: its arc, its number within the arc, and its motion.
    arc_of_piece, number = number_parts(counts)
    motions = motion_of_arc[arc_of_piece]

    def interpolate(cuts: Ints) -> Floats:
        """Return the configuration of each piece at a cut of its arc."""
        shares = cuts / counts[arc_of_piece]
        return rotations.add_steps(starts[motions], steps[arc_of_piece] * shares[:, np.newaxis])

    first = interpolate(number)
    last = interpolate(number + 1)
    if len(rotations.names) == 4:
        # OMPL's rotation may jump between nearly equal quaternions, so each piece has all of it.
        cosines = np.abs((starts[:, dim:] * ends[:, dim:]).sum(axis=1))
        jumps = (cosines > 1.0 - TINY_ARC_SLACK)[motions]
        first[jumps, dim:] = starts[motions[jumps], dim:]
        last[jumps, dim:] = ends[motions[jumps], dim:]
    return motions, first, last
