// Stub of nav2_core/planner_exceptions.hpp.
#ifndef NAV2_CORE_EXCEPTIONS_STUB_HPP
#define NAV2_CORE_EXCEPTIONS_STUB_HPP

#include <stdexcept>

namespace nav2_core {
class NoValidPathCouldBeFound : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};
}  // namespace nav2_core

#endif
