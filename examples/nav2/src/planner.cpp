#include "cspace_nav2/planner.hpp"

#include <ompl/geometric/planners/rrt/RRTConnect.h>

#include <cspace/ompl.hpp>
#include <nav2_core/planner_exceptions.hpp>
#include <pluginlib/class_list_macros.hpp>

#include "cspace_nav2/poses.hpp"

namespace og = ompl::geometric;

namespace cspace_nav2 {

void CspacePlanner::configure(const rclcpp_lifecycle::LifecycleNode::WeakPtr& parent, std::string name,
                              std::shared_ptr<tf2_ros::Buffer>, std::shared_ptr<nav2_costmap_2d::Costmap2DROS>) {
  const auto node = parent.lock();
  if (!node) throw std::runtime_error("cspace_nav2: the node is gone");
  const std::string path = node->declare_parameter<std::string>(name + ".map", "");
  time_limit_ = node->declare_parameter<double>(name + ".time_limit", time_limit_);
  step_ = node->declare_parameter<double>(name + ".step", step_);
  map_ = std::make_shared<const cspace::Map>(cspace::Map::open(path));
  check_plane(*map_);
}

nav_msgs::msg::Path CspacePlanner::createPlan(const geometry_msgs::msg::PoseStamped& start,
                                              const geometry_msgs::msg::PoseStamped& goal,
                                              std::function<bool()> cancel_checker) {
  og::SimpleSetup setup(cspace::state_space(*map_));
  cspace::set_checkers(setup, map_);
  ompl::base::ScopedState<> first(setup.getStateSpace()), last(setup.getStateSpace());
  cspace::write_state(*map_, configuration_of(*map_, start.pose), first.get());
  cspace::write_state(*map_, configuration_of(*map_, goal.pose), last.get());
  setup.setStartAndGoalStates(first, last);
  setup.setPlanner(std::make_shared<og::RRTConnect>(setup.getSpaceInformation()));
  const auto end = ompl::base::plannerOrTerminationCondition(ompl::base::PlannerTerminationCondition(cancel_checker),
                                                             ompl::base::timedPlannerTerminationCondition(time_limit_));
  if (setup.solve(end) != ompl::base::PlannerStatus::EXACT_SOLUTION)
    throw nav2_core::NoValidPathCouldBeFound("cspace_nav2: no path within the time limit");
  setup.simplifySolution();

  og::PathGeometric& found = setup.getSolutionPath();
  // More poses on the same edges, for controllers.
  found.interpolate(static_cast<unsigned int>(found.length() / step_) + 2);
  nav_msgs::msg::Path path;
  path.header = goal.header;
  for (const ompl::base::State* state : found.getStates()) {
    const std::array<double, 7> q = cspace::numbers_of(*map_, state);
    geometry_msgs::msg::PoseStamped pose = goal;
    pose.pose.position.x = q[0];
    pose.pose.position.y = q[1];
    if (map_->size() == 3) {
      pose.pose.orientation.x = pose.pose.orientation.y = 0.0;
      pose.pose.orientation.z = std::sin(q[2] / 2.0);
      pose.pose.orientation.w = std::cos(q[2] / 2.0);
    }
    path.poses.push_back(pose);
  }
  return path;
}

}  // namespace cspace_nav2

PLUGINLIB_EXPORT_CLASS(cspace_nav2::CspacePlanner, nav2_core::GlobalPlanner)
