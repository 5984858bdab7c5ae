// A node with Nav2's service is_path_valid: the saved map proves the footprint free along the whole path. It does not
// look at the costmap, which the service of the same name of planner_server does.
//
//   ros2 run cspace_nav2 path_checker --ros-args -p map:=/maps/office.zarr
//   ros2 service call /path_checker/is_path_valid nav2_msgs/srv/IsPathValid "{path: ...}"
#include <nav2_msgs/srv/is_path_valid.hpp>
#include <rclcpp/rclcpp.hpp>

#include <optional>

#include "cspace_nav2/parameters.hpp"
#include "cspace_nav2/poses.hpp"

namespace {

using Service = nav2_msgs::srv::IsPathValid;
using cspace_nav2::Configuration;

/// Say that the answer is one, in messages that have a field for it; Jazzy's does not.
template <typename Response>
auto set_success(Response& response, int) -> decltype(static_cast<void>(response.success = true)) {
  response.success = true;
}
template <typename Response>
void set_success(Response&, long) {}

/// Return a pose of a path as a configuration; nothing if it is in another frame or no pose of the plane.
std::optional<Configuration> read_pose(const cspace::Map& map, const std::string& frame,
                                       const geometry_msgs::msg::PoseStamped& pose) {
  // Nav2's planners leave the frames of poses empty, or repeat that of the path.
  if (!pose.header.frame_id.empty() && pose.header.frame_id != frame) return {};
  try {
    return cspace_nav2::configuration_of(map, pose.pose);
  } catch (const std::invalid_argument&) {
    return {};
  }
}

/// Answer whether the map proves a path free; list the poses from which the next motion is not proven.
void check_path(const cspace::Map& map, const std::string& frame, const nav_msgs::msg::Path& path,
                Service::Response& response) {
  const std::size_t count = path.poses.size();
  response.is_valid = count > 0;
  for (std::size_t k = 0; k < count; ++k) {
    const auto q = read_pose(map, frame, path.poses[k]);
    const auto next = read_pose(map, frame, path.poses[std::min(k + 1, count - 1)]);
    if (q && next && map.motion_is_free(q->data(), next->data())) continue;
    response.is_valid = false;
    response.invalid_pose_indices.push_back(static_cast<std::int32_t>(k));
  }
}

}  // namespace

int main(int count, char** arguments) {
  rclcpp::init(count, arguments);
  const auto node = std::make_shared<rclcpp::Node>("path_checker");
  cspace_nav2::Parameters<rclcpp::Node> parameters(*node);
  const std::string frame = parameters.text("frame", "map", "frame of the map, which paths must have");
  std::shared_ptr<const cspace::Map> map;
  try {
    const std::string folder = parameters.text("map", "", "folder of a map that space.save wrote");
    if (folder.empty()) throw std::invalid_argument("the parameter 'map' is missing; it names the folder that space.save wrote");
    map = cspace_nav2::open_plane_map(folder);
  } catch (const std::exception& error) {
    RCLCPP_FATAL(node->get_logger(), "%s", error.what());
    rclcpp::shutdown();
    return 1;
  }
  const auto service = node->create_service<Service>(
      "~/is_path_valid", [&](const std::shared_ptr<Service::Request> request, std::shared_ptr<Service::Response> response) {
        response->is_valid = false;
        const std::string& found = request->path.header.frame_id;
        if (found != frame) {
          RCLCPP_ERROR(node->get_logger(), "the path is in '%s', not in '%s'", found.c_str(), frame.c_str());
          return;
        }
        check_path(*map, frame, request->path, *response);
        set_success(*response, 0);
      });
  rclcpp::spin(node);
  rclcpp::shutdown();
  return 0;
}
