/// @file surroundings.hpp
/// The saved map, which proves motions free, and Nav2's live costmap, in which poses are tested.
#ifndef CSPACE_NAV2_SURROUNDINGS_HPP
#define CSPACE_NAV2_SURROUNDINGS_HPP

#include <algorithm>
#include <cmath>
#include <mutex>
#include <vector>

#include <nav2_costmap_2d/cost_values.hpp>
#include <nav2_costmap_2d/costmap_2d_ros.hpp>
#include <nav2_costmap_2d/footprint.hpp>
#include <nav2_costmap_2d/footprint_collision_checker.hpp>

#include "cspace_nav2/poses.hpp"

namespace cspace_nav2 {

/// A map and a costmap, which stays locked as long as this object lives.
class Surroundings {
 public:
  /// @param step          metres that no point of the robot exceeds between two tested poses
  /// @param allow_unknown  whether the footprint may touch unknown cells of the costmap
  Surroundings(const cspace::Map& map, nav2_costmap_2d::Costmap2DROS& costmap_ros, double step, bool allow_unknown)
      : map_(map), costmap_(*costmap_ros.getCostmap()), lock_(*costmap_.getMutex()), checker_(&costmap_), step_(step),
        allow_unknown_(allow_unknown) {
    nav2_costmap_2d::Footprint corners = costmap_ros.getRobotFootprint();
    if (corners.empty()) throw std::runtime_error("cspace_nav2: the costmap has no footprint");
    for (const auto& corner : corners) radius_ = std::max(radius_, std::hypot(corner.x, corner.y));
    // A map without yaw allows any heading, so the circle around the footprint is tested.
    if (map.size() == 2) corners = nav2_costmap_2d::makeFootprintFromRadius(radius_);
    for (std::size_t k = 0; k < corners.size(); ++k) edges_.push_back({corners[k], corners[(k + 1) % corners.size()]});
  }

  /// Return the greatest distance of the footprint from the robot's origin.
  double radius() const { return radius_; }

  /// Return true if the position is in the grids of both.
  bool contain(const Configuration& q) const {
    unsigned int column, row;
    for (std::size_t axis = 0; axis < 2; ++axis)
      if (q[axis] < map_.lower()[axis] || q[axis] > map_.upper()[axis]) return false;
    return costmap_.worldToMap(q[0], q[1], column, row);
  }

  /// Return true if the footprint's outline touches no lethal, and if not allowed no unknown, cell of the costmap.
  bool is_clear(const Configuration& q) const {
    const double yaw = q.size() == 3 ? q[2] : 0.0;
    // Each edge alone, because the cost of a whole footprint hides lethal cells behind unknown ones.
    return std::none_of(edges_.begin(), edges_.end(), [&](const nav2_costmap_2d::Footprint& edge) {
      const double cost = checker_.footprintCostAtPose(q[0], q[1], yaw, edge);
      return cost == nav2_costmap_2d::LETHAL_OBSTACLE || (cost == nav2_costmap_2d::NO_INFORMATION && !allow_unknown_);
    });
  }

  /// Return true if a configuration is proven free by the map and clear in the costmap.
  bool is_free(const Configuration& q) const { return map_.is_free(q) && is_clear(q); }

  /// Return true if a whole motion is proven free by the map, and its poses after the first are clear in the costmap.
  bool motion_is_free(const Configuration& from, const Configuration& to) const {
    if (!map_.motion_is_free(from, to)) return false;
    const std::vector<Configuration> poses = poses_between(from, to);
    return std::all_of(poses.begin(), poses.end(), [&](const Configuration& q) { return is_clear(q); });
  }

  /// Return a bound of how far any point of the robot moves.
  double distance(const Configuration& from, const Configuration& to) const {
    return std::hypot(to[0] - from[0], to[1] - from[1]) + radius_ * std::abs(turn(from, to));
  }

  /// Return the poses of a motion at most `step` apart, the last included and the first not.
  std::vector<Configuration> poses_between(const Configuration& from, const Configuration& to) const {
    // A motion of one step stays one step, whatever rounding does.
    const double count = std::ceil(distance(from, to) / step_ - 1e-6);
    std::vector<Configuration> poses;
    for (double k = 1.0; k < count; ++k) {
      const double t = k / count;
      poses.push_back({from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1])});
      if (from.size() == 3) poses.back().push_back(from[2] + t * turn(from, to));
    }
    poses.push_back(to);
    return poses;
  }

 private:
  /// Return the shorter turn between two configurations.
  static double turn(const Configuration& from, const Configuration& to) {
    return from.size() == 3 ? std::remainder(to[2] - from[2], 2.0 * M_PI) : 0.0;
  }

  const cspace::Map& map_;
  nav2_costmap_2d::Costmap2D& costmap_;
  std::unique_lock<nav2_costmap_2d::Costmap2D::mutex_t> lock_;
  mutable nav2_costmap_2d::FootprintCollisionChecker<nav2_costmap_2d::Costmap2D*> checker_;
  double step_;
  bool allow_unknown_;
  double radius_ = 0.0;
  std::vector<nav2_costmap_2d::Footprint> edges_;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_SURROUNDINGS_HPP
