// Stub of sensor_msgs/msg/laser_scan.hpp.
#ifndef SENSOR_MSGS_LASER_SCAN_STUB_HPP
#define SENSOR_MSGS_LASER_SCAN_STUB_HPP

#include <memory>
#include <vector>

#include <geometry_msgs/msg/pose.hpp>

namespace sensor_msgs::msg {
struct LaserScan {
  using ConstSharedPtr = std::shared_ptr<const LaserScan>;
  std_msgs::msg::Header header;
  float angle_min = 0.0f, angle_increment = 0.0f;
  float time_increment = 0.0f;
  float range_min = 0.0f, range_max = 0.0f;
  std::vector<float> ranges;
};
}  // namespace sensor_msgs::msg

#endif
