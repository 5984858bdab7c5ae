// Stub of nav2_core/global_planner.hpp of Jazzy.
#ifndef NAV2_CORE_STUB_HPP
#define NAV2_CORE_STUB_HPP

#include <functional>
#include <memory>
#include <string>

#include <nav2_costmap_2d/costmap_2d_ros.hpp>
#include <nav_msgs/msg/path.hpp>
#include <rclcpp_lifecycle/lifecycle_node.hpp>

namespace tf2_ros {
class Buffer;
}

namespace nav2_core {
class GlobalPlanner {
 public:
  using Ptr = std::shared_ptr<GlobalPlanner>;
  virtual ~GlobalPlanner() {}
  virtual void configure(const rclcpp_lifecycle::LifecycleNode::WeakPtr& parent, std::string name,
                         std::shared_ptr<tf2_ros::Buffer> tf, std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_ros) = 0;
  virtual void cleanup() = 0;
  virtual void activate() = 0;
  virtual void deactivate() = 0;
  virtual nav_msgs::msg::Path createPlan(const geometry_msgs::msg::PoseStamped& start,
                                         const geometry_msgs::msg::PoseStamped& goal,
                                         std::function<bool()> cancel_checker) = 0;
};
}  // namespace nav2_core

#endif
