/// @file drives.hpp
/// Drives of robots that cannot move aside, and their shortest curves without obstacles.
#ifndef CSPACE_NAV2_DRIVES_HPP
#define CSPACE_NAV2_DRIVES_HPP

#include <array>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include <ompl/base/spaces/DubinsStateSpace.h>
#include <ompl/base/spaces/ReedsSheppStateSpace.h>

#include "cspace_nav2/poses.hpp"

namespace cspace_nav2 {

/// A drive at one curvature: metres, negative in reverse, and radians to the left; without length, a turn on the spot.
struct Arc {
  double length, angle;
  double aside = 0.0;  ///< radians from ahead to where a holonomic robot moves
};

/// Cost of a radian turned on the spot, metres.
constexpr double SPOT_TURN_COST = 0.5;

/// Cost of a metre in reverse, in metres ahead.
constexpr double REVERSE_WEIGHT = 1.5;

inline double cost_of(const Arc& arc) {
  if (arc.length == 0.0) return SPOT_TURN_COST * std::abs(arc.angle);
  return arc.length < 0.0 ? -REVERSE_WEIGHT * arc.length : arc.length;
}

/// Return the pose at the end of an arc; its yaw is not wrapped.
inline Configuration advance(const Configuration& q, const Arc& arc) {
  const double half = 0.5 * arc.angle;
  const double chord = half == 0.0 ? arc.length : arc.length * std::sin(half) / half;
  const double heading = q[2] + half + arc.aside;
  return {q[0] + chord * std::cos(heading), q[1] + chord * std::sin(heading), q[2] + arc.angle};
}

/// Return the arc between two poses of which each lies on it: its chord, and the shorter turn.
inline Arc arc_between(const Configuration& from, const Configuration& to) {
  const double half = 0.5 * std::remainder(to[2] - from[2], 2.0 * M_PI);
  const double middle = from[2] + half;
  const double chord = (to[0] - from[0]) * std::cos(middle) + (to[1] - from[1]) * std::sin(middle);
  return {half == 0.0 ? chord : chord * half / std::sin(half), 2.0 * half};
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
    if (name == "dubins") dubins_ = std::make_shared<ompl::base::DubinsStateSpace>(radius_);
    if (name == "reeds-shepp") reeds_shepp_ = std::make_shared<ompl::base::ReedsSheppStateSpace>(radius_);
  }

  const bool is_holonomic;  ///< it moves in each direction, at each yaw
  const bool is_car;        ///< it cannot turn on the spot
  const bool reverses;

  /// Return the moves of a lattice: at least as long as given, and turning by whole steps of yaw.
  std::vector<Arc> moves(double length, double yaw_step) const {
    std::vector<Arc> arcs = {{length, 0.0}};
    if (is_holonomic)
      for (int k = 1; k < 8; ++k) arcs.push_back({length, 0.0, k * M_PI_4});
    if (is_car) {
      const double angle = yaw_step * std::ceil(length / (radius_ * yaw_step));
      // An arc of more than a quarter turn leads around most obstacles, and so do several shorter ones.
      const double turn = std::min(angle, std::max(yaw_step, M_PI_2));
      arcs.insert(arcs.end(), {{radius_ * turn, turn}, {radius_ * turn, -turn}});
    }
    if (reverses)
      for (std::size_t k = arcs.size(); k-- > 0;) arcs.push_back({-arcs[k].length, -arcs[k].angle});
    if (!is_car) arcs.insert(arcs.end(), {{0.0, yaw_step}, {0.0, -yaw_step}});
    return arcs;
  }

  /// Return the shortest curve between two poses, of a robot that is not holonomic.
  std::vector<Arc> curve(const Configuration& from, const Configuration& to) const {
    if (dubins_) return read_curve(*dubins_, from, to, ompl::base::DubinsStateSpace::DUBINS_STRAIGHT);
    if (reeds_shepp_) return read_curve(*reeds_shepp_, from, to, ompl::base::ReedsSheppStateSpace::RS_STRAIGHT);
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
    return is_holonomic ? straight_cost(from, to) : cost_of(arc_between(from, to));
  }

  static double total_cost(const std::vector<Arc>& arcs) {
    double sum = 0.0;
    for (const Arc& arc : arcs) sum += cost_of(arc);
    return sum;
  }

 private:
  static double straight_cost(const Configuration& from, const Configuration& to) {
    const double turn = std::abs(std::remainder(to[2] - from[2], 2.0 * M_PI));
    return std::hypot(to[0] - from[0], to[1] - from[1]) + SPOT_TURN_COST * turn;
  }

  static std::vector<Arc> turn_and_drive(double yaw, double ahead, double length, double last_yaw) {
    const double first = std::remainder(ahead - yaw, 2.0 * M_PI);
    return {{0.0, first}, {length, 0.0}, {0.0, std::remainder(last_yaw - yaw - first, 2.0 * M_PI)}};
  }

  // OMPL's names before and after 2.0.
  template <typename Space>
  static auto find_path(const Space& space, const ompl::base::State* from, const ompl::base::State* to)
      -> decltype(space.getPath(from, to)) {
    return space.getPath(from, to);
  }
  template <typename Space>
  static auto find_path(const Space& space, const ompl::base::State* from, const ompl::base::State* to)
      -> decltype(space.dubins(from, to)) {
    return space.dubins(from, to);
  }
  template <typename Space>
  static auto find_path(const Space& space, const ompl::base::State* from, const ompl::base::State* to)
      -> decltype(space.reedsShepp(from, to)) {
    return space.reedsShepp(from, to);
  }
  template <typename Type>
  static Type segment(const Type* types, int k) {
    return types[k];
  }
  template <typename Type>
  static Type segment(const std::vector<Type>* types, int k) {
    return (*types)[k];
  }

  /// Return a curve of OMPL as arcs. Its types are left, straight, right, and its lengths are in turning radii.
  template <typename Space>
  std::vector<Arc> read_curve(Space& space, const Configuration& from, const Configuration& to, int straight) const {
    std::array<ompl::base::State*, 2> ends;
    for (ompl::base::State*& end : ends) {
      const Configuration& q = &end == &ends[0] ? from : to;
      end = space.allocState();
      end->template as<ompl::base::SE2StateSpace::StateType>()->setXY(q[0], q[1]);
      end->template as<ompl::base::SE2StateSpace::StateType>()->setYaw(q[2]);
    }
    const auto path = find_path(space, ends[0], ends[1]);
    for (ompl::base::State* end : ends) space.freeState(end);
    std::vector<Arc> arcs;
    for (int k = 0; k < static_cast<int>(std::size(path.length_)); ++k)
      arcs.push_back({radius_ * path.length_[k], (straight - segment(path.type_, k)) * path.length_[k]});
    return arcs;
  }

  double radius_;
  std::shared_ptr<ompl::base::DubinsStateSpace> dubins_;
  std::shared_ptr<ompl::base::ReedsSheppStateSpace> reeds_shepp_;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_DRIVES_HPP
