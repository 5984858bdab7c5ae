/// @file surroundings.hpp
/// The saved map, which proves motions free, and Nav2's live costmap, in which poses are tested.
#ifndef CSPACE_NAV2_SURROUNDINGS_HPP
#define CSPACE_NAV2_SURROUNDINGS_HPP

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <mutex>
#include <vector>

#include <nav2_costmap_2d/cost_values.hpp>
#include <nav2_costmap_2d/costmap_2d_ros.hpp>
#include <nav2_costmap_2d/footprint.hpp>
#include <nav2_costmap_2d/footprint_collision_checker.hpp>

#include "cspace_nav2/drives.hpp"

namespace cspace_nav2 {

/// Distance beside the end of an arc, in cells, that passes as rounding of a curve.
constexpr double MAX_GAP_CELLS = 1e-3;

/// How poses are tested and weighed in the costmap.
struct Rules {
  double step;          ///< metres that no point of the robot exceeds between two tested poses
  double cost_penalty;  ///< share by which a metre at the highest cost below a collision costs more
  bool allow_unknown;   ///< whether the footprint may touch unknown cells
};

/// A map and a copy of the costmap, which is locked no longer than that takes: others need it during long searches.
class Surroundings {
 public:
  Surroundings(const cspace::Map& map, nav2_costmap_2d::Costmap2DROS& costmap_ros, const Drive& drive, const Rules& rules)
      : map_(map), drive_(drive), costmap_(copy(*costmap_ros.getCostmap())), rules_(rules),
        footprint_(costmap_ros.getRobotFootprint()), checker_(&costmap_), is_round_(costmap_ros.getUseRadius()),
        columns_(costmap_.getSizeInCellsX()), rows_(costmap_.getSizeInCellsY()), cells_(costmap_.getCharMap()) {
    for (const auto& corner : footprint_) corners_.push_back({corner.x, corner.y});
    if (corners_.empty()) throw std::runtime_error("cspace_nav2: the costmap has no footprint");
    for (const auto& [x, y] : corners_) radius_ = std::max(radius_, std::hypot(x, y));
    // A map without yaw allows any heading, so a polygon around the circle around the footprint is tested.
    if (map.size() == 2) {
      corners_.clear();
      for (const auto& corner : nav2_costmap_2d::makeFootprintFromRadius(radius_ / std::cos(M_PI / 16.0)))
        corners_.push_back({corner.x, corner.y});
    }
    for (const auto& [x, y] : corners_) radius_of_corners_ = std::max(radius_of_corners_, std::hypot(x, y));
    occupied_before_.assign(std::size_t{rows_ + 1} * (columns_ + 1), 0);
    const unsigned char* cell = cells_;
    for (unsigned int row = 0; row < rows_; ++row) {
      std::int32_t in_row = 0;
      for (unsigned int column = 0; column < columns_; ++column) {
        const unsigned char cost = *cell++;
        in_row += cost == nav2_costmap_2d::LETHAL_OBSTACLE ||
                  (cost == nav2_costmap_2d::NO_INFORMATION && !rules.allow_unknown);
        occupied_before_[index_of(row + 1, column + 1)] = occupied_before_[index_of(row, column + 1)] + in_row;
      }
    }
  }

  const cspace::Map& map() const { return map_; }
  const Drive& drive() const { return drive_; }

  /// Return the greatest distance of the footprint from the robot's origin.
  double radius() const { return radius_; }

  /// Return true if the position is in the grids of both.
  bool contain(const Configuration& q) const {
    unsigned int column, row;
    for (std::size_t axis = 0; axis < 2; ++axis)
      if (q[axis] < map_.lower()[axis] || q[axis] > map_.upper()[axis]) return false;
    return costmap_.worldToMap(q[0], q[1], column, row);
  }

  /// Return by how much a metre costs more at a pose than where nothing is near, as SMAC weighs it.
  double weight(const Configuration& q) const { return weight_at(q[0], q[1]); }
  double weight_at(double x, double y) const {
    unsigned int column, row;
    if (!costmap_.worldToMap(x, y, column, row)) return 1.0 + rules_.cost_penalty;
    constexpr unsigned char highest = nav2_costmap_2d::MAX_NON_OBSTACLE;
    return 1.0 + rules_.cost_penalty * std::min(cells_[std::size_t{row} * columns_ + column], highest) / highest;
  }

