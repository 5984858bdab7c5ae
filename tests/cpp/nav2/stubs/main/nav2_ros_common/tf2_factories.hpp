// Stub of nav2_ros_common/tf2_factories.hpp.
#ifndef NAV2_TF2_FACTORIES_STUB_HPP
#define NAV2_TF2_FACTORIES_STUB_HPP

#include <memory>

namespace tf2_ros {
class Buffer {
 public:
  using SharedPtr = std::shared_ptr<Buffer>;
};
}  // namespace tf2_ros

namespace nav2 {
using TransformBuffer = tf2_ros::Buffer;
}

#endif
