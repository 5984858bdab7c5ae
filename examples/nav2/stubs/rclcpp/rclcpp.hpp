// Stub of rclcpp/rclcpp.hpp: a node whose parameters are a map, and whose services are called by spin.
#ifndef RCLCPP_STUB_HPP
#define RCLCPP_STUB_HPP

#include <functional>
#include <map>
#include <memory>
#include <sstream>
#include <string>

namespace rclcpp {

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
  static Callback& callback() {
    static Callback callback;
    return callback;
  }
};

class Node {
 public:
  explicit Node(const std::string&) {}

  template <typename Value>
  Value declare_parameter(const std::string& name, const Value& otherwise) {
    const auto found = stub_parameters().find(name);
    if (found == stub_parameters().end()) return otherwise;
    Value value{};
    std::istringstream(found->second) >> value;
    return value;
  }

  template <typename Service, typename Callback>
  std::shared_ptr<StubService<Service>> create_service(const std::string&, Callback callback) {
    StubService<Service>::callback() = callback;
    return std::make_shared<StubService<Service>>();
  }
};

inline void init(int, char**) {}
inline void spin(const std::shared_ptr<Node>&) { stub_spin()(); }
inline void shutdown() {}

}  // namespace rclcpp

#endif
