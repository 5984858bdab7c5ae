// Stub of nav_msgs/msg/path.hpp.
#ifndef NAV_MSGS_STUB_HPP
#define NAV_MSGS_STUB_HPP

#include <vector>

#include <geometry_msgs/msg/pose.hpp>

namespace nav_msgs::msg {
struct Path {
  std_msgs::msg::Header header;
  std::vector<geometry_msgs::msg::PoseStamped> poses;
};
}  // namespace nav_msgs::msg

#endif
