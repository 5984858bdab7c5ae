"""ROS data without ROS: YAML maps with their images, messages, and the robots of Nav2 parameter files.

A message is any object with the right fields. The classes here have the fields of the messages of ROS 2 of the same
names, for use without ROS.
"""

from __future__ import annotations

import ast
import math
import os
import pathlib
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.arrays import Bools, Floats, Ints
from cspace.check import finite, not_negative, positive
from cspace.errors import FileError, GeometryError, InputError, warn_user
from cspace.files.access import Fault, decoding
from cspace.files.images import Shades, read_shades
from cspace.files.plain import read_yaml

SUFFIXES: Final = (".yaml", ".yml")

_FAR: Final = 1e15
"""Metres beyond which nothing is placed; resolutions are no smaller than one part of it."""
_KEYS: Final = ("image", "resolution", "origin", "negate", "occupied_thresh", "free_thresh")
"""What the YAML file must say."""


def read_ros_map(path: str | os.PathLike[str]) -> tuple[MapInfo, Bools, Bools]:
    """Read a ROS map.

    The image becomes cells as in map_server of ROS 1 and Navigation2. With *shade* the mean of the colour channels
    from 0 (black) to 1 (white), and ``p = 1 - shade``, or ``p = shade`` where ``negate`` is 1:

    * ``trinary`` (also where ``mode`` is absent): ``p >= occupied_thresh`` is occupied, ``p < free_thresh`` is free,
      the rest is unknown;
    * ``scale``: ``p < free_thresh`` is free, the rest is occupied: a cell that is occupied with some probability is
      not proven free;
    * ``raw``: ``round(255 * shade)`` is the occupancy in per cent; below ``100 * free_thresh`` is free, up to 100 is
      occupied, above is unknown.

    In ``trinary`` and ``scale`` a pixel that is not fully opaque is unknown, as in Navigation2 since 2025. Releases
    disagree about ``p`` equal to a threshold; here it is never free.

    Parameters
    ----------
    path : path-like
        The YAML file. Its ``image`` is looked up beside it.

    Returns
    -------
    info : MapInfo
        Where the cells lie.
    free, occupied : ndarray of bool, shape (nx, ny)
        Cells that are neither are unknown.

    Raises
    ------
    FileError
        If the YAML or its image is missing or malformed; the message names the key and its value.
    """
    with decoding(path, "ROS map"):
        header = _read_header(path)
    return header.info, *MODES[header.mode](header, read_shades(header.image, "ROS map's image"))


class MapInfo(NamedTuple):
    """Where the cells of a map lie.

    Attributes
    ----------
    source : str
        What the map is, for messages.
    resolution : float
        Side of a cell, metres.
    origin : tuple of float
        Lower left corner of the first cell, metres.
    yaw : float
        By which the map is turned about that corner, radians.
    """

    source: str
    resolution: float
    origin: tuple[float, float]
    yaw: float


@dataclass(frozen=True, slots=True)
class _Header:
    """What the YAML file says."""

    info: MapInfo
    image: pathlib.Path
    mode: str
    negate: bool
    occupied_thresh: float
    free_thresh: float


