// Stub of rclcpp_lifecycle/lifecycle_node.hpp: publishers print, and subscriptions are called by their topics.
#ifndef RCLCPP_LIFECYCLE_STUB_HPP
#define RCLCPP_LIFECYCLE_STUB_HPP

#include <chrono>

#include <rclcpp/rclcpp.hpp>

namespace rclcpp_lifecycle {

class State {};

/// Callbacks of a kind of message by topic, while their subscriptions live.
template <typename Message>
using StubCallbacks = std::map<std::string, std::function<void(std::shared_ptr<const Message>)>>;

template <typename Message>
StubCallbacks<Message>& stub_callbacks() {
  static StubCallbacks<Message> callbacks;
  return callbacks;
}

template <typename Message>
struct StubSubscription : rclcpp::SubscriptionBase {
  std::string topic;
  ~StubSubscription() override { stub_callbacks<Message>().erase(topic); }
};

template <typename Message>
class LifecyclePublisher {
 public:
  using SharedPtr = std::shared_ptr<LifecyclePublisher>;
  void publish(const Message& message) {
    if (stub_is_active()) stub_publish(message);
  }
  static bool& stub_is_active() {
    static bool is_active = false;
    return is_active;
  }
};

class LifecycleNode : public rclcpp::Node {
 public:
  using WeakPtr = std::weak_ptr<LifecycleNode>;
  enum class CallbackReturn { SUCCESS, FAILURE };
  using rclcpp::Node::Node;
  virtual ~LifecycleNode() = default;

  virtual CallbackReturn on_configure(const State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State&) { return stub_activate(true); }
  virtual CallbackReturn on_deactivate(const State&) { return stub_activate(false); }
  virtual CallbackReturn on_cleanup(const State&) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_shutdown(const State&) { return CallbackReturn::SUCCESS; }

  LifecycleNode* get_node_base_interface() { return this; }

  template <typename Message>
  std::shared_ptr<LifecyclePublisher<Message>> create_publisher(const std::string&, const rclcpp::QoS&) {
    LifecyclePublisher<Message>::stub_is_active() = false;
    stub_switches_.push_back([](bool is_active) { LifecyclePublisher<Message>::stub_is_active() = is_active; });
    return std::make_shared<LifecyclePublisher<Message>>();
  }

  template <typename Message, typename Callback>
  std::shared_ptr<StubSubscription<Message>> create_subscription(const std::string& topic, const rclcpp::QoS&, Callback callback) {
    stub_callbacks<Message>()[topic] = callback;
    auto subscription = std::make_shared<StubSubscription<Message>>();
    subscription->topic = topic;
    return subscription;
  }

  template <typename Callback>
  rclcpp::TimerBase::SharedPtr create_wall_timer(std::chrono::duration<double>, Callback callback) {
    rclcpp::TimerBase::stub_callback() = callback;
    return std::make_shared<rclcpp::TimerBase>();
  }

 private:
  CallbackReturn stub_activate(bool is_active) {
    for (const auto& turn : stub_switches_) turn(is_active);
    return CallbackReturn::SUCCESS;
  }

  std::vector<std::function<void(bool)>> stub_switches_;
};
}  // namespace rclcpp_lifecycle

#endif