  /// Return the cost of a way through poses: its metres, weighed by the costmap.
  double cost(const std::vector<Configuration>& poses) const {
    double sum = 0.0;
    for (std::size_t k = 1; k < poses.size(); ++k) sum += cost(poses[k - 1], poses[k]);
    return sum;
  }
  double cost(const Configuration& from, const Configuration& to) const {
    return drive_.step_cost(from, to) * weight(to);
  }

  /// Return true if the footprint is in the costmap and meets no lethal, and if not allowed no unknown, cell.
  ///
  /// A cell meets it if an edge passes through the cell, or if it contains the cell's center; or by the rule of Nav2's
  /// service is_path_valid, which rounds corners to cells.
  bool is_clear(const Configuration& q) const {
    if (is_round_ && !is_valid_in_nav2(q)) return false;
    if (square_is_clear(q)) return true;
    if (!is_round_ && !is_valid_in_nav2(q)) return false;
    const std::vector<Point> body = place(q);
    const auto lower = [](const Point& a, const Point& b) { return a[1] < b[1]; };
    const auto [lowest, highest] = std::minmax_element(body.begin(), body.end(), lower);
    if (!((*lowest)[1] >= 0.0 && (*highest)[1] < rows_)) return false;
    const auto last = static_cast<unsigned int>((*highest)[1]);
    for (auto row = static_cast<unsigned int>((*lowest)[1]); row <= last; ++row)
      if (!row_is_clear(body, row)) return false;
    return true;
  }

  /// Return true if the robot may turn here with half as much room to spare, as far as the costmap knows.
  bool is_wide(const Configuration& q) const { return square_is_clear(q, 1.5); }

  /// Return true if a configuration is proven free by the map and clear in the costmap.
  bool is_free(const Configuration& q) const { return map_.is_free(q.data()) && is_clear(q); }

  /// Return true if a whole motion is proven free by the map, and its poses after the first are clear in the costmap.
  ///
  /// A robot that is not holonomic drives the arc between the poses.
  bool motion_is_free(const Configuration& from, const Configuration& to) const {
    if (drive_.is_holonomic ? !map_.motion_is_free(from.data(), to.data()) : !arc_is_free(from, to)) return false;
    const double count = count_steps(from, to);
    for (double k = 1.0; k < count; ++k)
      if (!is_clear(mix(from, to, k / count))) return false;
    return is_clear(to);
  }

  /// Return true if all motions between poses that follow each other are free.
  bool poses_are_free(const std::vector<Configuration>& poses) const {
    for (std::size_t k = 1; k < poses.size(); ++k)
      if (!motion_is_free(poses[k - 1], poses[k])) return false;
    return true;
  }

  /// Return a bound of how far any point of the robot moves.
  double distance(const Configuration& from, const Configuration& to) const {
    return std::hypot(to[0] - from[0], to[1] - from[1]) + radius_ * std::abs(turn(from, to));
  }

  /// Return the sum of the distances between poses.
  double length(const std::vector<Configuration>& poses) const {
    double sum = 0.0;
    for (std::size_t k = 1; k < poses.size(); ++k) sum += distance(poses[k - 1], poses[k]);
    return sum;
  }

  /// Return the poses of a straight motion at most `step` apart, both ends included.
  std::vector<Configuration> poses_between(const Configuration& from, const Configuration& to) const {
    const double count = count_steps(from, to);
    std::vector<Configuration> poses = {from};
    for (double k = 1.0; k < count; ++k) poses.push_back(mix(from, to, k / count));
    poses.push_back(to);
    return poses;
  }

