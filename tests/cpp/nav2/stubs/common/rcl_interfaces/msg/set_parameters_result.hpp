// Stub of rcl_interfaces/msg/set_parameters_result.hpp.
#ifndef RCL_INTERFACES_RESULT_STUB_HPP
#define RCL_INTERFACES_RESULT_STUB_HPP

#include <string>

namespace rcl_interfaces::msg {
struct SetParametersResult {
  bool successful = false;
  std::string reason;
};
}  // namespace rcl_interfaces::msg

#endif
