"""Outlines of what a robot sweeps on lanes and nodes, and poses at which two robots touch.

A piece is an even motion with a turn w, at yaws up to b beside it. A point of the robot at a
distance r from the reference point leaves the chords between its places at the ends and bounds of
the piece by at most ``r (w^2 + (2 b)^2) / 8``, the error of linear interpolation. So the convex
hull of the robot's convex parts at these poses, grown by that, holds the robot all along.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from cspace.inside import (
    Balls,
    Bools,
    Cores,
    ExactShape,
    Floats,
    Ints,
    number_parts,
)
from cspace.lanes._collisions import place_points
from cspace.lanes._lane_motions import list_legs, list_motions, list_yaws
from cspace.lanes._route_graph import RouteGraph

if TYPE_CHECKING:
    from cspace.inside import ConfigurationMap

ROUNDING: Final = 1e-9
"""Distance, metres, that covers the rounding of placed robots and of outlines near the origin."""

MAX_TURN: Final = math.radians(5.0)
"""Largest turn of a piece, radians."""

RING_SIDES: Final = ((1e-6, 4), (0.01, 8), (math.inf, 64))
"""Largest growths, metres, and the numbers of sides of polygons around their circles."""

MAX_HULLS: Final = 2048
"""Number of hulls that are made at once."""

TURN_SLACK: Final = 1e-9
"""Angle, radians, by which a turn may exceed half a turn and still be the shorter way."""

SHARES: Final = 9
"""Number of poses of a piece among which the deepest is searched, in each round."""


class SweepPieces(NamedTuple):
    """Even motions of a robot on its elements: lanes, then nodes.

    Attributes
    ----------
    starts, ends : ndarray of float64, shape (n, 3)
        Poses: x, y, yaw.
    half_widths : ndarray of float64, shape (n,)
        Largest deviation of the yaw, radians.
    growths : ndarray of float64, shape (n,)
        Distance of the robot from the motion, metres.
    elements : ndarray of int64, shape (n,)
    on_lane : ndarray of bool, shape (n,)
        False for the chord of a curve, whose ends alone lie on the lane.
    """

    starts: Floats
    ends: Floats
    half_widths: Floats
    growths: Floats
    elements: Ints
    on_lane: Bools

    def take(self, rows: Ints | Bools) -> SweepPieces:
        """Return some of the pieces."""
        return SweepPieces._make(column[rows] for column in self)


class Body:
    """A robot in the plane: convex parts that hold it, and shapes that lie in it.

    Attributes
    ----------
    hulls : list of tuple
        Corners, shape (k, 2), and radius of each convex part, metres.
    cores : Cores
        Parts of a shape that lies in the robot.
    lever : float
        Largest distance of a point from the reference point, metres.
    margin : float
        Growth of the robot, metres.
    reference_gap : float
        Distance of the robot from its reference point, metres; not above zero inside.
    """

    def __init__(self, space: ConfigurationMap) -> None:
        """Split the robot of a map into parts."""
        shape = space.drawn_robot.shape
        self.hulls = list(_list_hulls(shape.outer))
        self.cores = Cores(shape.inner)
        self.lever = space.robot.shape.lever
        self.margin = space.margin
        self.reference_gap = min(
            shapely.distance(shapely.Point(0.0, 0.0), shapely.MultiPoint(corners).convex_hull)
            - radius
            for corners, radius in self.hulls
        )

    def measure_gaps(self, poses: Floats, points: Floats) -> Floats:
        """Return points' distances from posed robots; negative inside, shape (n,)."""
        offsets = points - poses[:, :2]
        cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        x, y = offsets.T
        x, y = cos * x + sin * y, cos * y - sin * x
        gaps = np.full(len(poses), math.inf)
        for geometry, radius in self.cores.parts:
            border = np.full(len(poses), math.inf)
            for start, step in zip(*_list_sides(geometry), strict=True):
                np.minimum(border, _measure_to_segment(x, y, start, step), out=border)
            border = np.sqrt(border)
            inside = shapely.contains_xy(geometry, x, y)
            np.minimum(gaps, np.where(inside, -border, border) - radius, out=gaps)
        return gaps


