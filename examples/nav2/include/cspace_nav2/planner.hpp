/// @file planner.hpp
/// A global planner of Nav2 on a map saved by cspace.
#ifndef CSPACE_NAV2_PLANNER_HPP
#define CSPACE_NAV2_PLANNER_HPP

#include <functional>
#include <memory>
#include <string>

#include <cspace/map.hpp>
#include <nav2_core/global_planner.hpp>

namespace cspace_nav2 {

/// Plans with RRTConnect, then shortens the path; every edge is proven free along its whole length.
///
/// Parameters: `<name>.map`, the folder that `space.save` wrote, in the global frame; `<name>.time_limit`, seconds; and
/// `<name>.step`, metres between poses of the path.
class CspacePlanner : public nav2_core::GlobalPlanner {
 public:
  void configure(const rclcpp_lifecycle::LifecycleNode::WeakPtr& parent, std::string name, std::shared_ptr<tf2_ros::Buffer> tf,
                 std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_ros) override;
  void cleanup() override { map_.reset(); }
  void activate() override {}
  void deactivate() override {}

  /// Return a path of proven edges; throw if there is none within the time limit.
  nav_msgs::msg::Path createPlan(const geometry_msgs::msg::PoseStamped& start,
                                 const geometry_msgs::msg::PoseStamped& goal,
                                 std::function<bool()> cancel_checker) override;

 private:
  std::shared_ptr<const cspace::Map> map_;
  double time_limit_ = 1.0;
  double step_ = 0.05;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_PLANNER_HPP
