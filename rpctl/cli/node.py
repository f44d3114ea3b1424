"""The command that runs a controller as a node of ROS 2: ``rpctl node``."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import import_module
from typing import Annotated, Any

import typer

from rpctl.cli.options import FieldOptions, LoadOptions, RobotArgument
from rpctl.control.controller import Controller
from rpctl.control.group_commands import GroupCommand
from rpctl.control.output_groups import OUTPUT_WORDS
from rpctl.control.ros_messages import COMMANDS, POINT, Readings, commands_of, fill, topic
from rpctl.errors import RpctlError
from rpctl.files.records import Plain
from rpctl.simulation.config import Config, RunSettings

QUEUE = 10  # messages
REMINDER = 2.0  # s between two messages on what is missing


@dataclass(frozen=True)
class NodeOptions:
    """What a node runs, and where it reads."""

    reference: Annotated[
        str, typer.Option(metavar="NAME|FILE", help="Reference, as for `rpctl track`.")
    ] = "eight"
    kinematic: Annotated[
        str | None,
        typer.Option(metavar="NAME|FILE.py:CLASS", help="Kinematic law, as for `rpctl track`."),
    ] = None
    dynamic: Annotated[
        str | None, typer.Option(metavar="NAME", help="Dynamic law, as for `rpctl track`.")
    ] = None
    period: Annotated[
        float, typer.Option("--control-period", metavar="S", help="Control period, s.")
    ] = 0.01
    output: Annotated[
        str,
        typer.Option(
            metavar=OUTPUT_WORDS,
            help="What the node commands, as for `rpctl track`. Efforts go to ~/efforts, in the "
            "order of `actuators` in `rpctl inspect --json`; speeds to ~/speeds, "
            "~/wheel_speeds, ~/cmd_vel or ~/ackermann_cmd; positions of an arm to "
            "~/joint_trajectory.",
        ),
    ] = "effort"
    lag: Annotated[
        float | None,
        typer.Option(
            "--actuator-lag", metavar="S", help="Lag of the speeds, as for `rpctl track`."
        ),
    ] = None
    dead_time: Annotated[
        float | None,
        typer.Option(metavar="S", help="Dead time of the speeds, as for `rpctl track`."),
    ] = None
    joints: Annotated[
        str,
        typer.Option("--joint-states", metavar="TOPIC", help="Topic of sensor_msgs/JointState."),
    ] = "/joint_states"
    odometry: Annotated[
        str,
        typer.Option(
            metavar="TOPIC|tf",
            help="Topic of nav_msgs/Odometry; tf: read --frame to --base-frame from /tf.",
        ),
    ] = "/odom"
    frame: Annotated[
        str,
        typer.Option(
            metavar="FRAME",
            help="Frame of the reference: that of the odometry, or a map in which /tf gives the "
            "odometry's frame.",
        ),
    ] = "odom"
    base_frame: Annotated[
        str | None,
        typer.Option(
            metavar="FRAME",
            help="Frame of the robot that odometry or tf locates; default: the root link.",
        ),
    ] = None
    known: Annotated[Plain, FieldOptions(RunSettings, ("rates", "delay"))] = field(
        default_factory=dict
    )


def node_command(*, robot: RobotArgument, options: LoadOptions, settings: NodeOptions) -> None:
    """Run a controller as a ROS 2 node, for prototypes, until Ctrl-C."""
    try:
        rclpy, signals = import_module("rclpy"), import_module("rclpy.signals")
    except ImportError as error:
        raise RpctlError(
            f"{error}: rclpy comes with ROS 2, not with pip; install ros-DISTRO-rclpy, source "
            "/opt/ros/DISTRO/setup.bash, and run rpctl with that ROS distribution's Python"
        ) from None
    loaded = options.load(robot)
    loaded.require_level()
    sent = Config().with_output(settings.output, settings.lag, settings.dead_time).output
    controller = Controller(
        loaded,
        settings.reference,
        kinematic=settings.kinematic,
        dynamic=settings.dynamic,
        period=settings.period,
        output=sent,
        **settings.known,
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
        self.sent: dict[str, GroupCommand] = {}
        self.late = ""  # how late the robot follows its speeds, as far as that was said
        joints = "sensor_msgs/JointState", settings.joints, self.readings.take_joints
        pose = "nav_msgs/Odometry", settings.odometry, self.readings.take_odometry
        tf = "tf2_msgs/TFMessage", "/tf", self.readings.take_transforms
        both = (pose, tf)[: 1 + (settings.frame != NodeOptions.frame)]  # in a map by both
        for kind, place, take in (joints, *((tf,) if settings.odometry == "tf" else both)):
            node.create_subscription(message_type(kind), place, take, QUEUE)
        self.publishers = dict[str, Any]()
        node.create_timer(controller.period, self.step)

    def step(self) -> None:
        """Send what the controller answers now; as long as readings are missing, say which."""
        sample = self.readings.sample(self.node.get_clock().now().nanoseconds)
        if sample is None:
            missing = ", ".join((*self.readings.missing(), *self.readings.refused))
            say = self.node.get_logger().warning
            say(f"waiting for {missing}", throttle_duration_sec=REMINDER)
        else:
            self.sent = commands_of(self.controller.step(*sample))
            self.send(self.sent)
            if (late := self.controller.lateness()) != self.late:
                self.late = late
                self.node.get_logger().warning(late, throttle_duration_sec=REMINDER)

    def leave(self) -> None:
        """Publish zeros in the place of what was sent last; positions stay as they are."""
        self.send({
            name: sent._replace(
                speeds=dict.fromkeys(sent.speeds, 0.0),
                accelerations=dict.fromkeys(sent.accelerations, 0.0),
                efforts=dict.fromkeys(sent.efforts, 0.0),
            )
            for name, sent in self.sent.items()
        })  # fmt: skip

    def send(self, commands: dict[str, GroupCommand]) -> None:
        """Publish what each group is sent."""
        for name, sent in commands.items():
            make = message_type(COMMANDS[sent.kind][0])
            if name not in self.publishers:
                place = topic(name, sent.kind)
                self.publishers[name] = self.node.create_publisher(make, place, QUEUE)
            message = make()
            if hasattr(message, "header"):
                message.header.stamp = self.node.get_clock().now().to_msg()
            fill(message, message_type(POINT)(), sent, self.controller.period)
            self.publishers[name].publish(message)
