"""ROS maps, messages and Nav2 parameter files, without ROS.

A message is any object with the right fields. The classes here are for use without ROS, and have
the fields of the ROS 2 messages of the same names.
"""

from __future__ import annotations

import ast
import itertools
import math
import os
import pathlib
from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._files.access import ContentError, decoding
from cspace._files.fields import Fields
from cspace._files.images import Shades, read_shades
from cspace._files.plain import read_yaml
from cspace._support.arrays import Bools, Floats, StrPath
from cspace._support.check import (
    check_count,
    check_finite,
    check_not_negative,
    check_positive,
    check_real,
)
from cspace._support.reporting import warn_user
from cspace.errors import AngleWarning, FileError, GeometryError, InputError

YAML_SUFFIXES: Final = (".yaml", ".yml")

_MAX_METRES: Final = 1e15
"""Maximum coordinate and resolution, in metres; its reciprocal is the minimum resolution."""

MODES: Final = ("trinary", "scale", "raw")
"""Values of ``mode`` in the YAML of a map; the first is the default."""

_REQUIRED_MAP_KEYS: Final = (
    "image",
    "resolution",
    "origin",
    "negate",
    "occupied_thresh",
    "free_thresh",
)

_ANGLE_ROUNDING: Final = 1e-6
"""Excess, in radians, of a whole turn that is written with few digits."""

_UNKNOWN_GREY: Final = 205 / 255
"""Shade that the map savers of ROS write for unknown cells in trinary mode."""

FIELDS: Final = (
    Fields(
        "ROS map, `.yaml`",
        honoured=(
            "`image`; `mode`; `resolution`; `origin` with its yaw; `negate`; `occupied_thresh`; "
            "`free_thresh`; transparency"
        ),
        refused="`negate` in raw mode; EXIF orientation of the image",
        warned=(
            "grey 205 below `free_thresh`, unknown; yaw beyond a whole turn; an image outside the "
            "folder; other keys"
        ),
    ),
    Fields(
        "`nav_msgs/OccupancyGrid`",
        honoured="`resolution`, of float32; `width`, `height`; `origin`; -1",
        refused="tilt of `origin`",
        warned="values beyond -1 to 100, unknown; 0 and 1 alone",
    ),
    Fields(
        "Nav2 parameters",
        honoured="`footprint`; `robot_radius`; `footprint_padding`",
        refused="numbers in quotes; negative padding",
        warned="padding, where Nav2's differs",
    ),
)


def read_ros_map(path: StrPath, unknown: str = "occupied") -> tuple[MapInfo, Bools, Bools]:
    """Read the placement and cells of a ROS map.

    The image becomes cells as in map_server of ROS 1 and Navigation2. Here *shade* is the mean of
    the colour channels from 0 (black) to 1 (white); ``p = 1 - shade``, or ``p = shade`` if
    ``negate`` is 1:

    * ``trinary`` (the default): ``p >= occupied_thresh`` is occupied, ``p < free_thresh`` is free,
      the rest is unknown. Grey 205, which map savers write for unknown cells, is unknown also if
      it is below ``free_thresh``; a warning counts such cells;
    * ``scale``: ``p < free_thresh`` is free and the rest is occupied, because a cell with some
      probability of being occupied is not proven free;
    * ``raw``: ``round(255 * shade)`` is the occupancy in per cent; below ``100 * free_thresh`` is
      free, up to 100 is occupied, above is unknown.

    A pixel that is not fully opaque is unknown, as in Navigation2 since 2025, and in ``raw``
    mode too. Releases disagree about ``p`` equal to a threshold; here it is never free.

    Parameters
    ----------
    path : path-like
        The YAML file. The path of its ``image`` is relative to its folder.
    unknown : {"occupied", "free"}
        What the caller takes unknown cells for; no warning counts them if they are free.

    Returns
    -------
    info : MapInfo
        Placement of the cells.
    free, occupied : ndarray of bool, shape (nx, ny)
        Cells in neither array are unknown.

    Raises
    ------
    FileError
        If the YAML or its image is missing or malformed; the message names the key and its value.
    """
    with decoding(path, "ROS map"):
        header = _read_header(path)
    image = read_shades(header.image, "ROS map's image", may_turn=False)
    free, occupied = _classify_pixels(header, image, unknown == "occupied")
    return header.info, free, occupied