def _list_sides(geometry: BaseGeometry) -> tuple[Floats, Floats]:
    """Return starts and steps of a polygon's sides, or a point's."""
    rings = [
        shapely.get_coordinates(ring)
        for part in shapely.get_parts(geometry)
        for ring in (shapely.get_rings(part) if part.geom_type == "Polygon" else [part])
    ]
    starts = np.concatenate([points[: max(1, len(points) - 1)] for points in rings])
    ends = np.concatenate([points[min(1, len(points) - 1) :] for points in rings])
    return starts, ends - starts


def _measure_to_segment(x: Floats, y: Floats, start: Floats, step: Floats) -> Floats:
    """Return the squared distances of points from a segment, shape (n,)."""
    dx, dy = x - start[0], y - start[1]
    length = float(step @ step)
    if length > 0.0:
        share = ((step[0] / length) * dx + (step[1] / length) * dy).clip(0.0, 1.0)
        dx, dy = dx - share * step[0], dy - share * step[1]
    return np.asarray(dx * dx + dy * dy)


def _list_hulls(shape: ExactShape) -> Iterator[tuple[Floats, float]]:
    """Yield corners and radius of convex parts that hold a shape."""
    if isinstance(shape, Balls):
        yield from zip(shape.centers[:, np.newaxis], shape.radii.tolist(), strict=True)
        return
    # Share of the area of a polygon up to which its hull stands for it.
    near_convex = 1e-6
    for part in shapely.get_parts(shape.outline):
        hull = shapely.convex_hull(part)
        parts = [hull]
        if part.area < (1.0 - near_convex) * hull.area:
            triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(part))
            is_whole = abs(shapely.area(triangles).sum() - part.area) <= near_convex * part.area
            parts = triangles.tolist() if is_whole else parts
        for each in parts:
            yield np.unique(shapely.get_coordinates(each), axis=0), 0.0


# ---- pieces --------------------------------------------------------------------------------------


def list_pieces(space: ConfigurationMap, graph: RouteGraph) -> SweepPieces:
    """List all lanes' pieces, then the nodes' with their turns."""
    motions = list_motions(space, graph)
    lever = space.robot.shape.lever if space.rotations.names else 0.0
    lanes = SweepPieces(
        _with_yaw(motions.starts),
        _with_yaw(motions.ends),
        motions.spares / lever if lever else np.zeros(len(motions.lanes)),
        motions.growths,
        motions.lanes,
        motions.on_lane,
    )
    nodes = _list_turns(space, graph)
    return _cut_turns(SweepPieces._make(map(np.concatenate, zip(lanes, nodes, strict=True))))


def _with_yaw(points: Floats) -> Floats:
    """Return configurations with a yaw, zero by default."""
    return np.column_stack([points, np.zeros((len(points), 3 - points.shape[1]))])


def _list_turns(space: ConfigurationMap, graph: RouteGraph) -> SweepPieces:
    """List each node's turns on the spot, or its pose."""
    rows = []
    deviations = list_deviations(graph)[len(graph.lanes) :].tolist()
    for node, intervals in enumerate(_list_node_yaws(space, graph)):
        place = graph._places[node]
        number = len(graph.lanes) + node
        for low, high in intervals:
            rows.append((*place, low, *place, high, deviations[node], number))
    table = np.array(rows, dtype=np.float64).reshape(-1, 8)
    is_on = np.ones(len(table), dtype=np.bool_)
    elements = table[:, 7].astype(np.int64)
    return SweepPieces(table[:, :3], table[:, 3:6], 0.0 * table[:, 6], table[:, 6], elements, is_on)


def list_deviations(graph: RouteGraph) -> Floats:
    """List how far a robot may stray from each element, metres.

    Lanes come first, then nodes. A node has the largest deviation of the lanes that end there.
    """
    lanes = np.array([lane.deviation for lane in graph.lanes], dtype=np.float64)
    nodes = np.zeros(len(graph.names))
    ends = np.array([(lane.start, lane.end) for lane in graph.lanes], dtype=np.int64)
    np.maximum.at(nodes, ends.reshape(-1, 2), lanes[:, np.newaxis])
    return np.concatenate([lanes, nodes])


