"""ROS messages without ROS, and occupancy grids, read.

A message is any object with the right fields. The classes here have the fields of the messages of ROS 2 of the same
names, for use without ROS.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Ints
from cspace.check import finite, not_negative, positive
from cspace.errors import InputError
from cspace.files.rosmap import MapInfo

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


def read_occupancy_grid(msg: GridMessage, free_thresh: float, occupied_thresh: float) -> tuple[MapInfo, Bools, Bools]:
    """Return where the cells of a message lie, the free and the occupied ones, shape (nx, ny).

    Arguments are those of :meth:`cspace.Workspace.from_occupancy_grid`. Raises InputError if a field is missing or not
    as it must be, or another argument is not usable.
    """
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
    return MapInfo("msg", _resolution(msg), (x, y), _yaw(msg)), free, occupied


def _field(msg: object, path: str) -> Any:
    """A field of a message, by the names on the way to it."""
    value = msg
    for name in path.split("."):
        try:
            value = getattr(value, name)
        except AttributeError as error:
            raise lacking("msg", path, "nav_msgs/OccupancyGrid") from error
    return value


def lacking(argument: str, path: str, kind: str) -> InputError:
    """Return the error of a message that has no such field."""
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
