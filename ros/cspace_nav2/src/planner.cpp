#include "cspace_nav2/planner.hpp"

#include <ompl/geometric/planners/rrt/RRTConnect.h>
#include <ompl/util/Console.h>
#include <ompl/util/RandomNumbers.h>

#include <cspace/ompl.hpp>
#include <nav2_core/planner_exceptions.hpp>
#include <pluginlib/class_list_macros.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>

#include "cspace_nav2/lattice.hpp"

namespace ob = ompl::base;
namespace og = ompl::geometric;

namespace cspace_nav2 {

namespace {

/// Number of routes kept: Nav2 plans through poses with one request a leg.
constexpr std::size_t MAX_KEPT_ROUTES = 16;
constexpr double MAX_NEW_SAVING = 0.05;  ///< share of a leg by which a kept route may be longer than when it was found

/// Declare a parameter as read-only, unless an earlier configuration did, and return its value.
template <typename Value>
Value read_parameter(Node& node, const std::string& name, const Value& otherwise) {
  if (node.has_parameter(name)) return node.get_parameter(name).template get_value<Value>();
  rcl_interfaces::msg::ParameterDescriptor rule;
  rule.read_only = true;
  return node.declare_parameter<Value>(name, otherwise, rule);
}

/// Throw if a parameter is below its least value, or is not finite.
void check_number(const std::string& name, double value, bool may_be_zero) {
  if (std::isfinite(value) && (may_be_zero ? value >= 0.0 : value > 0.0)) return;
  const std::string rule = may_be_zero ? "zero or positive" : "positive";
  throw std::invalid_argument("the parameter '" + name + "' is " + std::to_string(value) + "; it must be " + rule);
}

Configuration configuration_at(const cspace::Map& map, const ob::State* state) {
  const std::array<double, 7> q = cspace::numbers_of(map, state);
  return {q.begin(), q.begin() + map.size()};
}

/// Motions are valid if the map proves them free and the costmap is clear along them.
class MotionValidator : public cspace::MotionValidator {
 public:
  MotionValidator(const ob::SpaceInformationPtr& si, const std::shared_ptr<const cspace::Map>& map,
                  const Surroundings& surroundings)
      : cspace::MotionValidator(si, map), map_(*map), surroundings_(surroundings) {}

 protected:
  bool is_free(const ob::State* s1, const ob::State* s2) const override {
    return surroundings_.motion_is_free(configuration_at(map_, s1), configuration_at(map_, s2));
  }

