"""A controller as a node of ROS 2, for prototypes: readings in by topics, commands out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import Controller, ControllerOutput
from rpctl.control.ros_messages import (
    SECOND,
    Readings,
    fill_efforts,
    fill_trajectory,
    fill_twist,
)
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError

QUEUE = 10  # messages
COMPLAINT_PERIOD = 2.0  # s between two messages on what is missing
EFFORTS, TWIST, TRAJECTORY = "~/efforts", "~/cmd_vel", "~/joint_trajectory"


@dataclass(frozen=True)
class Topics:
    """Where a node reads.

    Attributes:
        joints: A topic of sensor_msgs/JointState.
        odometry: A topic of nav_msgs/Odometry; None: the transform of tf.
    """

    joints: str = "/joint_states"
    odometry: str | None = "/odom"


def require_ros() -> Any:
    """Return rclpy.

    Raises:
        RpctlError: It is not installed.
    """
    try:
        return import_module("rclpy")
    except ImportError as error:
        raise RpctlError(
            f"{error}: rclpy comes with ROS 2 and not with pip; install ros-DISTRO-rclpy, source "
            "/opt/ros/DISTRO/setup.bash, and run rpctl with the Python of that ROS"
        ) from None


def _message(package: str, name: str) -> Any:
    return getattr(import_module(f"{package}.msg"), name)


class ControllerNode:
    """What one node does: it takes messages, steps the controller, and publishes commands.

    Args:
        node: Of rclpy.
        controller: The controller.
        readings: What is read.
        topics: Where.
    """

    def __init__(
        self, node: Any, controller: Controller, readings: Readings, topics: Topics
    ) -> None:
        self._node, self._controller, self._readings = node, controller, readings
        self._dynamics, self._told = ReducedDynamics(controller.robot), 0
        self._q: Array | None = None  # of the last good sample
        self._sent: ControllerOutput | None = None
        subscribe = node.create_subscription
        subscribe(_message("sensor_msgs", "JointState"), topics.joints, readings.take_joints, QUEUE)
        if topics.odometry is not None:
            kind = _message("nav_msgs", "Odometry")
            subscribe(kind, topics.odometry, readings.take_odometry, QUEUE)
        else:
            subscribe(_message("tf2_msgs", "TFMessage"), "/tf", self._take_transforms, QUEUE)
        self._point = _message("trajectory_msgs", "JointTrajectoryPoint")
        self._publishers = {
            topic: (kind, node.create_publisher(kind, topic, QUEUE))
            for topic, kind in (
                (EFFORTS, _message("std_msgs", "Float64MultiArray")),
                (TWIST, _message("geometry_msgs", "Twist")),
                (TRAJECTORY, _message("trajectory_msgs", "JointTrajectory")),
            )
        }
        node.create_timer(controller.period, self.step)

    def _take_transforms(self, message: Any) -> None:
        """Take the one transform of a TFMessage that locates the base."""
        wanted = self._readings.frame, self._readings.base_frame
        for each in message.transforms:
            if (each.header.frame_id, each.child_frame_id) == wanted:
                self._readings.take_transform(each)

    def step(self) -> None:
        """Publish what the controller sends now; nothing as long as readings are missing."""
        now = self._node.get_clock().now().nanoseconds
        sample = self._readings.sample(now)
        if sample is None:
            if now - self._told > COMPLAINT_PERIOD * SECOND:
                self._told = now
                reasons = (*self._readings.missing(), *self._readings.refused)
                self._node.get_logger().warning(f"not read so far: {', '.join(reasons)}")
            return
        self._q = sample.q if np.isfinite(sample.q).all() else self._q
        self._sent = self._controller.step(*sample)
        self._publish(self._sent)

    def _publish(self, sent: ControllerOutput) -> None:
        if sent.efforts.size:
            self._send(EFFORTS, fill_efforts, sent)
        elif self._q is not None:
            robot, period = self._controller.robot, self._controller.period
            self._send(TWIST, fill_twist, self._dynamics, self._q, sent.speeds)
            self._send(
                TRAJECTORY, fill_trajectory, self._point(), robot, self._q, sent.speeds, period
            )

    def _send(self, topic: str, fill: Callable[..., None], *given: Any) -> None:
        kind, publisher = self._publishers[topic]
        message = kind()
        fill(message, *given)
        publisher.publish(message)

    def leave(self) -> None:
        """Publish zeros in the place of what was sent last."""
        if self._sent is not None:
            efforts, speeds = 0.0 * self._sent.efforts, 0.0 * self._sent.speeds
            self._publish(self._sent._replace(efforts=efforts, speeds=speeds))


def run_node(controller: Controller, readings: Readings, topics: Topics) -> None:
    """Step a controller on the topics of ROS until Ctrl-C; then publish zeros.

    Args:
        controller: The controller.
        readings: What is read.
        topics: Where.

    Raises:
        RpctlError: rclpy is not installed.
    """
    rclpy = require_ros()
    signals = import_module("rclpy.signals").SignalHandlerOptions
    rclpy.init(args=[], signal_handler_options=signals.NO)  # Ctrl-C is rpctl's
    node = rclpy.create_node("rpctl")
    running = ControllerNode(node, controller, readings, topics)
    try:
        rclpy.spin(node)
    finally:
        running.leave()
        node.destroy_node()
        rclpy.shutdown()