def _list_node_yaws(space: ConfigurationMap, graph: RouteGraph) -> list[list[tuple[float, float]]]:
    """List the yaws of each node's turns, as intervals.

    The robot turns the shorter way between any two yaws that its lanes and the node give it; all
    around if a lane allows any yaw, or if nothing gives one.
    """
    if not space.rotations.names:
        return [[(0.0, 0.0)]] * len(graph.names)
    yaws = [list(stops) for stops in graph._stops]
    for lane in graph.lanes:
        legs = list_legs(graph, lane)
        ways = list_yaws(graph, lane)
        is_any = [math.nan] * (not ways)
        yaws[lane.start] += [way.yaws(legs[0])[0] for way in ways] + is_any
        yaws[lane.end] += [way.yaws(legs[-1])[1] for way in ways] + is_any
    return [_join_yaws(np.array(found)) for found in yaws]


def _join_yaws(yaws: Floats) -> list[tuple[float, float]]:
    """Return the intervals that shorter ways between yaws cover."""
    if not len(yaws) or np.isnan(yaws).any():
        return [(-math.pi, math.pi)]
    # The shortest arc over a gap between neighbours joins these two.
    lows = np.unique(np.mod(yaws, math.tau))
    highs = np.append(lows[1:], lows[0] + math.tau)
    is_short = highs - lows <= math.pi + TURN_SLACK
    stands = [(low, low) for low in lows.tolist()] * (not is_short.any())
    return stands + list(zip(lows[is_short].tolist(), highs[is_short].tolist(), strict=True))


def _cut_turns(pieces: SweepPieces) -> SweepPieces:
    """Cut pieces that turn too far for one hull."""
    steps = pieces.ends - pieces.starts
    counts = np.ceil(np.abs(steps[:, 2]) / MAX_TURN - TURN_SLACK)
    counts = np.maximum(counts, 1.0).astype(np.int64)
    owners, numbers = number_parts(counts)
    cut = pieces.take(owners)
    begins, ends = (
        ((numbers + more) / counts[owners])[:, np.newaxis] * steps[owners] for more in (0, 1)
    )
    is_last = numbers + 1 == counts[owners]
    lasts = np.where(is_last[:, np.newaxis], cut.ends, cut.starts + ends)
    return cut._replace(starts=cut.starts + begins, ends=lasts)


# ---- outlines ------------------------------------------------------------------------------------


def make_outlines(body: Body, pieces: SweepPieces, count: int) -> Any:
    """Make polygons that hold the robot on each element, shape (count,)."""
    sweeps: list[list[BaseGeometry]] = [[] for _ in range(count)]
    cores: list[list[BaseGeometry]] = [[] for _ in range(count)]
    # A yaw deviates on lanes of any yaw alone, and there the robot sweeps discs. Rings sweep no
    # less along a way that is longer than their holes.
    lows, highs = np.full((count, 2), math.inf), np.full((count, 2), -math.inf)
    for points in (pieces.starts[:, :2], pieces.ends[:, :2]):
        np.minimum.at(lows, pieces.elements, points)
        np.maximum.at(highs, pieces.elements, points)
    is_long = (highs - lows).max(axis=1) >= 2.0 * body.reference_gap
    is_any = (pieces.half_widths > 0.0) & is_long[pieces.elements]
    rest = pieces.take(~is_any)
    for elements, points, growths, sides in itertools.chain(
        _place_discs(body, pieces.take(is_any)),
        *(_place_pieces(body, rest, *hull) for hull in body.hulls),
    ):
        slack = Cores.bound_rounding(np.abs(points).max(axis=(1, 2)))
        for lists, hulls in (
            (sweeps, _make_hulls(points, growths + 2.0 * slack, sides)),
            (cores, _make_hulls(points, growths + slack, sides)),
        ):
            for element, hull in zip(elements.tolist(), hulls.tolist(), strict=True):
                lists[element].append(hull)
    return np.array([_unite(*each) for each in zip(sweeps, cores, strict=True)], dtype=object)