class MapInfo(NamedTuple):
    """Placement of the cells of a map.

    Attributes
    ----------
    source : str
        Name of the map in messages.
    resolution : float
        Side of a cell, metres.
    origin : tuple of float
        Lower left corner of the first cell, metres.
    yaw : float
        Rotation of the map about that corner, radians.
    """

    source: str
    resolution: float
    origin: tuple[float, float]
    yaw: float


class _MapHeader(NamedTuple):
    """Content of the YAML file of a map."""

    info: MapInfo
    image: pathlib.Path
    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float


def _read_header(path: StrPath) -> _MapHeader:
    """Read the YAML file of a ROS map.

    Raises an error that names the key if a value is missing or wrong.
    """
    # The keys that must be there, then words, then numbers, then the image.
    document = read_yaml(path, "ROS map")
    if not isinstance(document, dict):
        problem = f"holds {type(document).__name__}"
        hint = "write e.g. 'resolution: 0.05'"
        raise _make_key_error(problem, "keys and values", hint)
    for key in _REQUIRED_MAP_KEYS:
        if key not in document:
            present = ", ".join(document) or "nothing"
            raise _make_key_error(f"{key} is missing", f"there, besides {present:.200}", "add it")
    read_keys = {*_REQUIRED_MAP_KEYS, "mode"}
    other_keys = ", ".join(key for key in document if key not in read_keys)
    if other_keys:
        warn_user(f"{path}: {other_keys:.60} is not read in a ROS map; remove or correct it")
    mode = document.get("mode", MODES[0])
    negate = document["negate"]
    if mode not in MODES:
        raise _make_key_error(f"mode is {mode!r:.60}", f"one of {', '.join(MODES)}", "correct it")
    if negate not in (0, 1):
        hint = "write 'negate: 0' if dark pixels are obstacles"
        raise _make_key_error(f"negate is {negate!r:.60}", "0 or 1", hint)
    if negate and mode == "raw":
        rule = "0 there: ROS 1 and ROS 2 disagree on its effect"
        raise _make_key_error("negate is 1 in raw mode", rule, "remove it")
    info = _parse_placement(document, os.fspath(path))
    occupied_thresh = _parse_number(document["occupied_thresh"], "occupied_thresh", 0.0, 1.0)
    free_thresh = _parse_number(document["free_thresh"], "free_thresh", 0.0, 1.0)
    if free_thresh >= occupied_thresh:
        problem = f"free_thresh is {free_thresh} and occupied_thresh is {occupied_thresh}"
        raise _make_key_error(problem, "free below occupied", "exchange them")
    image = _find_image(pathlib.Path(path), document["image"])
    return _MapHeader(info, image, mode, bool(negate), occupied_thresh, free_thresh)


