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

#include "cspace_nav2/lattice.hpp"
#include "cspace_nav2/map_maker.hpp"

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

/// Plans on a lattice, then shortens the path.
///
/// The map proves every edge free along its whole length, as it is driven. In the live costmap, poses along the path are
/// tested, and their costs count. Without the parameter `<name>.map`, the map is made of the topic `<name>.map_topic`. All
/// parameters say what they are; those that need no new map may change while the node runs.
class CspacePlanner : public nav2_core::GlobalPlanner {
 public:
  using Pose = geometry_msgs::msg::PoseStamped;

  /// @throws nav2_core::PlannerException if a parameter is wrong, or the map is missing or not of the plane
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
  };

  void read_parameters(Node& node);
  /// Read what may change between two plans.
  void read_live_parameters(Node& node);
  /// Take the newest map; throw a `nav2_core::PlannerException` that says why there is none.
  void update_map();
  /// Return a path through all viapoints; throw a `nav2_core::PlannerException` that says why there is none.
  nav_msgs::msg::Path plan(const Pose& start, const std::vector<Pose>& viapoints, const Pose& goal,
                           const std::function<bool()>& cancel_checker);
  nav_msgs::msg::Path write_path(const Route& route, const Pose& goal) const;
  Route find_kept_route(const Surroundings& surroundings, const Configuration& start,
                        const std::vector<Configuration>& goals) const;
  /// Replace legs of a route by ones that a search finds much cheaper; return true if there are any.
  bool improve(const Surroundings& surroundings, Route& route, const IsOver& is_over) const;
  /// Return the free configuration nearest to another one within a distance; that one if there is none.
  Configuration find_free(const Surroundings& surroundings, const Configuration& q, double tolerance) const;
  Route search_route(const Surroundings& surroundings, const Configuration& start, const std::vector<Configuration>& goals,
                     const IsOver& is_over) const;

  Node::WeakPtr parent_;
  std::string name_;
  std::shared_ptr<void> lock_;  ///< of parameters that need a new map
  std::shared_ptr<const cspace::Map> map_;
  std::unique_ptr<Blocks> blocks_;   ///< of the map
  std::shared_ptr<MapMaker> maker_;  ///< without one, the map is that of a folder
  std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_ros_;
  std::unique_ptr<const Drive> drive_;
  rclcpp::Clock::SharedPtr clock_;
  std::unique_ptr<const rclcpp::Logger> logger_;
  Rules rules_{};
  double time_limit_ = 5.0;
  double tolerance_ = 0.25, start_tolerance_ = 0.1;
  std::list<Route> kept_routes_;  ///< the newest first
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_PLANNER_HPP