def _place_discs(body: Body, pieces: SweepPieces) -> Iterator[tuple[Ints, Floats, Floats, int]]:
    """Yield elements, ends and growths of discs that hold the robot at any yaw."""
    table = np.column_stack(
        [pieces.elements, pieces.starts[:, :2], pieces.ends[:, :2], pieces.growths]
    )
    rows = np.unique(table, axis=0, return_index=True)[1]
    for begin in range(0, len(rows), MAX_HULLS):
        part = pieces.take(rows[begin : begin + MAX_HULLS])
        points = np.stack([part.starts[:, :2], part.ends[:, :2]], axis=1)
        # Number of sides of the polygon around a disc that holds the robot at any yaw.
        yield part.elements, points, part.growths + (body.lever + body.margin), 256


def _place_pieces(
    body: Body, pieces: SweepPieces, corners: Floats, radius: float
) -> Iterator[tuple[Ints, Floats, Floats, int]]:
    """Yield elements, a convex part's placed corners, growths, and sides of rings."""
    turns = np.abs(pieces.ends - pieces.starts)[:, 2]
    bulges = body.lever * (turns**2 + (2.0 * pieces.half_widths) ** 2) / 8.0
    growths = pieces.growths + bulges + (radius + body.margin)
    sides = np.searchsorted([most for most, _ in RING_SIDES], growths)
    kinds = 2 * sides + (pieces.half_widths > 0.0)
    for kind in np.unique(kinds):
        chosen = np.flatnonzero(kinds == kind)
        for begin in range(0, len(chosen), MAX_HULLS):
            rows = chosen[begin : begin + MAX_HULLS]
            part = pieces.take(rows)
            poses = [part.starts, part.ends]
            if kind % 2:
                swing = np.zeros_like(part.starts)
                swing[:, 2] = part.half_widths
                poses = [pose + side for pose in poses for side in (-swing, swing)]
            points = np.concatenate([place_points(corners, pose) for pose in poses], axis=1)
            yield part.elements, points, growths[rows], RING_SIDES[kind // 2][1]


def _make_hulls(points: Floats, growths: Floats, sides: int) -> Any:
    """Return convex hulls of points (n, k, 2), grown by distances."""
    angles = (np.arange(sides) + 0.5) * (math.tau / sides)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1) / math.cos(math.pi / sides)
    rings = growths[:, np.newaxis, np.newaxis] * ring
    grown = points[:, :, np.newaxis] + rings[:, np.newaxis]
    return shapely.convex_hull(shapely.linestrings(grown.reshape(len(points), -1, 2)))


def _unite(sweeps: list[BaseGeometry], cores: list[BaseGeometry]) -> BaseGeometry:
    """Return the union of sweeps, or a hull if rounding harms it."""
    if len(sweeps) == 1:
        return sweeps[0]
    union = shapely.union_all(sweeps)
    shapely.prepare(union)
    if shapely.covers(union, cores).all():
        return union
    return shapely.convex_hull(shapely.geometrycollections(sweeps))


# ---- poses that touch ----------------------------------------------------------------------------


class Sweeper(NamedTuple):
    """A robot with its pieces, in the order of elements, and their outlines.

    Attributes
    ----------
    body : Body
    pieces : SweepPieces
    begins : ndarray of int64, shape (n + 1,)
        First piece of each element.
    deviations : ndarray of float64, shape (n,)
        Distance of the robot from each element, metres.
    outlines : ndarray of shapely geometries, shape (n,)
    """

    body: Body
    pieces: SweepPieces
    begins: Ints
    deviations: Floats
    outlines: Any


def make_sweeper(space: ConfigurationMap, graph: RouteGraph) -> Sweeper:
    """Sweep a robot along the elements of a graph."""
    body = Body(space)
    pieces = list_pieces(space, graph)
    pieces = pieces.take(np.argsort(pieces.elements, kind="stable"))
    count = len(graph.lanes) + len(graph.names)
    begins = np.searchsorted(pieces.elements, np.arange(count + 1))
    outlines = make_outlines(body, pieces, count)
    return Sweeper(body, pieces, begins, list_deviations(graph), outlines)


class Touches(NamedTuple):
    """Poses of two robots for n pairs of elements.

    Attributes
    ----------
    found : ndarray of bool, shape (n,)
        Whether the robots touch at the poses.
    first, second : ndarray of float64, shape (n, 3)
    points : ndarray of float64, shape (n, 2)
        A point of the place.
    """

    found: Bools
    first: Floats
    second: Floats
    points: Floats


