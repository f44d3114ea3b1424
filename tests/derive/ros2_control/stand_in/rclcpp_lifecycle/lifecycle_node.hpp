#pragma once
#include <any>

#include "rclcpp/rclcpp.hpp"

namespace rclcpp_lifecycle
{
class State
{
};

namespace node_interfaces
{
class LifecycleNodeInterface
{
public:
  enum class CallbackReturn : std::uint8_t { SUCCESS = 97, FAILURE = 98, ERROR = 99 };
  virtual ~LifecycleNodeInterface() = default;
  virtual CallbackReturn on_configure(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_activate(const State &) { return CallbackReturn::SUCCESS; }
  virtual CallbackReturn on_deactivate(const State &) { return CallbackReturn::SUCCESS; }
};
}  // namespace node_interfaces

class LifecycleNode
{
public:
  explicit LifecycleNode(std::string name) : name_(std::move(name)) {}
  const char * get_name() const { return name_.c_str(); }
  rclcpp::Logger get_logger() const { return rclcpp::Logger(); }
  std::shared_ptr<rclcpp::Clock> get_clock() { return clock_; }
  rclcpp::Time now() const { return now_; }

  bool has_parameter(const std::string & name) const { return parameters_.count(name) > 0; }
  rclcpp::Parameter get_parameter(const std::string & name) const
  {
    return rclcpp::Parameter(parameters_.at(name));
  }
  template <class T>
  T declare_parameter(const std::string & name, const T & value)
  {
    parameters_.emplace(name, value);
    return std::get<T>(parameters_.at(name));
  }

  template <class Message, class Callback>
  typename rclcpp::Subscription<Message>::SharedPtr create_subscription(
    const std::string & topic, const rclcpp::SystemDefaultsQoS &, Callback && callback)
  {
    auto made = std::make_shared<rclcpp::Subscription<Message>>(std::forward<Callback>(callback));
    topics_[topic] = made;
    return made;
  }

  // Of tests:
  void set(const std::string & name, rclcpp::Parameter::Value value)
  {
    parameters_.insert_or_assign(name, std::move(value));
  }
  void set_now(rclcpp::Time time) { now_ = time; }
  template <class Message>
  void publish(const std::string & topic, const Message & message)
  {
    using Pointer = typename rclcpp::Subscription<Message>::SharedPtr;
    std::any_cast<Pointer>(topics_.at(topic))->callback(std::make_shared<const Message>(message));
  }

private:
  std::string name_;
  rclcpp::Time now_;
  std::shared_ptr<rclcpp::Clock> clock_ = std::make_shared<rclcpp::Clock>();
  std::map<std::string, rclcpp::Parameter::Value> parameters_;
  std::map<std::string, std::any> topics_;
};
}  // namespace rclcpp_lifecycle
