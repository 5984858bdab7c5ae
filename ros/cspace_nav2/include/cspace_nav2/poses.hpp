/// @file poses.hpp
/// Poses of ROS as configurations (x, y, yaw) of a map of SE(2), or (x, y) of a round robot's.
#ifndef CSPACE_NAV2_POSES_HPP
#define CSPACE_NAV2_POSES_HPP

#include <array>
#include <cmath>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>

#include <cspace/map.hpp>
#include <geometry_msgs/msg/pose.hpp>

namespace cspace_nav2 {

/// x, y and yaw, which is 0 on a map without one.
using Configuration = std::array<double, 3>;

/// Deviation of a quaternion's norm from 1, and sine of half the tilt, that pass as rounding.
constexpr double POSE_SLACK = 1e-3;

/// Return the yaw of a level pose.
inline double yaw_of(const geometry_msgs::msg::Pose& pose) {
  const auto& r = pose.orientation;
  return std::atan2(2.0 * (r.w * r.z + r.x * r.y), r.w * r.w + r.x * r.x - r.y * r.y - r.z * r.z);
}

/// @throws std::invalid_argument if a pose is tilted, or has no unit quaternion
inline void check_level(const geometry_msgs::msg::Pose& pose) {
  const auto& r = pose.orientation;
  const double norm = std::sqrt(r.x * r.x + r.y * r.y + r.z * r.z + r.w * r.w);
  std::ostringstream text;
  text << "its quaternion (x, y, z, w) is (" << r.x << ", " << r.y << ", " << r.z << ", " << r.w << "); ";
  // NaN fails each of these comparisons.
  if (!(std::abs(norm - 1.0) <= POSE_SLACK)) throw std::invalid_argument(text.str() + "it must have norm 1");
  if (!(std::hypot(r.x, r.y) <= POSE_SLACK)) throw std::invalid_argument(text.str() + "it must be level");
}

/// Return a pose as a configuration of a map.
/// @throws std::invalid_argument if the pose is tilted, not finite, or has no unit quaternion
inline Configuration configuration_of(const cspace::Map& map, const geometry_msgs::msg::Pose& pose) {
  check_level(pose);
  const Configuration q = {pose.position.x, pose.position.y, map.size() == 3 ? yaw_of(pose) : 0.0};
  if (!map.is_usable(q.data())) throw std::invalid_argument("its position is not finite");
  return q;
}

/// Open a map of the plane.
/// @throws std::runtime_error if there is none at this path
inline std::shared_ptr<const cspace::Map> open_plane_map(const std::string& path) {
  const auto map = std::make_shared<const cspace::Map>(cspace::Map::open(path));
  if (map->dim() != 2 || map->axes()[0] != "x" || map->axes()[1] != "y")
    throw std::runtime_error(path + ": is not a map of x, y, or of x, y, yaw");
  return map;
}

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_POSES_HPP
