"""Motions of lanes: straight, each for all configurations near it.

A robot that is off a motion by at most d lies within the robot on the motion grown by d. So does
one rotated by an angle a, if d is a times the largest distance of its points from the reference
point. So a motion of a grown robot stands for a curve, a corridor, or all yaws of a rotation cell.
"""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple, cast

import numpy as np

from cspace import CSpace
from cspace.errors import InputError
from cspace.inside import ANGLE_SLACK, Bools, ConfigurationMap, Floats, Ints
from cspace.lanes._curves import Leg
from cspace.lanes._headings import HeadingRule, Lane
from cspace.lanes._route_graph import RouteGraph

if TYPE_CHECKING:
    from cspace import TiledCSpace

SAME_YAW: Final = 1e-9
"""Angle, radians, up to which two legs of a lane need no turn between them."""


class LaneMotions(NamedTuple):
    """Motions of lanes, lane by lane.

    Attributes
    ----------
    starts, ends : ndarray of float64, shape (n, size)
    growths : ndarray of float64, shape (n,)
        Growth of the robot, metres.
    spares : ndarray of float64, shape (n,)
        Additional growth, metres, for proofs by geometry. Proofs by cells need none: a motion at
        the center of a rotation cell then stands for all yaws of the cell.
    lanes : ndarray of int64, shape (n,)
        Index of the lane.
    order : ndarray of int64, shape (n,)
        Place of the motion along its lane.
    on_lane : ndarray of bool, shape (n,)
        True for straight motions; only the ends of a curve's chord lie on the lane.
    """

    starts: Floats
    ends: Floats
    growths: Floats
    spares: Floats
    lanes: Ints
    order: Ints
    on_lane: Bools

    def take(self, rows: Ints | Bools) -> LaneMotions:
        """Return some of the motions."""
        return LaneMotions._make(column[rows] for column in self)


MOTION: Final = np.dtype(
    [
        ("starts", "f8", 3),
        ("ends", "f8", 3),
        ("growths", "f8"),
        ("spares", "f8"),
        ("lanes", "i8"),
        ("order", "i8"),
        ("on_lane", "?"),
    ]
)
"""A row of :class:`LaneMotions`, with three numbers for a configuration."""


class LaneYaw(NamedTuple):
    """One of the yaws at which a lane is driven.

    Attributes
    ----------
    yaw : float
        Radians.
    is_relative : bool
        Whether the yaw counts from the direction of travel.
    half_width : float
        Largest deviation of the yaw within its rotation cell, radians.
    """

    yaw: float
    is_relative: bool = False
    half_width: float = 0.0

    def yaws(self, leg: Leg) -> tuple[float, float]:
        """Return the yaws at both ends of a leg."""
        if self.is_relative:
            return leg.first + self.yaw, leg.last + self.yaw
        return self.yaw, self.yaw


def check_map(space: ConfigurationMap, graph: RouteGraph) -> None:
    """Raise InputError unless a map can have lanes."""
    if space.axes not in (("x", "y"), ("x", "y", "yaw")):
        rule = "lanes are for maps of x, y, or of x, y, yaw"
        raise InputError("space", f"has the axes {', '.join(space.axes)}", rule)
    if space.rotations.names or space.robot.shape.is_round_about_z:
        return
    for lane in graph.lanes:
        if lane.heading != HeadingRule("map", (0.0,)):
            problem = f"has no yaw, but {space.robot.name} turns on the lane {lane.name!r}"
            raise InputError("space", problem, "the shape at every yaw is needed")
    for name, yaws in zip(graph.names, graph._stops, strict=True):
        for yaw in (yaw for yaw in yaws if abs(math.remainder(yaw, math.tau)) > SAME_YAW):
            problem = f"has no yaw, but {space.robot.name} has the yaw {yaw:g} at the node {name!r}"
            raise InputError("space", problem, "the shape at every yaw is needed")


def open_graph(space: Any, graph: Any, name: str) -> RouteGraph:
    """Return a graph, perhaps of a file or networkx; raise InputError if it is not for the map."""
    lanes = graph
    if isinstance(graph, str | os.PathLike):
        lanes = RouteGraph.open(graph)
    elif hasattr(graph, "is_directed"):
        lanes = RouteGraph.from_networkx(graph)
    if not isinstance(lanes, RouteGraph):
        rule = "it must be a RouteGraph, a file or a graph of networkx"
        raise InputError(name, f"is a {type(graph).__name__}", rule)
    if not isinstance(space, ConfigurationMap):
        place = "space" if name == "graph" else name
        raise InputError(place, f"is a {type(space).__name__}", "it must be a map")
    check_map(space, lanes)
    return lanes