def _read_header(path: str | os.PathLike[str]) -> _Header:
    document = read_yaml(path, "ROS map")
    if not isinstance(document, dict):
        raise _fault(f"holds {type(document).__name__}", "keys and values", "write e.g. 'resolution: 0.05'")
    missing = [key for key in _KEYS if key not in document]
    if missing:
        beside = ", ".join(document) or "nothing"
        raise _fault(f"{missing[0]} is missing", f"there, beside {beside:.200}", f"add '{missing[0]}:'")
    image, mode, negate = document["image"], document.get("mode", "trinary"), document["negate"]
    if not isinstance(image, str) or not image or "\0" in image:
        raise _fault(f"image is {image!r:.60}", "the name of the image", "write e.g. 'image: map.pgm'")
    if not isinstance(mode, str) or mode not in MODES:
        raise _fault(f"mode is {mode!r:.60}", f"one of {', '.join(MODES)}", "correct it")
    resolution = _number(document["resolution"], "resolution")
    if not 1.0 / _FAR <= resolution <= _FAR:
        rule = f"metres per cell, above zero, from {1.0 / _FAR:g} to {_FAR:g}"
        raise _fault(f"resolution is {resolution}", rule, "write e.g. 'resolution: 0.05'")
    origin = document["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise _fault(f"origin is {origin!r:.60}", "x, y and yaw", "write e.g. 'origin: [0.0, 0.0, 0.0]'")
    x, y, yaw = (_number(value, f"origin[{i}]") for i, value in enumerate(origin))
    if max(abs(x), abs(y)) > _FAR:
        raise _fault(f"origin is {origin!r:.60}", f"metres, at most {_FAR:g}", "check its units")
    if isinstance(negate, list | dict) or negate not in (0, 1):
        raise _fault(f"negate is {negate!r:.60}", "0 or 1", "write 'negate: 0' where dark pixels are obstacles")
    if negate and mode == "raw":
        raise _fault("negate is 1 in raw mode", "0 there: ROS 1 and ROS 2 disagree on what it does", "remove it")
    occupied, free = (_number(document[key], key) for key in ("occupied_thresh", "free_thresh"))
    for key, value in (("occupied_thresh", occupied), ("free_thresh", free)):
        if not 0.0 <= value <= 1.0:
            raise _fault(f"{key} is {value}", "between 0 and 1", "correct it")
    if free >= occupied:
        raise _fault(f"free_thresh is {free} and occupied_thresh is {occupied}", "free below occupied", "exchange them")
    info = MapInfo(os.fspath(path), resolution, (x, y), yaw)
    return _Header(info, _beside(path, image), mode, bool(negate), occupied, free)


def _beside(path: str | os.PathLike[str], image: str) -> pathlib.Path:
    """The image's file; said where it is a link out of the folder of the map, or named so."""
    folder = pathlib.Path(path).parent
    file = folder / image
    try:
        outside = not file.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError) as error:
        problem = f"image is {image!r:.60}, which cannot be looked up"
        raise _fault(problem, "the name of a file", "correct it") from error
    if outside:
        warn_user(f"{os.fspath(path)}: image is {image!r}, which lies outside of its folder")
    return file


def _number(value: Any, key: str) -> float:
    """A finite number."""
    try:
        number = math.nan if isinstance(value, bool) else float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not math.isfinite(number):
        raise _fault(f"{key} is {value!r:.60}", "a finite number", "correct it")
    return number


def _fault(problem: str, rule: str, hint: str) -> Fault:
    return Fault(problem, f"in a ROS map it must be {rule}", hint)


def _trinary(header: _Header, image: Shades) -> tuple[Bools, Bools]:
    free, occupied = (
        image.where(lambda shade: _probability(header, shade) < header.free_thresh),
        image.where(lambda shade: _probability(header, shade) >= header.occupied_thresh),
    )
    return image.among_opaque(free), image.among_opaque(occupied)


def _scale(header: _Header, image: Shades) -> tuple[Bools, Bools]:
    free = image.where(lambda shade: _probability(header, shade) < header.free_thresh)
    return image.among_opaque(free), image.among_opaque(~free)


def _raw(header: _Header, image: Shades) -> tuple[Bools, Bools]:
    def percent(shade: Floats) -> Floats:
        return np.floor(255.0 * shade + 0.5)

    free = image.where(lambda shade: percent(shade) < 100.0 * header.free_thresh)
    return free, ~free & image.where(lambda shade: percent(shade) <= 100.0)


def _probability(header: _Header, shade: Floats) -> Floats:
    return shade if header.negate else 1.0 - shade


MODES: Final[Mapping[str, Callable[[_Header, Shades], tuple[Bools, Bools]]]] = {
    "trinary": _trinary,
    "scale": _scale,
    "raw": _raw,
}
"""From a shade to free and occupied cells, by the ``mode`` of the YAML; the remaining cells are unknown."""


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
        hint = "pass e.g. 0.25 and 0.65"
        raise InputError("free_thresh", f"is {low:g} and occupied_thresh is {high:g}", rule, hint, value=free_thresh)
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
        problem = f"holds values of type {values.dtype}"
        raise InputError("msg.data", problem, "they must be whole numbers, from -1 to 100", "round them", value=data)
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
        problem = f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is tilted"
        raise InputError(f"msg.{place}", problem, rule, "set x and y to 0", value=(x, y, z, w))
    return 2.0 * math.atan2(z, w)


