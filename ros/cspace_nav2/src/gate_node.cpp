// A lifecycle node between `cmd_vel_smoothed` and `cmd_vel`: what it lets through is proven free, with a stop, on a map and
// among the points that its sensors see. It brakes, and says why, if anything is missing, late or wrong.
//
//   ros2 run cspace_nav2 gate_node --ros-args -p robot:=disc:0.3
//   ros2 lifecycle set /cspace_gate configure; ros2 lifecycle set /cspace_gate activate
#include <chrono>
#include <csignal>
#include <set>
#include <thread>

#include <geometry_msgs/msg/twist_stamped.hpp>
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
#include "cspace_nav2/map_maker.hpp"
#include "cspace_nav2/scans.hpp"

namespace cspace_nav2 {

using geometry_msgs::msg::TwistStamped;
using sensor_msgs::msg::LaserScan;
using sensor_msgs::msg::PointCloud2;

class GateNode : public rclcpp_lifecycle::LifecycleNode {
 public:
  GateNode() : LifecycleNode("cspace_gate") {}

  CallbackReturn on_configure(const rclcpp_lifecycle::State& state) override {
    try {
      read_parameters();
      watch_ = std::make_unique<Watch>([this] { return find_ground(); }, options_);
      buffer_ = std::make_unique<tf2_ros::Buffer>(get_clock());
      listener_ = std::make_unique<tf2_ros::TransformListener>(*buffer_);
    } catch (const std::exception& error) {
      RCLCPP_ERROR(get_logger(), "%s", error.what());
      on_cleanup(state);
      return CallbackReturn::FAILURE;
    }
    return CallbackReturn::SUCCESS;
  }

