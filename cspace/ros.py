"""ROS maps, footprints of Nav2, and messages as plain records."""

from cspace._files.ros_maps import (
    Costmap,
    JointTrajectory,
    OccupancyGrid,
    OccupancyGridUpdate,
    Path,
    PoseStamped,
    Twist,
    configuration_of,
    read_ros_map,
    update_occupancy_grid,
)

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
