"""Motions of a robot that has something nearer than its margin, and comes no nearer to it.

The robot is made of convex cores, each grown by a radius, and each taken cell is a disc. In the
robot's frame, the center of a disc moves by the twist. Its distance from a core, negative inside,
is the largest of ``normal @ center - support(normal)`` over all unit normals. So the value of one
normal, that at the start of a piece of the motion, bounds it from below on the piece. A piece ends
before this value begins to fall, unless the disc stays above the margin all along the piece.

A robot that drives straight on beside a wall brings new parts of the wall beside it. So a disc may
also come as near to the line of a side as the nearest disc beside this side is at the start, its
level. Then no disc comes nearer than the margin, than it is, or than that one.

A robot that has the center of a taken cell deep inside is lost: it is somewhere else than it
believes, so no motion of it is proven.

A robot on a floor keeps its heights, so each of its parts meets only the cells of its layers. These
discs and parts are those seen from above, and so are their distances.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import shapely

from cspace._shapes.balls import Balls
from cspace._shapes.layers import Heights, LayeredShape
from cspace._shapes.polygon import Polygons
from cspace._support.arrays import Floats, Ints
from cspace.errors import InputError

if TYPE_CHECKING:
    from cspace._record.contents import Contents
    from cspace._shapes.shape import ExactShape

CELL_REACH: Final = 0.7072
"""Radius of a disc that covers a cell of the plane, in cells, rounded up."""

MAX_NEAR_CELLS: Final = 1 << 20
"""Largest number of cells around a robot; no motion near more is proven."""

FARTHEST_CELL: Final = 2.0**31
"""Number of cells from a grid's corner beyond which rounding could move a cell out of its disc."""

PIECES: Final = 1024
"""Number of pieces of a motion, of equal length, below which a piece ends the proof."""

STRAIGHT_ROUNDING: Final = 1e-12
"""Rounding of the rate of a distance from a straight motion, relative to the speed."""


LEVEL_ROUNDING: Final = 1e-12
"""Rounding of heights that are equal, metres."""

HULL_ROUNDING: Final = 1e-5
"""Distance from a convex polygon, metres, within which its hull may differ by rounding."""

LOST_DEPTH: Final = 0.5
"""Share of the depth of its deepest part: a robot with a taken cell deeper inside is lost."""

CORNER_ROUNDING: Final = 1e-9
"""Distance from a corner, metres, below which rounding would turn its direction."""


class Core(NamedTuple):
    """A convex part of a robot.

    Attributes
    ----------
    corners : ndarray of float64, shape (k, 2)
        Of a convex polygon, counterclockwise, or a single point; metres.
    radius : float
        By which the core is grown, metres.
    """

    corners: Floats
    radius: float


class RobotPart(NamedTuple):
    """Cores that meet the same layers of a scene.

    Attributes
    ----------
    cores : list of Core
    layers : list of int or None
        Layers of a workspace in space; None in the plane.
    """

    cores: list[Core]
    layers: list[int] | None


class Gaps(NamedTuple):
    """Gaps of n points from a polygon with k sides, or from a point.

    Attributes
    ----------
    distances : ndarray of float64, shape (n,)
        Metres, negative inside.
    directions : ndarray of float64, shape (n, 2)
        Unit normals along which the distances rise fastest.
    sides : ndarray of int64, shape (n,)
        The side that is nearest; -1 if a corner is.
    heights : ndarray of float64, shape (n, k)
        Distances from the line of each side, negative inside; k is 0 for a point.
    """

    distances: Floats
    directions: Floats
    sides: Ints
    heights: Floats


def split_robot(contents: Contents) -> list[RobotPart]:
    """Return the convex parts of a map's robot; InputError if a part is not convex."""
    grid, shape = contents.workspace.grid, contents.robot.shape
    heights = Heights.of(grid, contents.floor)
    if heights is None:
        return [RobotPart(split_shape(shape.outer), None)]
    parts = LayeredShape(shape, heights, grid.spacing).layers_of_parts
    return [RobotPart(split_shape(part), layers) for part, layers in parts.items()]


def describe_floor_parts(contents: Contents) -> dict[str, str]:
    """Return the attribute ``floor_parts`` of a saved map, for gates in C++.

    It is left out without a floor, or if a part of the robot is not convex.
    """
    if contents.floor is None:
        return {}
    try:
        parts = split_robot(contents)
    except InputError:
        return {}
    lists = []
    for cores, layers in parts:
        head = [len(layers or ()), *(layers or ())]
        lists += [[*head, core.radius, *core.corners.ravel().tolist()] for core in cores]
    return {"floor_parts": json.dumps(lists)}


