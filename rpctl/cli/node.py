"""The command that runs a controller as a node of ROS 2: ``rpctl node``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from rpctl.cli.options import LoadOptions, RobotArgument
from rpctl.cli.streams import say


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
            help="Efforts on ~/efforts; or the base's twist on ~/cmd_vel and the arm on "
            "~/joint_trajectory.",
        ),
    ] = "effort"
    joints: Annotated[
        str, typer.Option("--joint-states", metavar="TOPIC", help="Of sensor_msgs/JointState.")
    ] = "/joint_states"
    odometry: Annotated[str, typer.Option(metavar="TOPIC", help="Of nav_msgs/Odometry.")] = "/odom"
    tf: Annotated[
        bool,
        typer.Option(
            "--tf", help="Take the pose from /tf, from --frame to --base-frame in one transform."
        ),
    ] = False
    frame: Annotated[
        str, typer.Option(metavar="FRAME", help="In which poses and the reference are.")
    ] = "odom"
    base_frame: Annotated[
        str | None, typer.Option(metavar="FRAME", help="That is located; else the root link.")
    ] = None


def node_command(*, robot: RobotArgument, options: LoadOptions, settings: NodeOptions) -> None:
    """Run a controller as a node of ROS 2, for prototypes, until Ctrl-C."""
    from rpctl.control.controller import Controller
    from rpctl.control.ros_messages import Readings
    from rpctl.control.ros_node import Topics, require_ros, run_node

    require_ros()
    loaded = options.load(robot)
    laws = settings.kinematic, settings.dynamic
    controller = Controller(loaded, settings.reference, *laws, settings.period, settings.output)
    readings = Readings(loaded, settings.frame, settings.base_frame)
    say(f"{loaded.name}: waiting for {', '.join(readings.missing())}")
    run_node(
        controller, readings, Topics(settings.joints, None if settings.tf else settings.odometry)
    )
