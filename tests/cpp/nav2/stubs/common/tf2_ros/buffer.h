// Stub of tf2_ros/buffer.h: a robot that stands in the map, with a laser at a height of 0.25 m.
#ifndef TF2_ROS_BUFFER_STUB_HPP
#define TF2_ROS_BUFFER_STUB_HPP

#include <chrono>
#include <memory>
#include <stdexcept>
#include <string>

#include <geometry_msgs/msg/twist_stamped.hpp>
#include <rclcpp/rclcpp.hpp>

namespace geometry_msgs::msg {
struct Transform {
  Vector3 translation;
  Quaternion rotation;
};
struct TransformStamped {
  std_msgs::msg::Header header;
  Transform transform;
};
}  // namespace geometry_msgs::msg

namespace tf2 {
using TimePoint = std::chrono::time_point<std::chrono::system_clock, std::chrono::nanoseconds>;

class TransformException : public std::runtime_error {
  using std::runtime_error::runtime_error;
};
class LookupException : public TransformException {
  using TransformException::TransformException;
};
class ExtrapolationException : public TransformException {
  using TransformException::TransformException;
};
}  // namespace tf2

namespace tf2_ros {
class Buffer {
 public:
  using SharedPtr = std::shared_ptr<Buffer>;
  explicit Buffer(rclcpp::Clock::SharedPtr) {}

  static geometry_msgs::msg::Vector3& stub_place() {
    static geometry_msgs::msg::Vector3 place;
    return place;
  }

  geometry_msgs::msg::TransformStamped lookupTransform(const std::string&, const std::string& source_frame,
                                                       const tf2::TimePoint& time) const {
    geometry_msgs::msg::TransformStamped found;
    const std::int64_t stamp = time.time_since_epoch().count(), now = rclcpp::Clock().now().nanoseconds();
    if (stamp > now) throw tf2::ExtrapolationException("extrapolation into the future");
    found.header.stamp = rclcpp::Time(stamp == 0 ? now : stamp);
    if (source_frame != "odom" && source_frame != "base_link" && source_frame != "laser")
      throw tf2::LookupException('"' + source_frame + "\" does not exist");
    if (source_frame != "odom") found.transform.translation = stub_place();
    if (source_frame == "laser") found.transform.translation.z = 0.25;
    return found;
  }
};
}  // namespace tf2_ros

#endif
