// A lifecycle node between `cmd_vel_smoothed` and `cmd_vel`: what it lets through is proven free, with a stop, on a saved
// map and among the points that its sensors see. It brakes, and says why, if anything is missing, late or wrong.
//
//   ros2 run cspace_nav2 gate_node --ros-args -p map:=/maps/office.zarr
//   ros2 lifecycle set /cspace_gate configure; ros2 lifecycle set /cspace_gate activate
#include <chrono>
#include <csignal>
#include <thread>

#include <geometry_msgs/msg/twist_stamped.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp_lifecycle/lifecycle_node.hpp>
#if __has_include(<tf2_ros/buffer.hpp>)
#include <tf2_ros/buffer.hpp>
#include <tf2_ros/transform_listener.hpp>
#else  // before Kilted
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_listener.h>
#endif

#include "cspace_nav2/footprint.hpp"
#include "cspace_nav2/scans.hpp"

namespace cspace_nav2 {

using geometry_msgs::msg::TwistStamped;
using sensor_msgs::msg::LaserScan;
using sensor_msgs::msg::PointCloud2;

class GateNode : public rclcpp_lifecycle::LifecycleNode {
 public:
  GateNode() : LifecycleNode("cspace_gate") {
    const std::vector<std::string> none;
    declare("map", std::string(), "Folder of the map of x, y and yaw that space.save wrote.");
    declare("footprint", none, "Convex parts of the robot, such as '[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]]', "
                               "metres. They must be the map's robot, which is taken without them.");
    declare("period", 0.05, "Seconds between two commands.", 0.005, 0.5);
    declare("max_deceleration", std::vector<double>{1.0, 2.0}, "What the brakes reach, m/s^2 and rad/s^2.");
    declare("tracking", std::vector<double>{0.02, 0.02, 0.02}, "How far the robot may stray: x and y, metres, and yaw, radians.");
    declare("point_radius", 0.03, "What is around each point, metres.", 0.0, 1.0);
    declare("max_age", 0.3, "Seconds after which a command, scan, pose or cycle is too old.", 0.01, 5.0);
    declare("max_jump", 0.2, "How far a pose may be from where the commands lead, metres and radians.", 0.0, 10.0);
    declare("max_tilt", 0.1, "Largest tilt of the robot, radians.", 0.0, 0.5);
    declare("min_height", 0.05, "Points below are floor, metres above the base frame.", -10.0, 10.0);
    declare("max_height", 2.0, "Points above do not count, metres above the base frame.", -10.0, 100.0);
    declare("map_frame", std::string("map"), "Frame of the map.");
    declare("odom_frame", std::string("odom"), "Frame in which the robot's place never jumps.");
    declare("base_frame", std::string("base_link"), "Frame of the robot, which is at the origin of its footprint.");
    declare("scans", std::vector<std::string>{"scan"}, "Topics of lasers, each of which must be heard.");
    declare("clouds", none, "Topics of point clouds, each of which must be heard.");
    declare("stamped", false, "True if commands are TwistStamped.");
    declare("leaving", true, "True if the robot may also leave what it is too near to.");
  }

