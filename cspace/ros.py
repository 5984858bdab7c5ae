"""Messages of ROS: poses as configurations, and grids."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

# Other records are filled where the caller gives no message: their fields are those of ROS.
from cspace._files.ros_maps import Costmap as Costmap
from cspace._files.ros_maps import JointTrajectory as JointTrajectory
from cspace._files.ros_maps import JointTrajectoryPoint as JointTrajectoryPoint
from cspace._files.ros_maps import (
    OccupancyGrid,
    read_mask_values,
    read_pose,
    update_occupancy_grid,
)
from cspace._files.ros_maps import Path as Path
from cspace._files.ros_maps import PoseStamped as PoseStamped
from cspace._files.ros_maps import Twist as Twist
from cspace._rotations import Rotations
from cspace._support.check import check_not_negative, choose_text
from cspace.errors import InputError

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

__all__ = ["Mask", "OccupancyGrid", "configuration_of", "read_mask", "update_occupancy_grid"]


class Mask(NamedTuple):
    """Cells of a mask of Nav2, as polygons.

    Attributes
    ----------
    areas : dict of int to shapely geometry
        All cells of each value that occurs, except 0; metres. -1 is unknown.
    frame_id : str
        Frame of the areas; empty if none is named.
    """

    areas: dict[int, BaseGeometry]
    frame_id: str


def read_mask(mask: object) -> Mask:
    """Read a mask of Nav2's costmap filters.

    The areas are exactly its cells.

    Parameters
    ----------
    mask : path-like, object or mapping
        A ROS map in the mode ``trinary``, ``scale`` or ``raw``, read as Nav2's map server does, or
        a message with the fields of ``nav_msgs/OccupancyGrid``. The yaw of its origin applies.

    Returns
    -------
    Mask

    Raises
    ------
    FileError
        If the YAML or its image is missing or malformed.
    InputError
        If a field of the message is missing or malformed.

    Examples
    --------
    >>> import cspace
    >>> grid = cspace.ros.OccupancyGrid()
    >>> grid.info.width, grid.info.height, grid.info.resolution = 3, 1, 0.5
    >>> grid.data.extend([0, 100, 100])
    >>> mask = cspace.ros.read_mask(grid)
    >>> {value: area.bounds for value, area in mask.areas.items()}
    {100: (0.5, 0.0, 1.5, 0.5)}
    """
    from shapely import affinity

    from cspace._shapes import Voxels

    info, values = read_mask_values(mask)
    areas = {}
    for value in np.unique(values[values != 0]).tolist():
        area = Voxels(values == value, info.resolution, np.array(info.origin)).outline
        areas[value] = affinity.rotate(area, info.yaw, info.origin, use_radians=True)
    return Mask(areas, info.frame_id)


class SpaceOfPoses(Protocol):
    """A space into which messages of poses are converted."""

    @property
    def has_poses(self) -> bool: ...
    @property
    def frame_id(self) -> str: ...
    @property
    def rotations(self) -> Rotations: ...
    @property
    def dim(self) -> int: ...


def configuration_of(
    msg: object, space: SpaceOfPoses, frame_id: str | None = None, *, tilt_tolerance: float = 0.0
) -> tuple[float, ...]:
    """Convert a stamped pose to a configuration of a map.

    Parameters
    ----------
    msg : object or mapping
        With the fields of ``geometry_msgs/PoseStamped`` or ``PoseWithCovarianceStamped``, or of
        ``nav_msgs/Odometry``.
    space : CSpace or TiledCSpace
        A map in the plane ignores z; a map without a yaw ignores the yaw.
    frame_id : str, optional
        Frame of the map; by default ``space.frame_id``.
    tilt_tolerance : float
        Largest tilt, radians, that a map which cannot tilt ignores, e.g. 0.05 for the poses of a
        robot with an inertial sensor.

    Returns
    -------
    tuple of float
        Metres and radians, or a quaternion.

    Raises
    ------
    InputError
        If the pose has another frame, is tilted by more than the tolerance on a map that cannot
        tilt, has no unit quaternion or is not finite, a field is missing, or the space has no
        poses.

    Examples
    --------
    >>> import numpy as np, cspace
    >>> workspace = cspace.Workspace.from_array(np.zeros((40, 30), dtype=bool), 0.1)
    >>> space = cspace.build(workspace, cspace.Robot.rectangle(0.5, 0.3), rotations=8)
    >>> place = {"x": 1.5, "y": 0.0, "z": 0.0}, {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    >>> pose = dict(zip(("position", "orientation"), place))
    >>> cspace.ros.configuration_of({"header": {"frame_id": "map"}, "pose": pose}, space)
    (1.5, 0.0, 0.0)
    """
    if not getattr(space, "has_poses", False):
        rule = "it must be a map of a rigid robot"
        raise InputError("space", f"is {space!r}", rule)
    # Tilt, radians, that passes as rounding.
    tolerance = max(check_not_negative(tilt_tolerance, "tilt_tolerance", "rad"), 2e-3)
    position, turn = read_pose(msg, choose_text(frame_id, "frame_id", space.frame_id))
    x, y, z, w = turn
    names = space.rotations.names
    if len(names) == 4:
        return (*position, *turn)
    if math.hypot(x, y) > math.sin(0.5 * min(tolerance, math.pi)):
        problem = f"is ({x:g}, {y:g}, {z:g}, {w:g}), which is tilted"
        rule = "the robot of this map turns about z only"
        tilt = 2.0 * math.asin(min(math.hypot(x, y), 1.0))
        hint = f"project it with tilt_tolerance={math.ceil(1e3 * tilt) / 1e3:g} if that is right"
        raise InputError("msg.pose.orientation", problem, rule, hint)
    yaw = (2.0 * math.atan2(z, w),) if names else ()
    return (*position[: space.dim], *yaw)