def _parse_placement(document: Mapping[str, Any], source: str) -> MapInfo:
    """Parse the resolution and the origin of a ROS map."""
    resolution = _parse_number(document["resolution"], "resolution", 1.0 / _MAX_METRES)
    origin = document["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        hint = "write e.g. 'origin: [0.0, 0.0, 0.0]'"
        raise _make_key_error(f"origin is {origin!r:.60}", "x, y and yaw", hint)
    x, y, yaw = (_parse_number(value, f"origin[{index}]") for index, value in enumerate(origin))
    if abs(yaw) > 2.0 * math.pi + _ANGLE_ROUNDING:
        warn_user(
            f"{source}: the yaw of origin is {yaw:g}, beyond a whole turn; it is in radians; "
            f"write {math.radians(yaw):.6g} if it was in degrees",
            AngleWarning,
        )
    return MapInfo(source, resolution, (x, y), yaw)


def _find_image(path: pathlib.Path, name: Any) -> pathlib.Path:
    """Return the path of the image; warn if it lies outside the map's folder."""
    if not isinstance(name, str) or not name or "\0" in name:
        raise _make_key_error(f"image is {name!r:.60}", "its name", "write e.g. 'image: map.pgm'")
    file = path.parent / name
    if not file.resolve().is_relative_to(path.parent.resolve()):
        warn_user(f"{path}: image is {name!r}, which lies outside the folder of the map")
    return file


def _parse_number(
    value: Any, key: str, lowest: float = -_MAX_METRES, highest: float = _MAX_METRES
) -> float:
    """Return a value of the header as a float between two bounds."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not lowest <= number <= highest:
        rule = f"a number from {lowest:g} to {highest:g}"
        raise _make_key_error(f"{key} is {value!r:.60}", rule, "correct it")
    return number


def _make_key_error(problem: str, rule: str, hint: str) -> ContentError:
    """Return the error for a wrong value in the YAML of a ROS map."""
    return ContentError(problem, f"in a ROS map it must be {rule}", hint)


def _classify_pixels(header: _MapHeader, image: Shades, warn: bool) -> tuple[Bools, Bools]:
    """Return masks of the free and the occupied pixels of a ROS map.

    The modes are documented at :func:`read_ros_map`. All pixels of a level are alike, so levels are
    classified first. With `warn`, warn of unknown pixels below ``free_thresh``.
    """
    shades = image.shades
    # In raw mode, levels are percentages; in the other modes, they are shades of a probability.
    probability = shades if header.negate else 1.0 - shades
    if header.mode == "raw":
        probability = np.floor(255.0 * shades + 0.5) / 100.0
    free_levels = probability < header.free_thresh
    if header.mode == "raw":
        occupied_levels = ~free_levels & (probability <= 1.0)
    elif header.mode == "scale":
        occupied_levels = ~free_levels
    else:
        occupied_levels = probability >= header.occupied_thresh
        doubtful_levels = free_levels & (shades == _UNKNOWN_GREY) & (not header.negate)
        if doubtful_levels.any():
            free_levels &= ~doubtful_levels
            count = np.count_nonzero(image.select(doubtful_levels) & image.opaque)
            if count and warn:
                warn_user(
                    f"{header.info.source}: {count:,} cells are of grey 205, which map savers "
                    f"write for unknown ones, but lie below free_thresh: {header.free_thresh:g}; "
                    "they count as unknown: write free_thresh: 0.196, or pass unknown='free'"
                )
    free = image.select(free_levels) & image.opaque
    occupied = image.select(occupied_levels) & image.opaque
    return free, occupied


_MAX_TILT: Final = 1e-6
"""Maximum x and y components, relative to the norm of the quaternion, of a map that lies flat."""


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
    """nav_msgs/OccupancyGrid.

    `data` is the occupancy in per cent, row by row from the lowest x and y; -1 is unknown.
    """

    header: Header = field(default_factory=Header)
    info: MapMetaData = field(default_factory=MapMetaData)
    data: array[int] = field(default_factory=lambda: array("b"), repr=False)


@dataclass
class OccupancyGridUpdate:
    """map_msgs/OccupancyGridUpdate.

    `x` and `y` are the first cell of a box of an OccupancyGrid, and `data` its new values.
    """

    header: Header = field(default_factory=Header)
    x: int = 0
    y: int = 0
    width: int = 0
    height: int = 0
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
    """nav2_msgs/Costmap.

    `data` holds costs from 0 to 255, row by row from the lowest x and y.
    """

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
class Twist:
    """``geometry_msgs/Twist``: a velocity and an angular velocity."""

    linear: Point = field(default_factory=Point)
    angular: Point = field(default_factory=Point)


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
    """Any object with the fields of ``nav_msgs/OccupancyGrid``."""

    @property
    def info(self) -> object:
        """Size and placement."""
        ...

    @property
    def data(self) -> object:
        """Occupancy of the cells."""
        ...


def read_occupancy_grid(
    msg: GridMessage, free_thresh: float, occupied_thresh: float
) -> tuple[MapInfo, Bools, Bools]:
    """Read the placement, and the free and occupied cells, of a message.

    Parameters are as for :meth:`cspace.Workspace.from_occupancy_grid`.

    Raises InputError if a field is missing or invalid, or another argument is invalid.
    """
    low = check_not_negative(free_thresh, "free_thresh", "")
    high = check_not_negative(occupied_thresh, "occupied_thresh", "")
    if not low < high <= 1.0:
        problem = f"is {low:g} and occupied_thresh is {high:g}"
        rule = "free_thresh must be below occupied_thresh, both from 0 to 1"
        hint = "pass e.g. 0.25 and 0.65"
        raise InputError("free_thresh", problem, rule, hint)
    # Row by row from the lowest y; other numbers than per cent stand for unknown cells.
    percent = _read_rows(msg, "info.", "msg", "nav_msgs/OccupancyGrid").T
    is_known = (percent >= 0) & (percent <= 100)
    others = np.count_nonzero(~is_known & (percent != -1))
    if others:
        warn_user(
            f"msg.data: {others:,} values are beyond -1 to 100 and count as unknown; for the costs "
            "of a Costmap, pass e.g. np.where(costs >= 253, 100, 0)"
        )
    if percent.max() == 1:
        warn_user(
            "msg.data: no value is above 1 per cent, so all cells are free or unknown; write 100 "
            "for occupied cells, e.g. 100 * data"
        )
    free = is_known & (percent / 100.0 < low)
    occupied = is_known & (percent / 100.0 >= high)
    position = "info.origin.position"
    coordinates = [get_field(msg, f"{position}.{name}") for name in "xy"]
    x, y = check_finite(coordinates, f"msg.{position}").tolist()
    info = MapInfo("msg", _parse_resolution(msg), (x, y), _parse_yaw(msg))
    return info, free, occupied


def update_occupancy_grid(msg: GridMessage, update: object) -> None:
    """Write the new values of a box of cells into an occupancy grid message.

    Parameters
    ----------
    msg : object
        With the fields of ``nav_msgs/OccupancyGrid``; its ``data`` is replaced.
    update : object
        With the fields of ``map_msgs/OccupancyGridUpdate``.

    Raises
    ------
    InputError
        If a field is missing or malformed, the box is not within the grid, or the data of either
        are not as many as its cells; nothing changes then.

    Examples
    --------
    >>> import cspace
    >>> grid, update = cspace.ros.OccupancyGrid(), cspace.ros.OccupancyGridUpdate(x=1, width=2)
    >>> grid.info.width, grid.info.height, update.height = 3, 1, 1
    >>> grid.data.extend([0, 0, 0]); update.data.extend([100, -1])
    >>> cspace.ros.update_occupancy_grid(grid, update); grid.data.tolist()
    [0, 100, -1]
    """
    kind = "map_msgs/OccupancyGridUpdate"
    cells = _read_rows(msg, "info.", "msg", "nav_msgs/OccupancyGrid").astype(np.int8)
    values = _read_rows(update, "", "update", kind)
    x, y = (check_count(get_field(update, name, "update", kind), f"update.{name}") for name in "xy")
    window = cells[y : y + len(values), x : x + values.shape[1]]
    if window.shape != values.shape:
        problem = f"has {values.shape[1]} x {len(values)} cells from ({x}, {y}) on"
        rule = f"they must lie in the grid of {cells.shape[1]} x {len(cells)}"
        raise InputError("update", problem, rule, "wait for the whole new map")
    window[...] = values
    whole: Any = msg
    whole.data = array("b", cells.tobytes())


def _read_rows(msg: object, info: str, argument: str, kind: str) -> NDArray[Any]:
    """Return the data of a message as rows of its cells, shape (height, width).

    ``info`` is the prefix of the fields of its size, ``argument`` its name in errors, and ``kind``
    its type.
    """
    width, height = (
        check_count(get_field(msg, f"{info}{name}", argument, kind), f"{argument}.{info}{name}", 1)
        for name in ("width", "height")
    )
    values = check_real(get_field(msg, "data", argument, kind), f"{argument}.data")
    if values.shape != (width * height,) or values.dtype.kind not in "iu":
        problem = f"has shape {values.shape} and type {values.dtype}"
        rule = f"it must have width x height = {width} x {height} whole numbers, from -1 to 100"
        raise InputError(f"{argument}.data", problem, rule, "pass the whole message")
    return values.reshape(height, width)


def get_field(
    msg: object, path: str, argument: str = "msg", kind: str = "nav_msgs/OccupancyGrid"
) -> Any:
    """Return a field of a message by its dotted path.

    ``argument`` is its name in errors, and ``kind`` its type.
    """
    try:
        return attrgetter(path)(msg)
    except AttributeError as error:
        raise missing_field_error(argument, path, kind) from error


def missing_field_error(argument: str, path: str, kind: str) -> InputError:
    """Return the error for a message without a field."""
    return InputError(
        argument, f"has no {path}", f"it must have the fields of {kind}", "pass such a message"
    )


def _parse_resolution(msg: object) -> float:
    """Return the side of a cell of a message's map, metres.

    Messages store single precision; this undoes the rounding.
    """
    value = check_positive(get_field(msg, "info.resolution"), "msg.info.resolution")
    single = np.float32(value)
    # The shortest text of a float32 is the decimal number that was rounded to it.
    return float(str(single)) if float(single) == value else value


def _parse_yaw(msg: object) -> float:
    """Return the yaw of a message's map, radians.

    An unset quaternion, all zeros, counts as no rotation.
    """
    place = "info.origin.orientation"
    values = [get_field(msg, f"{place}.{name}") for name in "xyzw"]
    x, y, z, w = check_finite(values, f"msg.{place}").tolist()
    norm = math.hypot(x, y, z, w)
    if norm == 0.0:
        return 0.0
    if max(abs(x), abs(y)) > _MAX_TILT * norm:
        rule = "a map must lie flat, turned about z only"
        problem = f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is tilted"
        raise InputError(f"msg.{place}", problem, rule, "set x and y to 0")
    return 2.0 * math.atan2(z, w)  # a quaternion has half the angle


DEFAULT_FOOTPRINT_PADDING: Final = 0.01
"""Default ``footprint_padding`` of Nav2, metres."""

_NO_FOOTPRINT: Final[tuple[object, ...]] = (None, "", "[]", [])
"""Values of ``footprint`` that leave the robot to its radius."""


class CostmapRobot(NamedTuple):
    """Footprint corners or radius, and padding, of a costmap's robot; metres."""

    corners: tuple[tuple[float, float], ...]
    radius: float
    padding: float

    def __str__(self) -> str:
        """Describe the robot in the words of the parameters."""
        size = f"a robot_radius of {self.radius:g} m"
        if self.corners:
            size = f"a footprint of {len(self.corners)} corners"
        return f"{size}, footprint_padding {self.padding:g} m"


def parse_footprint(footprint: str | ArrayLike, name: str = "footprint") -> Floats:
    """Parse the corners of a footprint, shape (n, 2), metres.

    A text has the form of Nav2, ``"[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"``.

    Raises GeometryError if it is not a list of at least three points, and InputError if a number is
    not finite; `name` is the argument that messages name.
    """
    rule = "it must be at least three points, each of x and y in metres"
    problem = f"is {footprint!r:.80}"
    hint = "write e.g. [[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]"
    try:
        rows = ast.literal_eval(footprint.strip()) if isinstance(footprint, str) else footprint
        corners = check_finite(rows, name)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
        raise GeometryError(name, problem, rule, hint) from error
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise GeometryError(name, problem, rule, hint)
    return corners


def read_nav2(path: StrPath, costmap: str | None = None) -> CostmapRobot:
    """Read the robot of a Nav2 parameter file.

    The search covers tables at any depth with ``footprint`` or ``robot_radius``: the local and
    global costmaps of a Nav2 file, or the top of a ROS 1 ``costmap_common_params.yaml``. If they
    differ, pass `costmap`, for example "local_costmap".

    Raises FileError if the file is missing or malformed, or describes no robot, several, or not
    that costmap.
    """
    file = os.fspath(path)
    tables = dict(_iterate_tables(read_yaml(path, "Nav2 parameter file"), ()))
    if not tables:
        problem = "holds neither footprint nor robot_radius"
        rule = "a costmap has one of them"
        hint = "write e.g. 'robot_radius: 0.22' in its local_costmap and global_costmap"
        raise FileError(file, problem, rule, hint)
    robots = {
        name: _parse_robot(table, f"{file}: {name or 'the file'}")
        for name, table in tables.items()
        if costmap is None or name.endswith(costmap)
    }
    if not robots:
        rule = f"it has {', '.join(tables)}"
        raise FileError(file, f"has no costmap {costmap!r}", rule, "name one of these")
    # Costmaps may agree; then it does not matter which one is taken.
    name, robot = next(iter(robots.items()))
    if len(set(robots.values())) > 1:
        listed = "; ".join(f"{name} has {robot}" for name, robot in robots.items())
        hint = f"pass e.g. costmap={name!r}, or {pathlib.Path(file).name}#{name}"
        raise FileError(file, f"describes several robots: {listed}", "a map has one robot", hint)
    return robot


def _iterate_tables(value: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield each table that describes a robot, named by its path.

    A name repeated in a row appears once, as in Nav2's ``local_costmap: local_costmap:``.
    """
    if not isinstance(value, dict):
        return
    if value.get("footprint") not in _NO_FOOTPRINT or "robot_radius" in value:
        names = (name for name in path if name != "ros__parameters")
        yield "/".join(name for name, _ in itertools.groupby(names)), value
    for name, inner in value.items():
        yield from _iterate_tables(inner, (*path, name))


def _parse_robot(table: Mapping[str, Any], place: str) -> CostmapRobot:
    """Parse the robot of a costmap's parameters."""
    footprint: Any = table.get("footprint")
    padding = check_not_negative(
        table.get("footprint_padding", DEFAULT_FOOTPRINT_PADDING), f"{place}: footprint_padding"
    )
    if footprint in _NO_FOOTPRINT:
        radius = check_positive(table["robot_radius"], f"{place}: robot_radius")
        return CostmapRobot((), radius, padding)
    corners = parse_footprint(footprint, f"{place}: footprint").tolist()
    return CostmapRobot(tuple((x, y) for x, y in corners), 0.0, padding)
