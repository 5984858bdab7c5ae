"""Verdicts about lanes: proven free, proven in collision, or neither."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import shapely
from shapely import affinity

from cspace._rotations.base import ANGLE_SLACK
from cspace._support.arrays import BLOCKED, FREE, Bools, Floats, Ints, States
from cspace.errors import InputError
from cspace.lanes._curves import Leg
from cspace.lanes._headings import HeadingRule, Lane
from cspace.lanes._route_graph import RouteGraph
from cspace.lanes._tubes import Tubes, open_part, tubes_are_free

if TYPE_CHECKING:
    from cspace._configuration_map import ConfigurationMap
    from cspace._space import CSpace

SAMPLES_PER_CELL: Final = 4.0
"""Number of configurations for each cell of a lane among which the first collision is searched."""

SAMPLE_RADIANS: Final = math.radians(2.0)
"""Largest rotation between two of these configurations."""

MAX_SAMPLES: Final = 2**20
"""Approximate number of configurations that are classified at once."""

MIN_OVERLAP: Final = 1e-9
"""Area of robot and obstacle, square metres, that proves a collision in spite of rounding."""

SAME_YAW: Final = 1e-9
"""Angle, radians, up to which two legs of a lane need no turn between them."""

POINTS_PER_SIDE: Final = 16
"""Number of points along each side of the robot that look for the obstacle that it touches."""

BORDER: Final = "the border of the map"
"""Name of the space outside the map as an obstacle."""


class LaneMotions(NamedTuple):
    """The motions of all lanes, each a tube.

    Attributes
    ----------
    tubes : Tubes
    lanes : ndarray of int64, shape (n,)
        Index of the lane of each motion.
    order : ndarray of int64, shape (n,)
        Place of each motion along its lane.
    is_straight : ndarray of bool, shape (n,)
        False for the chord of a curve, which only touches the lane at both ends.
    in_cell : ndarray of bool, shape (n,)
        Whether the yaws of a motion are those of a rotation cell, so that a motion at its center
        proves all.
    """

    tubes: Tubes
    lanes: Ints
    order: Ints
    is_straight: Bools
    in_cell: Bools

    @property
    def is_plain(self) -> Bools:
        """Whether a straight motion alone proves the tube by cells."""
        return np.asarray((self.tubes.drifts == 0.0) & ((self.tubes.turns == 0.0) | self.in_cell))

    def take(self, rows: Ints | Bools) -> LaneMotions:
        """Return some of the motions."""
        return LaneMotions(
            self.tubes.take(rows),
            self.lanes[rows],
            self.order[rows],
            self.is_straight[rows],
            self.in_cell[rows],
        )


def check_map(space: ConfigurationMap, graph: RouteGraph) -> None:
    """Raise InputError unless a map has the axes of lanes, and turns as these do."""
    if space.axes not in (("x", "y"), ("x", "y", "yaw")):
        rule = "lanes are for maps of x, y, or of x, y, yaw"
        hint = "build one of the robot's footprint, with rotations=72"
        raise InputError("space", f"has the axes {', '.join(space.axes)}", rule, hint)
    if space.rotations.names or space.robot.shape.is_round:
        return
    for lane in graph.lanes:
        if lane.heading != HeadingRule("map", (0.0,)):
            problem = f"has no yaw, but {space.robot.name} turns on the lane {lane.name!r}"
            hint = "build it with rotations=72, or set heading=0.0 for a robot that never turns"
            raise InputError("space", problem, "the shape at every yaw is needed", hint)


def legs_of(graph: RouteGraph, lane: Lane) -> tuple[Leg, ...]:
    """Return the legs of a lane, of which a straight lane has one."""
    if lane.legs:
        return lane.legs
    start, end = graph.places[lane.start], graph.places[lane.end]
    direction = math.atan2(end[1] - start[1], end[0] - start[0])
    return (Leg(start, end, direction, direction),)


def end_yaws(graph: RouteGraph, lane: Lane) -> list[tuple[float, float]]:
    """Return the yaws at the start and at the end of a lane, for each way to drive it.

    The list is empty if all yaws are allowed.
    """
    if lane.heading.frame == "map":
        return [(yaw, yaw) for yaw in lane.heading.yaws]
    if lane.heading.frame == "any" or has_no_direction(graph, lane):
        return []
    legs = legs_of(graph, lane)
    return [(legs[0].first + yaw, legs[-1].last + yaw) for yaw in lane.heading.yaws]


def has_no_direction(graph: RouteGraph, lane: Lane) -> bool:
    """Return True for a straight lane without length, along which all yaws are possible."""
    return not lane.legs and graph.places[lane.start] == graph.places[lane.end]


def list_motions(space: ConfigurationMap, graph: RouteGraph) -> LaneMotions:
    """List the motions of all lanes, in the order of the lanes."""
    has_yaw = bool(space.rotations.names)
    bounds = space.rotations._stored_arrays["yaw_bounds"] if has_yaw else np.zeros((1, 2))
    # All yaws are those of all rotation cells.
    all_yaws = bounds.mean(axis=1).tolist()
    half_widths = (0.5 * np.ptp(bounds, axis=1) + ANGLE_SLACK).tolist()
    rows: list[tuple[float, ...]] = []
    for number, lane in enumerate(graph.lanes):
        legs = legs_of(graph, lane)
        ways = end_yaws(graph, lane) if has_yaw else [(0.0, 0.0)]
        if not ways:
            for yaw, half_width in zip(all_yaws, half_widths, strict=True):
                for place, leg in enumerate(legs):
                    ends = *leg.start, yaw, *leg.end, yaw
                    drift = leg.drift + lane.deviation
                    rows.append((*ends, drift, half_width, number, place, leg.drift == 0.0, True))
        stops = graph.yaws[[lane.start, lane.end]].tolist() if has_yaw else (math.nan, math.nan)
        for way in range(len(ways)):
            rows += _list_way(lane, legs, way, number, stops, has_yaw)
    table = np.array(rows, dtype=np.float64).reshape(-1, 12)
    axes = slice(0, 3 if has_yaw else 2)
    tubes = Tubes(
        np.ascontiguousarray(table[:, 0:3][:, axes]),
        np.ascontiguousarray(table[:, 3:6][:, axes]),
        table[:, 6].copy(),
        table[:, 7].copy() if has_yaw else np.zeros(len(table)),
    )
    lanes, order = table[:, 8].astype(np.int64), table[:, 9].astype(np.int64)
    return LaneMotions(tubes, lanes, order, table[:, 10] > 0.0, table[:, 11] > 0.0)


def _list_way(
    lane: Lane,
    legs: tuple[Leg, ...],
    way: int,
    number: int,
    stops: tuple[float, ...],
    has_yaw: bool,
) -> list[tuple[float, ...]]:
    """List the motions of one way to drive a lane, with the turns between its legs.

    ``stops`` are the yaws at both nodes, or NaN.
    """
    rows: list[tuple[float, ...]] = []

    def add(start: tuple[float, ...], end: tuple[float, ...], leg: Leg | None = None) -> None:
        """Add a motion, or a turn on the spot without a leg."""
        drift, turn = (0.0, 0.0) if leg is None else (leg.drift, leg.spread if has_yaw else 0.0)
        is_straight = leg is None or leg.drift == 0.0
        rest = drift + lane.deviation, turn, number, len(rows), is_straight, False
        rows.append((*start, *end, *rest))

    offset = lane.heading.yaws[way] if lane.heading.yaws else 0.0
    before = stops[0]
    for leg in legs:
        first, last = offset, offset
        if lane.heading.frame == "lane" and has_yaw:
            first, last = leg.first + offset, leg.last + offset
        if has_yaw and abs(math.remainder(first - before, math.tau)) > SAME_YAW:
            add((*leg.start, before), (*leg.start, first))
        add((*leg.start, first), (*leg.end, last), leg)
        before = last
    if has_yaw and abs(math.remainder(stops[1] - before, math.tau)) > SAME_YAW:
        add((*legs[-1].end, before), (*legs[-1].end, stops[1]))
    return rows


def prove_by_cells(space: ConfigurationMap, motions: LaneMotions) -> Bools:
    """Return whether FREE cells prove each motion, shape (n,)."""
    is_free = np.zeros(len(motions.lanes), dtype=np.bool_)
    plain = motions.is_plain
    is_free[plain] = space.motion_is_free(motions.tubes.starts[plain], motions.tubes.ends[plain])
    is_free[~plain] = tubes_are_free(space, motions.tubes.take(~plain), exact=False)
    return is_free


def prove_by_geometry(space: ConfigurationMap, motions: LaneMotions) -> Bools:
    """Return whether the geometry proves each motion, shape (n,)."""
    is_free = np.zeros(len(motions.lanes), dtype=np.bool_)
    alone = (motions.tubes.drifts == 0.0) & (motions.tubes.turns == 0.0) & space.in_memory
    if alone.any():
        ends = motions.tubes.starts[alone], motions.tubes.ends[alone]
        is_free[alone] = space.motion_is_free(*ends, exact=True)
    is_free[~alone] = tubes_are_free(space, motions.tubes.take(~alone), exact=True)
    return is_free


class Places(NamedTuple):
    """Configurations on lanes that are not FREE, in the order of lanes and along these.

    Attributes
    ----------
    points : ndarray of float64, shape (n, size)
    lanes : ndarray of int64, shape (n,)
    states : ndarray of uint8, shape (n,)
    """

    points: Floats
    lanes: Ints
    states: States

    def take(self, rows: Ints | Bools) -> Places:
        """Return some of the places."""
        return Places(self.points[rows], self.lanes[rows], self.states[rows])

    def firsts(self) -> Places:
        """Return the first place of each lane."""
        return self.take(np.unique(self.lanes, return_index=True)[1])


def find_places(space: ConfigurationMap, motions: LaneMotions) -> Places:
    """Find the configurations on motions that are not FREE, a fraction of a cell apart."""
    starts, ends = motions.tubes.starts, motions.tubes.ends
    metres = np.hypot(*(ends - starts)[:, :2].T)
    radians = np.zeros(len(starts))
    if space.rotations.names:
        radians = np.abs(space.steps_between(starts, ends)[:, 2])
    needs = np.maximum(metres * SAMPLES_PER_CELL / space.grid.spacing, radians / SAMPLE_RADIANS)
    counts = np.where(motions.is_straight, np.ceil(needs), 1.0).astype(np.int64) + 1
    counts = np.maximum(counts, 2)
    found = []
    batches = np.cumsum(counts) // MAX_SAMPLES
    for batch in np.unique(batches):
        chosen = np.flatnonzero(batches == batch)
        rows = np.repeat(chosen, counts[chosen])
        begins = np.cumsum(counts[chosen]) - counts[chosen]
        numbers = np.arange(len(rows)) - np.repeat(begins, counts[chosen])
        shares = numbers / (counts[rows] - 1)
        points = space.interpolate(starts[rows], ends[rows], shares[:, None])
        points[shares == 0.0] = starts[rows[shares == 0.0]]
        points[shares == 1.0] = ends[rows[shares == 1.0]]
        states = np.asarray(space.classify(points))
        kept = states != FREE
        along = motions.order[rows] + shares
        found.append((points[kept], motions.lanes[rows[kept]], states[kept], along[kept]))
    if not found:
        return Places(starts[:0], motions.lanes[:0], np.zeros(0, dtype=np.uint8))
    points, lanes, states, along = map(np.concatenate, zip(*found, strict=True))
    order = np.lexsort((along, lanes))
    return Places(points[order], lanes[order], states[order])


def find_collisions(
    space: ConfigurationMap, places: Places, exact: bool
) -> tuple[Places, dict[int, str]]:
    """Find the first place of each lane that is proven in collision, with its obstacle."""
    first_blocked = places.take(places.states == BLOCKED).firsts()
    is_decided = np.isin(places.lanes, first_blocked.lanes)
    rows = []
    named: dict[int, str] = {}
    rest = places.take(~is_decided & exact)
    # Cells prove some; of the other lanes the shapes are laid over the obstacles.
    for k, (point, lane) in enumerate(zip(rest.points, rest.lanes.tolist(), strict=True)):
        if lane not in named:
            obstacle = name_obstacle(space, point)
            if obstacle:
                named[lane] = obstacle
                rows.append(k)
    found = rest.take(np.array(rows, dtype=np.int64))
    texts = _name_cells(space, first_blocked.points)
    for k, lane in enumerate(first_blocked.lanes.tolist()):
        named[lane] = texts[k] or name_obstacle(space, first_blocked.points[k]) or "an obstacle"
    both = Places(
        np.concatenate([first_blocked.points, found.points]),
        np.concatenate([first_blocked.lanes, found.lanes]),
        np.concatenate([first_blocked.states, found.states]),
    )
    return both, named


def _name_cells(space: ConfigurationMap, points: Floats) -> list[str]:
    """Name a cell of the workspace that contains a point of the robot, for each configuration.

    A text is empty if that is not the way to name the obstacle: none of some points of the robot
    is in such a cell, the cells are on disk, or obstacles have names.
    """
    if not space.in_memory or not len(points) or space.obstacles:  # type: ignore[attr-defined]
        return [""] * len(points)
    outline = space.robot.shape.inner.outline
    lower, upper = np.array(outline.bounds).reshape(2, 2)
    axes = [np.linspace(a, b, POINTS_PER_SIDE) for a, b in zip(lower, upper, strict=True)]
    inside = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    inside = inside[shapely.contains_xy(outline, inside)]
    yaws = points[:, 2:3] if points.shape[1] > 2 else np.zeros((len(points), 1))
    cos, sin = np.cos(yaws), np.sin(yaws)
    x = points[:, :1] + cos * inside[:, 0] - sin * inside[:, 1]
    y = points[:, 1:2] + sin * inside[:, 0] + cos * inside[:, 1]
    cells = space.grid.cell_of(np.stack([x, y], axis=-1))
    in_grid = ((cells >= 0) & (cells < space.grid.shape)).all(axis=-1)
    hits = np.zeros(in_grid.shape, dtype=np.bool_)
    hits[in_grid] = space.workspace.inner[tuple(cells[in_grid].T)]  # type: ignore[attr-defined]
    if not hits.size:
        return [""] * len(points)
    first = hits.argmax(axis=1)
    rows = np.arange(len(points))
    centers = space.grid.center_of(cells[rows, first]).tolist()
    texts = [f"the obstacle at ({x:.2f}, {y:.2f})" for x, y in centers]
    return [text if hit else "" for text, hit in zip(texts, hits[rows, first], strict=True)]


def name_obstacle(space: ConfigurationMap, q: Floats) -> str:
    """Return the name of an obstacle that the robot overlaps, proven; "" if none is."""
    part = open_part(space, q[None, :2], space.robot.span)
    yaw = float(q[2]) if len(q) > 2 else 0.0
    inner = affinity.rotate(space.robot.shape.inner.outline, yaw, (0.0, 0.0), use_radians=True)
    robot = affinity.translate(inner, *q[:2])
    frame = shapely.box(*space.grid.lower, *space.grid.upper)
    for name, shape in part.obstacles.items():
        if _overlaps(robot, shapely.intersection(shape.inner.outline, frame)):
            return repr(name)
    place = _find_overlap(part, robot, frame)
    if place:
        return f"the obstacle at ({place[0]:.2f}, {place[1]:.2f})"
    leaves = shapely.area(shapely.difference(robot, frame)) > MIN_OVERLAP
    return BORDER if space.outside == "blocked" and leaves else ""


def _overlaps(robot: shapely.Geometry, obstacle: shapely.Geometry) -> bool:
    """Return True if a robot and an obstacle have an area in common."""
    return bool(shapely.area(shapely.intersection(robot, obstacle)) > MIN_OVERLAP)


def _find_overlap(
    part: CSpace, robot: shapely.Geometry, frame: shapely.Geometry
) -> tuple[float, float] | None:
    """Return a point of the robot in an inner cell or in a shape of the workspace, or None."""
    grid = part.grid
    corners = np.array(robot.bounds).reshape(2, 2)
    first = np.clip(grid.cell_of(corners[0]), 0, None)
    stop = np.clip(grid.cell_of(corners[1]) + 1, 0, grid.shape)
    window = tuple(map(slice, first, stop))
    cells = np.argwhere(part.workspace.inner[window]) + first
    lower = np.asarray(grid.lower) + grid.spacing * cells
    boxes = shapely.box(*lower.T, *(lower + grid.spacing).T)
    shapes = [shape.inner.outline for shape in part.workspace.shapes or ()]
    obstacles = np.concatenate([boxes, shapely.intersection(shapes, frame)])
    common = shapely.intersection(obstacles, robot)
    areas = shapely.area(common)
    if not len(areas) or areas.max() <= MIN_OVERLAP:
        return None
    point = common[int(np.argmax(areas))].representative_point()
    return point.x, point.y
