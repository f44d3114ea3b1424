// Drives an exported controller from lines on stdin, and prints what it sends and what update() cost.
//
//   parameter NAME NUMBER... | parameter NAME = TEXT      before configure
//   start CONTROLLER RATE, configure, activate, deactivate, chained 0|1
//   states NUMBER...                  of the state interfaces, in the order of the configuration
//   odometry STAMP FRAME CHILD X Y YAW VX VY WZ
//   twist STAMP VX VY WZ
//   path FRAME COUNT, then COUNT times STAMP X Y YAW
//   trajectory STAMP NAMES NAME... POINTS, then for each: TIME, and thrice COUNT NUMBER...
//   reference NUMBER...               of the reference interfaces
//   update TIME PERIOD                prints: status of update, tracking status, commands, reference
//   show                              prints the same, without an update
//   interfaces                        prints names: commands, states, reference, exported states
//   costs                             prints median, p99, p99.9, max [ns] of update(), and allocations
//                                     (-1: not counted)
//   samples COUNT, then COUNT times   TIME, POSE, STATES, REFERENCE: all of the above, at once
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <sstream>

#include HEADER

std::shared_ptr<controller_interface::ChainableControllerInterface> make_plugin();

#ifdef COUNTED
#include "allocations.hpp"
#else
namespace
{
bool counts = false;
const long allocations = -1;
}  // namespace
#endif

namespace
{
constexpr double kPeriodOfSamples = KPERIOD;
using controller_interface::CallbackReturn;

builtin_interfaces::msg::Time stamp(double time)
{
  const auto nanoseconds = std::llround(time * 1e9);
  return {
    static_cast<std::int32_t>(nanoseconds / 1000000000),
    static_cast<std::uint32_t>(nanoseconds % 1000000000)};
}

geometry_msgs::msg::Pose pose(double x, double y, double yaw)
{
  geometry_msgs::msg::Pose made;
  made.position.x = x;
  made.position.y = y;
  made.orientation.z = std::sin(0.5 * yaw);
  made.orientation.w = std::cos(0.5 * yaw);
  return made;
}

template <class T = double>
T read(std::istream & line)
{
  std::string word;
  line >> word;
  if constexpr (std::is_same_v<T, std::string>) {
    return word;
  } else {
    return static_cast<T>(std::strtod(word.c_str(), nullptr));  // it reads nan, too
  }
}

struct Driver
{
  std::shared_ptr<controller_interface::ChainableControllerInterface> plugin = make_plugin();
  std::vector<hardware_interface::StateInterface::SharedPtr> states;
  std::vector<hardware_interface::CommandInterface::SharedPtr> commands, references;
  std::vector<hardware_interface::StateInterface::ConstSharedPtr> exported;
  std::vector<double> costs;

  auto & node() { return *plugin->get_node(); }

  void say(CallbackReturn done) { std::cout << (done == CallbackReturn::SUCCESS) << "\n"; }

  void configure()
  {
    const auto done = plugin->on_configure({});
    if (done == CallbackReturn::SUCCESS) {
      references = plugin->export_reference_interfaces();
      exported = plugin->export_state_interfaces();
      std::vector<hardware_interface::LoanedCommandInterface> lent_commands;
      std::vector<hardware_interface::LoanedStateInterface> lent_states;
      for (const auto & name : plugin->command_interface_configuration().names) {
        commands.push_back(make<hardware_interface::CommandInterface>(name));
        lent_commands.emplace_back(commands.back());
      }
      for (const auto & name : plugin->state_interface_configuration().names) {
        states.push_back(make<hardware_interface::StateInterface>(name));
      }
      for (auto each = states.rbegin(); each != states.rend(); ++each) {
        lent_states.emplace_back(*each);  // in another order than asked for
      }
      plugin->assign_interfaces(std::move(lent_commands), std::move(lent_states));
    }
    say(done);
  }

  template <class Interface>
  std::shared_ptr<Interface> make(const std::string & name)
  {
    const auto slash = name.rfind('/');
    return std::make_shared<Interface>(name.substr(0, slash), name.substr(slash + 1));
  }

  template <class Interfaces>
  void set(const Interfaces & interfaces, std::istream & line)
  {
    for (const auto & each : interfaces) {
      if (!each->set_value(read(line))) {
        std::abort();
      }
    }
  }

  bool update(double time, double period)
  {
    const rclcpp::Time now(std::llround(time * 1e9));
    node().set_now(now);
    const auto lasting = rclcpp::Duration::from_seconds(period);
    const auto before = std::chrono::steady_clock::now();
    counts = true;
    const auto done = plugin->update(now, lasting);
    counts = false;
    const std::chrono::duration<double, std::nano> cost = std::chrono::steady_clock::now() - before;
    costs.push_back(cost.count());
    return done == controller_interface::return_type::OK;
  }

  void odometry(double time, const std::string & frame, const std::string & child, std::istream & line)
  {
    nav_msgs::msg::Odometry message;
    message.header.stamp = stamp(time);
    message.header.frame_id = frame;
    message.child_frame_id = child;
    const double x = read(line), y = read(line), yaw = read(line);
    message.pose.pose = pose(x, y, yaw);
    message.twist.twist.linear.x = read(line);
    message.twist.twist.linear.y = read(line);
    message.twist.twist.angular.z = read(line);
    node().publish("~/odometry", message);
  }

