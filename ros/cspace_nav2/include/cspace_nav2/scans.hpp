/// @file scans.hpp
/// Messages of lasers and cameras as scans of a watch.
#ifndef CSPACE_NAV2_SCANS_HPP
#define CSPACE_NAV2_SCANS_HPP

#include <cstring>

#include <sensor_msgs/msg/laser_scan.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>

#include "cspace_nav2/watch.hpp"

namespace cspace_nav2 {

/// Metres from a sensor beyond which no point can matter before the next scan.
constexpr double MAX_RANGE = 30.0;

/// Largest angle of a ray, radians; those of a laser that sends degrees are larger.
constexpr double MAX_TURN = 20.0;

/// Longest sweep of a laser, seconds.
constexpr double MAX_SWEEP = 1.0;

template <typename Stamp>
Time time_of(const Stamp& stamp) {
  return 1000000000 * Time{stamp.sec} + Time{stamp.nanosec};
}

/// Return the points of a laser. A ray of minus infinity met something too near to measure.
/// @throws std::runtime_error  if no ray is measured, or the message contradicts itself
inline Scan read_scan(const sensor_msgs::msg::LaserScan& msg) {
  const double step = msg.angle_increment;
  const double turn = std::abs(msg.angle_min) + std::abs(step) * static_cast<double>(msg.ranges.size());
  if (!(turn <= MAX_TURN) || (step == 0.0 && msg.ranges.size() > 1))
    throw std::runtime_error("the angles of a scan are none");
  if (!(msg.range_min >= 0.0f && msg.range_min < msg.range_max && std::isfinite(msg.range_min)))
    throw std::runtime_error("the ranges of a scan are none: from " + std::to_string(msg.range_min) + " to " +
                             std::to_string(msg.range_max) + " m");
  const double last = std::max<double>(static_cast<double>(msg.ranges.size()) - 1.0, 1.0), sweep = last * msg.time_increment;
  if (!(sweep >= 0.0 && sweep <= MAX_SWEEP)) throw std::runtime_error("the times of a scan are none");
  Scan scan{msg.header.frame_id, time_of(msg.header.stamp), {}, true, to_time(sweep)};
  bool is_measured = false;
  for (std::size_t k = 0; k < msg.ranges.size(); ++k) {
    const float least = msg.range_min;
    const float range = msg.ranges[k] == -std::numeric_limits<float>::infinity() ? least : msg.ranges[k];
    if (!(range >= least)) continue;  // not a number, or an invalid one
    is_measured = is_measured || range == msg.ranges[k];
    if (range > msg.range_max || range > MAX_RANGE) continue;
    const double angle = msg.angle_min + step * static_cast<double>(k);
    scan.points.push_back({{range * std::cos(angle), range * std::sin(angle), 0.0}, static_cast<double>(k) / last});
  }
  if (!is_measured) throw std::runtime_error("a scan has no ray that was measured");
  return scan;
}

/// Return where a coordinate begins in each point of a cloud, and whether it is a double.
inline std::pair<std::size_t, bool> find_field(const sensor_msgs::msg::PointCloud2& msg, const std::string& name) {
  for (const auto& field : msg.fields) {
    const bool is_double = field.datatype == sensor_msgs::msg::PointField::FLOAT64;
    if (field.name != name || (!is_double && field.datatype != sensor_msgs::msg::PointField::FLOAT32)) continue;
    if (std::size_t{field.offset} + (is_double ? 8 : 4) <= msg.point_step) return {field.offset, is_double};
  }
  throw std::runtime_error("a cloud has no field " + name + " of floats");
}

/// Return the points of a cloud that are finite.
/// @throws std::runtime_error  if there is none, or the message contradicts itself
inline Scan read_cloud(const sensor_msgs::msg::PointCloud2& msg) {
  const std::pair<std::size_t, bool> fields[] = {find_field(msg, "x"), find_field(msg, "y"), find_field(msg, "z")};
  const bool is_short = std::size_t{msg.row_step} * msg.height > msg.data.size() ||
                        std::size_t{msg.point_step} * msg.width > msg.row_step;
  if (msg.is_bigendian || is_short) throw std::runtime_error("a cloud is shorter than it says, or big-endian");
  Scan scan{msg.header.frame_id, time_of(msg.header.stamp), {}};
  bool is_measured = false;
  for (std::size_t row = 0; row < msg.height; ++row)
    for (std::size_t column = 0; column < msg.width; ++column) {
      double point[3];
      for (int axis = 0; axis < 3; ++axis) {
        const unsigned char* bytes = &msg.data[row * msg.row_step + column * msg.point_step + fields[axis].first];
        float single = 0.0f;
        std::memcpy(&single, bytes, sizeof single);
        point[axis] = single;
        if (fields[axis].second) std::memcpy(&point[axis], bytes, sizeof point[axis]);
      }
      const double range = std::hypot(point[0], point[1], point[2]);
      is_measured = is_measured || std::isfinite(range);
      if (range <= MAX_RANGE) scan.points.push_back({{point[0], point[1], point[2]}, 0.0});
    }
  if (!is_measured) throw std::runtime_error("a cloud has no point");
  return scan;
}

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_SCANS_HPP