 private:
  const cspace::Map& map_;
  const Surroundings& surroundings_;
};

/// Return a leg of a holonomic robot, with poses for controllers on its edges; empty if none is found before the end.
std::vector<Configuration> search_straight_leg(const std::shared_ptr<const cspace::Map>& map, const Surroundings& surroundings,
                                      const Configuration& from, const Configuration& to,
                                      const ob::PlannerTerminationCondition& end) {
  og::SimpleSetup setup(cspace::state_space(*map));
  const ob::SpaceInformationPtr& si = setup.getSpaceInformation();
  setup.setStateValidityChecker(
      [&](const ob::State* state) { return surroundings.is_free(configuration_at(*map, state)); });
  si->setMotionValidator(std::make_shared<MotionValidator>(si, map, surroundings));
  ob::ScopedState<> first(setup.getStateSpace()), last(setup.getStateSpace());
  cspace::write_state(*map, from, first.get());
  cspace::write_state(*map, to, last.get());
  setup.setStartAndGoalStates(first, last);
  setup.setPlanner(std::make_shared<og::RRTConnect>(si));
  if (setup.solve(end) != ob::PlannerStatus::EXACT_SOLUTION) return {};
  setup.simplifySolution(end);

  const std::vector<ob::State*>& states = setup.getSolutionPath().getStates();
  std::vector<Configuration> leg = {from};
  for (std::size_t k = 1; k < states.size(); ++k)
    for (const Configuration& pose : surroundings.poses_between(leg.back(), configuration_at(*map, states[k])))
      leg.push_back(pose);
  return leg;
}

/// Return a leg; empty if none is found before the end.
std::vector<Configuration> search_leg(const std::shared_ptr<const cspace::Map>& map, const Surroundings& surroundings,
                                      const Configuration& from, const Configuration& to,
                                      const ob::PlannerTerminationCondition& end) {
  if (surroundings.drive().is_holonomic) return search_straight_leg(map, surroundings, from, to, end);
  return Lattice(surroundings, end).find_path(from, to);
}

bool legs_are_free(const Surroundings& surroundings, const std::vector<std::vector<Configuration>>& legs) {
  return std::all_of(legs.begin(), legs.end(), [&](const auto& leg) { return surroundings.poses_are_free(leg); });
}

/// Return the largest share of a leg that one free motion between two of its poses saves.
double find_saving(const Surroundings& surroundings, const std::vector<std::vector<Configuration>>& legs) {
  double saving = 0.0;
  for (const auto& leg : legs) {
    const std::size_t stride = std::max<std::size_t>(leg.size() / 8, 1);
    for (std::size_t first = 0; first + stride < leg.size(); first += stride)
      for (std::size_t last = leg.size() - 1; last > first + stride; last -= stride) {
        const std::vector<Configuration> way = surroundings.connect(leg[first], leg[last]);
        const double old_length = surroundings.length({leg.begin() + first, leg.begin() + last + 1});
        const double share = (old_length - surroundings.length(way)) / std::max(surroundings.length(leg), 1e-9);
        if (share > saving && surroundings.poses_are_free(way)) saving = share;
      }
  }
  return saving;
}

/// Throw if a stop is outside or not free.
template <typename Outside, typename Occupied>
void check_stop(const cspace::Map& map, const Surroundings& surroundings, const Configuration& q, const std::string& stop) {
  if (!surroundings.contain(q)) throw Outside("cspace_nav2: the " + stop + " is outside the map or the costmap");
  if (!map.is_free(q)) throw Occupied("cspace_nav2: the map does not prove the " + stop + " free");
  if (!surroundings.is_clear(q)) throw Occupied("cspace_nav2: the costmap is occupied at the " + stop);
}

}  // namespace

void CspacePlanner::configure(const Node::WeakPtr& parent, std::string name, std::shared_ptr<Buffer>,
                              std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_ros) {
  const auto node = parent.lock();
  if (!node) throw nav2_core::PlannerException("cspace_nav2: the node is gone");
  ompl::msg::setLogLevel(ompl::msg::LOG_NONE);
  ompl::RNG::setSeed(1);  // equal requests in the same order get equal paths
  costmap_ros_ = costmap_ros;
  clock_ = node->get_clock();
  time_limit_ = read_parameter(*node, name + ".time_limit", 1.0);
  step_ = read_parameter(*node, name + ".step", 0.05);
  tolerance_ = read_parameter(*node, name + ".tolerance", 0.25);
  allow_unknown_ = read_parameter(*node, name + ".allow_unknown", true);
  const auto drive = read_parameter<std::string>(*node, name + ".drive", "holonomic");
  const double turning_radius = read_parameter(*node, name + ".turning_radius", 0.0);
  try {
    check_number("time_limit", time_limit_, false);
    check_number("step", step_, false);
    check_number("tolerance", tolerance_, true);
    drive_ = std::make_unique<const Drive>(drive, turning_radius);
    map_ = open_plane_map(read_parameter<std::string>(*node, name + ".map", ""));
    if (map_->size() == 2 && !drive_->is_holonomic)
      throw std::invalid_argument("the parameter 'drive' is '" + drive + "', which needs a map with yaw; build it with rotations");
  } catch (const std::exception& error) {
    RCLCPP_ERROR(node->get_logger(), "%s: %s", name.c_str(), error.what());
    throw nav2_core::PlannerException(name + ": " + error.what());
  }
}

void CspacePlanner::cleanup() {
  map_.reset();
  drive_.reset();
  clock_.reset();
  costmap_ros_.reset();
  kept_routes_.clear();
}

nav_msgs::msg::Path CspacePlanner::plan(const Pose& start, const std::vector<Pose>& viapoints, const Pose& goal,
                                        const std::function<bool()>& cancel_checker) {
  const std::string frame = costmap_ros_->getGlobalFrameID();
  const auto read_stop = [&](const Pose& pose, const std::string& stop) {
    if (pose.header.frame_id != frame) throw nav2_core::PlannerTFError("cspace_nav2: the " + stop + " is not in " + frame);
    try {
      return configuration_of(*map_, pose.pose);
    } catch (const std::invalid_argument& error) {
      throw nav2_core::PlannerException("cspace_nav2: the " + stop + " is no pose of the plane: " + error.what());
    }
  };
  const Surroundings surroundings(*map_, *costmap_ros_, *drive_, step_, allow_unknown_);
  const Configuration first = read_stop(start, "start");
  check_stop<nav2_core::StartOutsideMapBounds, nav2_core::StartOccupied>(*map_, surroundings, first, "start");
  std::vector<Configuration> goals;
  for (std::size_t k = 0; k <= viapoints.size(); ++k) {
    const bool is_last = k == viapoints.size();
    const std::string stop = is_last ? "goal" : "viapoint " + std::to_string(k + 1);
    goals.push_back(read_stop(is_last ? goal : viapoints[k], stop));
    if (is_last) goals.back() = find_free_goal(surroundings, goals.back());
    check_stop<nav2_core::GoalOutsideMapBounds, nav2_core::GoalOccupied>(*map_, surroundings, goals.back(), stop);
  }

  Route route = find_kept_route(surroundings, first, goals);
  if (route.legs.empty()) {
    route = search_route(surroundings, first, goals, cancel_checker);
    kept_routes_.push_front(route);
    if (kept_routes_.size() > MAX_KEPT_ROUTES) kept_routes_.pop_back();
  }
  nav_msgs::msg::Path path;
  path.header.frame_id = frame;
  path.header.stamp = clock_->now();
  for (const auto& leg : route.legs) {
    // A leg begins where the last one ended.
    for (std::size_t k = path.poses.empty() ? 0 : 1; k < leg.size(); ++k) {
      Pose pose = goal;
      pose.header = path.header;
      pose.pose.position.x = leg[k][0];
      pose.pose.position.y = leg[k][1];
      if (map_->size() == 3) {
        pose.pose.orientation.x = pose.pose.orientation.y = 0.0;
        pose.pose.orientation.z = std::sin(leg[k][2] / 2.0);
        pose.pose.orientation.w = std::cos(leg[k][2] / 2.0);
      }
      path.poses.push_back(pose);
    }
  }
  return path;
}

/// Return the rest of a route to the same goals that passes the start, is still free, and no detour; without legs if there is
/// none.
CspacePlanner::Route CspacePlanner::find_kept_route(const Surroundings& surroundings, const Configuration& start,
                                                    const std::vector<Configuration>& goals) const {
  for (Route route : kept_routes_) {
    if (route.goals != goals) continue;
    std::vector<Configuration>& leg = route.legs.front();
    const auto nearest = std::min_element(leg.begin(), leg.end(), [&](const Configuration& a, const Configuration& b) {
      return surroundings.distance(start, a) < surroundings.distance(start, b);
    });
    if (std::hypot(start[0] - (*nearest)[0], start[1] - (*nearest)[1]) > surroundings.radius()) continue;
    // The robot goes to the pose after the nearest one, and on from there; if it cannot move aside, to a later one.
    const std::vector<Configuration> whole = leg;
    const auto passed = static_cast<std::size_t>(nearest - leg.begin());
    for (std::size_t ahead = 1;; ahead *= 2) {
      const std::size_t next = std::min(passed + ahead, whole.size() - 1);
      leg = surroundings.connect(start, whole[next]);
      const bool is_detour = surroundings.length(leg) > surroundings.length({whole.begin() + passed, whole.begin() + next + 1}) +
                                                            2.0 * surroundings.distance(start, whole[passed]);
      leg.insert(leg.end(), whole.begin() + next + 1, whole.end());
      if (!is_detour && legs_are_free(surroundings, route.legs)) {
        // A shorter way than when the route was found means that something in the way has gone.
        if (find_saving(surroundings, route.legs) > route.saving + MAX_NEW_SAVING) break;
        return route;
      }
      if (drive_->is_holonomic || next == whole.size() - 1) break;
    }
  }
  return {};
}

Configuration CspacePlanner::find_free_goal(const Surroundings& surroundings, const Configuration& goal) const {
  const double spacing = map_->spacing();
  for (double radius = 0.0; radius <= tolerance_; radius += spacing) {
    const double count = std::max(1.0, std::ceil(2.0 * M_PI * radius / spacing));
    for (double k = 0.0; k < count; ++k) {
      Configuration q = goal;
      q[0] += radius * std::cos(2.0 * M_PI * k / count);
      q[1] += radius * std::sin(2.0 * M_PI * k / count);
      if (surroundings.contain(q) && surroundings.is_free(q)) return q;
    }
  }
  return goal;
}

CspacePlanner::Route CspacePlanner::search_route(const Surroundings& surroundings, const Configuration& start,
                                                 const std::vector<Configuration>& goals,
                                                 const std::function<bool()>& cancel_checker) const {
  bool is_cancelled = false, is_late = false;
  const ob::PlannerTerminationCondition limit = ob::timedPlannerTerminationCondition(time_limit_);
  const ob::PlannerTerminationCondition end([&] {
    is_cancelled = is_cancelled || (cancel_checker && cancel_checker());
    is_late = limit();
    return is_cancelled || is_late;
  });
  Route route = {goals, {}, 0.0};
  for (std::size_t k = 0; k < goals.size(); ++k) {
    route.legs.push_back(search_leg(map_, surroundings, k == 0 ? start : goals[k - 1], goals[k], end));
    if (is_cancelled) throw nav2_core::PlannerCancelled("cspace_nav2: cancelled");
    if (!route.legs.back().empty()) continue;
    if (is_late) throw nav2_core::PlannerTimedOut("cspace_nav2: no path within the time limit");
    throw nav2_core::NoValidPathCouldBeFound("cspace_nav2: the planner found no path");
  }
  if (!legs_are_free(surroundings, route.legs))
    throw nav2_core::NoValidPathCouldBeFound("cspace_nav2: the path is not free");
  route.saving = find_saving(surroundings, route.legs);
  return route;
}

}  // namespace cspace_nav2

PLUGINLIB_EXPORT_CLASS(cspace_nav2::CspacePlanner, nav2_core::GlobalPlanner)
