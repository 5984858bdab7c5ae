"""ROS maps, messages and Nav2 parameter files, without ROS.

A message is any object with the right fields. The classes here are for use without ROS, and have
the fields of the ROS 2 messages of the same names.
"""

from __future__ import annotations

import ast
import base64
import itertools
import math
import os
import pathlib
from array import array
from collections.abc import Iterator, Mapping, MutableMapping
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace._files.fields import Fields, Ledger
from cspace._files.images import UNKNOWN_SHADE, Shades, read_shades
from cspace._files.unit_notes import warn_of_size
from cspace._support.arrays import AXES, Bools, Floats, StrPath
from cspace._support.check import (
    check_finite,
    check_not_negative,
    check_positive,
    check_real,
)
from cspace._support.limits import check_cells
from cspace._support.reporting import warn_user
from cspace.errors import FileError, GeometryError, InputError

YAML_SUFFIXES: Final = (".yaml", ".yml")

_MAX_METRES: Final = 1e15
"""Maximum coordinate and resolution, in metres; its reciprocal is the minimum resolution."""

MODES: Final = ("trinary", "scale", "raw")
"""Values of ``mode`` in the YAML of a map; the first is the default."""

FIELDS: Final = (
    Fields(
        "ROS map, `.yaml`",
        honoured=(
            "`image`; `mode`; `resolution`; `origin` with its yaw; `negate`; `occupied_thresh`; "
            "`free_thresh`; transparency"
        ),
        refused="`negate` in raw mode; EXIF orientation of the image",
        warned=(
            "grey 205, and grey near it in a JPEG or a scaled image, below `free_thresh`, unknown; "
            "JPEG; yaw beyond a whole turn; an image outside the folder; unknown fields"
        ),
    ),
    Fields(
        "`nav_msgs/OccupancyGrid`, `map_msgs/OccupancyGridUpdate`",
        honoured=(
            "`header`, `frame_id`; `info`: `resolution`, of float32, `width`, `height`, `origin`; "
            "`position`: `x`, `y`; `orientation`: `z`, `w`; `data`; -1"
        ),
        refused="tilt of `origin`; an update in another frame",
        warned="values beyond -1 to 100, unknown; 0 and 1 alone; unknown fields",
        harmless="stamp seq map_load_time z",
    ),
    Fields(
        "`geometry_msgs/PoseStamped`, `PoseWithCovarianceStamped`, `nav_msgs/Odometry`",
        honoured=(
            "`header`, `frame_id`; `pose`; `position`: `x`, `y`, `z`; "
            "`orientation`: `x`, `y`, `z`, `w`"
        ),
        refused="frames other than that of the map; tilt, where the robot cannot tilt",
        warned="unknown fields",
        harmless="stamp seq child_frame_id covariance twist",
    ),
    Fields(
        "Nav2 parameters",
        honoured="`footprint`; `robot_radius`; `footprint_padding`",
        refused="numbers in quotes; negative padding",
        warned="padding, where Nav2's differs; unknown parameters of the costmap",
        harmless="always_send_full_costmap clearable_layers controller_frequency "
        "cost_scaling_factor enabled filters footprint_clearing_enabled footprint_topic "
        "global_frame height inflation_radius initial_transform_timeout introspection_mode "
        "lethal_cost_threshold map_topic map_type map_vis_z mark_threshold max_obstacle_height "
        "min_obstacle_height observation_sources obstacle_range origin_x origin_y origin_z "
        "plugins published_footprint_topic publish_frequency publish_voxel_map raytrace_range "
        "resolution robot_base_frame rolling_window static_map subscribe_to_updates "
        "track_unknown_space transform_tolerance trinary_costmap unknown_cost_value "
        "unknown_threshold update_frequency use_maximum use_sim_time width z_resolution z_voxels",
    ),
)


def read_ros_map(path: StrPath, unknown: str = "occupied") -> tuple[MapInfo, Bools, Bools]:
    """Read the placement and cells of a ROS map.

    :meth:`cspace.Workspace.open` says how the image becomes cells.

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

    Warns
    -----
    UserWarning
        If a field is not read, the image is a JPEG, or free cells may be unknown.
    """
    header, image = _open_map(path)
    free, occupied = _classify_pixels(header, image, unknown == "occupied")
    return header.info, free, occupied


