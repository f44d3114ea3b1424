#pragma once
#include <limits>
#include <memory>
#include <optional>
#include <string>

namespace hardware_interface
{
class Handle
{
public:
  explicit Handle(
    const std::string & prefix_name, const std::string & interface_name,
    const std::string & = "double", const std::string & = "")
  : name_(prefix_name + "/" + interface_name)
  {
  }
  const std::string & get_name() const { return name_; }
  template <class T = double>
  [[nodiscard]] std::optional<T> get_optional() const
  {
    return value_;
  }
  template <class T>
  [[nodiscard]] bool set_value(const T & value)
  {
    value_ = value;
    return true;
  }

private:
  std::string name_;
  double value_ = std::numeric_limits<double>::quiet_NaN();
};

class StateInterface : public Handle
{
public:
  using Handle::Handle;
  using SharedPtr = std::shared_ptr<StateInterface>;
  using ConstSharedPtr = std::shared_ptr<const StateInterface>;
};

class CommandInterface : public Handle
{
public:
  using Handle::Handle;
  CommandInterface(const CommandInterface &) = delete;
  using SharedPtr = std::shared_ptr<CommandInterface>;
};

class LoanedStateInterface
{
public:
  explicit LoanedStateInterface(StateInterface::ConstSharedPtr lent) : lent_(std::move(lent)) {}
  LoanedStateInterface(const LoanedStateInterface &) = delete;
  LoanedStateInterface(LoanedStateInterface &&) = default;
  const std::string & get_name() const { return lent_->get_name(); }
  template <class T = double>
  [[nodiscard]] std::optional<T> get_optional(unsigned int = 10) const
  {
    return lent_->template get_optional<T>();
  }

private:
  StateInterface::ConstSharedPtr lent_;
};

class LoanedCommandInterface
{
public:
  explicit LoanedCommandInterface(CommandInterface::SharedPtr lent) : lent_(std::move(lent)) {}
  LoanedCommandInterface(const LoanedCommandInterface &) = delete;
  LoanedCommandInterface(LoanedCommandInterface &&) = default;
  const std::string & get_name() const { return lent_->get_name(); }
  template <class T>
  [[nodiscard]] bool set_value(const T & value, unsigned int = 10)
  {
    return lent_->set_value(value);
  }

private:
  CommandInterface::SharedPtr lent_;
};
}  // namespace hardware_interface
