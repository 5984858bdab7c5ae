// The gate node over stubs, which answers lines of its input.
//
//   set NAME VALUE        a parameter, before the node starts; items of a list are separated by "|"
//   start                 starts it
//   configure, activate, deactivate, cleanup, shutdown   print "success" or "failure"
//   param NAME VALUE      sets a parameter while the node runs; prints why it is refused, and "."
//   rules                 prints each parameter, its range and its description
//   place X Y             of the robot in the map
//   command V OMEGA       or "stamped V OMEGA AGE", seconds, or "sideways SIDE V"
//   rival NAMES...        nodes that publish cmd_vel
//   scan FRAME RANGES...  of now
//   cloud TOPIC X Y Z     a point, of now, in the laser's frame
//   grid FRAME COLUMN [LEFT [SIDE [W]]]  the map's topic: a room of 60 x 40 cells of 0.1 m, with a wall in a column; none in
//                         column 0; the grid begins LEFT cells before the room, its cells have another SIDE, its quaternion W
//   cycle                 fires the timer, after 0.05 s of the clock of stamps; prints what is published, and "."
//   end                   sends SIGTERM
#include <algorithm>
#include <iomanip>
#include <iostream>

#include <geometry_msgs/msg/twist_stamped.hpp>

template <typename Message>
void stub_publish(const Message& message) {
  if constexpr (std::is_same_v<Message, geometry_msgs::msg::TwistStamped>) {
    std::cout << "stamped " << message.header.stamp.sec << " " << message.header.frame_id << " ";
    stub_publish(message.twist);
  } else {
    std::cout << "twist " << message.linear.x << " " << message.angular.z;
    if (message.linear.y != 0.0) std::cout << " " << message.linear.y;
    std::cout << std::endl;
  }
}

namespace rclcpp_lifecycle {
class LifecycleNode;
}
void stub_spin_once(rclcpp_lifecycle::LifecycleNode& node);

#define main gate_node_main
#include "../../../ros/cspace_nav2/src/gate_node.cpp"
#undef main

namespace {

using geometry_msgs::msg::Twist;
using geometry_msgs::msg::TwistStamped;
using rclcpp_lifecycle::LifecycleNode;
using sensor_msgs::msg::LaserScan;
using sensor_msgs::msg::PointCloud2;

template <typename Message>
void deliver(const Message& message, const std::string& topic) {
  const auto& callbacks = rclcpp_lifecycle::stub_callbacks<Message>();
  if (callbacks.count(topic) == 0) throw std::runtime_error("nobody hears " + topic);
  callbacks.at(topic)(std::make_shared<const Message>(message));
}

void print_rules() {
  for (const auto& [name, rule] : rclcpp::Node::stub_rules()) {
    std::cout << name;
    for (const auto& range : rule.floating_point_range) std::cout << " [" << range.from_value << ", " << range.to_value << "]";
    std::cout << ": " << rule.description << "\n";
  }
  std::cout << "." << std::endl;
}

void send_grid(std::istream& line) {
  const auto grid = std::make_shared<nav_msgs::msg::OccupancyGrid>();
  int wall = 0;
  double left = 0.0, side = 0.1, w = 1.0;
  line >> std::quoted(grid->header.frame_id) >> wall;
  if (double number = 0.0; line >> number) left = number;
  if (double number = 0.0; line >> number) side = number;
  if (double number = 0.0; line >> number) w = number;
  const int before = static_cast<int>(left), width = 60 + before;
  grid->info.width = static_cast<std::uint32_t>(width);
  grid->info.height = 40;
  grid->info.resolution = static_cast<float>(side);
  grid->info.origin.position.x = -side * left;
  grid->info.origin.orientation.w = w;
  for (int k = 0; k < 40 * width; ++k) {
    const int column = k % width - before, row = k / width;
    grid->data.push_back(column == wall || column % 59 == 0 || row % 39 == 0 ? 100 : 0);
  }
  const auto& callbacks = rclcpp::StubTopic<nav_msgs::msg::OccupancyGrid>::callbacks();
  if (const auto kept = callbacks.at("map").lock()) (*kept)(grid);
}

void send_cloud(std::istream& line) {
  PointCloud2 cloud;
  std::string topic;
  line >> topic;
  cloud.header.frame_id = "laser";
  cloud.header.stamp = rclcpp::Clock().now();
  for (const std::string name : {"x", "y", "z"}) {
    float number = 0.0f;
    line >> number;
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(&number);
    cloud.fields.emplace_back();
    cloud.fields.back().name = name;
    cloud.fields.back().offset = static_cast<std::uint32_t>(cloud.data.size());
    cloud.fields.back().datatype = sensor_msgs::msg::PointField::FLOAT32;
    cloud.data.insert(cloud.data.end(), bytes, bytes + sizeof number);
  }
  cloud.height = cloud.width = 1;
  cloud.point_step = cloud.row_step = static_cast<std::uint32_t>(cloud.data.size());
  deliver(cloud, topic);
}

Twist read_twist(std::istream& line) {
  std::string v, omega;
  line >> v >> omega;
  Twist twist;
  twist.linear.x = std::stod(v);
  twist.angular.z = std::stod(omega);
  return twist;
}

}  // namespace