def _open_map(path: StrPath) -> tuple[_MapHeader, Shades]:
    """Read the YAML file and the image of a ROS map; warn of a JPEG."""
    header = _read_header(path)
    image = read_shades(header.image, "ROS map's image", header.info.resolution, may_turn=False)
    if image.is_lossy:  # whatever the caller takes unknown cells for
        warn_user(
            f"{path}: its image is a JPEG, which changes shades, so that walls and unknown cells "
            "may be lost"
        )
    return header, image


def read_mask_values(mask: object) -> tuple[MapInfo, NDArray[np.int8]]:
    """Read the placement and values of a mask, shape (nx, ny).

    Parameters are as for :func:`cspace.ros.read_mask`. Values are 0 to 100, or -1 for unknown.
    """
    if not isinstance(mask, str | os.PathLike):
        info, percent = _read_message(mask, "mask")
        return info, np.where((percent >= 0) & (percent <= 100), percent, -1).astype(np.int8)
    header, image = _open_map(mask)
    shades = image.shades
    if header.mode == "raw":
        values = np.floor(255.0 * shades + 0.5)
        values[values > 100.0] = -1.0
    else:
        probability = shades if header.negate else 1.0 - shades
        share = (probability - header.free_thresh) / (header.occupied_thresh - header.free_thresh)
        values = np.floor(100.0 * np.clip(share, 0.0, 1.0) + 0.5)
        if header.mode != "scale":
            values[(share > 0.0) & (share < 1.0)] = -1.0
    cells = values.astype(np.int8)[image.levels]
    return header.info, np.where(image.opaque, cells, np.int8(-1))


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
    frame_id : str
        Frame of the corner; empty if none is named.
    """

    source: str
    resolution: float
    origin: tuple[float, float]
    yaw: float
    frame_id: str = ""


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

    Raises FileError, which names the key, if a value is missing or wrong.
    """
    with Ledger.reading(path, "ROS map", "map", FIELDS[0]) as (source, header):
        image = _find_image(header, pathlib.Path(path))
        resolution = header.number("resolution", lowest=1.0 / _MAX_METRES, highest=_MAX_METRES)
        origin = header.need("origin")
        if not isinstance(origin, list) or len(origin) != 3:
            raise header.fail(f"has the origin {origin!r:.60}", "it must be x, y and yaw")
        x, y, yaw = (
            header.check_number(f"origin[{index}]", value, -_MAX_METRES, _MAX_METRES)
            for index, value in enumerate(origin)
        )
        header.note_angle("origin[2], the yaw", yaw)
        header.refuse("mode", *MODES, rule=f"it must be one of {', '.join(MODES)}")
        mode = header.get("mode", MODES[0])
        negate = header.need("negate")
        header.refuse("negate", 0, 1, rule="it must be 0 or 1: 0 if dark pixels are obstacles")
        if negate and mode == "raw":
            rule = "ROS 1 and ROS 2 disagree on its effect"
            raise header.fail("has negate 1 in raw mode", rule)
        high, low = (
            header.number(key, lowest=0.0, highest=1.0)
            for key in ("occupied_thresh", "free_thresh")
        )
        if low >= high:
            problem = f"has free_thresh {low} and occupied_thresh {high}"
            raise header.fail(problem, "the first must be below the second")
    info = MapInfo(source, resolution, (x, y), yaw)
    return _MapHeader(info, image, mode, bool(negate), high, low)


def _find_image(header: Ledger, path: pathlib.Path) -> pathlib.Path:
    """Return the image's path; warn if it lies outside the folder."""
    name = header.need("image")
    if not isinstance(name, str) or not name or "\0" in name:
        raise header.fail(f"has the image {name!r:.60}", "it must be a file name")
    file = path.parent / name
    beside = pathlib.PureWindowsPath(name).name  # with separators of any system
    if not file.exists() and (path.parent / beside).exists():
        problem = f"has the image {name!r:.200}, which does not exist"
        raise header.fail(problem, f"it must be a file, as {beside!r} beside the map is")
    if not file.resolve().is_relative_to(path.parent.resolve()):
        warn_user(f"{path}: image is {name!r}, which lies outside the folder of the map")
    return file