def list_legs(graph: RouteGraph, lane: Lane) -> tuple[Leg, ...]:
    """Return a lane's legs; a straight lane has one."""
    if lane.legs:
        return lane.legs
    start, end = graph._places[lane.start], graph._places[lane.end]
    direction = math.atan2(end[1] - start[1], end[0] - start[0])
    return (Leg(start, end, direction, direction),)


def list_yaws(graph: RouteGraph, lane: Lane) -> list[LaneYaw]:
    """Return ways to drive a lane, empty for any yaw."""
    frame, yaws = lane.heading
    # A straight lane without length has no direction.
    is_point = not lane.legs and graph._places[lane.start] == graph._places[lane.end]
    if frame == "any" or (frame == "lane" and is_point):
        return []
    return [LaneYaw(yaw, frame == "lane") for yaw in yaws]


def split_yaws(space: ConfigurationMap) -> Floats:
    """Return rotation cells' parts by lower and upper yaws, (n, 2).

    Without a yaw, a round robot has all yaws, and another one only zero.
    """
    if not space.rotations.names:
        return np.array([[-math.pi, math.pi]]) * space.robot.shape.is_round_about_z
    borders = np.asarray(cast("Any", space.rotations).borders)
    # Largest part of a rotation cell of which all yaws are proven at once, radians.
    count = math.ceil(np.diff(borders).max() / math.radians(5.0) - SAME_YAW)
    parts = np.linspace(borders[:-1], borders[1:], count + 1, axis=1)
    return np.stack([parts[:, :-1], parts[:, 1:]], axis=-1).reshape(-1, 2)


def list_motions(space: ConfigurationMap, graph: RouteGraph) -> LaneMotions:
    """List the motions of all lanes."""
    has_yaw = bool(space.rotations.names)
    lever = space.robot.shape.lever if has_yaw else 0.0
    parts = split_yaws(space)
    half_widths = 0.5 * np.ptp(parts, axis=1) + ANGLE_SLACK
    pairs = zip(parts.mean(axis=1).tolist(), half_widths.tolist(), strict=True)
    all_ways = [LaneYaw(yaw, half_width=half_width) for yaw, half_width in pairs]
    rows: list[tuple[Any, ...]] = []
    for number, lane in enumerate(graph.lanes):
        legs = list_legs(graph, lane)
        if not isinstance(space, CSpace):
            longest = min(cast("TiledCSpace", space).tile) * space.grid.spacing
            legs = tuple(part for leg in legs for part in _cut(space, leg, longest))
        ways = list_yaws(graph, lane) if has_yaw else []
        start, end = (graph._stops[node] if ways else () for node in (lane.start, lane.end))
        for way in ways or all_ways:
            rows += _list_way(lane, legs, way, (start, end), lever, number)
    table = np.array(rows, dtype=MOTION)
    motions = LaneMotions(*(table[name].copy() for name in LaneMotions._fields))
    starts, ends = (rows[:, : space.size].copy() for rows in (motions.starts, motions.ends))
    return motions._replace(starts=starts, ends=ends)


def _cut(space: ConfigurationMap, leg: Leg, longest: float) -> Iterator[Leg]:
    """Cut a straight leg at a map's borders, and for windows."""
    if leg.drift > 0.0 or leg.start == leg.end:
        yield leg
        return
    start, end = np.array([leg.start]), np.array([leg.end])
    enter, leave = np.concatenate(find_shares_near_map(space, start, end - start)).tolist()
    count = math.ceil((leave - enter) * math.dist(leg.start, leg.end) / longest)
    between = start + np.linspace(enter, leave, count + 1)[:, np.newaxis] * (end - start)
    points = dict.fromkeys([leg.start, *map(tuple, between.tolist()), leg.end])  # equal ones once
    for first, last in itertools.pairwise(points):
        yield leg._replace(start=first, end=last)