def split_shape(shape: ExactShape) -> list[Core]:
    """Return the convex parts of a plane shape; InputError if a part is not convex."""
    if isinstance(shape, Balls):
        return [
            Core(center[np.newaxis], radius)
            for center, radius in zip(shape.centers, shape.radii.tolist(), strict=True)
        ]
    geometries = shape.geometries if isinstance(shape, Polygons) else ()
    hulls = shapely.convex_hull(geometries)
    near = shapely.buffer(geometries, HULL_ROUNDING)
    if not len(hulls) or not shapely.covers(near, hulls).all():
        problem = "has a part that is not convex"
        rule = "leaving is proven for discs and convex polygons, which may overlap"
        raise InputError("robot", problem, rule)
    rings = shapely.orient_polygons(hulls)
    return [Core(shapely.get_coordinates(ring)[:-1], 0.0) for ring in rings]


def find_leaving_seconds(
    contents: Contents,
    parts: Sequence[RobotPart],
    q: Floats,
    twist: Floats,
    seconds: float,
    tracking: Floats,
) -> float:
    """Return for how long, at most ``seconds``, a twist comes no nearer to anything.

    It is 0 if the robot is lost. ``parts`` are those of :func:`split_robot`. Distances above the
    margin and the reach of ``tracking``, shape (3,), may fall to these.
    """
    all_cores = [core for part in parts for core in part.cores]
    size = max((_find_reach(core) for core in all_cores), default=0.0)
    # A point of the robot moves by at most its distance from the origin for each radian.
    stray = math.hypot(tracking[0], tracking[1]) + size * min(float(tracking[2]), 2.0)
    margin = contents.margin + stray + CELL_REACH * contents.workspace.grid.spacing
    reach = size + margin + abs(float(twist[0])) * seconds
    cos, sin = math.cos(q[2]), math.sin(q[2])
    least = seconds / PIECES
    lost_depth = LOST_DEPTH * max(map(_find_depth, all_cores), default=0.0)
    for cores, layers in parts:
        centers = list_taken_cells(contents, layers, q, reach)
        if centers is None:
            return 0.0
        offsets = (centers - q[:2]) @ np.array([(cos, -sin), (sin, cos)])
        for core in cores:
            distances = measure_gaps(core.corners, offsets).distances - core.radius
            if (distances < -lost_depth).any():
                return 0.0
            seconds = follow(core, offsets, margin, twist, seconds, least)
    return seconds


def _find_depth(core: Core) -> float:
    """Return the depth of the mean of a core's corners below its surface, metres."""
    heights = measure_gaps(core.corners, core.corners.mean(axis=0, keepdims=True)).heights
    return core.radius - float(heights.max()) if heights.size else core.radius


def _find_reach(core: Core) -> float:
    """Return the largest distance of a core's points from the origin, metres."""
    return float(np.hypot(*core.corners.T).max()) + core.radius


def list_taken_cells(
    contents: Contents, layers: list[int] | None, q: Floats, reach: float
) -> Floats | None:
    """Return centers of taken cells within ``reach`` along each axis; None if too many or too far.

    With ``layers``, cells are those seen from above. Cells outside the grid are taken unless the
    outside is free.
    """
    grid = contents.grid
    lower, shape = np.asarray(grid.lower), np.asarray(grid.shape)
    if not 2.0 * reach / grid.spacing + 2.0 <= math.sqrt(MAX_NEAR_CELLS):
        return None
    if not np.abs(q[:2] - lower).max() / grid.spacing <= FARTHEST_CELL:
        return None
    first = np.floor((q[:2] - reach - lower) / grid.spacing).astype(np.int64)
    stop = np.floor((q[:2] + reach - lower) / grid.spacing).astype(np.int64) + 1
    taken = np.full(stop - first, contents.outside != "free")
    low, high = np.clip(first, 0, shape), np.clip(stop, 0, shape)
    inside = tuple(map(slice, low - first, high - first))
    near = contents.workspace.outer[tuple(map(slice, low, high))]
    taken[inside] = near if layers is None else near[:, :, layers].any(axis=2)
    centers: Floats = lower + (first + np.argwhere(taken) + 0.5) * grid.spacing
    return centers