  CallbackReturn on_configure(const rclcpp_lifecycle::State&) override {
    try {
      const WatchOptions options = read_options();
      watch_ = std::make_unique<Watch>(open_gate(options), options);
      buffer_ = std::make_unique<tf2_ros::Buffer>(get_clock());
      listener_ = std::make_unique<tf2_ros::TransformListener>(*buffer_);
    } catch (const std::exception& error) {
      RCLCPP_ERROR(get_logger(), "%s", error.what());
      return CallbackReturn::FAILURE;
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State& state) override {
    for (const std::string& name : get<std::vector<std::string>>("scans")) listen<LaserScan>(name, read_scan);
    for (const std::string& name : get<std::vector<std::string>>("clouds")) listen<PointCloud2>(name, read_cloud);
    if (get<bool>("stamped")) {
      stamped_publisher_ = create_publisher<TwistStamped>("cmd_vel", rclcpp::QoS(1));
      subscriptions_.push_back(create_subscription<TwistStamped>(
          "cmd_vel_smoothed", rclcpp::QoS(1), [this](TwistStamped::ConstSharedPtr msg) { hear_stamped(*msg); }));
    } else {
      publisher_ = create_publisher<Twist>("cmd_vel", rclcpp::QoS(1));
      subscriptions_.push_back(create_subscription<Twist>(
          "cmd_vel_smoothed", rclcpp::QoS(1), [this](Twist::ConstSharedPtr msg) { hear(*msg, find_now()); }));
    }
    LifecycleNode::on_activate(state);
    reason_.clear();
    // Other clocks may stand still or jump.
    timer_ = create_wall_timer(std::chrono::duration<double>(period_), [this] { cycle(); });
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_deactivate(const rclcpp_lifecycle::State& state) override {
    stop();
    subscriptions_.clear();
    LifecycleNode::on_deactivate(state);
    publisher_.reset();
    stamped_publisher_.reset();
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_cleanup(const rclcpp_lifecycle::State&) override {
    listener_.reset();
    buffer_.reset();
    watch_.reset();
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_shutdown(const rclcpp_lifecycle::State& state) override {
    on_deactivate(state);
    return on_cleanup(state);
  }

  /// Bring the robot to rest, if it moves, and send no more commands.
  void stop() {
    if (!timer_) return;
    timer_->cancel();
    timer_.reset();
    for (cspace::Twist twist{1.0, 1.0}; twist.v != 0.0 || twist.omega != 0.0;) {
      twist = watch_->brake();
      publish(twist);
      std::this_thread::sleep_for(std::chrono::duration<double>(period_));
    }
  }

 private:
  using Twist = geometry_msgs::msg::Twist;

  template <typename Value>
  void declare(const std::string& name, const Value& otherwise, const std::string& description) {
    rcl_interfaces::msg::ParameterDescriptor rule;
    rule.description = description + " Read when the node is configured.";
    declare_parameter<Value>(name, otherwise, rule);
  }

  void declare(const std::string& name, double otherwise, const std::string& description, double least, double most) {
    rcl_interfaces::msg::ParameterDescriptor rule;
    rule.description = description + " Read when the node is configured.";
    rule.floating_point_range.resize(1);
    rule.floating_point_range[0].from_value = least;
    rule.floating_point_range[0].to_value = most;
    declare_parameter<double>(name, otherwise, rule);
  }

  template <typename Value>
  Value get(const std::string& name) const {
    return get_parameter(name).get_value<Value>();
  }

  /// Return a number; a range lets through what is none.
  double get_number(const std::string& name) const {
    const double value = get<double>(name);
    if (!std::isfinite(value)) throw std::invalid_argument("the parameter '" + name + "' is not finite");
    return value;
  }

  std::vector<double> get_list(const std::string& name, std::size_t size) const {
    const std::vector<double> list = get<std::vector<double>>(name);
    if (list.size() != size)
      throw std::invalid_argument("the parameter '" + name + "' has " + std::to_string(list.size()) + " numbers; it must have " +
                                  std::to_string(size));
    return list;
  }

  WatchOptions read_options() {
    WatchOptions options;
    period_ = get_number("period");
    options.max_age = get_number("max_age");
    options.max_jump = get_number("max_jump");
    options.max_tilt = get_number("max_tilt");
    options.min_height = get_number("min_height");
    options.max_height = get_number("max_height");
    options.map_frame = get<std::string>("map_frame");
    options.odom_frame = get<std::string>("odom_frame");
    options.base_frame = get<std::string>("base_frame");
    options.leaving = get<bool>("leaving");
    options.sources = get<std::vector<std::string>>("scans");
    for (const std::string& name : get<std::vector<std::string>>("clouds")) options.sources.push_back(name);
    if (options.max_age < period_) throw std::invalid_argument("the parameter 'max_age' is below 'period'");
    if (!(options.min_height < options.max_height))
      throw std::invalid_argument("the parameter 'min_height' must be below 'max_height'");
    if (options.sources.empty()) throw std::invalid_argument("the parameters 'scans' and 'clouds' name no topic");
    return options;
  }

  /// Open the map of the parameters.
  std::shared_ptr<const cspace::Gate> open_gate(const WatchOptions& options) const {
    const std::string path = get<std::string>("map");
    if (path.empty()) throw std::invalid_argument("the parameter 'map' is missing; it names the folder that space.save wrote");
    const auto map = std::make_shared<const cspace::Map>(cspace::Map::open(path));
    if (!map->frame_id().empty() && map->frame_id() != options.map_frame)
      throw std::invalid_argument("the parameter 'map_frame' is '" + options.map_frame + "'; the map is in '" + map->frame_id() + "'");
    if (options.leaving && !map->has_taken_cells())
      throw std::invalid_argument("the parameter 'leaving' needs a map of x, y and yaw in one piece, not in tiles or on a floor");
    const std::vector<double> brakes = get_list("max_deceleration", 2), tracking = get_list("tracking", 3);
    cspace::GateOptions gate;
    gate.dt = period_;
    gate.max_deceleration = {brakes[0], brakes[1]};
    gate.tracking = {tracking[0], tracking[1], tracking[2]};
    gate.point_radius = get_number("point_radius");
    const std::vector<cspace::Core> robot = read_footprint(*map, get<std::vector<std::string>>("footprint"));
    return std::make_shared<const cspace::Gate>(map, robot, gate);
  }

  static Time find_now() { return std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1); }

  template <typename Message>
  void listen(const std::string& name, Scan (*read)(const Message&)) {
    const auto hear_message = [this, name, read](typename Message::ConstSharedPtr msg) {
      try {
        watch_->hear_scan(name, read(*msg));
      } catch (const std::exception& error) {
        watch_->refuse_scan(name, "'" + name + "': " + error.what());
      }
    };
    subscriptions_.push_back(create_subscription<Message>(name, rclcpp::SensorDataQoS(), hear_message));
  }

  void hear(const Twist& msg, Time when) {
    if (std::isfinite(msg.linear.x + msg.angular.z)) return watch_->hear_command({msg.linear.x, msg.angular.z}, when);
    watch_->refuse_command("a command is not finite");
  }

  /// Hear a command with its age; one without a stamp is of now.
  void hear_stamped(const TwistStamped& msg) {
    const Time stamp = time_of(msg.header.stamp), age = stamp == 0 ? 0 : get_clock()->now().nanoseconds() - stamp;
    hear(msg.twist, find_now() - std::abs(age));
  }

  /// Return where tf has a frame; nothing if it does not know it at that time.
  std::optional<Placement> look_up(const std::string& target, const std::string& frame, Time stamp) const {
    try {
      const auto found = buffer_->lookupTransform(target, frame, tf2::TimePoint(std::chrono::nanoseconds(stamp)));
      const auto& at = found.transform.translation;
      const auto& turn = found.transform.rotation;
      return Placement{{at.x, at.y, at.z}, {turn.x, turn.y, turn.z, turn.w}, time_of(found.header.stamp)};
    } catch (const tf2::ExtrapolationException&) {
      return std::nullopt;
    }
  }

  /// Send the next command.
  void cycle() {
    const Decision decision =
        watch_->decide(find_now(), get_clock()->now().nanoseconds(),
                       [this](const auto& target, const auto& frame, Time stamp) { return look_up(target, frame, stamp); });
    publish(decision.command);
    if (decision.reason == reason_) return;
    reason_ = decision.reason;
    if (reason_.empty()) RCLCPP_INFO(get_logger(), "drives");
    if (!reason_.empty()) RCLCPP_WARN(get_logger(), "stops: %s", reason_.c_str());
  }

  void publish(const cspace::Twist& twist) {
    TwistStamped msg;
    msg.header.stamp = get_clock()->now();
    msg.header.frame_id = get<std::string>("base_frame");
    msg.twist.linear.x = twist.v;
    msg.twist.angular.z = twist.omega;
    if (publisher_) publisher_->publish(msg.twist);
    if (stamped_publisher_) stamped_publisher_->publish(msg);
  }

  double period_ = 0.0;
  std::string reason_;
  std::unique_ptr<Watch> watch_;
  std::unique_ptr<tf2_ros::Buffer> buffer_;
  std::unique_ptr<tf2_ros::TransformListener> listener_;
  std::vector<rclcpp::SubscriptionBase::SharedPtr> subscriptions_;
  rclcpp_lifecycle::LifecyclePublisher<Twist>::SharedPtr publisher_;
  rclcpp_lifecycle::LifecyclePublisher<TwistStamped>::SharedPtr stamped_publisher_;
  rclcpp::TimerBase::SharedPtr timer_;
};

}  // namespace cspace_nav2

namespace {

volatile std::sig_atomic_t is_ended = 0;

}  // namespace

int main(int count, char** arguments) {
  // The robot is brought to rest before the node goes, which the handlers of rclcpp would not wait for.
  rclcpp::init(count, arguments, rclcpp::InitOptions(), rclcpp::SignalHandlerOptions::None);
  for (const int number : {SIGINT, SIGTERM}) std::signal(number, [](int) { is_ended = 1; });
  std::shared_ptr<cspace_nav2::GateNode> node;
  try {
    node = std::make_shared<cspace_nav2::GateNode>();
  } catch (const std::exception& error) {
    RCLCPP_FATAL(rclcpp::get_logger("cspace_gate"), "%s", error.what());
    rclcpp::shutdown();
    return 1;
  }
  rclcpp::executors::SingleThreadedExecutor executor;
  executor.add_node(node->get_node_base_interface());
  while (is_ended == 0 && rclcpp::ok()) executor.spin_once(std::chrono::milliseconds(100));
  node->stop();
  rclcpp::shutdown();
  return 0;
}
