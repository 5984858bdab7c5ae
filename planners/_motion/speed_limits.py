"""Largest speeds in zones, near obstacles, and of links of arms.

A limit holds at every instant, because it is computed for whole stretches of a path. From the
middle of a stretch, no point of the robot moves farther than the reach of the stretch. So a limit
that holds nowhere within the reach of the middle holds nowhere on the stretch. Otherwise the
stretch is cut, down to one cell of the map, and then the limit counts on the whole stretch.

The speed of a link by the length of a path changes along it. On a stretch, it is bounded by its
value in the middle and its largest change; the stretch is cut until the bound is near that value.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from numbers import Real
from typing import (
    TYPE_CHECKING,
    Any,
    Final,
    Literal,
    NamedTuple,
    Protocol,
    TypeAlias,
    cast,
)

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from cspace import Robot, Rotations, Space
from cspace.errors import GeometryError, InputError, UnitWarning
from cspace.inside import (
    Bools,
    ConfigurationMap,
    Cores,
    Floats,
    Ints,
    StrPath,
    as_shape,
    check_finite,
    check_known,
    check_points,
    check_positive,
    check_text,
    check_word,
    names_options,
    number_parts,
    warn_of_large,
    warn_user,
)
from planners._edges.own_space import check_space
from planners._motion.segments import Segments, place_along
from planners._space_kinds import ARMS, find_space_kind, has_positions

if TYPE_CHECKING:
    from cspace import Arm, ArmSpace
    from planners._motion.zone_files import Unit

Within: TypeAlias = Literal["contour", "point"]
"""Part of the robot that must be in a zone for its limit to hold."""

ROUNDING: Final = 1e-9
"""Share by which the reach of a stretch grows for rounding."""

JOINT_STEP: Final = 0.02
"""Length of the smallest stretches of an arm, radians or metres of its joints."""

GRADE: Final = 1.1
"""Ratio of neighbouring speeds to which an arm's speeds are rounded down, so that few change.

