// Stub of rcl_interfaces/msg/parameter_descriptor.hpp.
#ifndef RCL_INTERFACES_STUB_HPP
#define RCL_INTERFACES_STUB_HPP

#include <cstdint>
#include <string>
#include <vector>

namespace rcl_interfaces::msg {
struct FloatingPointRange {
  double from_value = 0.0, to_value = 0.0, step = 0.0;
};
struct IntegerRange {
  std::int64_t from_value = 0, to_value = 0;
  std::uint64_t step = 0;
};
struct ParameterDescriptor {
  std::string description;
  bool read_only = false;
  std::vector<FloatingPointRange> floating_point_range;
  std::vector<IntegerRange> integer_range;
};
}  // namespace rcl_interfaces::msg

#endif
