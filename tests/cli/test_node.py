"""``rpctl node`` on a stand-in of rclpy: what it subscribes to and publishes, and how it ends."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest
from typer.testing import CliRunner

from rpctl import Controller, VelocityOutput
from rpctl.cli.app import app
from tests.control.test_ros_messages import (
    ARM,
    MS,
    WHEELS,
    Message,
    joint_state,
    odometry,
    transforms,
)

MESSAGES = {
    "std_msgs": ("Float64MultiArray",),
    "geometry_msgs": ("TwistStamped",),
    "sensor_msgs": ("JointState",),
    "nav_msgs": ("Odometry",),
    "tf2_msgs": ("TFMessage",),
    "ackermann_msgs": ("AckermannDriveStamped",),
    "trajectory_msgs": ("JointTrajectory", "JointTrajectoryPoint"),
}


class Ros(ModuleType):
    """rclpy with one node, whose life a test tells."""

    def __init__(self, life: Callable[[Ros], None]) -> None:
        super().__init__("rclpy")
        self.life, self.now, self.period = life, 0, 0.0
        self.taken: dict[str, Callable[[Any], None]] = {}
        self.published: list[tuple[str, Any]] = []
        self.said: list[str] = []
        self.events: list[str] = []
        self.step: Callable[[], None] = lambda: None

    def init(self, args: list[str], signal_handler_options: str) -> None:
        self.events.append(f"init {args} {signal_handler_options}")

    def create_node(self, name: str) -> Any:
        def publisher(kind: Any, topic: str, queue: int) -> Any:
            return SimpleNamespace(publish=lambda message: self.published.append((topic, message)))

        def timer(period: float, step: Callable[[], None]) -> None:
            self.period, self.step = period, step

        now = SimpleNamespace(
            now=lambda: SimpleNamespace(nanoseconds=self.now, to_msg=lambda: self.now)
        )
        logger = SimpleNamespace(warning=lambda text, throttle_duration_sec: self.said.append(text))
        return SimpleNamespace(
            create_publisher=publisher,
            create_subscription=lambda kind, topic, take, queue: self.taken.update({topic: take}),
            create_timer=timer,
            get_clock=lambda: now,
            get_logger=lambda: logger,
            destroy_node=lambda: self.events.append("destroyed"),
        )

    def spin(self, node: Any) -> None:
        self.life(self)
        raise KeyboardInterrupt

    def shutdown(self) -> None:
        self.events.append("shut down")


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Ros], None]]:
    def install(ros: Ros) -> None:
        signals = ModuleType("rclpy.signals")
        signals.SignalHandlerOptions = SimpleNamespace(NO="no handlers")  # type: ignore[attr-defined]
        modules = {"rclpy": ros, "rclpy.signals": signals}
        for package, names in MESSAGES.items():
            modules[f"{package}.msg"] = module = ModuleType(f"{package}.msg")
            for name in names:
                setattr(module, name, type(name, (Message,), {}))
        for name, module in modules.items():
            monkeypatch.setitem(sys.modules, name, module)

    yield install


def test_without_rclpy_it_says_where_rclpy_is_from(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rclpy", None)
    done = CliRunner().invoke(app, ["node", "paper"])
    assert done.exit_code == 2
    assert "rclpy comes with ROS 2, not with pip; install ros-DISTRO-rclpy" in done.stderr


def tell(ros: Ros, pose: Any = odometry, topic: str = "/odom") -> None:
    """Let joints and pose be read now: at rest, beside the reference."""
    state = joint_state(ros.now, [*WHEELS, *ARM], [0.0] * 4, [0.0] * 4)
    ros.taken["/joint_states"](state)
    ros.taken[topic](pose(ros.now, (0.0, 0.1, 0.0)))


def test_efforts_go_out_from_the_first_whole_sample_to_zeros_at_the_end(
    installed: Callable[[Ros], None],
) -> None:
    def life(ros: Ros) -> None:
        ros.step()
        assert not ros.published
        assert "waiting for" in ros.said[0]
        assert ARM[0] in ros.said[0]
        for ros.now in (5 * MS, 15 * MS):
            tell(ros)
            ros.step()

    ros = Ros(life)
    installed(ros)
    done = CliRunner().invoke(app, ["node", "paper", "--reference", "line"])
    assert done.exit_code == 130
    topics = [topic for topic, _ in ros.published]
    assert topics == ["~/efforts"] * 3
    first, second, last = (message.data for _, message in ros.published)
    assert len(first) == len(second) == 4
    assert any(first)
    assert last == [0.0] * 4
    assert ros.period == 0.01
    assert ros.events == ["init [] no handlers", "destroyed", "shut down"]


def test_speeds_go_out_as_twist_and_trajectory_and_stop_when_readings_do(
    installed: Callable[[Ros], None],
) -> None:
    def life(ros: Ros) -> None:
        for ros.now in range(0, 3000 * MS, 10 * MS):
            if ros.now < 1000 * MS:
                tell(ros, transforms, "/tf")
            ros.step()

    ros = Ros(life)
    installed(ros)
    words = ["--reference", "line", "--output", "base=twist,*=position", "--odometry", "tf"]
    assert CliRunner().invoke(app, ["node", "paper", *words]).exit_code == 130
    twists = [message.twist.linear.x for topic, message in ros.published if topic == "~/cmd_vel"]
    names = {tuple(m.joint_names) for topic, m in ros.published if topic == "~/joint_trajectory"}
    assert names == {ARM}
    assert twists[99] > 0.01
    assert twists[-2] < 0.01 * twists[99]  # braked, before it left
    assert twists[-1] == 0.0
    assert "/odom" not in ros.taken


def test_a_robot_that_follows_late_is_told(
    installed: Callable[[Ros], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each sentence once; lag and dead time of the options are what the controller begins with."""
    begun = []

    def life(ros: Ros) -> None:
        for ros.now in range(0, 50 * MS, 10 * MS):
            tell(ros)
            ros.step()

    def lateness(controller: Controller) -> str:
        begun.append(controller._output)
        return "late by .1 s" if len(begun) < 3 else "late by .2 s"

    monkeypatch.setattr(Controller, "lateness", lateness)
    ros = Ros(life)
    installed(ros)
    words = ["--output", "velocity", "--actuator-lag", "0.1", "--dead-time", "0.05"]
    assert CliRunner().invoke(app, ["node", "paper", *words]).exit_code == 130
    assert ros.said == ["late by .1 s", "late by .2 s"]
    assert begun[0] == VelocityOutput(0.1, 0.05)
