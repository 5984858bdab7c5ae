"""ROS messages without ROS: occupancy grids are read; grids, costmaps, paths and joint trajectories are filled.

A message is any object with the right fields. The classes here have the fields of the messages of ROS 2 of the same
names, for use without ROS.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any, Final, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.errors import InputError
from cspace.grid import Grid, check_word, finite, not_negative, positive
from cspace.io.files import UNKNOWNS
from cspace.io.rosmap import MapInfo, on_grid
from cspace.states import BLOCKED, FREE, MIXED

Message = TypeVar("Message")

LETHAL, INSCRIBED, NO_INFORMATION = 254, 253, 255
"""Costs of Nav2: an obstacle is there; a robot there is in collision, however it is turned; nothing is known."""

OCCUPANCY: Final = {FREE: 0, MIXED: -1, BLOCKED: 100}
"""Value of each state in an occupancy grid, in per cent; -1 is unknown."""

_TILT: Final = 1e-6
"""Components of a quaternion, of norm 1, below which a map is taken to lie flat."""


@dataclass
class Time:
    """builtin_interfaces/Time."""

    sec: int = 0
    nanosec: int = 0


@dataclass
class Header:
    """std_msgs/Header."""

    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Point:
    """geometry_msgs/Point."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Quaternion:
    """geometry_msgs/Quaternion."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class Pose:
    """geometry_msgs/Pose."""

    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class MapMetaData:
    """nav_msgs/MapMetaData."""

    map_load_time: Time = field(default_factory=Time)
    resolution: float = 0.0
    width: int = 0
    height: int = 0
    origin: Pose = field(default_factory=Pose)


@dataclass
class OccupancyGrid:
    """nav_msgs/OccupancyGrid: per cent of occupancy row by row, from the cell of the lowest x and y; -1 is unknown."""

    header: Header = field(default_factory=Header)
    info: MapMetaData = field(default_factory=MapMetaData)
    data: array[int] = field(default_factory=lambda: array("b"), repr=False)


@dataclass
class CostmapMetaData:
    """nav2_msgs/CostmapMetaData."""

    map_load_time: Time = field(default_factory=Time)
    update_time: Time = field(default_factory=Time)
    layer: str = ""
    resolution: float = 0.0
    size_x: int = 0
    size_y: int = 0
    origin: Pose = field(default_factory=Pose)


@dataclass
class Costmap:
    """nav2_msgs/Costmap: costs from 0 to 255 row by row, from the cell of the lowest x and y."""

    header: Header = field(default_factory=Header)
    metadata: CostmapMetaData = field(default_factory=CostmapMetaData)
    data: array[int] = field(default_factory=lambda: array("B"), repr=False)


@dataclass
class PoseStamped:
    """geometry_msgs/PoseStamped."""

    header: Header = field(default_factory=Header)
    pose: Pose = field(default_factory=Pose)


@dataclass
class Path:
    """nav_msgs/Path."""

    header: Header = field(default_factory=Header)
    poses: list[PoseStamped] = field(default_factory=list)


@dataclass
class Duration:
    """builtin_interfaces/Duration."""

    sec: int = 0
    nanosec: int = 0


@dataclass
class JointTrajectoryPoint:
    """trajectory_msgs/JointTrajectoryPoint."""

    positions: array[float] = field(default_factory=lambda: array("d"))
    velocities: array[float] = field(default_factory=lambda: array("d"))
    accelerations: array[float] = field(default_factory=lambda: array("d"))
    effort: array[float] = field(default_factory=lambda: array("d"))
    time_from_start: Duration = field(default_factory=Duration)


@dataclass
class JointTrajectory:
    """trajectory_msgs/JointTrajectory."""

    header: Header = field(default_factory=Header)
    joint_names: list[str] = field(default_factory=list)
    points: list[JointTrajectoryPoint] = field(default_factory=list)


class GridMessage(Protocol):
    """What has the fields of ``nav_msgs/OccupancyGrid``; each is looked up by its name."""

    @property
    def info(self) -> object: ...
    @property
    def data(self) -> object: ...


def read_occupancy_grid(
    msg: GridMessage, unknown: str, free_thresh: float, occupied_thresh: float
) -> tuple[Grid, Bools, Bools, Bools]:
    """The cells of a message, as :func:`cspace.io.rosmap.read_ros_map` returns them.

    Arguments are those of :meth:`cspace.Workspace.from_occupancy_grid`. Raises InputError if a field is missing or not
    as it must be, or another argument is not usable.
    """
    check_word(unknown, "unknown", UNKNOWNS)
    low, high = not_negative(free_thresh, "free_thresh", ""), not_negative(occupied_thresh, "occupied_thresh", "")
    if not 0.0 <= low < high <= 1.0:
        rule = "free_thresh must be below occupied_thresh, both from 0 to 1"
        raise InputError(
            "free_thresh",
            f"is {low:g} and occupied_thresh is {high:g}",
            rule,
            "pass e.g. 0.25 and 0.65",
            value=free_thresh,
        )
    width, height = (_size(msg, name) for name in ("width", "height"))
    values = _values(_field(msg, "data"))
    if values.shape != (width * height,):
        rule = f"it must have one value for each of width x height = {width} x {height} cells"
        raise InputError("msg.data", f"has shape {values.shape}", rule, "pass the message whole", value=values)
    percent = values.reshape(height, width).T
    known = (percent >= 0) & (percent <= 100)
    free, occupied = known & (percent / 100.0 < low), known & (percent / 100.0 >= high)
    x, y = (float(finite(_field(msg, f"info.origin.position.{k}"), f"msg.info.origin.position.{k}")) for k in "xy")
    return on_grid(MapInfo("msg", _resolution(msg), (x, y), _yaw(msg)), free, occupied, unknown)


def fill_occupancy_grid(state: NDArray[np.uint8], grid: Grid, msg: Message, frame_id: str) -> Message:
    """The message, which is changed, with a map of states in it: free 0, undecided -1, blocked 100.

    Raises InputError if the grid is not plane, or a field is missing.
    """
    values = np.array([OCCUPANCY[each] for each in sorted(OCCUPANCY)], dtype=np.int8)
    fields = {"info.width": grid.shape[0], "info.height": grid.shape[1]}
    return _filled(msg, "nav_msgs/OccupancyGrid", values[state], grid, "info", fields, frame_id)


def fill_costmap(costs: NDArray[np.uint8], grid: Grid, msg: Message, frame_id: str) -> Message:
    """The message with a map of costs in it; as :func:`fill_occupancy_grid`, of ``nav2_msgs/Costmap``."""
    fields = {"metadata.size_x": grid.shape[0], "metadata.size_y": grid.shape[1]}
    return _filled(msg, "nav2_msgs/Costmap", costs, grid, "metadata", fields, frame_id)


def fill_path(positions: Floats, quaternions: Floats, msg: Message, frame_id: str) -> Message:
    """Fill a ``nav_msgs/Path`` with poses.

    ``positions``, shape (n, 3), are in metres; ``quaternions``, shape (n, 4), are x, y, z, w. Each pose gets the frame
    and the stamp of the message. Raises InputError if the message lacks a field.
    """
    kind = "nav_msgs/Path"
    make, stamp = _element_class(msg, "poses", PoseStamped), getattr(getattr(msg, "header", None), "stamp", None)
    poses = []
    for position, quaternion in zip(positions.tolist(), quaternions.tolist(), strict=True):
        fields = {"header.frame_id": frame_id} | ({} if stamp is None else {"header.stamp": stamp})
        fields |= {f"pose.position.{name}": x for name, x in zip("xyz", position, strict=True)}
        fields |= {f"pose.orientation.{name}": x for name, x in zip("xyzw", quaternion, strict=True)}
        poses.append(_set_fields(make(), kind, fields))
    return _set_fields(msg, kind, {"header.frame_id": frame_id, "poses": poses})


def fill_joint_trajectory(
    joints: Sequence[str], positions: Floats, seconds: Floats, msg: Message, frame_id: str
) -> Message:
    """Fill a ``trajectory_msgs/JointTrajectory`` with positions, shape (n, dof), at seconds from its start, shape (n,).

    Raises InputError if the message lacks a field.
    """
    kind = "trajectory_msgs/JointTrajectory"
    make = _element_class(msg, "points", JointTrajectoryPoint)
    points = []
    for row, time in zip(positions.tolist(), seconds.tolist(), strict=True):
        whole, nanoseconds = divmod(round(time * 1e9), 10**9)
        point = make()
        # A duration of ROS 1 has other names for the same fields.
        names = ("secs", "nsecs") if hasattr(getattr(point, "time_from_start", None), "secs") else ("sec", "nanosec")
        times = {f"time_from_start.{name}": n for name, n in zip(names, (whole, nanoseconds), strict=True)}
        points.append(_set_fields(point, kind, {"positions": array("d", row), **times}))
    return _set_fields(msg, kind, {"header.frame_id": frame_id, "joint_names": list(joints), "points": points})


def costs_of(
    clearance: Floats, lethal: Bools, unknown: Bools | None, inscribed: float, scaling: float, radius: float
) -> NDArray[np.uint8]:
    """Compute costs of Nav2's inflation layer, shape (nx, ny), from each cell's clearance in metres.

    The clearance is zero where a robot may be in collision; above ``radius - inscribed`` it may be infinite. ``lethal``
    cells meet an obstacle; nothing is known of ``unknown`` cells. ``inscribed`` is the radius of the robot's inscribed
    circle, metres; ``scaling`` is ``cost_scaling_factor``, per metre, and ``radius`` is ``inflation_radius``, metres,
    from the obstacles.
    """
    costs = ((INSCRIBED - 1) * np.exp(-scaling * np.minimum(clearance, radius))).astype(np.uint8)
    costs[clearance + inscribed > radius] = 0
    taken = clearance <= 0.0
    costs[taken] = INSCRIBED
    costs[taken & lethal] = LETHAL
    if unknown is not None:
        costs[taken & unknown] = NO_INFORMATION
    return costs


def _field(msg: object, path: str) -> Any:
    """A field of a message, by the names on the way to it."""
    value = msg
    for name in path.split("."):
        try:
            value = getattr(value, name)
        except AttributeError as error:
            raise _lacking("msg", path, "nav_msgs/OccupancyGrid") from error
    return value


def _lacking(argument: str, path: str, kind: str) -> InputError:
    return InputError(argument, f"has no {path}", f"it must have the fields of {kind}", "pass such a message")


def _size(msg: object, name: str) -> int:
    value = _field(msg, f"info.{name}")
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
        raise InputError(
            f"msg.info.{name}", f"is {value!r}", "it must be a whole number above zero", "fill it", value=value
        )
    return int(value)


def _values(data: ArrayLike) -> Ints | NDArray[np.int8]:
    """The data of a message, whatever holds its whole numbers."""
    try:
        values = np.asarray(data)
    except ValueError as error:
        raise InputError(
            "msg.data", "is not one list of numbers", "it must be", "pass the message whole", value=data
        ) from error
    if values.dtype.kind not in "iu":
        fault = f"holds values of type {values.dtype}"
        raise InputError("msg.data", fault, "they must be whole numbers, from -1 to 100", "round them", value=data)
    return values


def _resolution(msg: object) -> float:
    """The side of a cell; a message keeps it in single precision, of which the shortest number is what was meant."""
    value = positive(_field(msg, "info.resolution"), "msg.info.resolution")
    single = np.float32(value)
    return float(str(single)) if float(single) == value else value


def _yaw(msg: object) -> float:
    """By how much the map is turned; a quaternion of zeros, as messages have it that nobody filled, is none."""
    place = "info.origin.orientation"
    x, y, z, w = finite([_field(msg, f"{place}.{name}") for name in "xyzw"], f"msg.{place}").tolist()
    norm = math.hypot(x, y, z, w)
    if norm == 0.0:
        return 0.0
    if max(abs(x), abs(y)) > _TILT * norm:
        rule = "a map lies flat, and is turned about z alone"
        raise InputError(
            f"msg.{place}",
            f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is tilted",
            rule,
            "set x and y to 0",
            value=(x, y, z, w),
        )
    return 2.0 * math.atan2(z, w)


def _filled(
    msg: Message,
    kind: str,
    cells: NDArray[np.int8] | NDArray[np.uint8],
    grid: Grid,
    about: str,
    fields: Mapping[str, object],
    frame_id: str,
) -> Message:
    if cells.shape != grid.shape[:2]:
        raise InputError("the map", "is one in space", f"{kind} is plane", "cut it, or export another format")
    origin = f"{about}.origin"
    every = {
        "header.frame_id": frame_id,
        f"{about}.resolution": grid.spacing,
        **fields,
        **{f"{origin}.position.{name}": x for name, x in zip("xyz", (*grid.lower, 0.0), strict=True)},
        **{f"{origin}.orientation.{name}": x for name, x in zip("xyzw", (0.0, 0.0, 0.0, 1.0), strict=True)},
        "data": array({"i": "b", "u": "B"}[cells.dtype.kind], cells.T.tobytes()),
    }
    return _set_fields(msg, kind, every)


def _set_fields(msg: Message, kind: str, fields: Mapping[str, object]) -> Message:
    """Set fields of a message, given by dotted paths.

    Raises InputError if it has no such field.
    """
    for path, value in fields.items():
        *parents, last = path.split(".")
        target: object = msg
        for name in parents:
            target = getattr(target, name, None)
        if not hasattr(target, last):
            raise _lacking("msg", path, kind)
        setattr(target, last, value)
    return msg


def _element_class(msg: object, name: str, otherwise: Callable[[], Any]) -> Callable[[], Any]:
    """Return the class of the elements of a list field, as a message of ROS declares it, or else ``otherwise``."""
    declared = getattr(msg, "get_fields_and_field_types", None)  # ROS 2
    if declared is not None:
        kinds = dict(declared())
    else:
        kinds = dict(zip(getattr(msg, "__slots__", ()), getattr(msg, "_slot_types", ()), strict=False))  # ROS 1
    named = re.search(r"(\w+)/(\w+)", kinds.get(name, ""))
    if named is None:
        return otherwise
    package, message = named.groups()
    made: Callable[[], Any] = getattr(import_module(f"{package}.msg"), message)
    return made
