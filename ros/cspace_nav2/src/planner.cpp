#include "cspace_nav2/planner.hpp"

#include <nav2_core/planner_exceptions.hpp>
#include <pluginlib/class_list_macros.hpp>

#include "cspace_nav2/footprint.hpp"
#include "cspace_nav2/parameters.hpp"

namespace cspace_nav2 {

namespace {

/// Number of routes kept: Nav2 plans through poses with one request a leg.
constexpr std::size_t MAX_KEPT_ROUTES = 16;
/// Steps of searches that count for a second of `time_limit`. On one core of a server of 2026, searches that do not end take
/// 220,000 to 430,000 a second.
constexpr double STEPS_PER_SECOND = 250000.0;
constexpr double MAX_EXCESS = 1.05;  ///< a kept route is left for one that is cheaper by this factor

/// Return a robot in words of `cspace build --robot`, at least as large as in the costmap.
std::string describe_robot(nav2_costmap_2d::Costmap2DROS& costmap_ros) {
  std::ostringstream text;
  text << std::setprecision(17);
  const nav2_costmap_2d::Footprint corners = costmap_ros.getRobotFootprint();
  if (corners.empty()) throw std::runtime_error("the costmap has no footprint");
  if (costmap_ros.getUseRadius()) {
    double radius = 0.0;
    for (const auto& corner : corners) radius = std::max(radius, std::hypot(corner.x, corner.y));
    text << "disc:" << radius;
  } else {
    for (const auto& corner : corners)
      text << (&corner == &corners.front() ? "footprint:[" : ",") << "[" << corner.x << "," << corner.y << "]";
    text << "]";
  }
  return text.str();
}

/// Throw if a saved map is in another frame than the costmap, or its robot lacks a corner of the costmap's footprint.
void check_robot(const cspace::Map& map, nav2_costmap_2d::Costmap2DROS& costmap_ros) {
  const std::string frame = costmap_ros.getGlobalFrameID();
  if (!map.frame_id().empty() && map.frame_id() != frame)
    throw std::invalid_argument("the map is in '" + map.frame_id() + "', the costmap in '" + frame + "'");
  std::ostringstream robot, footprint;
  std::vector<cspace::Core> parts;
  try {
    parts = cspace::read_robot(map);
  } catch (const cspace::InputError&) {
    return;  // of parts that are not convex, which only gates need
  }
  for (const cspace::Core& part : parts) write_part(robot, part);
  cspace::Core whole;
  for (const auto& corner : costmap_ros.getUnpaddedRobotFootprint()) whole.corners.push_back({corner.x, corner.y});
  write_part(footprint, whole);
  for (const cspace::Point& corner : whole.corners)
    if (std::none_of(parts.begin(), parts.end(), [&](const cspace::Core& part) { return contains(part, corner); }))
      throw std::invalid_argument("the robot of the map," + robot.str() + ", lacks a corner of the costmap's footprint," + footprint.str());
}

bool legs_are_free(const Surroundings& surroundings, const std::vector<std::vector<Configuration>>& legs) {
  return std::all_of(legs.begin(), legs.end(), [&](const auto& leg) { return surroundings.poses_are_free(leg); });
}

/// Throw if a stop is outside or not free.
template <typename Outside, typename Occupied>
void check_stop(const cspace::Map& map, const Surroundings& surroundings, const Configuration& q, const std::string& stop) {
  if (!surroundings.contain(q)) throw Outside("cspace_nav2: the " + stop + " is outside the map or the costmap");
  if (!map.is_free(q.data())) throw Occupied("cspace_nav2: the map does not prove the " + stop + " free");
  if (!surroundings.is_clear(q)) throw Occupied("cspace_nav2: the costmap is occupied at the " + stop);
}

}  // namespace

void CspacePlanner::configure(const Node::WeakPtr& parent, std::string name, std::shared_ptr<Buffer>,
                              std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_ros) {
  const auto node = parent.lock();
  if (!node) throw nav2_core::PlannerException("cspace_nav2: the node is gone");
  parent_ = parent;
  name_ = name;
  costmap_ros_ = costmap_ros;
  clock_ = node->get_clock();
  logger_ = std::make_unique<const rclcpp::Logger>(node->get_logger());
  try {
    read_parameters(*node);
  } catch (const std::exception& error) {
    cleanup();
    RCLCPP_ERROR(*logger_, "%s: %s", name.c_str(), error.what());
    throw nav2_core::PlannerException(name + ": " + error.what());
  }
}

void CspacePlanner::read_parameters(Node& node) {
  Parameters<Node> parameters(node, name_ + ".");
  const std::string drive = parameters.word("drive", "how the robot moves", {DRIVES.begin(), DRIVES.end()});
  const double radius = parameters.number("turning_radius", 0.0, 0.0, 1000.0, "least turning radius of a car, metres");
  rules_.allow_unknown = parameters.flag("allow_unknown", false, "whether the robot may drive through unknown cells");
  const std::string folder = parameters.text("map", "", "folder of a map that space.save wrote; empty: made of map_topic");
  Recipe recipe = read_recipe(parameters);
  read_live_parameters(node);
  drive_ = std::make_unique<const Drive>(drive, radius);
  lock_ = parameters.lock();
  if (!folder.empty()) {
    map_ = open_plane_map(folder);
    if (map_->size() == 2 && !drive_->is_holonomic)
      throw std::invalid_argument("the parameter 'drive' is '" + drive + "', which needs a map with yaw; build it with rotations");
    check_robot(*map_, *costmap_ros_);
    blocks_ = std::make_unique<Blocks>(*map_);
    return;
  }
  recipe.frame = costmap_ros_->getGlobalFrameID();
  recipe.unknown_is_free = rules_.allow_unknown;
  recipe.robot = [costmap_ros = costmap_ros_] { return describe_robot(*costmap_ros); };
  maker_ = follow_topic(node, recipe, name_);
}

void CspacePlanner::read_live_parameters(Node& node) {
  Parameters<Node> parameters(node, name_ + ".");
  time_limit_ = parameters.number("time_limit", 5.0, 0.001, 3600.0, "seconds of a request, of 250,000 steps of the search each");
  rules_.step = parameters.number("step", 0.05, 0.001, 10.0, "metres that a point of the robot moves between two poses");
  rules_.cost_penalty = parameters.number("cost_penalty", 2.0, 0.0, 100.0, "weight of the costmap's costs, as SMAC's");
  tolerance_ = parameters.number("tolerance", 0.25, 0.0, 100.0, "metres to a free place if the goal is not free");
  start_tolerance_ = parameters.number("start_tolerance", 0.1, 0.0, 0.5, "metres to a free place if the start is not free");
}

void CspacePlanner::cleanup() {
  lock_.reset();
  maker_.reset();
  blocks_.reset();
  map_.reset();
  drive_.reset();
  clock_.reset();
  costmap_ros_.reset();
  kept_routes_.clear();
}

void CspacePlanner::update_map() {
  if (!maker_) return;
  try {
    const auto newest = maker_->map();
    if (newest == map_) return;
    blocks_ = std::make_unique<Blocks>(*newest);
    map_ = newest;
    kept_routes_.clear();
  } catch (const std::runtime_error& error) {
    throw nav2_core::PlannerException(std::string("cspace_nav2: ") + error.what());
  }
}

nav_msgs::msg::Path CspacePlanner::plan(const Pose& start, const std::vector<Pose>& viapoints, const Pose& goal,
                                        const std::function<bool()>& cancel_checker) {
  update_map();
  if (const auto node = parent_.lock()) read_live_parameters(*node);
  const std::string frame = costmap_ros_->getGlobalFrameID();
  const auto read_stop = [&](const Pose& pose, const std::string& stop) {
    if (pose.header.frame_id != frame) {
      throw nav2_core::PlannerTFError("cspace_nav2: the " + stop + " is in '" + pose.header.frame_id + "', not in '" + frame + "'");
    }
    try {
      return configuration_of(*map_, pose.pose);
    } catch (const std::invalid_argument& error) {
      throw nav2_core::PlannerException("cspace_nav2: the " + stop + " is no pose of the plane: " + error.what());
    }
  };
  const Surroundings surroundings(*map_, *costmap_ros_, *drive_, rules_);
  const Configuration given = read_stop(start, "start"), first = find_free(surroundings, given, start_tolerance_);
  check_stop<nav2_core::StartOutsideMapBounds, nav2_core::StartOccupied>(*map_, surroundings, first, "start");
  if (first != given)
    RCLCPP_WARN(*logger_, "the start is not proven free; the path begins %.3f m beside it",
                std::hypot(first[0] - given[0], first[1] - given[1]));
  std::vector<Configuration> goals;
  for (std::size_t k = 0; k <= viapoints.size(); ++k) {
    const bool is_last = k == viapoints.size();
    const std::string stop = is_last ? "goal" : "viapoint " + std::to_string(k + 1);
    goals.push_back(read_stop(is_last ? goal : viapoints[k], stop));
    if (is_last) goals.back() = find_free(surroundings, goals.back(), tolerance_);
    check_stop<nav2_core::GoalOutsideMapBounds, nav2_core::GoalOccupied>(*map_, surroundings, goals.back(), stop);
  }

  // Steps are counted, because a clock would give equal requests other paths on a busy machine.
  const IsOver is_over = [&, left = time_limit_ * STEPS_PER_SECOND]() mutable {
    if (cancel_checker && cancel_checker()) throw nav2_core::PlannerCancelled("cspace_nav2: cancelled");
    return --left < 0.0;
  };
  Route route = find_kept_route(surroundings, first, goals);
  const bool is_kept = !route.legs.empty();
  if (!is_kept) route = search_route(surroundings, first, goals, is_over);
  if (!is_kept || improve(surroundings, route, is_over)) {
    kept_routes_.push_front(route);
    if (kept_routes_.size() > MAX_KEPT_ROUTES) kept_routes_.pop_back();
  }
  return write_path(route, goal);
}

nav_msgs::msg::Path CspacePlanner::write_path(const Route& route, const Pose& goal) const {
  nav_msgs::msg::Path path;
  path.header.frame_id = goal.header.frame_id;
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
      if (!is_detour && legs_are_free(surroundings, route.legs)) return route;
      if (drive_->is_holonomic || next == whole.size() - 1) break;
    }
  }
  return {};
}