  CallbackReturn on_activate(const rclcpp_lifecycle::State& state) override {
    if (const std::string rival = find_rival(); !rival.empty()) {
      RCLCPP_ERROR(get_logger(), "%s", rival.c_str());
      return CallbackReturn::FAILURE;
    }
    for (const std::string& name : scans_) listen<LaserScan>(name, read_scan);
    for (const std::string& name : clouds_) listen<PointCloud2>(name, read_cloud);
    if (is_stamped_) {
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
    timer_ = create_wall_timer(std::chrono::duration<double>(gate_options_.dt), [this] { cycle(); });
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
    maker_.reset();
    map_.reset();
    lock_.reset();
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
    for (cspace::Twist twist{1.0, 1.0}; !Watch::is_rest(twist);) {
      twist = watch_->brake();
      publish(twist);
      std::this_thread::sleep_for(std::chrono::duration<double>(gate_options_.dt));
    }
  }

 private:
  using Twist = geometry_msgs::msg::Twist;

  /// Read all parameters, and open the map, or follow its topic.
  void read_parameters() {
    const std::vector<std::string> none;
    Parameters<GateNode> parameters(*this);
    const std::string map = parameters.text("map", "", "folder of a map of x, y and yaw that space.save wrote; empty: made of map_topic");
    Recipe recipe = read_recipe(parameters);
    const std::string robot = parameters.text("robot", "", "robot of a map made of map_topic, as for cspace build: disc:0.3, or "
                                              "footprint:[[0.3, 0.2], [-0.3, 0.2], [-0.3, -0.2], [0.3, -0.2]], metres");
    footprint_ = parameters.texts("footprint", none, "convex parts that the map's robot must have, such as "
                                  "'[[0.3, 0.2], [-0.3, 0.2], [0, -0.2]]', metres");
    gate_options_.dt = parameters.number("period", 0.05, 0.005, 0.5, "seconds between two commands");
    for (const std::string& part : footprint_) read_part(part);  // the map may come later
    const std::vector<double> brakes =
        parameters.numbers("max_deceleration", {1.0, 2.0}, 0.001, 1000.0, "what the brakes reach, m/s^2 and rad/s^2");
    gate_options_.max_deceleration = {brakes[0], brakes[1]};
    read_live_parameters();
    options_.max_age =
        parameters.number("max_age", 0.3, 0.01, 5.0, "seconds after which a command, scan, pose or cycle is too old");
    options_.max_jump =
        parameters.number("max_jump", 0.2, 0.0, 10.0, "how far a pose may be from where the commands lead, metres and radians");
    options_.max_tilt = parameters.number("max_tilt", 0.1, 0.0, 0.5, "largest tilt of the robot, radians");
    options_.min_height = parameters.number("min_height", 0.05, -10.0, 10.0, "points below are floor, metres above the base frame");
    options_.max_height =
        parameters.number("max_height", 2.0, -10.0, 100.0, "points above do not count, metres above the base frame");
    options_.map_frame = parameters.text("map_frame", "map", "frame of the map");
    options_.odom_frame = parameters.text("odom_frame", "odom", "frame in which the robot's place never jumps");
    options_.base_frame = parameters.text("base_frame", "base_link", "frame of the robot, at the origin of its footprint");
    clouds_ = parameters.texts("clouds", none, "topics of point clouds, each of which must be heard");
    const std::vector<std::string> lasers = clouds_.empty() ? std::vector<std::string>{"scan"} : none;
    scans_ = parameters.texts("scans", lasers, "topics of lasers, each of which must be heard: scan, or none beside clouds");
    is_stamped_ = parameters.flag("stamped", false, "whether commands are TwistStamped");
    is_holonomic_ = parameters.flag("holonomic", false, "whether the robot also drives sideways, by linear.y of a command");
    options_.leaving = parameters.flag("leaving", true, "whether the robot may also leave what it is too near to");
    options_.sources = scans_;
    options_.sources.insert(options_.sources.end(), clouds_.begin(), clouds_.end());
    std::set<std::string> topics;
    for (const std::string& name : options_.sources)
      if (!topics.insert(get_node_topics_interface()->resolve_topic_name(name)).second)
        throw std::invalid_argument("the parameters 'scans' and 'clouds' name '" + name + "' twice; each sensor has a topic");
    if (options_.max_age < gate_options_.dt) throw std::invalid_argument("the parameter 'max_age' is below 'period'");
    if (!(options_.min_height < options_.max_height))
      throw std::invalid_argument("the parameter 'min_height' must be below 'max_height'");
    if (options_.sources.empty()) throw std::invalid_argument("the parameters 'scans' and 'clouds' name no topic");
    if (!robot.empty()) check_shape(robot);
    lock_ = parameters.lock();
    if (!map.empty()) {
      take_map(std::make_shared<const cspace::Map>(cspace::Map::open(map)));
      return;
    }
    if (robot.empty()) throw std::invalid_argument("the parameters 'map' and 'robot' are missing; one says what the map is of");
    recipe.frame = options_.map_frame;
    recipe.robot = [robot] { return robot; };
    maker_ = follow_topic(*this, recipe, "map");
  }

  /// Read what may change while the robot drives; return true if that needs a new gate.
  bool read_live_parameters() {
    Parameters<GateNode> parameters(*this);
    const std::vector<double> speeds =
        parameters.numbers("max_velocity", {1.0, 2.0}, 0.001, 1000.0, "commands beyond it are refused, m/s and rad/s");
    const double leaving_speed =
        parameters.number("leaving_speed", 0.1, 0.001, 10.0, "of any point of a robot that leaves what it is too near to, m/s");
    const std::vector<double> tracking = parameters.numbers("tracking", {0.02, 0.02, 0.02}, 0.0, 10.0,
                                                            "how far the robot may stray: x and y, metres, and yaw, radians");
    const double point_radius = parameters.number("point_radius", 0.03, 0.0, 1.0, "what is around each point, metres");
    const cspace::GateOptions before = gate_options_;
    options_.max_velocity = {speeds[0], speeds[1]};
    options_.leaving_speed = leaving_speed;
    gate_options_.tracking = {tracking[0], tracking[1], tracking[2]};
    gate_options_.point_radius = point_radius;
    return before.tracking != gate_options_.tracking || before.point_radius != point_radius;
  }

  /// Return the gate on the newest map.
  /// @throws std::exception  that says why there is none
  Ground find_ground() {
    const KnownMap known = maker_ ? maker_->known_map() : KnownMap{map_, nullptr};
    if (read_live_parameters() || known.map != map_) take_map(known.map);
    watch_->set_options(options_);
    return {gate_, known.changed};
  }

  void take_map(const std::shared_ptr<const cspace::Map>& map) {
    if (!map->frame_id().empty() && map->frame_id() != options_.map_frame)
      throw std::invalid_argument("the parameter 'map_frame' is '" + options_.map_frame + "'; the map is in '" + map->frame_id() + "'");
    if (options_.leaving && !map->has_taken_cells())
      throw std::invalid_argument("the parameter 'leaving' needs a map of x, y and yaw in one piece, not in tiles");
    gate_ = std::make_shared<const cspace::Gate>(map, read_footprint(*map, footprint_), gate_options_);
    map_ = map;
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
    if (!is_holonomic_ && msg.linear.y != 0.0)
      return watch_->refuse_command("a command goes sideways, and the parameter 'holonomic' is false");
    if (!std::isfinite(msg.linear.x + msg.linear.y + msg.angular.z)) return watch_->refuse_command("a command is not finite");
    watch_->hear_command({msg.linear.x, msg.angular.z, msg.linear.y}, when);
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

  /// Return what is wrong if another node publishes commands, as one that the gate replaces.
  std::string find_rival() const {
    int own = publisher_ || stamped_publisher_;  // further ones are of another node with this name
    for (const auto& info : get_publishers_info_by_topic("cmd_vel"))
      if (info.node_name() != get_name() || info.node_namespace() != get_namespace() || own-- <= 0)
        return "the node '" + info.node_name() + "' publishes cmd_vel, too: its commands are not proven";
    return "";
  }

  /// Send the next command.
  void cycle() {
    if (const std::string rival = find_rival(); !rival.empty()) watch_->refuse_command(rival);
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
    msg.header.frame_id = options_.base_frame;
    msg.twist.linear.x = twist.v;
    msg.twist.linear.y = twist.side;
    msg.twist.angular.z = twist.omega;
    if (publisher_) publisher_->publish(msg.twist);
    if (stamped_publisher_) stamped_publisher_->publish(msg);
  }

  WatchOptions options_;
  cspace::GateOptions gate_options_;
  std::vector<std::string> footprint_, scans_, clouds_;
  bool is_stamped_ = false, is_holonomic_ = false;
  std::shared_ptr<MapMaker> maker_;  ///< without one, the map is that of a folder
  std::shared_ptr<void> lock_;       ///< of all other parameters, while it is configured
  std::shared_ptr<const cspace::Map> map_;
  std::shared_ptr<const cspace::Gate> gate_;
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
  } catch (const std::exception& error) {  // of an empty list as a parameter, for one
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