def find_touches(
    one: Sweeper, first: Ints, other: Sweeper, second: Ints, distance: float
) -> Touches:
    """Search poses at which two robots are near, by pairs."""
    count = len(first)
    limits = np.full(count, distance + one.body.margin + other.body.margin)
    deviations = one.deviations[first] + other.deviations[second]
    points, common = _choose_points(one.outlines[first], other.outlines[second])
    begins = one.pieces.starts[one.begins[first]], other.pieces.starts[other.begins[second]]
    result = Touches(np.zeros(count, np.bool_), *begins, points.copy())
    pending = np.arange(count)
    # Number of points at which two robots are tried before a pair stays undecided.
    for move in range(6):
        reach = limits[pending] + deviations[pending]
        sides = []
        # Later tries are few, and find places as small as a share of 1e-4 of a lane.
        for sweeper, elements, kept in ((one, first, result.first), (other, second, result.second)):
            queries = elements[pending], points[pending], reach
            sides.append(_find_poses(sweeper, *queries, (move + 1) * (move + 2), kept[pending]))
        (poses, gaps), (others, other_gaps) = sides
        rounding = Cores.bound_rounding(np.abs(points[pending]).max(axis=1, initial=0.0))
        needed = np.maximum(gaps + rounding, 0.0) + np.maximum(other_gaps + rounding, 0.0)
        result.first[pending], result.second[pending] = poses, others
        result.found[pending] = needed <= reach
        left = np.flatnonzero(needed > reach)
        distances, lines = one.body.cores.measure_distances(
            poses[left], other.body.cores, others[left]
        )
        is_close = distances + rounding[left] <= reach[left]
        result.found[pending[left[is_close]]] = True
        pending, lines = pending[left[~is_close]], lines[~is_close]
        if not len(pending):
            break
        if move == 0:
            # The middle of what is common is the deepest point.
            wide = pending[shapely.area(common[pending]) > 0.0]
            circles = shapely.maximum_inscribed_circle(common[wide])
            points[wide] = shapely.get_coordinates(shapely.get_point(circles, 0))
        else:
            points[pending] = lines.mean(axis=1)
    return _approach(one, other, result, limits, one.deviations[first])


def _choose_points(outlines: Any, others: Any) -> tuple[Floats, Any]:
    """Return a point of, or between, two outlines (n, 2)."""
    common = shapely.intersection(outlines, others)
    points = shapely.point_on_surface(common)
    is_apart = shapely.is_empty(points)
    joins = shapely.shortest_line(outlines[is_apart], others[is_apart])
    points[is_apart] = shapely.line_interpolate_point(joins, 0.5, normalized=True)
    return shapely.get_coordinates(points), common


def _approach(
    one: Sweeper, other: Sweeper, touches: Touches, limits: Floats, deviations: Floats
) -> Touches:
    """Move poses within deviations until robots touch, and check it."""
    rows = np.flatnonzero(touches.found)
    first, second = touches.first[rows], touches.second[rows]
    distances, lines = one.body.cores.measure_distances(first, other.body.cores, second)
    steps = lines[:, 1] - lines[:, 0]
    lengths = np.hypot(*steps.T)
    ahead = steps / np.where(lengths > 0.0, lengths, 1.0)[:, np.newaxis]
    missing = np.maximum(distances - limits[rows] + ROUNDING, 0.0) * (distances > limits[rows])
    shares = np.minimum(missing, deviations[rows])
    first[:, :2] += shares[:, np.newaxis] * ahead
    second[:, :2] -= (missing - shares)[:, np.newaxis] * ahead
    distances, lines = one.body.cores.measure_distances(first, other.body.cores, second)
    touches.first[rows], touches.second[rows] = first, second
    touches.points[rows] = lines.mean(axis=1)
    touches.found[rows] = distances <= limits[rows]
    return touches


