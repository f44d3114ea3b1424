#pragma once
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "builtin_interfaces/msg/time.hpp"

namespace rclcpp
{
class Duration
{
public:
  static Duration from_seconds(double seconds) { return Duration(seconds); }
  double seconds() const { return seconds_; }

private:
  explicit Duration(double seconds) : seconds_(seconds) {}
  double seconds_;
};

class Time
{
public:
  explicit Time(std::int64_t nanoseconds = 0) : nanoseconds_(nanoseconds) {}
  std::int64_t nanoseconds() const { return nanoseconds_; }

private:
  std::int64_t nanoseconds_;
};

class Clock
{
};

class Logger
{
};

class SystemDefaultsQoS
{
};

class Parameter
{
public:
  using Value = std::variant<std::string, double, std::vector<double>>;
  explicit Parameter(Value value) : value_(std::move(value)) {}
  std::string as_string() const { return std::get<std::string>(value_); }
  double as_double() const { return std::get<double>(value_); }
  std::vector<double> as_double_array() const { return std::get<std::vector<double>>(value_); }

private:
  Value value_;
};

template <class Message>
class Subscription
{
public:
  using SharedPtr = std::shared_ptr<Subscription>;
  using Callback = std::function<void(std::shared_ptr<const Message>)>;
  explicit Subscription(Callback given) : callback(std::move(given)) {}
  Callback callback;
};
}  // namespace rclcpp

// Messages go to stderr, where tests read them.
#define RCLCPP_LOG_(logger, ...) \
  do {                           \
    (void)(logger);              \
    std::fprintf(stderr, __VA_ARGS__); \
    std::fputc('\n', stderr);    \
  } while (false)
#define RCLCPP_ERROR(logger, ...) RCLCPP_LOG_(logger, __VA_ARGS__)
#define RCLCPP_WARN(logger, ...) RCLCPP_LOG_(logger, __VA_ARGS__)
#define RCLCPP_ERROR_THROTTLE(logger, clock, milliseconds, ...) \
  do {                                                          \
    (void)(clock);                                              \
    (void)(milliseconds);                                       \
    RCLCPP_LOG_(logger, __VA_ARGS__);                           \
  } while (false)
