#pragma once
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "hardware_interface/handle.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

namespace controller_interface
{
using CallbackReturn = rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface::CallbackReturn;

enum class return_type : std::uint8_t { OK = 0, ERROR = 1 };

enum class interface_configuration_type : std::uint8_t { ALL = 0, INDIVIDUAL = 1, NONE = 2 };

struct InterfaceConfiguration
{
  interface_configuration_type type = interface_configuration_type::NONE;
  std::vector<std::string> names = {};
};

class ControllerInterfaceBase : public rclcpp_lifecycle::node_interfaces::LifecycleNodeInterface
{
public:
  virtual InterfaceConfiguration command_interface_configuration() const = 0;
  virtual InterfaceConfiguration state_interface_configuration() const = 0;
  virtual CallbackReturn on_init() = 0;
  virtual return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> get_node() { return node_; }
  std::shared_ptr<const rclcpp_lifecycle::LifecycleNode> get_node() const { return node_; }
  unsigned int get_update_rate() const { return update_rate_; }

  virtual void assign_interfaces(
    std::vector<hardware_interface::LoanedCommandInterface> && commands,
    std::vector<hardware_interface::LoanedStateInterface> && states)
  {
    command_interfaces_ = std::move(commands);
    state_interfaces_ = std::move(states);
  }

  template <class T>
  auto auto_declare(const std::string & name, const T & value)
  {
    return get_node()->template declare_parameter<T>(name, value);
  }

  // Of tests, in the place of init(): it differs between versions.
  CallbackReturn start(const std::string & name, unsigned int update_rate)
  {
    node_ = std::make_shared<rclcpp_lifecycle::LifecycleNode>(name);
    update_rate_ = update_rate;
    return on_init();
  }

protected:
  std::vector<hardware_interface::LoanedCommandInterface> command_interfaces_;
  std::vector<hardware_interface::LoanedStateInterface> state_interfaces_;

private:
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node_;
  unsigned int update_rate_ = 0;
};

class ChainableControllerInterface : public ControllerInterfaceBase
{
public:
  return_type update(const rclcpp::Time & time, const rclcpp::Duration & period) final
  {
    if (!in_chained_mode_ && update_reference_from_subscribers(time, period) != return_type::OK) {
      return return_type::ERROR;
    }
    return update_and_write_commands(time, period);
  }

  std::vector<hardware_interface::StateInterface::ConstSharedPtr> export_state_interfaces()
  {
    ordered_exported_state_interfaces_ = on_export_state_interfaces_list();
    require_own_names(ordered_exported_state_interfaces_);
    return {ordered_exported_state_interfaces_.begin(), ordered_exported_state_interfaces_.end()};
  }

  std::vector<hardware_interface::CommandInterface::SharedPtr> export_reference_interfaces()
  {
    ordered_exported_reference_interfaces_ = on_export_reference_interfaces_list();
    require_own_names(ordered_exported_reference_interfaces_);
    return ordered_exported_reference_interfaces_;
  }

  bool set_chained_mode(bool chained_mode)
  {
    const bool done = on_set_chained_mode(chained_mode);
    in_chained_mode_ = done ? chained_mode : in_chained_mode_;
    return done;
  }

  bool is_in_chained_mode() const { return in_chained_mode_; }

protected:
  virtual std::vector<hardware_interface::StateInterface::SharedPtr>
  on_export_state_interfaces_list()
  {
    return {};
  }
  virtual std::vector<hardware_interface::CommandInterface::SharedPtr>
  on_export_reference_interfaces_list()
  {
    return {};
  }
  virtual bool on_set_chained_mode(bool) { return true; }
  virtual return_type update_reference_from_subscribers(
    const rclcpp::Time & time, const rclcpp::Duration & period) = 0;
  virtual return_type update_and_write_commands(
    const rclcpp::Time & time, const rclcpp::Duration & period) = 0;

  std::vector<hardware_interface::StateInterface::SharedPtr> ordered_exported_state_interfaces_;
  std::vector<hardware_interface::CommandInterface::SharedPtr>
    ordered_exported_reference_interfaces_;

private:
  /// As ros2_control: names begin with the controller's, and no two are the same.
  template <class Interfaces>
  void require_own_names(const Interfaces & all)
  {
    std::map<std::string, int> seen;
    for (const auto & each : all) {
      const std::string own = std::string(get_node()->get_name()) + "/";
      if (each->get_name().rfind(own, 0) != 0 || ++seen[each->get_name()] > 1) {
        throw std::runtime_error("interface " + each->get_name());
      }
    }
  }

  bool in_chained_mode_ = false;
};
}  // namespace controller_interface