  void print(bool done)
  {
    std::cout << done;
    const auto show = [](const auto & all) {
      for (const auto & each : all) {
        std::cout << ' ' << each->get_optional().value();
      }
    };
    show(exported);
    show(commands);
    show(references);
    std::cout << "\n";
  }

  void samples(std::size_t count)
  {
    std::string text;
    for (std::size_t k = 0; k < count; ++k) {
      std::getline(std::cin, text);
      std::istringstream line(text);
      const double time = read(line), x = read(line), y = read(line), yaw = read(line);
      std::ostringstream place;
      place.precision(17);
      place << x << ' ' << y << ' ' << yaw << " 0 0 0";
      std::istringstream placed(place.str());
      odometry(time, "odom", ROOT, placed);
      set(states, line);
      set(references, line);
      const bool done = update(time, kPeriodOfSamples);
      std::cout << (done && exported[0]->get_optional().value() == 0.0);
      for (const auto & each : commands) {
        std::cout << ' ' << each->get_optional().value();
      }
      std::cout << "\n";
    }
  }

  void trajectory(std::istream & line)
  {
    trajectory_msgs::msg::JointTrajectory message;
    message.header.stamp = stamp(read(line));
    message.joint_names.resize(read<std::size_t>(line));
    for (auto & name : message.joint_names) {
      name = read<std::string>(line);
    }
    message.points.resize(read<std::size_t>(line));
    for (auto & point : message.points) {
      const auto time = stamp(read(line));
      point.time_from_start = {time.sec, time.nanosec};
      for (auto * numbers : {&point.positions, &point.velocities, &point.accelerations}) {
        numbers->resize(read<std::size_t>(line));
        std::generate(numbers->begin(), numbers->end(), [&] { return read(line); });
      }
    }
    node().publish("~/joint_trajectory", message);
  }

  void obey(std::istream & line)
  {
    const auto word = read<std::string>(line);
    if (word == "parameter") {
      const auto name = read<std::string>(line);
      std::vector<double> numbers;
      for (std::string each; line >> each;) {
        if (each == "=") {
          return node().set(name, read<std::string>(line));
        }
        numbers.push_back(std::strtod(each.c_str(), nullptr));
      }
      const bool list = name == "limits" || name == "twist_acceleration";
      if (list) {
        node().set(name, numbers);
      } else {
        node().set(name, numbers.at(0));
      }
    } else if (word == "start") {
      const auto name = read<std::string>(line);
      say(plugin->start(name, read<unsigned int>(line)));
    } else if (word == "configure") {
      configure();
    } else if (word == "activate") {
      say(plugin->on_activate({}));
    } else if (word == "deactivate") {
      say(plugin->on_deactivate({}));
    } else if (word == "chained") {
      plugin->set_chained_mode(read(line) != 0.0);
    } else if (word == "states") {
      set(states, line);
    } else if (word == "reference") {
      set(references, line);
    } else if (word == "odometry") {
      const double time = read(line);
      const auto frame = read<std::string>(line), child = read<std::string>(line);
      odometry(time, frame, child, line);
    } else if (word == "twist") {
      geometry_msgs::msg::TwistStamped message;
      message.header.stamp = stamp(read(line));
      message.twist.linear.x = read(line);
      message.twist.linear.y = read(line);
      message.twist.angular.z = read(line);
      node().publish("~/twist", message);
    } else if (word == "path") {
      nav_msgs::msg::Path message;
      message.header.frame_id = read<std::string>(line);
      message.poses.resize(read<std::size_t>(line));
      for (auto & each : message.poses) {
        each.header.stamp = stamp(read(line));
        const double x = read(line), y = read(line), yaw = read(line);
        each.pose = pose(x, y, yaw);
      }
      node().publish("~/path", message);
    } else if (word == "trajectory") {
      trajectory(line);
    } else if (word == "update") {
      const double time = read(line);
      print(update(time, read(line)));
    } else if (word == "show") {
      print(true);
    } else if (word == "samples") {
      samples(read<std::size_t>(line));
    } else if (word == "interfaces") {
      const auto names = [](const auto & all) {
        for (const auto & each : all) {
          std::cout << each->get_name() << ' ';
        }
        std::cout << "\n";
      };
      names(commands);
      names(states);
      names(references);
      names(exported);
    } else if (word == "costs") {
      std::sort(costs.begin(), costs.end());
      for (const double part : {0.5, 0.99, 0.999, 1.0}) {
        std::cout << costs[static_cast<std::size_t>(part * static_cast<double>(costs.size() - 1))] << ' ';
      }
      std::cout << allocations << "\n";
    }
  }
};
}  // namespace

int main()
{
  std::cout.precision(17);
  std::ios::sync_with_stdio(false);
  Driver driver;
  for (std::string text; std::getline(std::cin, text);) {
    std::istringstream line(text);
    driver.obey(line);
  }
}
