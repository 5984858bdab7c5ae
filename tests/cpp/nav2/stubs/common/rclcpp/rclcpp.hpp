// Stub of rclcpp/rclcpp.hpp: a node whose parameters are a map.
#ifndef RCLCPP_STUB_HPP
#define RCLCPP_STUB_HPP

#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include <geometry_msgs/msg/pose.hpp>
#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rcl_interfaces/msg/set_parameters_result.hpp>

#define RCLCPP_INFO(logger, ...) rclcpp::stub_log("INFO", logger, __VA_ARGS__)
#define RCLCPP_WARN(logger, ...) rclcpp::stub_log("WARN", logger, __VA_ARGS__)
#define RCLCPP_ERROR(logger, ...) rclcpp::stub_log("ERROR", logger, __VA_ARGS__)
#define RCLCPP_FATAL(logger, ...) rclcpp::stub_log("FATAL", logger, __VA_ARGS__)

namespace rclcpp {

struct Logger {
  std::string name;
};

inline Logger get_logger(const std::string& name) { return {name}; }

template <typename... Values>
void stub_log(const char* level, const Logger& logger, const char* format, Values... values) {
  char text[1000];
  std::snprintf(text, sizeof text, format, values...);
  std::fprintf(stderr, "[%s] [%s]: %s\n", level, logger.name.c_str(), text);
}

inline std::map<std::string, std::string>& stub_parameters() {
  static std::map<std::string, std::string> parameters;
  return parameters;
}

class Time {
 public:
  explicit Time(std::int64_t nanoseconds) : nanoseconds_(nanoseconds) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }
  operator builtin_interfaces::msg::Time() const {
    return {static_cast<std::int32_t>(nanoseconds_ / 1000000000), static_cast<std::uint32_t>(nanoseconds_ % 1000000000)};
  }

 private:
  std::int64_t nanoseconds_;
};

inline std::int64_t& stub_nanoseconds() {
  static std::int64_t nanoseconds = 0;
  return nanoseconds;
}

class Clock {
 public:
  using SharedPtr = std::shared_ptr<Clock>;
  Time now() const { return Time(stub_nanoseconds()); }
};

/// A parameter as a text; a list has one item a line.
class Parameter {
 public:
  explicit Parameter(const std::string& text, const std::string& name = "") : text_(text), name_(name) {}
  const std::string& get_name() const { return name_; }

  template <typename Value>
  Value get_value() const {
    Value value{};
    read(text_, value);
    return value;
  }

  template <typename Value>
  static std::string write(const Value& value) {
    std::ostringstream text;
    text << std::boolalpha << value;
    return text.str();
  }
  template <typename Item>
  static std::string write(const std::vector<Item>& list) {
    std::string text;
    for (const Item& item : list) text += write(item) + "\n";
    return text;
  }

 private:
  template <typename Value>
  static void read(const std::string& text, Value& value) {
    std::istringstream(text) >> std::boolalpha >> value;
  }
  static void read(const std::string& text, std::string& value) { value = text; }
  template <typename Item>
  static void read(const std::string& text, std::vector<Item>& list) {
    std::istringstream lines(text);
    for (std::string line; std::getline(lines, line);) read(line, list.emplace_back());
  }

  std::string text_, name_;
};

/// A publisher of a topic: "node", or "namespace/node".
class TopicEndpointInfo {
 public:
  explicit TopicEndpointInfo(const std::string& name)
      : name_(name.substr(name.find('/') + 1)), space_("/" + name.substr(0, name.find('/') + 1)) {}
  const std::string& node_name() const { return name_; }
  const std::string& node_namespace() const { return space_; }

 private:
  std::string name_, space_;
};

/// Names of topics, by the rules of ROS.
struct StubTopics {
  std::string resolve_topic_name(const std::string& name) const {
    const bool has_digit_first = !name.empty() && name[0] >= '0' && name[0] <= '9';
    if (name.empty() || has_digit_first || name.find_first_of(" -.[]") != std::string::npos)
      throw std::invalid_argument("Invalid topic name: '" + name + "'");
    return name[0] == '/' ? name : "/" + name;
  }
};

class Node {
 public:
  using StubCheck = std::function<rcl_interfaces::msg::SetParametersResult(const std::vector<Parameter>&)>;

  explicit Node(const std::string& name) : name_(name) {}

