// Stub of nav2_costmap_2d/footprint.hpp.
#ifndef NAV2_FOOTPRINT_STUB_HPP
#define NAV2_FOOTPRINT_STUB_HPP

#include <cmath>
#include <vector>

#include <geometry_msgs/msg/pose.hpp>

namespace nav2_costmap_2d {
using Footprint = std::vector<geometry_msgs::msg::Point>;

inline std::vector<geometry_msgs::msg::Point> makeFootprintFromRadius(double radius) {
  std::vector<geometry_msgs::msg::Point> points(16);
  for (int k = 0; k < 16; ++k) {
    points[k].x = radius * std::cos(k * M_PI / 8.0);
    points[k].y = radius * std::sin(k * M_PI / 8.0);
  }
  return points;
}
}  // namespace nav2_costmap_2d

#endif
