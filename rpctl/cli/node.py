"""The command that runs a controller as a node of ROS 2: ``rpctl node``."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from typing import Annotated, Any

import typer

from rpctl.cli.options import FieldOptions, LoadOptions, RobotArgument
from rpctl.control.controller import Controller, ControllerOutput
from rpctl.control.ros_messages import COMMANDS, POINT, Readings, fill
from rpctl.errors import RpctlError
from rpctl.files.records import Plain
from rpctl.simulation.config import Config, RunSettings

QUEUE = 10  # messages
REMINDER = 2.0  # s between two messages on what is missing


@dataclass(frozen=True)
class NodeOptions:
    """What a node runs, and where it reads."""

    reference: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="What is tracked, as of `rpctl track`.")
    ] = "eight"
    kinematic: Annotated[
        str | None, typer.Option(metavar="NAME|FILE.py:CLASS", help="As of `rpctl track`.")
    ] = None
    dynamic: Annotated[str | None, typer.Option(metavar="NAME", help="As of `rpctl track`.")] = None
    period: Annotated[
        float, typer.Option("--control-period", metavar="SECONDS", help="Between two steps.")
    ] = 0.01
    output: Annotated[
        str,
        typer.Option(
            metavar="effort|velocity",
            help="Efforts to ~/efforts, in the order of `rpctl inspect --json`'s actuators; or the "
            "base's twist to ~/cmd_vel, and positions and rates of the arm to ~/joint_trajectory.",
        ),
    ] = "effort"
    lag: Annotated[
        float | None, typer.Option("--actuator-lag", metavar="SECONDS", help="As of `rpctl track`.")
    ] = None
    dead_time: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="As of `rpctl track`.")
    ] = None
    joints: Annotated[
        str, typer.Option("--joint-states", metavar="TOPIC", help="Of sensor_msgs/JointState.")
    ] = "/joint_states"
    odometry: Annotated[
        str,
        typer.Option(
            metavar="TOPIC|tf",
            help="Of nav_msgs/Odometry; tf: one transform of /tf, from --frame to --base-frame.",
        ),
    ] = "/odom"
    frame: Annotated[
        str, typer.Option(metavar="FRAME", help="In which poses and the reference are.")
    ] = "odom"
    base_frame: Annotated[
        str | None, typer.Option(metavar="FRAME", help="That is located; else the root link.")
    ] = None
    known: Annotated[Plain, FieldOptions(RunSettings, ("rates", "delay"))] = field(
        default_factory=dict
    )


def node_command(*, robot: RobotArgument, options: LoadOptions, settings: NodeOptions) -> None:
    """Run a controller as a node of ROS 2, for prototypes, until Ctrl-C."""
    try:
        rclpy, signals = import_module("rclpy"), import_module("rclpy.signals")
    except ImportError as error:
        raise RpctlError(
            f"{error}: rclpy comes with ROS 2 and not with pip; install ros-DISTRO-rclpy, source "
            "/opt/ros/DISTRO/setup.bash, and run rpctl with the Python of that ROS"
        ) from None
    loaded, laws = options.load(robot), (settings.kinematic, settings.dynamic)
    sent = Config().with_output(settings.output, settings.lag, settings.dead_time).output
    controller = Controller(
        loaded, settings.reference, *laws, settings.period, sent or "effort", **settings.known
    )
    handlers = signals.SignalHandlerOptions.NO  # Ctrl-C is rpctl's
    rclpy.init(args=[], signal_handler_options=handlers)
    node = rclpy.create_node("rpctl")
    running = ControllerNode(node, controller, settings)
    try:
        rclpy.spin(node)
    finally:
        running.leave()
        node.destroy_node()
        rclpy.shutdown()


def message_type(kind: str) -> Any:
    """Return a type of messages, as of std_msgs/String."""
    package, name = kind.split("/")
    return getattr(import_module(f"{package}.msg"), name)


class ControllerNode:
    """What the node does: it takes messages, steps the controller, and publishes commands."""

    def __init__(self, node: Any, controller: Controller, settings: NodeOptions) -> None:
        self.node, self.controller = node, controller
        self.readings = Readings(controller.robot, settings.frame, settings.base_frame)
        self.sent: ControllerOutput | None = None
        self.late = ""  # how late the robot follows its speeds, as far as that was said
        joints = "sensor_msgs/JointState", settings.joints, self.readings.take_joints
        pose = "nav_msgs/Odometry", settings.odometry, self.readings.take_odometry
        tf = "tf2_msgs/TFMessage", "/tf", self.readings.take_transforms
        for kind, topic, take in (joints, tf if settings.odometry == "tf" else pose):
            node.create_subscription(message_type(kind), topic, take, QUEUE)
        self.publishers = {
            kind: node.create_publisher(message_type(kind), topic, QUEUE)
            for kind, topic in COMMANDS.items()
        }
        node.create_timer(controller.period, self.step)

    def step(self) -> None:
        """Send what the controller answers now; as long as readings are missing, say which."""
        sample = self.readings.sample(self.node.get_clock().now().nanoseconds)
        if sample is None:
            missing = ", ".join((*self.readings.missing(), *self.readings.refused))
            say = self.node.get_logger().warning
            say(f"not read so far: {missing}", throttle_duration_sec=REMINDER)
        else:
            self.sent = self.controller.step(*sample)
            self.send(self.sent)
            if (late := self.controller.lateness()) != self.late:
                self.late = late
                self.node.get_logger().warning(late, throttle_duration_sec=REMINDER)

    def leave(self) -> None:
        """Publish zeros in the place of what was sent last."""
        if self.sent is not None:
            efforts, speeds = 0.0 * self.sent.efforts, 0.0 * self.sent.speeds
            self.send(self.sent._replace(efforts=efforts, speeds=speeds))

    def send(self, sent: ControllerOutput) -> None:
        """Publish efforts, or the base's twist and the arm's next point."""
        empty = {kind: message_type(kind)() for kind in (*COMMANDS, POINT)}
        for kind in fill(empty, self.controller, sent, self.readings.q):
            self.publishers[kind].publish(empty[kind])