def follow(
    core: Core, points: Floats, margin: float, twist: Floats, seconds: float, least: float
) -> float:
    """Return for how long, at most ``seconds``, no point comes nearer to a core.

    Points, shape (n, 2), are given in the robot's frame. ``margin`` is that of their distances. A
    piece shorter than ``least`` seconds ends the proof.
    """
    v, omega = float(twist[0]), float(twist[1])
    times = np.zeros(len(points))
    needed = margin + core.radius
    normals = find_normals(core.corners)
    levels = None
    if omega == 0.0 and len(normals):
        levels = _find_levels(core, points, needed)
    while len(points):
        places = see_from(v, omega, times, points)
        gaps = measure_gaps(core.corners, places)
        flows = _find_flows(v, omega, places)
        speeds = np.hypot(*flows.T)
        # Normals turn with the point around a single corner, which moves slower than the point.
        moving = flows if len(normals) else _find_flows(v, omega, core.corners)
        bends = abs(omega) * np.hypot(*moving.T)
        rounding = STRAIGHT_ROUNDING * speeds if omega == 0.0 else 0.0
        rates = (gaps.directions * moving).sum(axis=1) + rounding
        above = gaps.distances - needed
        if levels is not None:
            over = gaps.heights - levels
            above = np.maximum(above, over.max(axis=1))
            # Behind the level of a side, the distance is that from the side.
            along = np.where(over >= -LEVEL_ROUNDING, flows @ normals.T, -math.inf)
            rates = np.maximum(rates, along.max(axis=1) + rounding)
        with np.errstate(all="ignore"):
            steps = np.where(above > 0.0, above / speeds, 0.0)
            rising = np.where(bends > 0.0, rates / bends, math.inf)
        steps = np.where(rates >= 0.0, np.maximum(steps, rising), steps)
        steps[speeds == 0.0] = math.inf
        is_proven = (steps >= least) & (steps > 0.0)
        seconds = min(seconds, float(times[~is_proven].min(initial=math.inf)))
        times += steps
        goes_on = is_proven & (times < seconds)
        points, times = points[goes_on], times[goes_on]
    return seconds


def _find_levels(core: Core, points: Floats, needed: float) -> Floats:
    """Return the smallest distance of points beside each side, at most ``needed``, shape (k,)."""
    gaps = measure_gaps(core.corners, points)
    levels = np.full(len(core.corners), needed)
    is_beside = gaps.sides >= 0
    np.minimum.at(levels, gaps.sides[is_beside], gaps.distances[is_beside])
    return levels


def see_from(v: float, omega: float, times: Floats, points: Floats) -> Floats:
    """Return points, shape (n, 2), as the robot sees them that has driven for ``times``, (n,)."""
    half = 0.5 * omega * times
    chord = v * times * np.sinc(half / math.pi)
    x = points[:, 0] - chord * np.cos(half)
    y = points[:, 1] - chord * np.sin(half)
    cos, sin = np.cos(omega * times), np.sin(omega * times)
    return np.stack([cos * x + sin * y, cos * y - sin * x], axis=1)


def find_normals(corners: Floats) -> Floats:
    """Return the unit normals of a polygon's sides, shape (k, 2); of a point, none."""
    if len(corners) == 1:
        return np.empty((0, 2))
    edges = np.roll(corners, -1, axis=0) - corners
    turned = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    normals: Floats = turned / np.sqrt((edges**2).sum(axis=1))[:, np.newaxis]
    return normals


def measure_gaps(corners: Floats, points: Floats) -> Gaps:
    """Measure the gaps of points, shape (n, 2), from a convex polygon or a point."""
    edges = np.roll(corners, -1, axis=0) - corners
    squares = (edges**2).sum(axis=1)
    offsets = points[:, np.newaxis] - corners
    with np.errstate(all="ignore"):  # a point has no edge, and no direction from itself
        shares = np.clip((offsets * edges).sum(axis=2) / squares, 0.0, 1.0)
        ways = offsets - np.where(squares > 0.0, shares, 0.0)[..., np.newaxis] * edges
        lengths = np.hypot(ways[..., 0], ways[..., 1])
        rows = np.arange(len(points))
        nearest = lengths.argmin(axis=1)
        distances = lengths[rows, nearest]
        directions = np.nan_to_num(ways[rows, nearest] / distances[:, np.newaxis])
    normals = find_normals(corners)
    if not len(normals):
        return Gaps(distances, directions, np.full(len(points), -1), np.empty((len(points), 0)))
    heights = (offsets * normals).sum(axis=2)
    highest = heights.argmax(axis=1)
    is_inside = heights[rows, highest] <= CORNER_ROUNDING
    # The normal of a side has no rounding of a short distance.
    share = shares[rows, nearest]
    sides = np.where((share > 0.0) & (share < 1.0), nearest, -1)
    sides[is_inside] = highest[is_inside]
    is_beside = sides >= 0
    directions[is_beside] = normals[sides[is_beside]]
    distances[is_beside] = heights[rows, sides][is_beside]
    return Gaps(distances, directions, sides, heights)


def _find_flows(v: float, omega: float, points: Floats) -> Floats:
    """Return the velocities of points, shape (n, 2), as the robot sees them."""
    return np.stack([omega * points[:, 1] - v, -omega * points[:, 0]], axis=1)
