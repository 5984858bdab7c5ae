// Stub of rcl_interfaces/msg/parameter_descriptor.hpp.
#ifndef RCL_INTERFACES_STUB_HPP
#define RCL_INTERFACES_STUB_HPP

#include <string>
#include <vector>

namespace rcl_interfaces::msg {
struct FloatingPointRange {
  double from_value = 0.0, to_value = 0.0;
};
struct ParameterDescriptor {
  bool read_only = false;
  std::string description;
  std::vector<FloatingPointRange> floating_point_range;
};
}  // namespace rcl_interfaces::msg

#endif