  /// Return the poses along arcs at most `step` apart, the first included.
  std::vector<Configuration> poses_along(const Configuration& from, const std::vector<Arc>& arcs) const {
    std::vector<Configuration> poses = {from};
    for (const Arc& arc : arcs) {
      const double length = std::abs(arc.length), angle = std::abs(arc.angle);
      // The second bound keeps a piece within a sixteenth of a cell of its chord.
      const double steps = (length + radius_ * angle) / rules_.step, bends = std::sqrt(2.0 * length * angle / map_.spacing());
      const double count = std::ceil(std::max({steps, bends, angle}) - 1e-6);
      const Configuration begin = poses.back(), end = advance(begin, arc);
      const bool is_straight = arc.angle == 0.0;  // which needs no more sines
      for (double k = 1.0; k <= count; ++k) {
        const Arc part = {k / count * arc.length, k / count * arc.angle, arc.aside};
        poses.push_back(is_straight ? mix(begin, end, k / count) : advance(begin, part));
      }
    }
    return poses;
  }

  /// Return the poses of the shortest motion between two poses without obstacles, both included; empty if its cost without
  /// obstacles reaches a bound.
  std::vector<Configuration> connect(const Configuration& from, const Configuration& to,
                                     double bound = std::numeric_limits<double>::infinity()) const {
    if (drive_.is_holonomic && drive_.least_cost(from, to) >= bound) return {};
    if (drive_.is_holonomic) return poses_between(from, to);
    const std::vector<Arc> arcs = drive_.curve(from, to);
    if (Drive::total_cost(arcs) >= bound) return {};
    std::vector<Configuration> poses = poses_along(from, arcs);
    // The curve ends where it should, up to rounding.
    if (poses.size() > 1) poses.pop_back();
    poses.push_back(to);
    return poses;
  }

 private:
  using Point = std::array<double, 2>;

  static nav2_costmap_2d::Costmap2D copy(nav2_costmap_2d::Costmap2D& costmap) {
    const std::lock_guard<nav2_costmap_2d::Costmap2D::mutex_t> lock(*costmap.getMutex());
    return nav2_costmap_2d::Costmap2D(costmap);
  }

  /// Return the shorter turn between two configurations.
  static double turn(const Configuration& from, const Configuration& to) {
    return wrap(to[2] - from[2]);
  }

  /// Return the number of steps of a straight motion; one of one step stays so, whatever rounding does.
  double count_steps(const Configuration& from, const Configuration& to) const {
    return std::ceil(distance(from, to) / rules_.step - 1e-6);
  }

  static Configuration mix(const Configuration& from, const Configuration& to, double t) {
    return {from[0] + t * (to[0] - from[0]), from[1] + t * (to[1] - from[1]), from[2] + t * turn(from, to)};
  }

  /// Return true if Nav2's service is_path_valid accepts a pose, as far as lethal cells are concerned.
  bool is_valid_in_nav2(const Configuration& q) const {
    if (is_round_) {
      unsigned int column, row;
      if (!costmap_.worldToMap(q[0], q[1], column, row)) return false;
      const unsigned char cost = costmap_.getCost(column, row);
      return cost < nav2_costmap_2d::INSCRIBED_INFLATED_OBSTACLE || cost == nav2_costmap_2d::NO_INFORMATION;
    }
    // The yaw as it is read from the path: rounding may move a corner into the next cell.
    const double half = 0.5 * q[2], sine = std::sin(half), cosine = std::cos(half);
    const double yaw = std::atan2(2.0 * cosine * sine, cosine * cosine - sine * sine);
    return checker_.footprintCostAtPose(q[0], q[1], yaw, footprint_) != nav2_costmap_2d::LETHAL_OBSTACLE;
  }

  /// Return true if the map proves the arc between two poses free.
  ///
  /// An arc of length L that turns by angle a lies within L a / 8 of even motion along its chord. If the second pose is
  /// beside the end of the arc, up to rounding, this counts, too.
  bool arc_is_free(const Configuration& from, const Configuration& to) const {
    const auto [arc, gap] = arc_between(from, to);
    if (gap > MAX_GAP_CELLS * map_.spacing()) return false;
    const double stray = std::abs(arc.length * arc.angle) / 8.0 + gap + 0x1p-30 * map_.spacing();
    const double rows[] = {from[0], from[1], from[2], to[0], to[1], to[2]};
    return map_.proven_prefix(rows, 2, {stray, stray, 0.0}) == 1;
  }

