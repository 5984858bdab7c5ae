// Stub of nav2_core/planner_exceptions.hpp.
#ifndef NAV2_CORE_EXCEPTIONS_STUB_HPP
#define NAV2_CORE_EXCEPTIONS_STUB_HPP

#include <stdexcept>
#include <string>

namespace nav2_core {

class PlannerException : public std::runtime_error {
 public:
  explicit PlannerException(const std::string& description) : std::runtime_error(description) {}
};

#define STUB_EXCEPTION(Name)                                                         \
  class Name : public PlannerException {                                             \
   public:                                                                           \
    explicit Name(const std::string& description) : PlannerException(description) {} \
  }
STUB_EXCEPTION(PlannerTFError);
STUB_EXCEPTION(StartOutsideMapBounds);
STUB_EXCEPTION(GoalOutsideMapBounds);
STUB_EXCEPTION(StartOccupied);
STUB_EXCEPTION(GoalOccupied);
STUB_EXCEPTION(PlannerTimedOut);
STUB_EXCEPTION(NoValidPathCouldBeFound);
STUB_EXCEPTION(PlannerCancelled);
#undef STUB_EXCEPTION

}  // namespace nav2_core

#endif