def _classify_pixels(header: _MapHeader, image: Shades, warn: bool) -> tuple[Bools, Bools]:
    """Return masks of a map's free and occupied pixels.

    The modes are documented at :meth:`cspace.Workspace.open`. All pixels of a level are
    alike, so levels are classified first. With `warn`, warn of unknown pixels below
    ``free_thresh``.
    """
    shades = image.shades
    # In raw mode, levels are percentages; in the other modes, they are shades of a probability.
    probability = shades if header.negate else 1.0 - shades
    if header.mode == "raw":
        probability = np.floor(255.0 * shades + 0.5) / 100.0
    free_levels = probability < header.free_thresh
    if header.mode == "raw":
        occupied_levels = ~free_levels & (probability <= 1.0)
    else:
        is_scale = header.mode == "scale"
        occupied_levels = ~free_levels if is_scale else probability >= header.occupied_thresh
        free_levels &= ~_find_doubtful_levels(header, image, free_levels, warn)
    return image.select_opaque(free_levels), image.select_opaque(occupied_levels)


def _find_doubtful_levels(
    header: _MapHeader, image: Shades, free_levels: Bools, warn: bool
) -> Bools:
    """Find free levels that may mean unknown.

    In an image that was compressed or scaled, they are all that are darker than halfway from 205 to
    254, the level of free cells. With `warn`, warn of their cells.
    """
    shades = image.shades[::-1] if header.negate else image.shades
    unknown: Bools = shades == UNKNOWN_SHADE
    doubtful: Bools = free_levels & unknown
    name = "of grey 205"
    if image.is_lossy or (header.mode == MODES[0] and image.select(unknown).any()):
        # Shade halfway between those that map savers write for unknown and for free cells.
        blurred = free_levels & (shades < (205 + 254) / 2 / 255)
        if image.select(blurred & ~unknown).any():
            doubtful = blurred
            name = "of grey 205 or near it"
    count = np.count_nonzero(image.select_opaque(doubtful))
    if count and warn:
        warn_user(
            f"{header.info.source}: {count:,} cells are {name}, which map savers write for unknown "
            f"ones, but lie below free_thresh: {header.free_thresh:g}; they count as unknown, "
            "unless you pass unknown='free'"
        )
    return doubtful


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


