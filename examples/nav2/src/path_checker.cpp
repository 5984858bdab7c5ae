// A node with the service is_path_valid of Nav2: the footprint is free at every pose and all along between them.
//
//   ros2 run cspace_nav2 path_checker --ros-args -p map:=/maps/office.zarr
#include <cspace/map.hpp>
#include <nav2_msgs/srv/is_path_valid.hpp>
#include <rclcpp/rclcpp.hpp>

#include "cspace_nav2/poses.hpp"

namespace {

using Service = nav2_msgs::srv::IsPathValid;

/// Answer whether the map proves a path free; list the poses from which the next motion is not proven.
void check_path(const cspace::Map& map, const Service::Request& request, Service::Response& response) {
  const auto& poses = request.path.poses;
  response.is_valid = !poses.empty();
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const std::vector<double> q = cspace_nav2::configuration_of(map, poses[k].pose);
    const std::vector<double> next = cspace_nav2::configuration_of(map, poses[std::min(k + 1, poses.size() - 1)].pose);
    if (map.is_usable(q.data()) && map.is_usable(next.data()) && map.motion_is_free(q, next)) continue;
    response.is_valid = false;
    response.invalid_pose_indices.push_back(static_cast<std::int32_t>(k));
  }
}

}  // namespace

int main(int count, char** arguments) {
  rclcpp::init(count, arguments);
  const auto node = std::make_shared<rclcpp::Node>("path_checker");
  const auto map = std::make_shared<const cspace::Map>(cspace::Map::open(node->declare_parameter<std::string>("map", "")));
  cspace_nav2::check_plane(*map);
  const auto service = node->create_service<Service>(
      "is_path_valid", [map](const std::shared_ptr<Service::Request> request, std::shared_ptr<Service::Response> response) {
        check_path(*map, *request, *response);
      });
  rclcpp::spin(node);
  rclcpp::shutdown();
  return 0;
}
