// Stub of rclcpp/rclcpp.hpp: a node whose parameters are a map, and whose services are called by spin.
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

#define RCLCPP_ERROR(logger, ...) rclcpp::stub_log("ERROR", logger, __VA_ARGS__)
#define RCLCPP_FATAL(logger, ...) rclcpp::stub_log("FATAL", logger, __VA_ARGS__)

namespace rclcpp {

struct Logger {
  std::string name;
};

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

inline std::function<void()>& stub_spin() {
  static std::function<void()> spin = [] {};
  return spin;
}

template <typename Service>
struct StubService {
  using Callback = std::function<void(std::shared_ptr<typename Service::Request>, std::shared_ptr<typename Service::Response>)>;
  static std::map<std::string, Callback>& callbacks() {
    static std::map<std::string, Callback> callbacks;
    return callbacks;
  }
};

class Time {
 public:
  explicit Time(std::int32_t seconds) : seconds_(seconds) {}
  operator builtin_interfaces::msg::Time() const { return {seconds_, 0}; }

 private:
  std::int32_t seconds_;
};

inline std::int32_t& stub_seconds() {
  static std::int32_t seconds = 0;
  return seconds;
}

class Clock {
 public:
  using SharedPtr = std::shared_ptr<Clock>;
  Time now() const { return Time(stub_seconds()); }
};

class Parameter {
 public:
  explicit Parameter(const std::string& text) : text_(text) {}

  template <typename Value>
  Value get_value() const {
    Value value{};
    std::istringstream(text_) >> std::boolalpha >> value;
    return value;
  }

 private:
  std::string text_;
};

class Node {
 public:
  explicit Node(const std::string& name) : name_(name) {}

  Logger get_logger() const { return {name_}; }

  template <typename Value>
  Value declare_parameter(const std::string& name, const Value& otherwise,
                          const rcl_interfaces::msg::ParameterDescriptor& rule = {}) {
    if (has_parameter(name)) throw std::runtime_error("parameter '" + name + "' has already been declared");
    std::ostringstream text;
    text << std::boolalpha << otherwise;
    const auto found = stub_parameters().find(name);
    if (!rule.read_only) stub_writable().push_back(name);
    declared_.emplace(name, found == stub_parameters().end() ? text.str() : found->second);
    return get_parameter(name).get_value<Value>();
  }
  static std::vector<std::string>& stub_writable() {
    static std::vector<std::string> names;
    return names;
  }
  Clock::SharedPtr get_clock() const { return std::make_shared<Clock>(); }
  bool has_parameter(const std::string& name) const { return declared_.count(name) > 0; }
  Parameter get_parameter(const std::string& name) const { return declared_.at(name); }

  template <typename Service, typename Callback>
  std::shared_ptr<StubService<Service>> create_service(const std::string& name, Callback callback) {
    StubService<Service>::callbacks()[name.substr(0, 2) == "~/" ? name_ + name.substr(1) : name] = callback;
    return std::make_shared<StubService<Service>>();
  }

 private:
  std::string name_;
  std::map<std::string, Parameter> declared_;
};

inline void init(int, char**) {}
inline void spin(const std::shared_ptr<Node>&) { stub_spin()(); }
inline void shutdown() {}

}  // namespace rclcpp

#endif