def read_occupancy_grid(
    msg: object, free_thresh: float, occupied_thresh: float
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
        raise InputError("free_thresh", problem, rule)
    info, percent = _read_message(msg, "msg")
    if percent.max() == 1:
        warn_user("msg.data: no value is above 1 per cent, so all cells are free or unknown")
    is_known = (percent >= 0) & (percent <= 100)
    free = is_known & (percent / 100.0 < low)
    occupied = is_known & (percent / 100.0 >= high)
    return info, free, occupied


def _read_message(msg: object, name: str) -> tuple[MapInfo, NDArray[Any]]:
    """Read the placement and data of an occupancy grid, shape (nx, ny); warn of other numbers."""
    with Ledger.reading(msg, "occupancy grid", name, FIELDS[1]) as (_, grid):
        if "metadata" in grid.fields:
            rule = "its data are costs; those of an OccupancyGrid are per cent"
            raise grid.fail("is a Costmap", rule, "")
        frame_id = read_frame(grid)
        info = grid.child("info")
        # Row by row from the lowest y; other numbers than per cent stand for unknown cells.
        percent = _read_rows(grid, info).T
        origin = info.child("origin")
        x, y = origin.child("position").numbers("xy")
        yaw = _read_yaw(origin.child("orientation"))
        resolution = info.number("resolution", lowest=1.0 / _MAX_METRES, highest=_MAX_METRES)
    others = np.count_nonzero((percent < -1) | (percent > 100))
    if others:
        warn_user(
            f"{name}.data: {others:,} values are beyond -1 to 100 and count as unknown; they are "
            "per cent"
        )
    single = np.float32(resolution)
    if float(single) == resolution:
        # Messages store single precision. The shortest text of a float32 is the decimal number that
        # was rounded to it.
        resolution = float(str(single))
    return MapInfo(name, resolution, (x, y), yaw, frame_id), percent


def update_occupancy_grid(msg: object, update: object) -> None:
    """Write a box of new values into an occupancy grid message.

    Parameters
    ----------
    msg : object or mapping
        With the fields of ``nav_msgs/OccupancyGrid``; its ``data`` is replaced.
    update : object or mapping
        With the fields of ``map_msgs/OccupancyGridUpdate``.

    Raises
    ------
    InputError
        If a field is missing or malformed, both name a frame and the frames differ, the box is not
        within the grid, or the data of either are not as many as its cells; nothing changes then.

    Examples
    --------
    >>> import cspace
    >>> grid = cspace.ros.OccupancyGrid()
    >>> grid.info.width, grid.info.height = 3, 1
    >>> grid.data.extend([0, 0, 0])
    >>> update = {"x": 1, "y": 0, "width": 2, "height": 1, "data": [100, -1]}
    >>> cspace.ros.update_occupancy_grid(grid, update); grid.data.tolist()
    [0, 100, -1]
    """
    with Ledger.reading(msg, "occupancy grid", "msg", FIELDS[1]) as (_, grid):
        frame_id = read_frame(grid)
        info = grid.child("info")
        cells = _read_rows(grid, info).astype(np.int8)
        for key in ("resolution", "origin"):
            info.get(key)
    with Ledger.reading(update, "grid update", "update", FIELDS[1]) as (_, box):
        values = _read_rows(box, box)
        if read_frame(box) and frame_id:
            check_frame(box, frame_id)
        x, y = box.count("x"), box.count("y")
        window = cells[y : y + len(values), x : x + values.shape[1]]
        if window.shape != values.shape:
            problem = f"has {values.shape[1]} x {len(values)} cells from ({x}, {y}) on"
            rule = f"they must lie in the grid of {cells.shape[1]} x {len(cells)}"
            raise box.fail(problem, rule)
    window[...] = values
    data = array("b", cells.tobytes())
    whole: Any = msg
    if isinstance(msg, MutableMapping):
        whole["data"] = data.tolist()
        return
    try:
        whole.data = data
    except AttributeError as error:
        rule = "its data are replaced"
        raise InputError("msg", "cannot be written to", rule) from error


def _read_rows(grid: Ledger, size: Ledger) -> NDArray[Any]:
    """Return a message's data as rows, shape (height, width).

    ``size`` has the fields ``width`` and ``height``.
    """
    width, height = (size.count(name, lowest=1) for name in ("width", "height"))
    # Numbers of 8 bytes, and masks.
    check_cells(grid.where, (width, height), memory=12.0)
    data = grid.need("data")
    if isinstance(data, str):  # as rosbridge writes bytes
        with suppress(ValueError):
            data = base64.b64decode(data, validate=True)
    if isinstance(data, str):
        raise grid.fail(f"has the data {data!r:.60}", "they must be a whole list of numbers")
    if isinstance(data, bytes):
        data = np.frombuffer(data, dtype=np.int8)
    if isinstance(data, list) and data:
        grid.check_number("last of the data", data[-1])
    values = check_real(data, f"{grid.where}.data")
    if values.shape != (width * height,) or values.dtype.kind not in "iu":
        problem = f"has data of shape {values.shape} and type {values.dtype}"
        rule = f"it must have width x height = {width} x {height} whole numbers, from -1 to 100"
        raise grid.fail(problem, rule)
    return values.reshape(height, width)


def read_frame(message: Ledger) -> str:
    """Return the frame of a message, without an old version's slash.

    It is empty if the header names none.
    """
    header = message.child("header", otherwise={})
    frame_id = header.get("frame_id", "")
    if not isinstance(frame_id, str):
        raise header.fail(f"has the frame_id {frame_id!r:.60}", "it must be a name")
    return frame_id.lstrip("/")


def check_frame(message: Ledger, frame_id: str) -> None:
    """Refuse a message in another frame than that of the map."""
    frame = read_frame(message)
    if frame != frame_id.lstrip("/"):
        rule = f"it must be {frame_id!r}, the frame of the map"
        place = f"{message.where}.header.frame_id"
        raise InputError(place, f"is {frame!r}", rule)


def read_pose(msg: object, frame_id: str) -> tuple[list[float], list[float]]:
    """Return a stamped pose's position, metres, and quaternion, x to w.

    Raises InputError if the pose is in another frame, a field is missing or not a finite number, or
    the quaternion is not of norm 1.
    """
    with Ledger.reading(msg, "pose", "msg", FIELDS[2]) as (_, stamped):
        pose = stamped.child("pose")
        check_frame(stamped, frame_id)
        if "pose" in pose.fields:  # of a pose with a covariance, or an odometry
            pose = pose.child("pose")
        return pose.child("position").numbers("xyz"), _read_turn(pose.child("orientation"))


def _read_turn(orientation: Ledger) -> list[float]:
    """Return the quaternion of a message, x to w, of norm 1."""
    x, y, z, w = turn = orientation.numbers("xyzw")
    # Deviation of a quaternion's norm from 1 that passes as rounding.
    if abs(math.hypot(x, y, z, w) - 1.0) > 1e-3:
        problem = f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is no unit quaternion"
        raise orientation.fail(problem, "its norm must be 1")
    return turn


def _read_yaw(orientation: Ledger) -> float:
    """Return the yaw of a message's map, radians.

    An unset quaternion, all zeros, counts as no rotation.
    """
    x, y, z, w = orientation.numbers("xyzw")
    if x == y == z == w == 0.0:
        return 0.0
    # Maximum x and y components of the quaternion of a map that lies flat.
    if max(abs(x), abs(y)) > 1e-6:
        rule = "a map must lie flat, turned about z only"
        problem = f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is tilted"
        raise orientation.fail(problem, rule)
    _read_turn(orientation)
    return 2.0 * math.atan2(z, w)  # a quaternion has half the angle


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
    """Parse corners of a footprint, shape (n, 2), metres.

    A text has the form of Nav2, ``"[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"``.

    Raises GeometryError if it is not a list of at least three points, and InputError if a number is
    not finite; `name` is the argument that messages name.
    """
    rule = "it must be at least three points, each of x and y in metres"
    problem = f"is {footprint!r:.80}"
    try:
        rows = ast.literal_eval(footprint.strip()) if isinstance(footprint, str) else footprint
        corners = check_finite(rows, name, AXES[:2])
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
        raise GeometryError(name, problem, rule) from error
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise GeometryError(name, problem, rule)
    warn_of_size(name, corners)
    return corners


def read_nav2(path: StrPath, costmap: str | None) -> CostmapRobot:
    """Read the robot of a Nav2 parameter file.

    The search covers tables at any depth with ``footprint`` or ``robot_radius``: the local and
    global costmaps of a Nav2 file, or the top of a ROS 1 ``costmap_common_params.yaml``. If they
    differ, pass `costmap`, for example "local_costmap".

    Raises FileError if the file is missing or malformed, or describes no robot, several, or not
    that costmap.
    """
    with Ledger.reading(path, "Nav2 parameter file", "file", FIELDS[3]) as (file, document):
        document.skip()  # most of it concerns other nodes
        tables = dict(_iterate_tables(document.fields, ()))
        if not tables:
            problem = "holds neither footprint nor robot_radius"
            rule = "a costmap has one of them"
            raise FileError(file, problem, rule)
        robots = {
            name: _parse_robot(document.inner(table, f"{file}: {name or 'the file'}", name))
            for name, table in tables.items()
            if costmap is None or name.endswith(costmap)
        }
    if not robots:
        rule = f"it has {', '.join(tables)}"
        raise FileError(file, f"has no costmap {costmap!r}", rule)
    # Costmaps may agree; then it does not matter which one is taken.
    name, robot = next(iter(robots.items()))
    if len(set(robots.values())) > 1:
        listed = "; ".join(f"{name} has {robot}" for name, robot in robots.items())
        hint = f"pass e.g. path={f'{file}#{name}'!r}"
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


def _parse_robot(table: Ledger) -> CostmapRobot:
    """Parse the robot of a costmap's parameters."""
    layers = [key for key, value in table.fields.items() if isinstance(value, Mapping)]
    table.taken.update(layers)
    footprint = table.get("footprint")
    radius = table.get("robot_radius")
    # Default ``footprint_padding`` of Nav2, metres.
    padding = check_not_negative(
        table.get("footprint_padding", 0.01),
        f"{table.where}: footprint_padding",
    )
    if footprint in _NO_FOOTPRINT:
        radius = check_positive(radius, f"{table.where}: robot_radius")
        warn_of_size(f"{table.where}: robot_radius", np.array([[-radius], [radius]]))
        return CostmapRobot((), radius, padding)
    corners = parse_footprint(footprint, f"{table.where}: footprint").tolist()
    return CostmapRobot(tuple((x, y) for x, y in corners), 0.0, padding)
