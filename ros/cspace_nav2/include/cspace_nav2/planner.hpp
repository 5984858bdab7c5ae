/// @file planner.hpp
/// A global planner of Nav2 on a map saved by cspace.
#ifndef CSPACE_NAV2_PLANNER_HPP
#define CSPACE_NAV2_PLANNER_HPP

#include <functional>
#include <list>
#include <memory>
#include <string>
#include <vector>

#include <nav2_core/global_planner.hpp>
#include <rclcpp/rclcpp.hpp>

#include "cspace_nav2/surroundings.hpp"

#if __has_include(<nav2_ros_common/lifecycle_node.hpp>)
#include <nav2_ros_common/lifecycle_node.hpp>
#define CSPACE_NAV2_HAS_VIAPOINTS
#endif

namespace cspace_nav2 {

#ifdef CSPACE_NAV2_HAS_VIAPOINTS
using Node = nav2::LifecycleNode;
using Buffer = nav2::TransformBuffer;
#else
using Node = rclcpp_lifecycle::LifecycleNode;
using Buffer = tf2_ros::Buffer;
#endif

/// Plans with RRTConnect, or on a lattice for a robot that cannot move aside, then shortens the path.
///
/// The saved map proves every edge free along its whole length, as it is driven. In the live costmap, poses along the
/// path are tested.
///
/// Parameters, which are read-only while the node runs: `<name>.map`, the folder that `space.save` wrote, in the
/// costmap's global frame; `<name>.drive` and `<name>.turning_radius`, metres; `<name>.time_limit`, seconds;
/// `<name>.step`, metres between poses of the path; `<name>.tolerance`, metres, within which another goal is taken if
/// the goal is not free; `<name>.allow_unknown`, of the costmap.
class CspacePlanner : public nav2_core::GlobalPlanner {
 public:
  using Pose = geometry_msgs::msg::PoseStamped;

  /// @throws nav2_core::PlannerException if the map is missing or not of the plane, or a parameter is not positive
  void configure(const Node::WeakPtr& parent, std::string name, std::shared_ptr<Buffer> tf,
                 std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_ros) override;
  void cleanup() override;
  void activate() override {}
  void deactivate() override {}

#ifdef CSPACE_NAV2_HAS_VIAPOINTS
  nav_msgs::msg::Path createPlan(const Pose& start, const Pose& goal, const std::vector<Pose>& viapoints,
                                 std::function<bool()> cancel_checker) override {
    return plan(start, viapoints, goal, cancel_checker);
  }
#else
  nav_msgs::msg::Path createPlan(const Pose& start, const Pose& goal, std::function<bool()> cancel_checker) override {
    return plan(start, {}, goal, cancel_checker);
  }
#endif

 private:
  /// Legs from stop to stop; the configurations of a leg are the poses of the path, its ends included.
  struct Route {
    std::vector<Configuration> goals;
    std::vector<std::vector<Configuration>> legs;
    double saving;  ///< largest share of a leg that a single motion saved when it was found
  };

  /// Return a path through all viapoints; throw a `nav2_core::PlannerException` that says why there is none.
  nav_msgs::msg::Path plan(const Pose& start, const std::vector<Pose>& viapoints, const Pose& goal,
                           const std::function<bool()>& cancel_checker);
  Route find_kept_route(const Surroundings& surroundings, const Configuration& start,
                        const std::vector<Configuration>& goals) const;
  /// Return the free configuration nearest to a goal within the tolerance; the goal if there is none.
  Configuration find_free_goal(const Surroundings& surroundings, const Configuration& goal) const;
  Route search_route(const Surroundings& surroundings, const Configuration& start,
                     const std::vector<Configuration>& goals, const std::function<bool()>& cancel_checker) const;

  std::shared_ptr<const cspace::Map> map_;
  std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_ros_;
  std::unique_ptr<const Drive> drive_;
  rclcpp::Clock::SharedPtr clock_;
  double time_limit_ = 1.0;
  double step_ = 0.05;
  double tolerance_ = 0.25;
  bool allow_unknown_ = true;
  std::list<Route> kept_routes_;  ///< the newest first
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_PLANNER_HPP
