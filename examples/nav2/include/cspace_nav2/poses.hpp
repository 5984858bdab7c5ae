/// @file poses.hpp
/// Poses of ROS as configurations (x, y, yaw) of a map of SE(2), or (x, y) of a round robot's.
#ifndef CSPACE_NAV2_POSES_HPP
#define CSPACE_NAV2_POSES_HPP

#include <cmath>
#include <vector>

#include <cspace/map.hpp>
#include <geometry_msgs/msg/pose.hpp>

namespace cspace_nav2 {

/// Return the yaw of a pose that is level.
inline double yaw_of(const geometry_msgs::msg::Pose& pose) {
  const auto& q = pose.orientation;
  return std::atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z));
}

inline std::vector<double> configuration_of(const cspace::Map& map, const geometry_msgs::msg::Pose& pose) {
  std::vector<double> q = {pose.position.x, pose.position.y};
  if (map.size() == 3) q.push_back(yaw_of(pose));
  return q;
}

/// Throw unless a map is of the plane.
inline void check_plane(const cspace::Map& map) {
  if (map.dim() != 2 || map.axes()[0] != "x" || map.axes()[1] != "y")
    throw std::runtime_error("cspace_nav2: the map must be of x, y, or of x, y, yaw");
}

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_POSES_HPP