bool CspacePlanner::improve(const Surroundings& surroundings, Route& route, const IsOver& is_over) const {
  bool is_improved = false;
  for (auto& leg : route.legs) {
    const double bound = surroundings.cost(leg) / MAX_EXCESS;
    const auto cheaper = Lattice(surroundings, *blocks_, is_over).find_cheaper(leg.front(), leg.back(), bound);
    if (cheaper.empty()) continue;
    leg = cheaper;
    is_improved = true;
  }
  return is_improved;
}

Configuration CspacePlanner::find_free(const Surroundings& surroundings, const Configuration& q, double tolerance) const {
  const double spacing = 0.25 * map_->spacing();
  for (double radius = 0.0; radius <= tolerance; radius += spacing) {
    const double count = std::max(1.0, std::ceil(2.0 * M_PI * radius / spacing));
    for (double k = 0.0; k < count; ++k) {
      Configuration near = q;
      near[0] += radius * std::cos(2.0 * M_PI * k / count);
      near[1] += radius * std::sin(2.0 * M_PI * k / count);
      if (surroundings.contain(near) && surroundings.motion_is_free(near, near)) return near;  // a path can leave it
    }
  }
  return q;
}

CspacePlanner::Route CspacePlanner::search_route(const Surroundings& surroundings, const Configuration& start,
                                                 const std::vector<Configuration>& goals, const IsOver& is_over) const {
  Route route = {goals, {}};
  for (std::size_t k = 0; k < goals.size(); ++k) {
    const Lattice lattice(surroundings, *blocks_, is_over);
    route.legs.push_back(lattice.find_path(k == 0 ? start : goals[k - 1], goals[k]));
    if (!route.legs.back().empty()) continue;
    if (is_over()) throw nav2_core::PlannerTimedOut("cspace_nav2: no path within the time limit");
    throw nav2_core::NoValidPathCouldBeFound("cspace_nav2: the planner found no path");
  }
  if (!legs_are_free(surroundings, route.legs))
    throw nav2_core::NoValidPathCouldBeFound("cspace_nav2: the path is not free");
  return route;
}

}  // namespace cspace_nav2

PLUGINLIB_EXPORT_CLASS(cspace_nav2::CspacePlanner, nav2_core::GlobalPlanner)