def _find_poses(
    sweeper: Sweeper, elements: Ints, points: Floats, reach: Floats, rounds: int, poses: Floats
) -> tuple[Floats, Floats]:
    """Return each element's pose nearest to a point, with its gap.

    Each round searches more finely. Gaps are those of :meth:`Body.measure_gaps`; if no pose is
    near, they are infinite, and the pose is that of ``poses``, shape (n, 3), which are changed.
    """
    counts = sweeper.begins[elements + 1] - sweeper.begins[elements]
    queries, numbers = number_parts(counts)
    rows = sweeper.begins[elements][queries] + numbers
    # Points beside the lane are in reach, too, so that each element has a pose.
    # Distance of poses from a point, in levers of the robot, at which they are tried.
    radii = 1.25 * sweeper.body.lever + sweeper.pieces.growths[rows] + reach[queries]
    lows, highs = _find_windows(sweeper.pieces, rows, points[queries], radii)
    near = np.flatnonzero(lows <= highs)
    queries, rows, lows, highs = queries[near], rows[near], lows[near], highs[near]
    # A turn on the spot is so small that its middle comes first.
    moves = (sweeper.pieces.starts != sweeper.pieces.ends)[rows, :2].any(axis=1)
    moves |= ~sweeper.pieces.on_lane[rows]
    lows, highs = np.where(moves, lows, 0.5), np.where(moves, highs, 0.5)
    gaps = np.full(len(elements), math.inf)
    for _ in range(rounds):
        shares, found = _sample_windows(sweeper, rows, points[queries], lows, highs)
        order = np.lexsort((found, queries))
        queries, best = np.unique(queries[order], return_index=True)
        best = order[best]
        spans = np.where(moves[best], (highs - lows)[best] / (SHARES - 1), 0.5)
        rows, found, shares = rows[best], found[best], shares[best]
        better = found < gaps[queries]
        gaps[queries[better]] = found[better]
        poses[queries[better]] = _poses_at(sweeper.pieces, rows[better], shares[better])
        moves, lows, highs = moves[best], np.maximum(shares - spans, 0.0), shares + spans
        highs = np.minimum(highs, 1.0)
    return poses, gaps


def _find_windows(
    pieces: SweepPieces, rows: Ints, points: Floats, radii: Floats
) -> tuple[Floats, Floats]:
    """Return where pieces are near points; low above high if nowhere."""
    starts = pieces.starts[rows, :2]
    steps = pieces.ends[rows, :2] - starts
    squares = (steps**2).sum(axis=1)
    moves = squares > 0.0
    offsets = points - starts
    middles = (offsets * steps).sum(axis=1) / np.where(moves, squares, 1.0)
    aside = ((offsets - middles[:, np.newaxis] * steps) ** 2).sum(axis=1)
    rest = radii**2 - aside
    widths = np.sqrt(np.maximum(rest, 0.0) / np.where(moves, squares, 1.0))
    lows = np.where(moves, np.maximum(middles - widths, 0.0), 0.0)
    highs = np.where(moves, np.minimum(middles + widths, 1.0), 1.0)
    return np.where(rest < 0.0, 1.0, lows), np.where(rest < 0.0, 0.0, highs)


def _sample_windows(
    sweeper: Sweeper, rows: Ints, points: Floats, lows: Floats, highs: Floats
) -> tuple[Floats, Floats]:
    """Return each window's deepest pose, with its gap."""
    counts = np.where(highs > lows, SHARES, 1)
    owners, numbers = number_parts(counts)
    shares = lows[owners] + numbers / (SHARES - 1) * (highs - lows)[owners]
    shares = np.where(sweeper.pieces.on_lane[rows[owners]], shares, np.rint(shares))
    gaps = sweeper.body.measure_gaps(
        _poses_at(sweeper.pieces, rows[owners], shares), points[owners]
    )
    best = np.lexsort((gaps, owners))[numbers == 0]
    return shares[best], gaps[best]


def _poses_at(pieces: SweepPieces, rows: Ints, shares: Floats) -> Floats:
    """Return poses at shares of pieces, shape (n, 3)."""
    starts = pieces.starts[rows]
    poses = starts + shares[:, np.newaxis] * (pieces.ends[rows] - starts)
    is_end = shares == 1.0
    poses[is_end] = pieces.ends[rows[is_end]]
    return np.asarray(poses)
