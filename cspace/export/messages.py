"""Filled ROS messages without ROS: occupancy grids, costmaps, paths and joint trajectories.

A message is any object with the right fields, such as those of :mod:`cspace.files.ros`.
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cspace.errors import InputError
from cspace.files.ros import (
    Costmap,
    JointTrajectoryPoint,
    OccupancyGrid,
    PoseStamped,
    missing_field_error,
)
from cspace.grid import Grid
from cspace.support.arrays import BLOCKED, FREE, MIXED, Bools, Floats
from cspace.support.check import check_not_negative

if TYPE_CHECKING:
    from cspace.space import CSpace

Message = TypeVar("Message")

LETHAL, INSCRIBED, NO_INFORMATION = 254, 253, 255
"""Costs of Nav2: an obstacle is in the cell; a robot in the cell collides at every rotation; the
cell is unknown."""

OCCUPANCY: Final = {FREE: 0, MIXED: -1, BLOCKED: 100}
"""Occupancy of each state, in per cent; -1 is unknown."""


def occupancy_grid_of(
    space: CSpace, msg: Message | None, rotation: ArrayLike | None, frame_id: str
) -> Message | OccupancyGrid:
    """Fill an occupancy grid with the states of a map.

    See :meth:`cspace.CSpace.to_occupancy_grid`.
    """
    grid, state = space.grid, space._flat_state() if rotation is None else space.states_at(rotation)
    values = np.array([OCCUPANCY[each] for each in sorted(OCCUPANCY)], dtype=np.int8)[state]
    fields = {"info.width": grid.shape[0], "info.height": grid.shape[1]}
    filled = OccupancyGrid() if msg is None else msg
    return _fill_grid(filled, "nav_msgs/OccupancyGrid", values, grid, "info", fields, frame_id)


def costmap_of(
    space: CSpace,
    msg: Message | None,
    inflation_radius: float,
    cost_scaling_factor: float,
    rotation: ArrayLike | None,
    frame_id: str,
) -> Message | Costmap:
    """Fill a costmap with the clearances of a map; see :meth:`cspace.CSpace.to_costmap`."""
    radius = check_not_negative(inflation_radius, "inflation_radius")
    scaling = check_not_negative(cost_scaling_factor, "cost_scaling_factor", "pass it per metre")
    if space.grid.dim == 3:
        raise InputError(
            "the map", "is one in space", "a costmap is plane", "build a map of the plane"
        )
    number = None
    if rotation is not None:
        number = int(
            space.slice_of[
                int(space.rotations.find_cells(space.rotations.check_rotation(rotation)))
            ]
        )
    inscribed, clearance = (
        space.robot.inscribed_radius + space.margin,
        space._clearances_of_cells(number),
    )
    costs = costs_of(
        clearance, space.workspace.outer, space.workspace.unknown, inscribed, scaling, radius
    )
    fields = {"metadata.size_x": space.grid.shape[0], "metadata.size_y": space.grid.shape[1]}
    filled = Costmap() if msg is None else msg
    return _fill_grid(filled, "nav2_msgs/Costmap", costs, space.grid, "metadata", fields, frame_id)


def fill_path(
    axes: Sequence[str], rows: Floats, msg: Message, frame_id: str, seconds: Floats | None = None
) -> Message:
    """Fill a ``nav_msgs/Path`` with the poses of configurations.

    `rows`, shape (n, size), have the columns `axes`. Each pose gets the frame and the stamp of the
    message, later by its `seconds`, shape (n,).

    Raises InputError if the message lacks a field.
    """
    kind = "nav_msgs/Path"
    make, stamp = (
        _element_class(msg, "poses", PoseStamped),
        getattr(getattr(msg, "header", None), "stamp", None),
    )
    poses = []
    for k, row in enumerate(rows.tolist()):
        q = dict(zip(axes, row, strict=True))
        if "yaw" in q:
            q |= {"qz": math.sin(q["yaw"] / 2.0), "qw": math.cos(q["yaw"] / 2.0)}
        pose = _set_fields(make(), kind, {"header.frame_id": frame_id})
        if stamp is not None:
            # Each pose needs a stamp of its own, because the times differ.
            _set_fields(pose, kind, {"header.stamp": stamp if seconds is None else copy(stamp)})
            if seconds is not None:
                _add_seconds(pose, kind, "header.stamp", float(seconds[k]))
        fields = {f"pose.position.{name}": q.get(name, 0.0) for name in "xyz"}
        fields |= {
            f"pose.orientation.{name}": q.get(f"q{name}", float(name == "w")) for name in "xyzw"
        }
        poses.append(_set_fields(pose, kind, fields))
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
    make = _element_class(msg, "points", JointTrajectoryPoint)
    points = []
    for position, velocity, time in zip(
        positions.tolist(), velocities.tolist(), seconds.tolist(), strict=True
    ):
        point = _set_fields(
            make(), kind, {"positions": array("d", position), "velocities": array("d", velocity)}
        )
        _add_seconds(point, kind, "time_from_start", time)
        points.append(point)
    return _set_fields(
        msg, kind, {"header.frame_id": frame_id, "joint_names": list(joints), "points": points}
    )


def _add_seconds(msg: object, kind: str, name: str, seconds: float) -> None:
    """Add seconds to a time of a message.

    ``name`` is the dotted path of the time. The sum is rounded to nanoseconds.
    """
    time: object = msg
    for part in name.split("."):
        time = getattr(time, part, None)
    # A time of ROS 1 has other names for the same fields.
    names = ("secs", "nsecs") if hasattr(time, "secs") else ("sec", "nanosec")
    whole, fraction = (getattr(time, part, 0) for part in names)
    parts = divmod(10**9 * whole + fraction + round(1e9 * seconds), 10**9)
    _set_fields(
        msg, kind, {f"{name}.{part}": value for part, value in zip(names, parts, strict=True)}
    )


def costs_of(
    clearance: Floats,
    lethal: Bools,
    unknown: Bools | None,
    inscribed: float,
    scaling: float,
    radius: float,
) -> NDArray[np.uint8]:
    """Compute the costs of Nav2's inflation layer.

    `clearance` and costs have shape (nx, ny); clearances are in metres. The clearance of a cell is
    zero if a robot there may collide; above ``radius - inscribed`` it may be infinite. `lethal`
    marks cells that touch an obstacle, and `unknown` marks unknown cells. `inscribed` is the radius
    of the robot's inscribed circle, metres. `scaling` is ``cost_scaling_factor``, per metre.
    `radius` is ``inflation_radius``, metres from the obstacles.
    """
    costs = ((INSCRIBED - 1) * np.exp(-scaling * np.minimum(clearance, radius))).astype(np.uint8)
    costs[clearance + inscribed > radius] = 0
    taken = clearance <= 0.0
    costs[taken] = INSCRIBED
    costs[taken & lethal] = LETHAL
    if unknown is not None:
        costs[taken & unknown] = NO_INFORMATION
    return costs


def _fill_grid(
    msg: Message,
    kind: str,
    cells: NDArray[np.int8] | NDArray[np.uint8],
    grid: Grid,
    about: str,
    fields: Mapping[str, object],
    frame_id: str,
) -> Message:
    """Fill a message with the cells of a plane map.

    `about` is the field that holds the origin and the resolution.

    Raises InputError if the grid is not plane, or the message lacks a field.
    """
    if cells.shape != grid.shape[:2]:
        raise InputError(
            "the map", "is one in space", f"{kind} is plane", "cut it, or export another format"
        )
    origin = f"{about}.origin"
    every = {
        "header.frame_id": frame_id,
        f"{about}.resolution": grid.spacing,
        **fields,
        **{
            f"{origin}.position.{name}": x
            for name, x in zip("xyz", (*grid.lower, 0.0), strict=True)
        },
        **{
            f"{origin}.orientation.{name}": x
            for name, x in zip("xyzw", (0.0, 0.0, 0.0, 1.0), strict=True)
        },
        "data": array({"i": "b", "u": "B"}[cells.dtype.kind], cells.T.tobytes()),
    }
    return _set_fields(msg, kind, every)


def _set_fields(msg: Message, kind: str, fields: Mapping[str, object]) -> Message:
    """Set fields of a message, given by dotted paths.

    Raises InputError if the message lacks a field.
    """
    for path, value in fields.items():
        *parents, last = path.split(".")
        target: object = msg
        for name in parents:
            target = getattr(target, name, None)
        if not hasattr(target, last):
            raise missing_field_error("msg", path, kind)
        setattr(target, last, value)
    return msg


def _element_class(msg: object, name: str, otherwise: Callable[[], Any]) -> Callable[[], Any]:
    """Return the class of the elements of a list field.

    ROS messages declare it; for others, return `otherwise`.
    """
    declared = getattr(msg, "get_fields_and_field_types", None)  # ROS 2
    if declared is not None:
        kinds = dict(declared())
    else:
        kinds = dict(
            zip(getattr(msg, "__slots__", ()), getattr(msg, "_slot_types", ()), strict=False)
        )  # ROS 1
    named = re.search(r"(\w+)/(\w+)", kinds.get(name, ""))
    if named is None:
        return otherwise
    package, message = named.groups()
    made: Callable[[], Any] = getattr(import_module(f"{package}.msg"), message)
    return made
