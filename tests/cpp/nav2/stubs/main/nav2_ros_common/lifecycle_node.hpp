// Stub of nav2_ros_common/lifecycle_node.hpp.
#ifndef NAV2_LIFECYCLE_NODE_STUB_HPP
#define NAV2_LIFECYCLE_NODE_STUB_HPP

#include <rclcpp_lifecycle/lifecycle_node.hpp>

namespace nav2 {
class LifecycleNode : public rclcpp_lifecycle::LifecycleNode {
 public:
  using WeakPtr = std::weak_ptr<nav2::LifecycleNode>;
  using rclcpp_lifecycle::LifecycleNode::LifecycleNode;
};
}  // namespace nav2

#endif
