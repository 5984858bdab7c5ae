// Stub of tf2_ros/transform_listener.h.
#ifndef TF2_ROS_LISTENER_STUB_HPP
#define TF2_ROS_LISTENER_STUB_HPP

#include <tf2_ros/buffer.h>

namespace tf2_ros {
class TransformListener {
 public:
  explicit TransformListener(Buffer&) {}
};
}  // namespace tf2_ros

#endif
