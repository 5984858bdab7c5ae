"""ROS messages, filled without ROS: occupancy grids, costmaps, paths and joint trajectories.

A message is any object with the right fields, such as those of :mod:`cspace._files.ros_maps`, or a
mapping, which gets the fields that it lacks.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Mapping, MutableMapping, Sequence
from copy import copy
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace import BLOCKED, FREE, MIXED, Grid
from cspace.errors import InputError
from cspace.inside import (
    Bools,
    DistanceTable,
    Floats,
    check_memory,
    check_not_negative,
)
from cspace.ros import Costmap, JointTrajectoryPoint, OccupancyGrid, PoseStamped

if TYPE_CHECKING:
    from cspace import CSpace

Message = TypeVar("Message")

LETHAL = 254
INSCRIBED = 253
NO_INFORMATION = 255
"""Costs of Nav2: an obstacle is in the cell; a robot in the cell collides at every rotation; the
cell is unknown."""

OCCUPANCY: Final = {FREE: 0, MIXED: -1, BLOCKED: 100}
"""Occupancy of each state, in per cent; -1 is unknown."""


def to_occupancy_grid(
    space: CSpace,
    msg: Any = None,
    *,
    rotation: ArrayLike | None = None,
    frame_id: str | None = None,
) -> Any:
    """Return a plane map as a ROS occupancy grid.

    FREE is 0, BLOCKED 100 and MIXED -1 (unknown). :meth:`cspace.Workspace.from_occupancy_grid`
    reads it back: as the cells that are not FREE, or, with ``unknown="free"``, as the BLOCKED
    cells.

    Parameters
    ----------
    msg : object, optional
        A message of ROS 1 or 2 to fill: any object with the fields of
        ``nav_msgs/OccupancyGrid``. Default: a new :class:`cspace.ros.OccupancyGrid`.
    rotation : array-like, shape (k,), optional
        Rotation of the robot. Default: 0 means free, and 100 blocked, at every rotation.
    frame_id : str, optional
        Frame in the header, whose stamp stays as it is; by default :attr:`cspace.CSpace.frame_id`.

    Returns
    -------
    object
        The message.

    Raises
    ------
    InputError
        If the map is in space or in radians, the message lacks a field, or the map does not
        have the ``rotation``.
    """
    grid = space.grid
    # Bytes for each cell while an occupancy grid is filled, measured.
    check_memory(6 * grid.size, "the message", grid)
    if rotation is None:
        # A cell is FREE or BLOCKED only if it is so in all slices.
        stack = space.cell_states.reshape(-1, *grid.shape)
        lowest = stack.min(axis=0)
        states = np.where(lowest == stack.max(axis=0), lowest, MIXED)
    else:
        states = space.states_at(rotation)
    # Look the occupancy up by the value of the state.
    percent_of_state = np.array([OCCUPANCY[state] for state in sorted(OCCUPANCY)], dtype=np.int8)
    percent = percent_of_state[states]
    size = {"info.width": grid.shape[0], "info.height": grid.shape[1]}
    filled = OccupancyGrid() if msg is None else msg
    frame = space.frame_id if frame_id is None else frame_id
    return _fill_grid(filled, "nav_msgs/OccupancyGrid", percent, grid, "info", size, frame)


def to_costmap(
    space: CSpace,
    msg: Any = None,
    *,
    inflation_radius: float = 0.55,
    cost_scaling_factor: float = 10.0,
    rotation: ArrayLike | None = None,
    frame_id: str | None = None,
) -> Any:
    """Return a plane map as a Nav2 costmap.

    It is inflated by the robot itself. 254 is an obstacle, 255 unknown, 253 not proven free for
    the robot. A FREE cell costs ``252 * exp(-cost_scaling_factor * clearance)``, rounded down,
    and 0 if it is farther than ``inflation_radius`` from the obstacles. Its clearance, taken at
    its center, stands for Nav2's distance less the inscribed radius.

    Parameters
    ----------
    msg : object, optional
        A message to fill: any object with the fields of ``nav2_msgs/Costmap``. Default: a new
        object with these.
    inflation_radius : float
        Metres from the obstacles, zero or above; compared with the clearance plus the radius of
        the robot's inscribed circle, margin included. The defaults of this and of
        ``cost_scaling_factor`` are Nav2's.
    cost_scaling_factor : float
        Per metre, zero or above.
    rotation : array-like, shape (k,), optional
        Rotation of the robot. Default: in each cell, the rotation of the largest clearance;
        this takes some 20 nanoseconds for each cell and slice at the first call, and after an
        update.
    frame_id : str, optional
        As for :meth:`cspace.CSpace.to_occupancy_grid`.

    Returns
    -------
    object
        The message.

    Raises
    ------
    InputError
        If the map is in space or of joints, the message lacks a field, or an argument is not
        usable.
    """
    radius = check_not_negative(inflation_radius, "inflation_radius")
    scaling = check_not_negative(cost_scaling_factor, "cost_scaling_factor", "1/m")
    grid = space.grid
    # Bytes for each cell while a costmap is filled, measured.
    check_memory(36 * grid.size, "the message", grid)
    workspace = space.drawn_workspace
    if not space.has_poses:
        raise _make_joints_error("a costmap")
    if grid.dim == 3:
        raise InputError("the map", "is one in space", "a costmap is plane")
    if rotation is None:  # costs are those of the best rotation of each cell
        distances = _distances_of(space, None).max(axis=0)
    else:
        cell = space.rotations.cell_of(space.rotations.check_rotation(rotation))
        number = int(space.slice_of[cell.item()])
        distances = _distances_of(space, [number])[number]
    clearance = grid.spacing * distances.astype(np.float64)
    inscribed = space.drawn_robot.shape.inner.inscribed_radius + space.margin
    costs = compute_costs(clearance, workspace.outer, workspace.unknown, inscribed, scaling, radius)
    nx, ny = grid.shape
    size = {"metadata.size_x": nx, "metadata.size_y": ny}
    filled = Costmap() if msg is None else msg
    frame = space.frame_id if frame_id is None else frame_id
    return _fill_grid(filled, "nav2_msgs/Costmap", costs, grid, "metadata", size, frame)


def _distances_of(space: CSpace, slices: Sequence[int] | None) -> NDArray[np.float32]:
    """Return distances of cells, in cells, shape (slices, nx, ny); by default of all slices."""
    return DistanceTable.of(space, slices).cells.reshape(-1, *space.grid.shape)


def fill_path(
    axes: Sequence[str], rows: Floats, msg: Message, frame_id: str, seconds: Floats | None = None
) -> Message:
    """Fill a ``nav_msgs/Path`` with the poses of configurations.

    `rows`, shape (n, size), have the columns `axes`. Each pose gets the frame and the stamp of the
    message, plus its `seconds`, shape (n,).

    Raises InputError if the message lacks a field.
    """
    kind = "nav_msgs/Path"
    make_pose = _find_element_class(msg, "poses", PoseStamped)
    if isinstance(msg, MutableMapping):
        msg.setdefault("header", {}).setdefault("stamp", {"sec": 0, "nanosec": 0})
    stamp = _get_field(_get_field(msg, "header"), "stamp")
    poses = []
    for index, row in enumerate(rows.tolist()):
        # The rotation is a quaternion. Missing coordinates are 0, a missing rotation the identity.
        values = dict(zip(axes, row, strict=True))
        if "yaw" in values:
            half_yaw = values["yaw"] / 2.0
            values |= {"qz": math.sin(half_yaw), "qw": math.cos(half_yaw)}
        fields: dict[str, object] = {"header.frame_id": frame_id}
        if stamp is not None:
            fields["header.stamp"] = copy(stamp)
        for name in "xyz":
            fields[f"pose.position.{name}"] = values.get(name, 0.0)
            fields[f"pose.orientation.{name}"] = values.get(f"q{name}", 0.0)
        fields["pose.orientation.w"] = values.get("qw", 1.0)
        pose = _set_fields(make_pose(), kind, fields)
        if stamp is not None and seconds is not None:
            _add_seconds(pose, kind, "header.stamp", float(seconds[index]))
        poses.append(pose)
    return _set_fields(msg, kind, {"header.frame_id": frame_id, "poses": poses})


def fill_joint_trajectory(
    joints: Sequence[str],
    positions: Floats,
    velocities: Floats,
    seconds: Floats,
    msg: Message,
    frame_id: str,
) -> Message:
    """Fill a ``trajectory_msgs/JointTrajectory`` with timed positions and velocities.

    `positions` and `velocities` have shape (n, dof); `seconds` from the start has shape (n,).

    Raises InputError if the message lacks a field.
    """
    kind = "trajectory_msgs/JointTrajectory"
    make_point = _find_element_class(msg, "points", JointTrajectoryPoint)
    points = []
    for position, velocity, time in zip(positions, velocities, seconds, strict=True):
        fields = {"positions": array("d", position), "velocities": array("d", velocity)}
        point = _set_fields(make_point(), kind, fields)
        _add_seconds(point, kind, "time_from_start", float(time))
        points.append(point)
    content = {"header.frame_id": frame_id, "joint_names": list(joints), "points": points}
    return _set_fields(msg, kind, content)


def make_twists(make: Callable[[], Message], v: Floats, omega: Floats) -> list[Message]:
    """Return a ``geometry_msgs/Twist`` for each pair of velocities.

    ``v`` is forward, m/s, and ``omega`` the yaw rate, rad/s, both of shape (n,).

    Raises InputError if the messages lack a field.
    """
    twists = []
    for ahead, turn in zip(v.tolist(), omega.tolist(), strict=True):
        fields = {"linear.x": ahead, "angular.z": turn}
        twists.append(_set_fields(make(), "geometry_msgs/Twist", fields))
    return twists


_NANO: Final = 10**9
"""Nanoseconds per second."""


def _add_seconds(msg: object, kind: str, name: str, seconds: float) -> None:
    """Add seconds to a time field of a message, rounded to nanoseconds.

    ``name`` is the dotted path of the field.
    """
    time: object = msg
    for field in name.split("."):
        time = _get_field(time, field)
    # The fields of a time have other names in ROS 1.
    is_old = _get_field(time, "secs") is not None
    second_name, nano_name = ("secs", "nsecs") if is_old else ("sec", "nanosec")
    old_seconds = _get_field(time, second_name) or 0
    old_nanoseconds = _get_field(time, nano_name) or 0
    total = _NANO * old_seconds + old_nanoseconds + round(_NANO * seconds)
    whole, nanoseconds = divmod(total, _NANO)
    fields = {f"{name}.{second_name}": whole, f"{name}.{nano_name}": nanoseconds}
    _set_fields(msg, kind, fields)


def compute_costs(
    clearance: Floats,
    lethal: Bools,
    unknown: Bools | None,
    inscribed: float,
    scaling: float,
    radius: float,
) -> NDArray[np.uint8]:
    """Compute costs of Nav2's inflation layer.

    `clearance` and costs have shape (nx, ny); clearances are in metres. The clearance of a cell is
    zero if a robot there may collide; above ``radius - inscribed`` it may be infinite. `lethal`
    marks cells that touch an obstacle, and `unknown` marks unknown cells. `inscribed` is the radius
    of the robot's inscribed circle, metres. `scaling` is ``cost_scaling_factor``, per metre.
    `radius` is ``inflation_radius``, metres from the obstacles.
    """
    # Costs fall from below INSCRIBED with the clearance, and are zero beyond the radius.
    decay = np.exp(-scaling * np.minimum(clearance, radius))
    costs = ((INSCRIBED - 1) * decay).astype(np.uint8)
    costs[clearance + inscribed > radius] = 0
    may_collide = clearance <= 0.0
    costs[may_collide] = INSCRIBED
    costs[may_collide & lethal] = LETHAL
    if unknown is not None:
        costs[may_collide & unknown] = NO_INFORMATION
    return costs


def _fill_grid(
    msg: Message,
    kind: str,
    cells: NDArray[np.int8] | NDArray[np.uint8],
    grid: Grid,
    info: str,
    size: Mapping[str, object],
    frame_id: str,
) -> Message:
    """Fill a grid message with plane values.

    `cells` have shape (nx, ny). `info` is the name of the field with the origin and the resolution.
    `size` maps the dotted paths of the fields for the numbers of cells to their values.

    Raises InputError if the grid is not plane, or the message lacks a field.
    """
    if grid.dim == 3:
        raise InputError("the map", "is one in space", f"{kind} is plane")
    if grid.unit != "m":
        raise _make_joints_error(kind)
    # The origin is the pose of the grid's lower corner; grids of maps are never rotated.
    position = f"{info}.origin.position"
    orientation = f"{info}.origin.orientation"
    typecode = "b" if cells.dtype == np.int8 else "B"
    fields = {
        "header.frame_id": frame_id,
        f"{info}.resolution": grid.spacing,
        **size,
        f"{position}.x": grid.lower[0],
        f"{position}.y": grid.lower[1],
        f"{position}.z": 0.0,
        f"{orientation}.x": 0.0,
        f"{orientation}.y": 0.0,
        f"{orientation}.z": 0.0,
        f"{orientation}.w": 1.0,
        "data": array(typecode, cells.T.tobytes()),
    }
    return _set_fields(msg, kind, fields)


def _make_joints_error(kind: str) -> InputError:
    """Make the error for a map whose cells are no places."""
    return InputError("the map", "is one of joints", f"{kind} is in metres")


def _set_fields(msg: Message, kind: str, fields: Mapping[str, object]) -> Message:
    """Set fields of a message, given by dotted paths.

    Raises InputError if the message lacks a field.
    """
    for path, value in fields.items():
        if path == "header.frame_id" and not isinstance(value, str):
            raise InputError("frame_id", f"is {value!r}", "it must be a name")
        *parents, last = path.split(".")
        target: Any = msg
        for name in parents:
            if isinstance(target, MutableMapping):
                target.setdefault(name, {})
            target = _get_field(target, name)
        if isinstance(target, MutableMapping):
            target[last] = value.tolist() if isinstance(value, array) else value
        elif hasattr(target, last):
            setattr(target, last, value)
        else:
            rule = f"it must have the fields of {kind}"
            raise InputError("msg", f"has no {path}", rule)
    return msg


def _get_field(target: Any, name: str) -> Any:
    """Return a field of a message or mapping, or None."""
    return target.get(name) if isinstance(target, Mapping) else getattr(target, name, None)


def _find_element_class(msg: object, name: str, default: Callable[[], Any]) -> Callable[[], Any]:
    """Return the class of the elements of a message's list field.

    ROS messages declare it as text, such as "geometry_msgs/PoseStamped[]". For others, return
    `default`.
    """
    if isinstance(msg, Mapping):
        return dict
    get_types = getattr(msg, "get_fields_and_field_types", None)
    if get_types is not None:  # ROS 2
        types = dict(get_types())
    else:  # ROS 1
        names = getattr(msg, "__slots__", ())
        types = dict(zip(names, getattr(msg, "_slot_types", ()), strict=False))
    declared = re.search(r"(\w+)/(\w+)", types.get(name, ""))
    if declared is None:
        return default
    package, class_name = declared.groups()
    element_class: Callable[[], Any] = getattr(import_module(f"{package}.msg"), class_name)
    return element_class
