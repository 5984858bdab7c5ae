// Stub of sensor_msgs/msg/point_cloud2.hpp.
#ifndef SENSOR_MSGS_POINT_CLOUD2_STUB_HPP
#define SENSOR_MSGS_POINT_CLOUD2_STUB_HPP

#include <memory>
#include <vector>

#include <geometry_msgs/msg/pose.hpp>

namespace sensor_msgs::msg {
struct PointField {
  static constexpr std::uint8_t FLOAT32 = 7, FLOAT64 = 8;
  std::string name;
  std::uint32_t offset = 0;
  std::uint8_t datatype = 0;
};
struct PointCloud2 {
  using ConstSharedPtr = std::shared_ptr<const PointCloud2>;
  std_msgs::msg::Header header;
  std::uint32_t height = 0, width = 0;
  std::vector<PointField> fields;
  bool is_bigendian = false;
  std::uint32_t point_step = 0, row_step = 0;
  std::vector<std::uint8_t> data;
};
}  // namespace sensor_msgs::msg

#endif
