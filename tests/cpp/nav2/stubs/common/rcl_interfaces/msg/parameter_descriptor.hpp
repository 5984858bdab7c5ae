// Stub of rcl_interfaces/msg/parameter_descriptor.hpp.
#ifndef RCL_INTERFACES_STUB_HPP
#define RCL_INTERFACES_STUB_HPP

namespace rcl_interfaces::msg {
struct ParameterDescriptor {
  bool read_only = false;
};
}  // namespace rcl_interfaces::msg

#endif
