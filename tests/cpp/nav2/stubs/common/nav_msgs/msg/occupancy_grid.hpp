// Stub of nav_msgs/msg/occupancy_grid.hpp.
#ifndef NAV_MSGS_OCCUPANCY_GRID_STUB_HPP
#define NAV_MSGS_OCCUPANCY_GRID_STUB_HPP

#include <cstdint>
#include <vector>

#include <geometry_msgs/msg/pose.hpp>

namespace nav_msgs::msg {
struct MapMetaData {
  builtin_interfaces::msg::Time map_load_time;
  float resolution = 0.0F;
  std::uint32_t width = 0, height = 0;
  geometry_msgs::msg::Pose origin;
};
struct OccupancyGrid {
  std_msgs::msg::Header header;
  MapMetaData info;
  std::vector<std::int8_t> data;
};
}  // namespace nav_msgs::msg

#endif
