// Stub of nav2_msgs/srv/is_path_valid.hpp of the main branch.
#ifndef NAV2_MSGS_STUB_HPP
#define NAV2_MSGS_STUB_HPP

#include <cstdint>
#include <vector>

#include <nav_msgs/msg/path.hpp>

namespace nav2_msgs::srv {
struct IsPathValid {
  struct Request {
    nav_msgs::msg::Path path;
  };
  struct Response {
    bool success = false;
    bool is_valid = false;
    std::vector<std::int32_t> invalid_pose_indices;
  };
};
}  // namespace nav2_msgs::srv

#endif