def find_shares_near_map(
    space: ConfigurationMap, starts: Floats, steps: Floats
) -> tuple[Floats, Floats]:
    """Find the shares where straight motions enter and leave a map.

    Two equal shares cut a motion that does not come near into parts beside the map. ``starts`` and
    ``steps`` have shape (n, 2) or (n, 3); the yaw does not count.
    """
    reach = space.robot.shape.lever + space.margin + 2.0 * space.grid.spacing
    borders = np.array([space.grid.lower, space.grid.upper]) + np.array([[-reach], [reach]])
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = (borders[:, np.newaxis] - starts[:, :2]) / steps[:, :2]
    # A motion along a border never crosses it.
    shares = np.where(np.isnan(shares), [[[-math.inf]], [[math.inf]]], shares)
    enter = np.clip(shares.min(axis=0).max(axis=1), 0.0, 1.0)
    return enter, np.clip(shares.max(axis=0).min(axis=1), enter, 1.0)


def _list_way(
    lane: Lane,
    legs: tuple[Leg, ...],
    way: LaneYaw,
    stops: tuple[Sequence[float], Sequence[float]],
    lever: float,
    number: int,
) -> list[tuple[Any, ...]]:
    """List the motions and turns of one way along a lane, each as a row of :data:`MOTION`.

    ``stops`` are the yaws of both nodes. A point of the robot moves by at most ``lever`` times an
    angle.
    """
    rows: list[tuple[Any, ...]] = []

    def add(
        start: tuple[float, ...], end: tuple[float, ...], bend: float = 0.0, spare: float = 0.0
    ) -> None:
        """Add a motion, which a lane leaves by ``bend``."""
        growth = lane.deviation + bend
        rows.append((start, end, growth, spare, number, len(rows), bend == 0.0))

    def turn(place: tuple[float, float], before: float, after: float) -> None:
        """Add the shorter turn on the spot, or both half turns."""
        step = math.remainder(after - before, math.tau)
        ways = [step] if abs(step) > SAME_YAW else []
        if abs(step) >= math.pi - SAME_YAW:
            ways = [-math.pi, math.pi]
        for way in ways:
            # Motions take the shorter way, and half a turn has none.
            middle = before + 0.5 * way
            add((*place, before), (*place, middle))
            add((*place, middle), (*place, before + way))

    def stop(place: tuple[float, float], yaws: Sequence[float], yaw: float) -> None:
        """Add turns through all yaws of a node, and to that of the lane from either end."""
        chain = [*yaws, yaw, *yaws[:-1][:1]]
        for before, after in itertools.pairwise(chain):
            turn(place, before, after)

    stop(legs[0].start, stops[0], way.yaws(legs[0])[0])
    before = way.yaws(legs[0])[0]
    # Step, metres, of the growths of curves; motions of one growth are proven at once.
    growth_step = 1e-3
    for leg in legs:
        first, last = way.yaws(leg)
        turn(leg.start, before, first)
        bend = leg.drift + (lever * leg.spread if way.is_relative else 0.0)
        bend = growth_step * math.ceil(bend / growth_step)
        # A robot on the spot turns through all yaws of its part.
        swing = way.half_width if leg.start == leg.end else 0.0
        spare = lever * (way.half_width - swing)
        add((*leg.start, first - swing), (*leg.end, last + swing), bend, spare)
        before = last
    stop(legs[-1].end, stops[1], before)
    return rows


def list_parts(
    space: ConfigurationMap, motions: LaneMotions, more: float
) -> Iterator[tuple[CSpace, Ints]]:
    """Yield map parts in memory with the rows inside them.

    A part also has what the robot touches within ``more`` metres beside the motions.
    """
    if isinstance(space, CSpace):
        yield space, np.arange(len(motions.lanes))
        return
    tiles = cast("TiledCSpace", space)
    spacing = space.grid.spacing
    middles = 0.5 * (motions.starts + motions.ends)[:, :2]
    blocks = np.floor(middles / (spacing * np.array(tiles.tile)))
    _, numbers, counts = np.unique(blocks, axis=0, return_inverse=True, return_counts=True)
    rows = np.argsort(numbers.ravel(), kind="stable")
    for chosen in np.split(rows, np.cumsum(counts)[:-1]) if len(rows) else ():
        ends = np.concatenate([motions.starts[chosen], motions.ends[chosen]])[:, :2]
        reach = (motions.growths + motions.spares)[chosen].max() + more + 2.0 * spacing
        # A motion beside the map has a window at its border.
        lower = np.minimum(ends.min(axis=0), space.grid.upper) - reach
        upper = np.maximum(ends.max(axis=0), space.grid.lower) + reach
        yield tiles.window(lower, upper), chosen