void stub_spin_once(LifecycleNode& node) {
  using Step = LifecycleNode::CallbackReturn (LifecycleNode::*)(const rclcpp_lifecycle::State&);
  const std::map<std::string, Step> steps = {{"configure", &LifecycleNode::on_configure},
                                             {"activate", &LifecycleNode::on_activate},
                                             {"deactivate", &LifecycleNode::on_deactivate},
                                             {"cleanup", &LifecycleNode::on_cleanup},
                                             {"shutdown", &LifecycleNode::on_shutdown}};
  std::string text, command;
  if (!std::getline(std::cin, text)) std::raise(SIGTERM);
  std::istringstream line(text);
  line >> command;
  if (steps.count(command) > 0) {
    const auto done = (node.*steps.at(command))({});
    std::cout << (done == LifecycleNode::CallbackReturn::SUCCESS ? "success" : "failure") << std::endl;
  }
  if (command == "rules") print_rules();
  if (command == "param") {
    std::string name, value;
    std::getline(line >> name >> std::ws, value);
    std::replace(value.begin(), value.end(), '|', '\n');
    std::cout << node.stub_set(name, value) << "." << std::endl;
  }
  if (command == "place") line >> tf2_ros::Buffer::stub_place().x >> tf2_ros::Buffer::stub_place().y;
  if (command == "rival") {
    rclcpp::Node::stub_publishers().clear();
    for (std::string name; line >> name;) rclcpp::Node::stub_publishers().emplace_back(name);
  }
  if (command == "sideways") {
    std::string side, v;
    line >> side >> v;
    Twist twist;
    twist.linear.y = std::stod(side);
    twist.linear.x = std::stod(v);
    deliver(twist, "cmd_vel_smoothed");
  }
  if (command == "command") deliver(read_twist(line), "cmd_vel_smoothed");
  if (command == "stamped") {
    TwistStamped message;
    double age = 0.0;
    message.twist = read_twist(line);
    line >> age;
    message.header.stamp = rclcpp::Time(rclcpp::stub_nanoseconds() - static_cast<std::int64_t>(1e9 * age));
    deliver(message, "cmd_vel_smoothed");
  }
  if (command == "scan") {
    LaserScan scan;
    line >> scan.header.frame_id;
    scan.header.stamp = rclcpp::Clock().now();
    scan.range_max = 20.0f;
    scan.angle_increment = 0.01f;
    for (std::string range; line >> range;) scan.ranges.push_back(std::stof(range));
    deliver(scan, "scan");
  }
  if (command == "cloud") send_cloud(line);
  if (command == "grid") send_grid(line);
  if (command == "cycle") {
    rclcpp::stub_nanoseconds() += 50000000;
    rclcpp::TimerBase::stub_callback()();
    std::cout << "." << std::endl;
  }
  if (command == "end") std::raise(SIGTERM);
}

int main(int count, char** arguments) {
  rclcpp::stub_nanoseconds() = 1700000000000000000;
  for (std::string text, word, name, value; std::getline(std::cin, text) && text != "start";) {
    std::istringstream line(text);
    line >> word >> name;
    value.clear();
    std::getline(line >> std::ws, value);
    std::replace(value.begin(), value.end(), '|', '\n');
    rclcpp::stub_parameters()[name] = value;
  }
  return gate_node_main(count, arguments);
}
