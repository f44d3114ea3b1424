#pragma once
#include <vector>

#include "geometry_msgs/msg/twist_stamped.hpp"
namespace nav_msgs::msg
{
struct Path
{
  using ConstSharedPtr = std::shared_ptr<const Path>;
  std_msgs::msg::Header header;
  std::vector<geometry_msgs::msg::PoseStamped> poses;
};
}  // namespace nav_msgs::msg
