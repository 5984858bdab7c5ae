// Plan between two poses with the plugin, and ask the checker about the path, as Nav2 would: try MAP X Y YAW X Y YAW.
//
// It prints the poses of the path, then "valid" or the numbers of invalid poses: of the path, and of the straight motion.
#define main path_checker_main
#include "../src/path_checker.cpp"
#undef main

#include <iomanip>
#include <iostream>

#include <nav2_core/global_planner.hpp>

std::shared_ptr<nav2_core::GlobalPlanner> stub_plugin();

namespace {

geometry_msgs::msg::PoseStamped pose_of(char** numbers) {
  geometry_msgs::msg::PoseStamped pose;
  pose.header.frame_id = "map";
  pose.pose.position.x = std::stod(numbers[0]);
  pose.pose.position.y = std::stod(numbers[1]);
  pose.pose.orientation.z = std::sin(std::stod(numbers[2]) / 2.0);
  pose.pose.orientation.w = std::cos(std::stod(numbers[2]) / 2.0);
  return pose;
}

void ask(const nav_msgs::msg::Path& path) {
  const auto request = std::make_shared<Service::Request>();
  const auto response = std::make_shared<Service::Response>();
  request->path = path;
  rclcpp::StubService<Service>::callback()(request, response);
  if (response->is_valid) std::cout << "valid";
  for (const std::int32_t k : response->invalid_pose_indices) std::cout << k << " ";
  std::cout << "\n";
}

}  // namespace

int main(int, char** arguments) {
  rclcpp::stub_parameters() = {{"map", arguments[1]}, {"plan.map", arguments[1]}};
  const auto node = std::make_shared<rclcpp_lifecycle::LifecycleNode>("planner_server");
  const auto planner = stub_plugin();
  planner->configure(node, "plan", nullptr, nullptr);
  const auto start = pose_of(arguments + 2), goal = pose_of(arguments + 5);
  const nav_msgs::msg::Path path = planner->createPlan(start, goal, [] { return false; });
  std::cout << std::setprecision(17);
  for (const auto& pose : path.poses)
    std::cout << pose.pose.position.x << " " << pose.pose.position.y << " " << cspace_nav2::yaw_of(pose.pose) << "\n";
  nav_msgs::msg::Path straight;
  straight.poses = {start, goal};
  rclcpp::stub_spin() = [&] {
    ask(path);
    ask(straight);
  };
  return path_checker_main(0, nullptr);
}