  std::shared_ptr<StubTopics> get_node_topics_interface() const { return std::make_shared<StubTopics>(); }
  std::shared_ptr<StubCheck> add_on_set_parameters_callback(const StubCheck& check) {
    const auto kept = std::make_shared<StubCheck>(check);
    stub_check_ = kept;
    return kept;
  }
  /// Set a declared parameter as `ros2 param set` does; return why it is refused, or "".
  std::string stub_set(const std::string& name, const std::string& text) {
    if (const auto check = stub_check_.lock())
      if (const auto result = (*check)({Parameter(text, name)}); !result.successful) return result.reason;
    declared_.at(name) = Parameter(text, name);
    return "";
  }

  const char* get_name() const { return name_.c_str(); }
  const char* get_namespace() const { return "/"; }
  std::vector<TopicEndpointInfo> get_publishers_info_by_topic(const std::string&) const { return stub_publishers(); }
  static std::vector<TopicEndpointInfo>& stub_publishers() {
    static std::vector<TopicEndpointInfo> publishers;
    return publishers;
  }

  Logger get_logger() const { return {name_}; }

  template <typename Value>
  Value declare_parameter(const std::string& name, const Value& otherwise,
                          const rcl_interfaces::msg::ParameterDescriptor& rule = {}) {
    if (has_parameter(name)) throw std::runtime_error("parameter '" + name + "' has already been declared");
    const auto found = stub_parameters().find(name);
    stub_rules()[name] = rule;
    declared_.emplace(name, found == stub_parameters().end() ? Parameter::write(otherwise) : found->second);
    for (const auto& range : rule.floating_point_range) {
      const double number = get_parameter(name).get_value<double>();
      if (number < range.from_value || number > range.to_value)
        throw std::runtime_error("parameter '" + name + "' is not in its range");
    }
    return get_parameter(name).get_value<Value>();
  }
  static std::map<std::string, rcl_interfaces::msg::ParameterDescriptor>& stub_rules() {
    static std::map<std::string, rcl_interfaces::msg::ParameterDescriptor> rules;
    return rules;
  }
  Clock::SharedPtr get_clock() const { return std::make_shared<Clock>(); }
  bool has_parameter(const std::string& name) const { return declared_.count(name) > 0; }
  Parameter get_parameter(const std::string& name) const { return declared_.at(name); }

 private:
  std::string name_;
  std::map<std::string, Parameter> declared_;
  std::weak_ptr<StubCheck> stub_check_;
};

struct QoS {
  explicit QoS(std::size_t) {}
  QoS& transient_local() { return *this; }
};
struct SensorDataQoS : QoS {
  SensorDataQoS() : QoS(5) {}
};

struct SubscriptionBase {
  using SharedPtr = std::shared_ptr<SubscriptionBase>;
  virtual ~SubscriptionBase() = default;
};

/// The one timer, which the program fires.
struct TimerBase {
  using SharedPtr = std::shared_ptr<TimerBase>;
  void cancel() { stub_callback() = [] {}; }
  static std::function<void()>& stub_callback() {
    static std::function<void()> callback = [] {};
    return callback;
  }
};

struct InitOptions {};
enum class SignalHandlerOptions { None };

namespace executors {
struct SingleThreadedExecutor {
  template <typename Node>
  void add_node(Node* node) {
    spin = [node] { stub_spin_once(*node); };
  }
  template <typename Duration>
  void spin_once(Duration) {
    spin();
  }
  std::function<void()> spin;
};
}  // namespace executors

template <typename Message>
struct StubTopic {
  using Callback = std::function<void(std::shared_ptr<const Message>)>;
  static std::map<std::string, std::weak_ptr<Callback>>& callbacks() {
    static std::map<std::string, std::weak_ptr<Callback>> callbacks;
    return callbacks;
  }
};

/// Subscribe as long as the answer lives.
template <typename Message, typename Callback>
std::shared_ptr<void> create_subscription(Node&, const std::string& topic, const QoS&, Callback callback) {
  const auto kept = std::make_shared<typename StubTopic<Message>::Callback>(callback);
  StubTopic<Message>::callbacks()[topic] = kept;
  return kept;
}

inline bool ok() { return true; }
inline void init(int, char**, InitOptions = {}, SignalHandlerOptions = SignalHandlerOptions::None) {}
inline void shutdown() {}

}  // namespace rclcpp

#endif
