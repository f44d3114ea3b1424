#pragma once
#include <memory>

#include "std_msgs/msg/header.hpp"
namespace geometry_msgs::msg
{
struct Vector3
{
  double x = 0.0, y = 0.0, z = 0.0;
};
struct Twist
{
  Vector3 linear, angular;
};
struct TwistStamped
{
  using ConstSharedPtr = std::shared_ptr<const TwistStamped>;
  std_msgs::msg::Header header;
  Twist twist;
};
struct Point
{
  double x = 0.0, y = 0.0, z = 0.0;
};
struct Quaternion
{
  double x = 0.0, y = 0.0, z = 0.0, w = 1.0;
};
struct Pose
{
  Point position;
  Quaternion orientation;
};
struct PoseStamped
{
  std_msgs::msg::Header header;
  Pose pose;
};
struct PoseWithCovariance
{
  Pose pose;
  double covariance[36] = {};
};
struct TwistWithCovariance
{
  Twist twist;
  double covariance[36] = {};
};
}  // namespace geometry_msgs::msg
