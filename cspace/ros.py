"""ROS maps, footprints of Nav2, and messages as plain records."""

from cspace._files.ros_maps import (
    Costmap,
    JointTrajectory,
    OccupancyGrid,
    Path,
    Twist,
    read_ros_map,
)

__all__ = ["Costmap", "JointTrajectory", "OccupancyGrid", "Path", "Twist", "read_ros_map"]
