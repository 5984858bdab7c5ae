/// @file ompl.hpp
/// A saved map for the planners of OMPL (1.5 or later): state space, validity checker and motion validator.
///
///     auto map = std::make_shared<const cspace::Map>(cspace::Map::open("map.zarr"));
///     ompl::geometric::SimpleSetup setup(cspace::state_space(*map));
///     cspace::set_checkers(setup, map);
///
/// An edge is valid if the map proves the whole motion free, so no resolution is set, and a path is certified as it is.
#ifndef CSPACE_OMPL_HPP
#define CSPACE_OMPL_HPP

#include <ompl/base/MotionValidator.h>
#include <ompl/base/ProjectionEvaluator.h>
#include <ompl/base/SpaceInformation.h>
#include <ompl/base/StateValidityChecker.h>
#include <ompl/base/spaces/RealVectorStateSpace.h>
#include <ompl/base/spaces/SE2StateSpace.h>
#include <ompl/base/spaces/SE3StateSpace.h>
#include <ompl/base/spaces/SO2StateSpace.h>
#include <ompl/geometric/SimpleSetup.h>

#include <cspace/map.hpp>

namespace cspace {

/// Return the bounds of positions of a map, its grid.
inline ompl::base::RealVectorBounds position_bounds(const Map& map) {
  ompl::base::RealVectorBounds bounds(static_cast<unsigned int>(map.dim()));
  bounds.low = map.lower();
  bounds.high = map.upper();
  return bounds;
}

/// Make the state space of a map: a vector, SE(2), a vector and SO(2), or SE(3); a radian counts as half a metre.
inline ompl::base::StateSpacePtr state_space(const Map& map) {
  namespace ob = ompl::base;
  const ob::RealVectorBounds bounds = position_bounds(map);
  const std::size_t turns = map.size() - map.dim();
  if (turns == 4) {
    const auto space = std::make_shared<ob::SE3StateSpace>();
    space->setBounds(bounds);
    return space;
  }
  if (turns == 1 && map.dim() == 2) {
    const auto space = std::make_shared<ob::SE2StateSpace>();
    space->setBounds(bounds);
    return space;
  }
  const auto positions = std::make_shared<ob::RealVectorStateSpace>(static_cast<unsigned int>(map.dim()));
  positions->setBounds(bounds);
  if (turns == 0) return positions;
  const auto space = std::make_shared<ob::CompoundStateSpace>();
  space->addSubspace(positions, 1.0);
  space->addSubspace(std::make_shared<ob::SO2StateSpace>(), 0.5);
  space->lock();
  // As SE(2) and SE(3) do, planners with cells (KPIECE, EST, STRIDE) look at the position alone.
  space->registerDefaultProjection(std::make_shared<ob::SubspaceProjectionEvaluator>(space.get(), 0));
  return space;
}

/// Return the numbers of a state of `state_space(map)`.
inline std::array<double, 7> numbers_of(const Map& map, const ompl::base::State* state) {
  namespace ob = ompl::base;
  std::array<double, 7> q{};
  const std::size_t turns = map.size() - map.dim();
  if (turns == 4) {
    const auto* pose = state->as<ob::SE3StateSpace::StateType>();
    const auto& turn = pose->rotation();
    q = {pose->getX(), pose->getY(), pose->getZ(), turn.x, turn.y, turn.z, turn.w};
  } else if (turns == 1 && map.dim() == 2) {
    const auto* pose = state->as<ob::SE2StateSpace::StateType>();
    q = {pose->getX(), pose->getY(), pose->getYaw()};
  } else {
    const ob::State* position = turns == 0 ? state : state->as<ob::CompoundState>()->components[0];
    std::copy_n(position->as<ob::RealVectorStateSpace::StateType>()->values, map.dim(), q.begin());
    if (turns == 1) q[map.dim()] = state->as<ob::CompoundState>()->as<ob::SO2StateSpace::StateType>(1)->value;
  }
  return q;
}

/// Write the numbers of a configuration into a state of `state_space(map)`.
inline void write_state(const Map& map, const std::vector<double>& q, ompl::base::State* state) {
  namespace ob = ompl::base;
  const std::size_t turns = map.size() - map.dim();
  if (q.size() != map.size()) throw InputError("cspace: a configuration has " + std::to_string(map.size()) + " numbers");
  if (turns == 4) {
    auto* pose = state->as<ob::SE3StateSpace::StateType>();
    pose->setXYZ(q[0], q[1], q[2]);
    auto& turn = pose->rotation();
    turn.x = q[3];
    turn.y = q[4];
    turn.z = q[5];
    turn.w = q[6];
  } else if (turns == 1 && map.dim() == 2) {
    state->as<ob::SE2StateSpace::StateType>()->setXY(q[0], q[1]);
    state->as<ob::SE2StateSpace::StateType>()->setYaw(q[2]);
  } else {
    ob::State* position = turns == 0 ? state : state->as<ob::CompoundState>()->components[0];
    std::copy_n(q.begin(), map.dim(), position->as<ob::RealVectorStateSpace::StateType>()->values);
    if (turns == 1) state->as<ob::CompoundState>()->as<ob::SO2StateSpace::StateType>(1)->value = q[map.dim()];
  }
}

/// States are valid if the map proves them free.
class StateValidityChecker : public ompl::base::StateValidityChecker {
 public:
  StateValidityChecker(const ompl::base::SpaceInformationPtr& si, std::shared_ptr<const Map> map)
      : ompl::base::StateValidityChecker(si), map_(std::move(map)) {
    specs_.clearanceComputationType = map_->has_clearance() ? ompl::base::StateValidityCheckerSpecs::BOUNDED_APPROXIMATE
                                                            : ompl::base::StateValidityCheckerSpecs::NONE;
  }

