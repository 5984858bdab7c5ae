/// @file parameters.hpp
/// Parameters of nodes, which say what they are and are refused at once.
#ifndef CSPACE_NAV2_PARAMETERS_HPP
#define CSPACE_NAV2_PARAMETERS_HPP

#include <algorithm>
#include <cstdint>
#include <memory>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include <rcl_interfaces/msg/parameter_descriptor.hpp>
#include <rcl_interfaces/msg/set_parameters_result.hpp>
#include <rclcpp/rclcpp.hpp>

namespace cspace_nav2 {

/// Declares parameters, unless an earlier configuration did, and reads them.
template <typename Node>
class Parameters {
 public:
  /// @param prefix  of the names of all parameters
  explicit Parameters(Node& node, const std::string& prefix = "") : node_(node), prefix_(prefix) {}

  /// Refuse to change what has been read, as long as the answer lives.
  std::shared_ptr<void> lock() const {
    return node_.add_on_set_parameters_callback([names = names_](const std::vector<rclcpp::Parameter>& list) {
      rcl_interfaces::msg::SetParametersResult result;
      for (const rclcpp::Parameter& parameter : list)
        if (names.count(parameter.get_name()) > 0)
          result.reason = "the parameter '" + parameter.get_name() + "' is read when the node is configured; clean it up first";
      result.successful = result.reason.empty();
      return result;
    });
  }

  /// Return a number within bounds.
  double number(const std::string& name, double otherwise, double lowest, double highest, const std::string& about) {
    rcl_interfaces::msg::ParameterDescriptor rule = describe(about);
    rule.floating_point_range.resize(1);
    rule.floating_point_range[0].from_value = lowest;
    rule.floating_point_range[0].to_value = highest;
    return check(name, read(name, otherwise, rule), lowest, highest);
  }

  /// Return a whole number within bounds.
  std::int64_t count(const std::string& name, std::int64_t otherwise, std::int64_t lowest, std::int64_t highest,
                     const std::string& about) {
    rcl_interfaces::msg::ParameterDescriptor rule = describe(about);
    rule.integer_range.resize(1);
    rule.integer_range[0].from_value = lowest;
    rule.integer_range[0].to_value = highest;
    rule.integer_range[0].step = 1;
    return check(name, read(name, otherwise, rule), lowest, highest);
  }

  bool flag(const std::string& name, bool otherwise, const std::string& about) {
    return read(name, otherwise, describe(about));
  }

  std::string text(const std::string& name, const std::string& otherwise, const std::string& about) {
    return read(name, otherwise, describe(about));
  }

  std::vector<std::string> texts(const std::string& name, const std::vector<std::string>& otherwise, const std::string& about) {
    return read(name, otherwise, describe(about));
  }

  /// Return as many numbers as there are defaults, each within bounds.
  std::vector<double> numbers(const std::string& name, const std::vector<double>& otherwise, double lowest, double highest,
                              const std::string& about) {
    const std::vector<double> list = read(name, otherwise, describe(about));
    for (const double number : list) check(name, number, lowest, highest);
    if (list.size() == otherwise.size()) return list;
    throw std::invalid_argument("the parameter '" + name + "' has " + std::to_string(list.size()) + " numbers; it must have " +
                                std::to_string(otherwise.size()));
  }

  /// Return one of some words, which must be given.
  std::string word(const std::string& name, const std::string& about, const std::vector<std::string>& words) {
    std::string rule;
    for (const std::string& each : words) rule += (rule.empty() ? "" : each == words.back() ? " or " : ", ") + each;
    const std::string found = text(name, "", about + ": " + rule);
    if (std::find(words.begin(), words.end(), found) != words.end()) return found;
    const std::string problem = found.empty() ? "is missing" : "is '" + found + "'";
    throw std::invalid_argument("the parameter '" + name + "' " + problem + "; it must be " + rule);
  }

 private:
  static rcl_interfaces::msg::ParameterDescriptor describe(const std::string& about) {
    rcl_interfaces::msg::ParameterDescriptor rule;
    rule.description = about;
    return rule;
  }

  template <typename Value>
  Value read(const std::string& name, const Value& otherwise, const rcl_interfaces::msg::ParameterDescriptor& rule) {
    const std::string full = prefix_ + name;
    names_.insert(full);
    if (node_.has_parameter(full)) return node_.get_parameter(full).template get_value<Value>();
    return node_.template declare_parameter<Value>(full, otherwise, rule);
  }

  template <typename Number>
  static Number check(const std::string& name, Number value, Number lowest, Number highest) {
    if (value >= lowest && value <= highest) return value;  // which NaN is not
    throw std::invalid_argument("the parameter '" + name + "' is " + std::to_string(value) + "; it must be from " +
                                std::to_string(lowest) + " to " + std::to_string(highest));
  }

  Node& node_;
  const std::string prefix_;
  std::set<std::string> names_;
};

}  // namespace cspace_nav2

#endif  // CSPACE_NAV2_PARAMETERS_HPP
