#pragma once
#include "geometry_msgs/msg/twist_stamped.hpp"
namespace nav_msgs::msg
{
struct Odometry
{
  using ConstSharedPtr = std::shared_ptr<const Odometry>;
  std_msgs::msg::Header header;
  std::string child_frame_id;
  geometry_msgs::msg::PoseWithCovariance pose;
  geometry_msgs::msg::TwistWithCovariance twist;
};
}  // namespace nav_msgs::msg
