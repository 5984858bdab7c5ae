// Stub of rclcpp_lifecycle/lifecycle_node.hpp.
#ifndef RCLCPP_LIFECYCLE_STUB_HPP
#define RCLCPP_LIFECYCLE_STUB_HPP

#include <rclcpp/rclcpp.hpp>

namespace rclcpp_lifecycle {
class LifecycleNode : public rclcpp::Node {
 public:
  using WeakPtr = std::weak_ptr<LifecycleNode>;
  using rclcpp::Node::Node;
};
}  // namespace rclcpp_lifecycle

#endif