Its square is above :data:`planners._motion.jerk.BORDER_RATIO`, so that legs of limited jerk end
there."""


class ZoneLevels(NamedTuple):
    """The n unions of areas with one speed each, lowest first."""

    speeds: Floats  # (n,), m/s
    areas: Any  # (n,), prepared geometries
    borders: Any  # (n,), borders of the areas
    lower: Floats  # (n, 2), corners of the areas' bounding boxes
    upper: Floats


@names_options
@dataclass(frozen=True, slots=True, weakref_slot=True)
class SpeedZones:
    """Areas with a largest speed each, for trajectories of mobile robots.

    The speed is the reference point's. If areas overlap, the lowest speed holds. In space, an area
    reaches from the ground to the sky.

    Attributes
    ----------
    zones : sequence of pairs
        An area and its speed, m/s. An area is a shapely Polygon or MultiPolygon, or the vertices of
        a polygon, shape (n, 2), metres.
    within : str
        "contour": a limit holds while any part of the robot is in the area, as in VDA 5050.
        "point": while its reference point is, as in Nav2. For a robot that rotates about any axis,
        the ball around its reference point counts as its contour.
    frame_id : str
        Frame of the areas; None for the frame of the plan.

    Raises
    ------
    InputError
        If a speed is not above zero, or there is no zone.
    GeometryError
        If an area is no valid polygon.

    Examples
    --------
    >>> import numpy as np, shapely, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.zeros((80, 30), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
    >>> plan = planners.plan(space, (0.5, 1.5), (7.5, 1.5))
    >>> limits = {"max_velocity": 1.0, "max_acceleration": 0.5}
    >>> crossing = planners.SpeedZones([(shapely.box(3.0, 0.0, 5.0, 3.0), 0.4)])
    >>> slow = plan.trajectory(**limits, speed=crossing)
    >>> round(plan.trajectory(**limits).duration, 2), round(slow.duration, 2)
    (9.0, 13.8)
    """

    zones: Sequence[tuple[Any, float]]
    within: Within = "contour"
    frame_id: str | None = None
    _levels: ZoneLevels = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Check the zones, and keep shapely geometries."""
        zones: list[tuple[BaseGeometry, float]] = []
        for number, zone in enumerate(self.zones if np.iterable(self.zones) else ()):
            name = f"zones[{number}]"
            if not isinstance(zone, tuple | list) or len(zone) != 2:
                raise InputError(name, f"is {zone!r}", "it must be an area and its speed, m/s")
            area, speed = zone
            shape = as_shape(area, name=name)
            if shape.dim != 2:
                raise InputError(name, "is in space", "an area lies in the plane")
            parts = shapely.get_parts(shape.outer.outline)
            if (shapely.get_dimensions(parts) < 2).any():
                raise GeometryError(name, "has a part without area", "a zone is of polygons")
            speed = check_positive(speed, f"speed of {name}", "m/s")
            zones.append((shape.outer.outline, speed))
        if not zones:
            raise InputError("zones", f"is {self.zones!r}", "it must list areas with their speeds")
        check_word(self.within, "within", ("contour", "point"))
        if self.frame_id is not None:
            check_text(self.frame_id, "frame_id")
        speeds = sorted({speed for _, speed in zones})
        areas = np.array(
            [shapely.union_all([area for area, each in zones if each == speed]) for speed in speeds]
        )
        borders = shapely.boundary(areas)
        shapely.prepare([areas, borders])
        boxes = shapely.bounds(areas)
        levels = ZoneLevels(np.array(speeds), areas, borders, boxes[:, :2], boxes[:, 2:])
        object.__setattr__(self, "zones", tuple(zones))
        object.__setattr__(self, "_levels", levels)

    @classmethod
    def open(
        cls,
        path: StrPath,
        speed: str | None = None,
        within: Within = "contour",
        frame_id: str | None = None,
    ) -> SpeedZones:
        """Read zones from GeoJSON, or from a zone set of VDA 5050.

        Parameters
        ----------
        path : path-like
            A file that ends in ``.geojson`` or ``.json``; metres. In a zone set, zones of type
            SPEED_LIMIT are read, and a warning counts the others.
        speed : str, optional
            Name of the property of GeoJSON's features with the largest speed, in m/s, or in the
            unit in its name, such as ``top_kmh``. ``maxspeed`` is in km/h, as in OpenStreetMap.
        within, frame_id
            As for the class.

        Raises
        ------
        FileError
            If the file is missing or malformed.
        GeometryError
            If an area is no valid polygon, or not in metres.
        InputError
            If a speed is missing or not above zero, or ``speed`` is not given for GeoJSON.
        """
        from planners._motion.zone_files import read_zone_file

        return cls(read_zone_file(path, speed), within, frame_id)

    @classmethod
    def from_mask(
        cls,
        mask: object,
        unit: Unit,
        base: float = 0.0,
        multiplier: float = 1.0,
        max_velocity: float | None = None,
        within: Within = "point",
    ) -> SpeedZones:
        """Read zones from a speed mask of Nav2.

        A cell of value v from 1 to 100 has the limit ``base + multiplier * v``. Cells of value 0 or
        -1 have none, and as in Nav2, neither have those whose limit is not above zero, or above 100
        per cent; a warning names such values.

        Parameters
        ----------
        mask : path-like, object or mapping
            A ROS map or message, as for :func:`cspace.ros.read_mask`.
        unit : {"percent", "m/s"}
            Unit of the limits: Nav2's types 1 and 2 of filters.
        base, multiplier : float
            As in Nav2's ``CostmapFilterInfo``.
        max_velocity : float, optional
            Speed, m/s, of 100 per cent.
        within : str
            As for the class.

        Raises
        ------
        FileError
            If the mask's YAML or image is missing or malformed.
        InputError
            If an argument is missing or invalid, or no cell has a limit.
        """
        from planners._motion.zone_files import read_mask_zones

        zones, frame_id = read_mask_zones(mask, unit, base, multiplier, max_velocity)
        return cls(zones, within, frame_id)

    def largest_speed(
        self, space: Space, q: ArrayLike, lengths: ArrayLike = 0.0, turns: ArrayLike = 0.0
    ) -> Floats:
        """Return the largest speeds at configurations of a map's robot.

        Parameters
        ----------
        space : CSpace or TiledCSpace
        q : array-like, shape (..., size)
            Configurations, or the centers of pieces of a path; metres, and radians.
        lengths, turns : array-like, shape () or (...)
            Length and rotation of each piece, metres and radians. The speeds hold for all
            configurations within half of both from the center.

        Returns
        -------
        ndarray of float64, shape (...)
            m/s; infinite without a limit.

        Raises
        ------
        InputError
            If all zones lie off the map, or in another frame, the space is no map of positions, or
            a number is not finite.
        """
        return _find_largest(self, space, q, lengths, turns)


@names_options
@dataclass(frozen=True, slots=True)
class SlowNear:
    """A largest speed near obstacles, for trajectories of mobile robots.

    The distance is between the robot and the obstacles. Its bound is proven, by
    :meth:`cspace.CSpace.clearance`, so the robot may slow down earlier, by some 1.5 cells, the
    margin of the map, and its travel in a turn within a rotation cell.

    Attributes
    ----------
    space : CSpace
        Map of the obstacles, such as ``plan.space``, or a map of people alone. Its obstacles count
        as they are when the trajectory is computed.
    speed : float
        Largest speed of the reference point, m/s.
    distance : float
        Distance from obstacles below which it holds, metres.

    Raises
    ------
    InputError
        If the speed or the distance is not above zero, or the space is no map.

    Examples
    --------
    >>> import numpy as np, shapely, cspace, planners
    >>> workspace = cspace.Workspace.from_array(np.zeros((80, 30), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.disc(0.3))
    >>> update = space.add_obstacle("shelf", shapely.box(3.0, 0.0, 5.0, 0.9))
    >>> plan = planners.plan(space, (0.5, 1.5), (7.5, 1.5))
    >>> limits = {"max_velocity": 1.0, "max_acceleration": 0.5}
    >>> slow = plan.trajectory(**limits, speed=planners.SlowNear(space, 0.4, 0.5))
    >>> float(np.linalg.norm(slow.sample(slow.duration / 2)[1])) <= 0.4
    True
    """

    space: ConfigurationMap
    speed: float
    distance: float

    def __post_init__(self) -> None:
        """Check the numbers and the map."""
        if not has_positions(self.space):
            raise InputError("space", f"is {self.space!r}", "it must be a map of positions")
        object.__setattr__(self, "speed", check_positive(self.speed, "speed", "m/s"))
        object.__setattr__(self, "distance", check_positive(self.distance, "distance"))

    def largest_speed(
        self, space: Space, q: ArrayLike, lengths: ArrayLike = 0.0, turns: ArrayLike = 0.0
    ) -> Floats:
        """Return the largest speeds at configurations; see :meth:`SpeedZones.largest_speed`."""
        return _find_largest(self, space, q, lengths, turns)


@names_options
@dataclass(frozen=True, slots=True)
class ToolSpeed:
    """A largest speed of a link of an arm, for trajectories.

    No point of the link, nor the origin of its frame, is faster at any instant. The bound is
    proven, by :meth:`cspace.Arm.link_speed`, so the link may be some percent slower.

    Attributes
    ----------
    link : str
        A name in :attr:`cspace.Arm.frames`: a link, with geometry or without, or an attached
        object.
    speed : float
        Largest speed, m/s, in the frame of the arm's base.

    Raises
    ------
    InputError
        If the speed is not above zero, or the link is no text.

    Examples
    --------
    >>> import planners
    >>> planners.ToolSpeed("tool0", 0.25)
    ToolSpeed(link='tool0', speed=0.25)
    """

    link: str
    speed: float

    def __post_init__(self) -> None:
        """Check the name and the number."""
        check_text(self.link, "link")
        object.__setattr__(self, "speed", check_positive(self.speed, "speed", "m/s"))


SpeedLike: TypeAlias = float | SpeedZones | SlowNear | ToolSpeed
"""A limit: a number of m/s holds everywhere."""


class SpeedRule(Protocol):
    """A limit, placed on the map of a plan."""

    @property
    def lever(self) -> float:
        """Largest distance of the robot's points from its reference point, metres."""

    @property
    def step(self) -> float:
        """Length of the smallest stretches, metres."""

    def measure(self, q: Floats, reaches: Floats) -> Floats:
        """Return the lowest speeds that may hold within reaches, or infinity."""

    def bound_speeds(self, q: Floats, reaches: Floats) -> tuple[Floats, Floats]:
        """Bound the lowest speeds near rows quickly, from both sides.

        The first are at most the lowest speeds that may hold within the reaches, the second are
        speeds that surely hold there. If both are equal, no cut leads to a higher speed.
        """


class ZoneRule(NamedTuple):
    """Zones for one robot."""

    zones: SpeedZones
    cores: Cores | None  # of the robot; None for a disc around the reference point
    inner: float  # radius of a disc around the reference point within the robot, metres
    size: float  # radius of a disc around the reference point that holds the robot, metres
    has_yaw: bool
    lever: float
    step: float

    @property
    def levels(self) -> ZoneLevels:
        """The areas by their speeds."""
        return self.zones._levels

    def measure(self, q: Floats, reaches: Floats) -> Floats:
        """Return the lowest speeds that may hold."""
        levels, rows, anchors, reached = self._find_near(q, reaches)
        if self.cores is not None:
            touches = shapely.dwithin(self.levels.areas[levels], anchors, reached + self.inner)
            left = np.flatnonzero(~touches)
            touches[left] = self._touch(q, levels[left], rows[left], reached[left])
            levels, rows = levels[touches], rows[touches]
        return self._find_lowest(levels, rows, len(q))

    def bound_speeds(self, q: Floats, reaches: Floats) -> tuple[Floats, Floats]:
        """Bound the lowest speeds by outer and inner discs."""
        levels, rows, anchors, reached = self._find_near(q, reaches)
        lowest = self._find_lowest(levels, rows, len(q))
        # A point of the robot stays in the area.
        areas, borders = self.levels.areas, self.levels.borders
        depths = reached - self.inner
        is_sure = shapely.dwithin(areas[levels], anchors, np.maximum(-depths, 0.0))
        is_sure &= (depths < 0.0) | ~shapely.dwithin(borders[levels], anchors, depths)
        return lowest, self._find_lowest(levels[is_sure], rows[is_sure], len(q))

    def _find_near(self, q: Floats, reaches: Floats) -> tuple[Ints, Ints, Any, Floats]:
        """Return pairs of areas and rows in reach, the lowest speeds first.

        They are levels, rows, reference points, and reaches, shape (m,) each.
        """
        points = q[:, :2]
        largest = np.abs(points).max(axis=1, initial=0.0) + self.size
        reaches = reaches + Cores.bound_rounding(largest)
        lower, upper = self.levels.lower[:, np.newaxis], self.levels.upper[:, np.newaxis]
        gaps = np.maximum(lower - points, points - upper).max(axis=2)
        levels, rows = np.nonzero(gaps <= reaches + self.size)
        used, numbers = _number(rows, len(q))
        anchors = shapely.points(points[used])[numbers]
        reached = reaches[rows]
        is_near = shapely.dwithin(self.levels.areas[levels], anchors, reached + self.size)
        return levels[is_near], rows[is_near], anchors[is_near], reached[is_near]

    def _find_lowest(self, levels: Ints, rows: Ints, count: int) -> Floats:
        """Return the lowest speed of each row in sorted pairs, or infinity."""
        lowest = np.full(count, np.inf)
        # The last assignment of a row wins.
        lowest[rows[::-1]] = self.levels.speeds[levels[::-1]]
        return lowest

    def _touch(self, q: Floats, levels: Ints, rows: Ints, reached: Floats) -> Bools:
        """Return whether the robot is in reach, for pairs, shape (m,)."""
        touches = np.zeros(len(rows), dtype=np.bool_)
        poses = q[:, [0, 1, -1]] if self.has_yaw else q[:, :2]
        used, numbers = _number(rows, len(q))
        for bodies, radius in self.cores.place(poses[used]) if self.cores and len(used) else ():
            areas = self.levels.areas[levels]
            touches |= shapely.dwithin(areas, bodies[numbers], reached + radius)
        return touches


class NearRule(NamedTuple):
    """The surroundings of obstacles for one robot."""

    limit: SlowNear
    lever: float
    step: float

    def measure(self, q: Floats, reaches: Floats) -> Floats:
        """Return the lowest speeds that may hold."""
        return self.bound_speeds(q, reaches)[0]

    def bound_speeds(self, q: Floats, reaches: Floats) -> tuple[Floats, Floats]:
        """Bound the speeds by the clearance minus and plus the reach.

        The clearance of a row is a bound of the robot's true distance there. The distance falls by
        at most the reach, even if the bound jumps between rotation cells.
        """
        space, speed, distance = self.limit.space, self.limit.speed, self.limit.distance
        gaps = np.asarray(space.clearance(space.rotations.make_canonical(q)))
        lowest = np.where(gaps - reaches < distance, speed, np.inf)
        return lowest, np.where(gaps + reaches < distance, speed, np.inf)


class EverywhereRule(NamedTuple):
    """One largest speed."""

    speed: float
    step: float
    lever: float = 0.0

    def measure(self, q: Floats, reaches: Floats) -> Floats:
        """Return the speed for each row."""
        return np.full(len(q), self.speed)

    def bound_speeds(self, q: Floats, reaches: Floats) -> tuple[Floats, Floats]:
        """Return the speed for each row, twice."""
        speeds = self.measure(q, reaches)
        return speeds, speeds


class ToolRule(NamedTuple):
    """The largest speed of a link of an arm."""

    arm: Arm
    limit: ToolSpeed
    lever: float = 0.0
    step: float = JOINT_STEP

    def measure_along(
        self, q: Floats, firsts: Floats, halves: Floats, rates: Floats, bends: Floats
    ) -> tuple[Floats, Floats]:
        """Return the largest speeds along stretches, and bounds for any cuts.

        ``firsts`` are the first derivatives in the middles ``q``; ``rates`` and ``bends``, shapes
        (n, k), bound the first and second derivatives within ``halves``, shape (n,), of the
        middles.
        """
        link, speed = self.limit.link, self.limit.speed
        bounds = self.arm.link_speed(link, q, firsts, halves, rates, bends)
        middles = self.arm.link_speed(link, q, firsts)
        with np.errstate(divide="ignore"):
            grades = np.floor(np.log(speed / bounds) / np.log(GRADE))
            return (1.0 - ROUNDING) * GRADE**grades, speed / middles / GRADE


def place_limits(
    given: object, space: Space | None, axes: tuple[str, ...], frame_id: str
) -> tuple[SpeedRule | ToolRule, ...]:
    """Check limits of speed, and place them on a map."""
    limits = tuple(given) if isinstance(given, list | tuple) else (given,)
    rules: list[SpeedRule | ToolRule] = []
    for limit in limits:
        if not (is_number(limit) or isinstance(limit, SpeedZones | SlowNear | ToolSpeed)):
            rule = "it must be a number, SpeedZones, SlowNear, ToolSpeed, or a list of these"
            raise InputError("speed", f"is {limit!r}", rule)
        if space is None:
            raise InputError("plan", "has no map", "pickling leaves the map behind")
        if isinstance(limit, ToolSpeed):
            rules.append(_place_tool(limit, space))
            continue
        if not has_positions(space):
            rule = "limits of places are for robots on a map of positions"
            raise InputError("speed", f"is given, and space is {space!r}", rule)
        if isinstance(limit, SpeedZones):
            rules.append(_place_zones(limit, space, frame_id))
        elif isinstance(limit, SlowNear):
            rules.append(_place_near(limit, space, axes, frame_id))
        else:
            speed = check_positive(cast(float, limit), "speed", "m/s")
            rules.append(EverywhereRule(speed, 2.0 * space.resolution))
    return tuple(rules)


def is_number(limit: object) -> bool:
    """Return whether a limit is one number, m/s."""
    return isinstance(limit, Real) and not isinstance(limit, bool)


def _find_largest(
    limit: SpeedZones | SlowNear, space: Space, q: ArrayLike, lengths: ArrayLike, turns: ArrayLike
) -> Floats:
    """Return the largest speeds by one limit around configurations, shape (...)."""
    check_space(space)
    (rule,) = place_limits(limit, space, space.axes, space.frame_id)
    if isinstance(rule, ToolRule):
        raise TypeError("a limit of a link is none of a place")
    points = np.asarray(check_points(q, "q", space.axes))
    sizes = check_finite(lengths, "lengths"), check_finite(turns, "turns")
    warn_of_large(sizes[1], "rad", "turns")
    if "yaw" in space.axes:
        warn_of_large(points[..., -1], "rad", "q: yaw")
    reaches = 0.5 * (1.0 + ROUNDING) * (sizes[0] + rule.lever * sizes[1])
    reaches = np.broadcast_to(reaches, points.shape[:-1]).reshape(-1)
    found = rule.measure(points.reshape(-1, space.size), reaches)
    return found.reshape(points.shape[:-1])


def _place_zones(zones: SpeedZones, space: ConfigurationMap, frame_id: str) -> SpeedRule:
    """Check zones, and place them on a map."""
    _check_frame("speed", zones.frame_id, frame_id)
    grid = space.grid
    size = _measure_size(space)
    lower, upper = np.array(grid.lower[:2]), np.array(grid.upper[:2])
    box = shapely.box(*lower - size, *upper + size)
    areas = [area for area, _ in zones.zones]
    away = np.flatnonzero(~shapely.intersects(box, areas)).tolist()
    if away:
        name, problem = f"zones[{away[0]}]", f"lies off the map: {_format_box(areas[away[0]])}"
        rule = f"the map has {_format_box(shapely.box(*lower, *upper))}"
        if len(away) == len(areas):
            raise InputError(name, problem, rule)
        count = f"{len(away)} of {len(areas)} zones are left out"
        warn_user(f"{name} {problem}; {rule}; {count}", UnitWarning)
    step = 2.0 * space.resolution
    if zones.within == "point":
        return ZoneRule(zones, None, 0.0, 0.0, False, 0.0, step)
    names = space.rotations.names
    if len(names) > 1:
        return ZoneRule(zones, None, size, size, False, 0.0, step)
    cores, inner = _split_robot(space.robot)
    return ZoneRule(zones, cores, inner, size, bool(names), size if names else 0.0, step)


def _place_near(
    near: SlowNear, space: ConfigurationMap, axes: tuple[str, ...], frame_id: str
) -> SpeedRule:
    """Check the surroundings of obstacles, and place them on a map."""
    if near.space.axes != axes:
        problem = f"is of a map of {', '.join(near.space.axes)}"
        raise InputError("speed", problem, f"the plan has {', '.join(axes)}")
    # Obstacles in the plane meet the footprint of a robot on a floor, whatever their heights.
    own = space.drawn_robot if near.space.floor is None else space.robot
    other = near.space.robot
    if other is not own and other.shape.spec != own.shape.spec:
        problem = f"is of a map for another robot, a {other.name}"
        raise InputError("speed", problem, f"its shape must be that of the plan's, a {own.name}")
    if near.space.floor not in (None, space.floor):
        problem = f"is of a map with floor={near.space.floor!r}"
        raise InputError("speed", problem, f"the plan has floor={space.floor!r}")
    _check_frame("speed", near.space.frame_id, frame_id)
    lever = _measure_size(near.space) if near.space.rotations.names else 0.0
    return NearRule(near, lever, 2.0 * space.resolution)


def _place_tool(tool: ToolSpeed, space: Space) -> ToolRule:
    """Check a limit of a link, and give it the arm."""
    if find_space_kind(space) != ARMS:
        raise InputError("speed", f"is {tool}, and space is {space!r}", "links are those of an arm")
    arm = cast("ArmSpace", space).arm
    check_known(tool.link, "link", arm.frames)
    return ToolRule(arm, tool)


def _check_frame(name: str, frame_id: str | None, of_plan: str) -> None:
    """Raise InputError if a frame is not the plan's."""
    if frame_id not in (None, of_plan):
        raise InputError(name, f"has the frame {frame_id!r}", f"the plan has {of_plan!r}")


def _format_box(area: BaseGeometry) -> str:
    """Format the bounding box of an area."""
    x0, y0, x1, y1 = area.bounds
    return f"x {x0:g} to {x1:g} m, y {y0:g} to {y1:g} m"


def _number(rows: Ints, count: int) -> tuple[Ints, Ints]:
    """Return the distinct rows, and each row's number among them."""
    is_used = np.zeros(count, dtype=np.bool_)
    is_used[rows] = True
    return np.flatnonzero(is_used), (np.cumsum(is_used) - 1)[rows]


@lru_cache(maxsize=16)
def _split_robot(robot: Robot) -> tuple[Cores, float]:
    """Return a robot's outline, and its disc's radius at the origin."""
    cores = Cores(robot.shape.project_to_plane().outer)
    origin = shapely.Point(0.0, 0.0)
    largest = 0.0
    for geometry, radius in cores.parts:
        if radius:
            largest = max(largest, radius - geometry.distance(origin))
        elif geometry.contains(origin):
            largest = max(largest, geometry.boundary.distance(origin))
    return cores, (1.0 - ROUNDING) * largest


def _measure_size(space: ConfigurationMap) -> float:
    """Return the radius of the robot around its reference point.

    Heights count only if the robot rotates about any axis.
    """
    dim = space.dim if len(space.rotations.names) > 1 else 2
    corner = np.abs(space.robot.shape.outer.bounds)[:, :dim].max(axis=0)
    return float(np.linalg.norm(corner)) * (1.0 + ROUNDING)


class Stretches(NamedTuple):
    """The n parts of intervals with one largest speed each."""

    numbers: Ints  # (n,), the intervals
    begins: Floats  # (n,), lengths along the segment
    lengths: Floats  # (n,)
    tops: Floats  # (n,), largest speeds along the segment


class PlacedLimits(NamedTuple):
    """The limits of places and links that a motion keeps."""

    rules: tuple[SpeedRule | ToolRule, ...]
    rotations: Rotations
    dim: int  # number of axes of the translation

    def find_stretches(
        self,
        parts: Segments,
        intervals: tuple[Floats, Floats, Floats],
        rates: Floats,
        bends: Floats,
    ) -> Stretches:
        """Cut intervals of n segments at changes of limits.

        Each segment has one interval: begins and lengths along the segments, and largest speeds
        along these, shapes (n,). ``rates`` and ``bends``, shapes (n, k), bound the first and second
        derivatives.
        """
        found = Stretches(np.arange(len(rates)), *intervals)
        for rule in self.rules:
            found = self._cut(found, rule, parts, rates, bends)
        return found

    def _cut(
        self,
        stretches: Stretches,
        rule: SpeedRule | ToolRule,
        parts: Segments,
        rates: Floats,
        bends: Floats,
    ) -> Stretches:
        """Cut stretches at changes of one limit."""
        # They bound metres and radians by the length of each interval.
        ahead = np.linalg.norm(rates[:, : self.dim], axis=1)
        turning = np.linalg.norm(rates[:, self.dim :], axis=1)
        travel = (ahead + rule.lever * turning) * (1.0 + ROUNDING)
        numbers, begins, lengths, tops = stretches
        done = []
        # At first an interval has at most 1000 stretches, of at most eight cells.
        for step in (8 * rule.step, rule.step):
            is_last = step == rule.step
            least = np.ceil(np.minimum(travel[numbers] * lengths / step, 1000))
            counts = np.maximum(least, 1.0).astype(np.int64)
            owners, places = number_parts(counts)
            lengths = (lengths / counts)[owners]
            begins = begins[owners] + places * lengths
            numbers, tops = numbers[owners], tops[owners]
            halves = 0.5 * lengths
            q, first, _ = place_along(parts.select(numbers), self.rotations, begins + halves)
            reaches = halves * travel[numbers]
            if isinstance(rule, ToolRule):
                slopes = rates[numbers], bends[numbers]
                lowest, surest = rule.measure_along(q, first, halves, *slopes)
            else:
                with np.errstate(divide="ignore"):
                    if is_last:
                        lowest = surest = rule.measure(q, reaches) / ahead[numbers]
                    else:
                        lowest, surest = rule.bound_speeds(q, reaches) / ahead[numbers]
            is_open = (lowest < surest) & (lowest < tops) & (not is_last)
            found = Stretches(numbers, begins, lengths, np.minimum(tops, lowest))
            done.append(Stretches._make(column[~is_open] for column in found))
            if not is_open.any():
                break
            numbers, begins, lengths = numbers[is_open], begins[is_open], lengths[is_open]
            tops = tops[is_open]
        joined = Stretches._make(np.concatenate(columns) for columns in zip(*done, strict=True))
        order = np.lexsort((joined.begins, joined.numbers))
        return Stretches._make(column[order] for column in joined)
