/// @file drives.hpp
/// Drives of robots that cannot move aside, and their shortest curves without obstacles.
#ifndef CSPACE_NAV2_DRIVES_HPP
#define CSPACE_NAV2_DRIVES_HPP

#include <array>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "cspace_nav2/curves.hpp"

namespace cspace_nav2 {

/// Cost of a radian turned on the spot, metres.
constexpr double SPOT_TURN_COST = 0.5;

/// Cost of a metre in reverse, in metres ahead.
constexpr double REVERSE_WEIGHT = 1.5;

inline double cost_of(const Arc& arc) {
  if (arc.length == 0.0) return SPOT_TURN_COST * std::abs(arc.angle);
  return arc.length < 0.0 ? -REVERSE_WEIGHT * arc.length : arc.length;
}

/// Names of drives.
constexpr std::array<const char*, 5> DRIVES = {"holonomic", "differential", "differential-reverse", "dubins", "reeds-shepp"};

/// The way a robot moves, with the names of `planners.plan(drive=)` in Python.
class Drive {
 public:
  /// @param turning_radius  metres, of a car; 0 for other robots
  /// @throws std::invalid_argument if the radius does not fit the drive
  explicit Drive(const std::string& name, double turning_radius = 0.0)
      : is_holonomic(name == "holonomic"), is_car(name == "dubins" || name == "reeds-shepp"),
        reverses(name == "differential-reverse" || name == "reeds-shepp"), radius_(turning_radius) {
    if (is_car ? !(radius_ > 0.0 && std::isfinite(radius_)) : radius_ != 0.0)
      throw std::invalid_argument("the parameter 'turning_radius' is " + std::to_string(radius_) +
                                  "; it must be positive for dubins and reeds-shepp, and 0 for other drives");
  }

  const bool is_holonomic;  ///< it moves in each direction, at each yaw
  const bool is_car;        ///< it cannot turn on the spot
  const bool reverses;

  /// Return the moves of a lattice: at least as long as given, and turning by whole steps of yaw.
  /// @param backs_out  whether all robots reverse, and drive gentle arcs, too, on which no corner swings far
  /// @param is_narrow  whether cars drive arcs of one step of yaw, too, which shift them a little aside
  std::vector<Arc> moves(double length, double yaw_step, bool backs_out, bool is_narrow) const {
    std::vector<Arc> arcs = {{length, 0.0}};
    if (is_holonomic)
      for (int k = 1; k < 8; ++k) arcs.push_back({length, 0.0, k * M_PI_4});
    if (is_car) {
      const double angle = yaw_step * std::ceil(length / (radius_ * yaw_step));
      // An arc of more than a quarter turn leads around most obstacles, and so do several shorter ones.
      const double turn = std::min(angle, std::max(yaw_step, M_PI_2));
      arcs.insert(arcs.end(), {{radius_ * turn, turn}, {radius_ * turn, -turn}});
      const double gentle = std::max(length, radius_ * yaw_step);
      if (is_narrow && turn > yaw_step) arcs.insert(arcs.end(), {{gentle, yaw_step}, {gentle, -yaw_step}});
    }
    if (backs_out) {
      const double gentle = std::max(4.0 * length, radius_ * yaw_step);
      arcs.insert(arcs.end(), {{gentle, yaw_step}, {gentle, -yaw_step}});
    }
    if (reverses || backs_out)
      for (std::size_t k = arcs.size(); k-- > 0;) arcs.push_back({-arcs[k].length, -arcs[k].angle});
    if (!is_car) arcs.insert(arcs.end(), {{0.0, yaw_step}, {0.0, -yaw_step}});
    return arcs;
  }

  /// Return the shortest curve between two poses, of a robot that is not holonomic.
  std::vector<Arc> curve(const Configuration& from, const Configuration& to) const {
    if (is_car) return find_shortest_curve(radius_, reverses, from, to);
    const double length = std::hypot(to[0] - from[0], to[1] - from[1]);
    const double ahead = length > 0.0 ? std::atan2(to[1] - from[1], to[0] - from[0]) : from[2];
    const std::vector<Arc> forward = turn_and_drive(from[2], ahead, length, to[2]);
    if (!reverses) return forward;
    const std::vector<Arc> backward = turn_and_drive(from[2], ahead + M_PI, -length, to[2]);
    return total_cost(backward) < total_cost(forward) ? backward : forward;
  }

  /// Return the cost of the shortest motion between two poses without obstacles.
  double least_cost(const Configuration& from, const Configuration& to) const {
    return is_holonomic ? straight_cost(from, to) : total_cost(curve(from, to));
  }

  /// Return the cost of a motion between two near poses, as it is driven.
  double step_cost(const Configuration& from, const Configuration& to) const {
    return is_holonomic ? straight_cost(from, to) : cost_of(arc_between(from, to).arc);
  }

  static double total_cost(const std::vector<Arc>& arcs) {
    double sum = 0.0;
    for (const Arc& arc : arcs) sum += cost_of(arc);
    return sum;
  }

 private:
  static double straight_cost(const Configuration& from, const Configuration& to) {
    const double turn = std::abs(wrap(to[2] - from[2]));
    return std::hypot(to[0] - from[0], to[1] - from[1]) + SPOT_TURN_COST * turn;
  }

  static std::vector<Arc> turn_and_drive(double yaw, double ahead, double length, double last_yaw) {
    const double first = wrap(ahead - yaw);
    return {{0.0, first}, {length, 0.0}, {0.0, wrap(last_yaw - yaw - first)}};
  }

  double radius_;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_DRIVES_HPP