  bool isValid(const ompl::base::State* state) const override {
    const std::array<double, 7> q = numbers_of(*map_, state);
    return map_->is_usable(q.data()) && map_->is_free(q.data());
  }

  /// Return a lower bound of the distance to states that are not valid, at this rotation; 0 if the map has none stored.
  double clearance(const ompl::base::State* state) const override {
    const std::array<double, 7> q = numbers_of(*map_, state);
    return map_->has_clearance() && map_->is_usable(q.data()) ? map_->clearance(q.data()) : 0.0;
  }

 private:
  std::shared_ptr<const Map> map_;
};

/// Motions are valid if the map proves them free along their whole length.
class MotionValidator : public ompl::base::MotionValidator {
 public:
  MotionValidator(const ompl::base::SpaceInformationPtr& si, std::shared_ptr<const Map> map)
      : ompl::base::MotionValidator(si), map_(std::move(map)) {}

  bool checkMotion(const ompl::base::State* s1, const ompl::base::State* s2) const override {
    const bool is_valid = is_free(s1, s2);
    ++(is_valid ? valid_ : invalid_);
    return is_valid;
  }

  /// Also find how far the motion is proven free: bisection to 2^-20 of it.
  bool checkMotion(const ompl::base::State* s1, const ompl::base::State* s2,
                   std::pair<ompl::base::State*, double>& lastValid) const override {
    if (checkMotion(s1, s2)) return true;
    double proven = 0.0, unproven = 1.0;
    ompl::base::State* middle = si_->allocState();
    for (int step = 0; step < 20; ++step) {
      const double t = 0.5 * (proven + unproven);
      si_->getStateSpace()->interpolate(s1, s2, t, middle);
      (is_free(s1, middle) ? proven : unproven) = t;
    }
    si_->freeState(middle);
    lastValid.second = proven;
    if (lastValid.first != nullptr) si_->getStateSpace()->interpolate(s1, s2, proven, lastValid.first);
    return false;
  }

 protected:
  /// Return true if a motion is valid; a subclass may ask for more.
  virtual bool is_free(const ompl::base::State* s1, const ompl::base::State* s2) const {
    const std::array<double, 7> q0 = numbers_of(*map_, s1), q1 = numbers_of(*map_, s2);
    return map_->is_usable(q0.data()) && map_->is_usable(q1.data()) && map_->motion_is_free(q0.data(), q1.data());
  }

 private:
  std::shared_ptr<const Map> map_;
};

/// Give a setup over `state_space(*map)` both checkers.
inline void set_checkers(ompl::geometric::SimpleSetup& setup, const std::shared_ptr<const Map>& map) {
  const ompl::base::SpaceInformationPtr& si = setup.getSpaceInformation();
  setup.setStateValidityChecker(std::make_shared<StateValidityChecker>(si, map));
  si->setMotionValidator(std::make_shared<MotionValidator>(si, map));
}

}  // namespace cspace

#endif  // CSPACE_OMPL_HPP