  /// Return the corners of the footprint at a pose, in cells of the costmap.
  std::vector<Point> place(const Configuration& q) const {
    const double cosine = std::cos(q[2]), sine = std::sin(q[2]), side = costmap_.getResolution();
    std::vector<Point> body;
    for (const auto& [x, y] : corners_)
      body.push_back({(q[0] + x * cosine - y * sine - costmap_.getOriginX()) / side,
                      (q[1] + x * sine + y * cosine - costmap_.getOriginY()) / side});
    return body;
  }

  bool row_is_clear(const std::vector<Point>& body, unsigned int row) const {
    const double bottom = row, top = row + 1.0, middle = row + 0.5;
    std::vector<double> crossings;
    for (std::size_t k = 0; k < body.size(); ++k) {
      Point a = body[k], b = body[(k + 1) % body.size()];
      if (a[1] > b[1]) std::swap(a, b);
      if (b[1] < bottom || a[1] > top) continue;
      const auto x_at = [&](double y) { return a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]); };
      const double begin = a[1] < bottom ? x_at(bottom) : a[0], end = b[1] > top ? x_at(top) : b[0];
      if (!run_is_clear(row, std::min(begin, end), std::max(begin, end))) return false;
      if (a[1] <= middle && middle < b[1]) crossings.push_back(x_at(middle));
    }
    std::sort(crossings.begin(), crossings.end());
    for (std::size_t k = 0; k + 1 < crossings.size(); k += 2)
      if (!run_is_clear(row, crossings[k], crossings[k + 1])) return false;
    return true;
  }

  /// Return true if the cells of a row from one place to another are in the costmap and not occupied.
  bool run_is_clear(unsigned int row, double first, double last) const { return box_is_clear(row, row, first, last); }

  /// Return true if the square around the footprint at each yaw, scaled, is in the costmap and has no occupied cell.
  bool square_is_clear(const Configuration& q, double scale = 1.0) const {
    const double side = costmap_.getResolution(), reach = scale * radius_of_corners_ / side + 1e-6;
    const double x = (q[0] - costmap_.getOriginX()) / side, y = (q[1] - costmap_.getOriginY()) / side;
    return box_is_clear(y - reach, y + reach, x - reach, x + reach);
  }

  /// Return true if all cells from one row and column to others are in the costmap and not occupied.
  bool box_is_clear(double bottom, double top, double left, double right) const {
    if (!(bottom >= 0.0 && top < rows_ && left >= 0.0 && right < columns_)) return false;
    const auto first_row = static_cast<std::size_t>(bottom), first_column = static_cast<std::size_t>(left);
    const std::size_t row = static_cast<std::size_t>(top) + 1, column = static_cast<std::size_t>(right) + 1;
    return occupied_before_[index_of(row, column)] - occupied_before_[index_of(first_row, column)] ==
           occupied_before_[index_of(row, first_column)] - occupied_before_[index_of(first_row, first_column)];
  }

  std::size_t index_of(std::size_t row, std::size_t column) const { return row * (columns_ + 1) + column; }

  const cspace::Map& map_;
  const Drive& drive_;
  nav2_costmap_2d::Costmap2D costmap_;
  const Rules rules_;
  nav2_costmap_2d::Footprint footprint_;
  mutable nav2_costmap_2d::FootprintCollisionChecker<nav2_costmap_2d::Costmap2D*> checker_;
  bool is_round_;  ///< Nav2 tests the cell below the robot's center
  unsigned int columns_, rows_;
  const unsigned char* cells_;  ///< costs, row by row; calls of getCost would take longer than the rest
  double radius_ = 0.0, radius_of_corners_ = 0.0;  ///< of the footprint, and of the polygon that is tested
  std::vector<Point> corners_;
  std::vector<std::int32_t> occupied_before_;  ///< occupied cells below each row and before each column, as a table of both
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_SURROUNDINGS_HPP
