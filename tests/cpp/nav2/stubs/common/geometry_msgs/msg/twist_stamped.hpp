// Stub of geometry_msgs/msg/twist_stamped.hpp and twist.hpp.
#ifndef GEOMETRY_MSGS_TWIST_STUB_HPP
#define GEOMETRY_MSGS_TWIST_STUB_HPP

#include <memory>

#include <geometry_msgs/msg/pose.hpp>

namespace geometry_msgs::msg {
struct Vector3 {
  double x = 0.0, y = 0.0, z = 0.0;
};
struct Twist {
  using ConstSharedPtr = std::shared_ptr<const Twist>;
  Vector3 linear, angular;
};
struct TwistStamped {
  using ConstSharedPtr = std::shared_ptr<const TwistStamped>;
  std_msgs::msg::Header header;
  Twist twist;
};
}  // namespace geometry_msgs::msg

#endif