PADDING: Final = 0.01
"""Metres of ``footprint_padding`` where a file does not say."""

_NONE: Final[tuple[object, ...]] = (None, "", "[]", [])
"""Footprints that are none, for which the radius counts."""


class Base(NamedTuple):
    """What a costmap says of a robot: the corners of its footprint, or else its radius; and by how much to pad it."""

    corners: tuple[tuple[float, float], ...]
    radius: float
    padding: float

    def __str__(self) -> str:
        size = f"a footprint of {len(self.corners)} corners" if self.corners else f"a robot_radius of {self.radius:g} m"
        return f"{size}, footprint_padding {self.padding:g} m"


def corners_of(footprint: str | ArrayLike, name: str = "footprint") -> Floats:
    """The corners of a footprint, shape (n, 2), metres.

    A text is Nav2's, ``"[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"``. Raises GeometryError if it is not a
    list of three points or more, and InputError, with its ``name``, if a number is not finite.
    """
    rule = "it must be three points or more, each of two numbers, x and y in metres"
    problem, hint = f"is {footprint!r:.80}", "write e.g. [[0.3, 0.2], [0.3, -0.2], [-0.3, 0]]"
    try:
        value = ast.literal_eval(footprint.strip()) if isinstance(footprint, str) else footprint
        corners = finite(value, name)
    except (ValueError, TypeError, SyntaxError, MemoryError, RecursionError) as error:
        raise GeometryError(name, problem, rule, hint, value=footprint) from error
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise GeometryError(name, problem, rule, hint, value=footprint)
    return corners


def read_nav2(path: str | os.PathLike[str], costmap: str | None = None) -> Base:
    """What a file of parameters says of the robot.

    Every table that holds ``footprint`` or ``robot_radius`` is looked at, at whatever depth: those of the local and of
    the global costmap in a file of Nav2, or the top of a ``costmap_common_params.yaml`` of ROS 1. Where the costmaps of
    a file differ in it, one has to be named, such as "local_costmap".

    Raises FileError if the file is missing or malformed, describes no robot, or several, or not that costmap.
    """
    file = os.fspath(path)
    tables = dict(_tables(read_yaml(path, "file of Nav2's parameters"), ()))
    if not tables:
        hint = "write e.g. 'robot_radius: 0.22' in its local_costmap and global_costmap"
        raise FileError(file, "holds neither footprint nor robot_radius", "a costmap has one of them", hint)
    bases = {name: _base(table, f"{file}: {name or 'the file'}") for name, table in tables.items()}
    chosen = {name: base for name, base in bases.items() if costmap is None or name.endswith(costmap)}
    if not chosen:
        raise FileError(file, f"has no costmap {costmap!r}", f"it has {', '.join(bases)}", "name one of these")
    if len(set(chosen.values())) > 1:
        names = "; ".join(f"{name} has {base}" for name, base in chosen.items())
        first = next(iter(chosen))
        hint = f"pass e.g. costmap={first!r}, or {pathlib.Path(file).name}#{first}"
        raise FileError(file, f"tells of more than one robot: {names}", "one is mapped at a time", hint)
    return next(iter(chosen.values()))


def _tables(value: Any, path: tuple[str, ...]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Tables that tell of a robot, each with the names of those that it is in; a repeated name is said once."""
    if not isinstance(value, dict):
        return
    if value.get("footprint") not in _NONE or "robot_radius" in value:
        names = [name for name in path if name != "ros__parameters"]
        yield "/".join(name for k, name in enumerate(names) if name not in names[k - 1 : k]), value
    for name, part in value.items():
        yield from _tables(part, (*path, name))


def _base(table: Mapping[str, Any], place: str) -> Base:
    footprint: Any = table.get("footprint")
    padding = not_negative(table.get("footprint_padding", PADDING), f"{place}: footprint_padding")
    if footprint in _NONE:
        return Base((), positive(table["robot_radius"], f"{place}: robot_radius"), padding)
    corners: Sequence[Sequence[float]] = corners_of(footprint, f"{place}: footprint").tolist()
    return Base(tuple((x, y) for x, y in corners), 0.0, padding)
