"""ROS maps, footprints of Nav2, and messages as plain records."""

import math
from typing import Final

from cspace._files.ros_maps import (
    Costmap,
    JointTrajectory,
    OccupancyGrid,
    OccupancyGridUpdate,
    Path,
    PoseStamped,
    Twist,
    get_field,
    read_ros_map,
    update_occupancy_grid,
)
from cspace._interface import Space
from cspace._support.check import check_finite
from cspace.errors import InputError

__all__ = [
    "Costmap",
    "JointTrajectory",
    "OccupancyGrid",
    "OccupancyGridUpdate",
    "Path",
    "PoseStamped",
    "Twist",
    "configuration_of",
    "read_ros_map",
    "update_occupancy_grid",
]

_POSE_SLACK: Final = 1e-3
"""Deviation of a quaternion's norm from 1, and sine of half the tilt, that pass as rounding."""


def configuration_of(msg: object, space: Space, frame_id: str = "map") -> tuple[float, ...]:
    """Convert a stamped pose to a configuration of a map.

    Parameters
    ----------
    msg : object
        With the fields of ``geometry_msgs/PoseStamped``.
    space : CSpace or TiledCSpace
        A map in the plane ignores z; a map without a yaw ignores the yaw.
    frame_id : str
        Frame of the map.

    Returns
    -------
    tuple of float
        Metres and radians, or a quaternion.

    Raises
    ------
    InputError
        If the pose has another frame, is tilted on a map that cannot tilt, has no unit quaternion
        or is not finite, a field is missing, or the space has no poses.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.3), rotations=8)
    >>> pose = cspace.ros.PoseStamped()
    >>> pose.header.frame_id, pose.pose.position.x = "map", 1.5
    >>> cspace.ros.configuration_of(pose, space)
    (1.5, 0.0, 0.0)
    """
    kind = "geometry_msgs/PoseStamped"
    if not space.has_poses:
        rule = "it must be a map of a rigid robot"
        raise InputError("space", f"is {space!r}", rule, "pass joint positions to plan instead")
    frame = get_field(msg, "header.frame_id", "msg", kind)
    if frame != frame_id:
        problem = f"is {frame!r}"
        rule = f"it must be {frame_id!r}, the frame of the map"
        raise InputError("msg.header.frame_id", problem, rule, "transform the pose with tf2")
    values = [get_field(msg, f"pose.position.{name}", "msg", kind) for name in "xyz"]
    position = check_finite(values, "msg.pose.position").tolist()
    place = "msg.pose.orientation"
    values = [get_field(msg, f"pose.orientation.{name}", "msg", kind) for name in "xyzw"]
    x, y, z, w = turn = check_finite(values, place).tolist()
    if abs(math.hypot(x, y, z, w) - 1.0) > _POSE_SLACK:
        problem = f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is no unit quaternion"
        raise InputError(place, problem, "its norm must be 1", "set w to 1 for no rotation")
    names = space.rotations.names
    if len(names) == 4:
        return (*position, *turn)
    if math.hypot(x, y) > _POSE_SLACK:
        problem = f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is tilted"
        rule = "the robot of this map turns about z only"
        raise InputError(place, problem, rule, "set x and y to 0")
    yaw = (2.0 * math.atan2(z, w),) if names else ()
    return (*position[: space.dim], *yaw)
