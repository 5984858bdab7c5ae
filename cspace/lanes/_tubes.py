"""Proofs of tubes: straight motions with all configurations near them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple, cast

import numpy as np

from cspace._bodies import ADVANCE_FACTOR, MAX_DISTANCES_PER_EDGE
from cspace._exact.proofs import BoundaryTrees, fraction_apart, make_scratch, reference_point
from cspace._queries.edges import position_along
from cspace._queries.points import configuration_in, is_usable, neighborhood_is_free
from cspace._record.cells import Map
from cspace._rotations.lookup import arc_angle_and_error, arc_count, matrix_rows, rotation_along
from cspace._support.arrays import Bools, Floats, Ints, Numbers, Row
from cspace._support.compiling import internal, kernel
from cspace._support.vectors import dot, minus

if TYPE_CHECKING:
    from cspace._configuration_map import ConfigurationMap
    from cspace._space import CSpace
    from cspace._tiles.tiled_space import TiledCSpace

Geometry = tuple[BoundaryTrees, Ints] | None
"""Boundaries of robot and obstacles, and scratch memory; None if only cells prove tubes."""

MAX_PART_CELLS: Final = 4.0
"""Length of the longest part of a tube that is proven at once, in cells."""

MIN_PART_CELLS: Final = 1.0 / 16.0
"""Length of the shortest part of a tube that cells prove at once, in cells."""

MIN_PART_SHARE: Final = 1e-6
"""Length of the shortest part that the geometry proves at once, as a share of the tube."""


class Tubes(NamedTuple):
    """Straight motions, each with all configurations near it.

    Attributes
    ----------
    starts, ends : ndarray of float64, shape (n, size)
    drifts : ndarray of float64, shape (n,)
        Distance, metres, up to which a position near the motion belongs to the tube.
    turns : ndarray of float64, shape (n,)
        Angle, radians, up to which a yaw near that of the motion belongs to the tube.
    """

    starts: Floats
    ends: Floats
    drifts: Floats
    turns: Floats

    def take(self, rows: Ints | Bools) -> Tubes:
        """Return some of the tubes."""
        return Tubes(*(column[rows] for column in self))


def open_part(space: ConfigurationMap, points: Floats, reach: float) -> CSpace:
    """Return the map in memory around points, shape (n, d), as far as ``reach`` from them."""
    if space.in_memory:
        return cast("CSpace", space)
    more = reach + 2.0 * space.grid.spacing
    lower, upper = points.min(axis=0) - more, points.max(axis=0) + more
    # A point beside the map has a window at its border.
    least, most = np.array(space.grid.lower), np.array(space.grid.upper)
    tiles = cast("TiledCSpace", space)
    return tiles.window(np.minimum(lower, most - more), np.maximum(upper, least + more))


def tubes_are_free(
    space: ConfigurationMap, tubes: Tubes, exact: bool, is_joined: bool = False
) -> Bools:
    """Return whether each tube is proven free, shape (n,).

    With ``exact``, the geometry decides what cells do not. With ``is_joined``, every tube touches a
    configuration that is proven free, so that no containment needs a test.
    """
    out = np.zeros(len(tubes.drifts), dtype=np.bool_)
    if not space.in_memory:
        # A map in tiles has no array for kernels, so each tube opens the part around it.
        for k in range(len(out)):
            tube = tubes.take(np.array([k]))
            ends = np.concatenate([tube.starts, tube.ends])[:, : space.dim]
            part = open_part(space, ends, float(tube.drifts[0]))
            out[k] = tubes_are_free(part, tube, exact, is_joined)[0]
        return out
    part = open_part(space, tubes.starts, 0.0)
    geometry = None
    if exact:
        geometry = part._boundary_proofs().boundaries, make_scratch().node_pairs
    starts, ends, drifts, turns = map(np.ascontiguousarray, tubes)
    prove_tubes(part._kernel_map, geometry, starts, ends, drifts, turns, out)
    if exact and not is_joined:
        # No boundaries meet in a tube, so that its start decides containment.
        for row in np.flatnonzero(out & ~part.is_free(starts)).tolist():
            out[row] = part._boundary_proofs().is_outside(*starts[row].tolist())
    return out


@kernel
def prove_tubes(
    map_: Map,
    geometry: Geometry,
    starts: Floats,
    ends: Floats,
    drifts: Floats,
    turns: Floats,
    out: Bools,
) -> None:
    """Write which tubes are proven; see :class:`Tubes` for the arrays.

    With a geometry, a tube is proven if the boundaries of robot and obstacles stay apart in it.
    """
    for k in range(len(out)):
        p0, r0 = configuration_in(map_, starts, k)
        p1, r1 = configuration_in(map_, ends, k)
        out[k] = False
        # Of two turns that are equally short, neither is the one.
        if is_usable(p0, r0) and is_usable(p1, r1) and arc_count(r0, r1) == 1:
            out[k] = tube_is_free(map_, geometry, p0, r0, p1, r1, drifts[k], turns[k])


@internal
def tube_is_free(
    map_: Map,
    geometry: Geometry,
    p0: Row,
    r0: Numbers,
    p1: Row,
    r1: Numbers,
    drift: float,
    turn: float,
) -> bool:
    """Return True if a tube is proven free, part by part.

    An unproven part is halved until its middle is not free, or it is too short.
    """
    step = minus(p1, p0)
    length = math.sqrt(dot(step, step))
    angle, error = arc_angle_and_error(r0, r1, 0)
    longest = 1.0 / math.ceil(max(length / (MAX_PART_CELLS * map_.spacing), angle, 1.0))
    shortest = MIN_PART_SHARE
    if geometry is None:
        shortest = MIN_PART_CELLS * map_.spacing / max(length, map_.spacing)
    proven = 0.0
    part = longest
    unproven = 0
    while proven < 1.0:
        share = min(part, 1.0 - proven)
        is_last = part >= 1.0 - proven
        center = proven + 0.5 * share
        position = position_along(p0, p1, center)
        rotation = rotation_along(r0, r1, 0, center)
        half = 0.5 * share
        spare = turn + error
        if part_is_free(map_, geometry, position, rotation, step, half, angle, drift, spare):
            if is_last:
                return True
            proven += share
            part = min(2.0 * part, longest)
            continue
        unproven += 1
        if share <= shortest or unproven == MAX_DISTANCES_PER_EDGE:
            return False
        if not part_is_free(map_, geometry, position, rotation, step, 0.0, angle, drift, spare):
            return False
        part = half
    return True


@internal
def part_is_free(
    map_: Map,
    geometry: Geometry,
    position: Row,
    rotation: Numbers,
    step: Row,
    half: float,
    angle: float,
    drift: float,
    spare: float,
) -> bool:
    """Return True if a part of a tube is proven free.

    From its middle, the part extends by a share ``half`` of the tube to both sides.
    """
    length = math.sqrt(dot(step, step))
    turn = half * angle + spare
    if neighborhood_is_free(map_, position, rotation, half * length + drift, turn):
        return True
    # The branch of the geometry is left out if there is none.
    if geometry is None:
        return False
    boundaries, node_pairs = geometry
    scale = boundaries.scale
    place = reference_point(map_, position, scale)
    x, y, z = reference_point(map_, step, scale)
    ahead = half * x, half * y, half * z
    enough = 1.0 / ADVANCE_FACTOR
    proven = fraction_apart(
        boundaries,
        place,
        matrix_rows(rotation),
        ahead,
        turn,
        scale * drift,
        enough,
        node_pairs,
    )
    return proven >= enough
