"""What a page is told of a simulation: the robot as it is, the reference as it should be."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl import Robot, Run
from rpctl.reference.motion import ReferenceState
from rpctl.simulation.closed_loop import WatchedSample
from rpctl.view.pages.robot_page import LiveMotion, robot_page
from rpctl.view.serve.events import Stream
from rpctl.view.serve.live import Broadcast, broadcast
from tests.view.readers import embedded, path_distances, trails
from tests.view.serve.test_live import Unopened, frames
from tests.view.serve.test_server import ask


def bend(curvature: float) -> ReferenceState:
    """Return a reference that drives a bend at 0.5 m/s, with its arm held out."""
    nothing = np.zeros(2)
    return ReferenceState(
        pose=np.array([1.0, 2.0, 0.4]),
        twist=np.array([0.5, 0.0, 0.5 * curvature]),
        twist_dot=np.zeros(3),
        joints=np.array([-0.3, 0.2]),
        joint_rates=nothing,
        joint_accelerations=nothing,
    )


@pytest.mark.parametrize("curvature", [0.5, -0.25])
def test_live_page_is_told_of_robot_and_reference(
    tricycle: Robot, golden: Run, curvature: float
) -> None:
    """P is 0.8 m behind the front wheel: in a bend that one steers by atan(0.8 κ)."""
    stream = Stream()
    sample = WatchedSample(0.0, golden.q[5], golden.log.e[5], golden.tau[5], bend(curvature))
    Broadcast(tricycle, Unopened(), stream, 1.0)(sample)
    ((t, count, *rest),) = frames(stream)
    names = ("x", "y", "heading", *list(tricycle.model.names)[2:])
    assert (t, count) == (0.0, len(names))
    robot = dict(zip(names, rest[: int(count)], strict=True))
    ghost = dict(zip(names, rest[int(count) :], strict=True))
    wheels = {"left_wheel_joint": 5.5, "right_wheel_joint": 4.5, "front_wheel_joint": -3.5}
    wheels = {name: float(np.angle(np.exp(1j * angle))) for name, angle in wheels.items()}
    arm = {"steer_joint": 0.5, "swing_joint": 1.0, "slide_joint": 0.25}
    expected = {"x": 1.0, "y": 0.75, "heading": 1.5, **arm, **wheels}
    assert robot == pytest.approx(expected, abs=1e-5)
    steer = float(np.arctan(0.8 * curvature))
    arm = {"steer_joint": steer, "swing_joint": -0.3, "slide_joint": 0.2}
    x, y = 1.0 + 0.1 * np.cos(0.4), 2.0 + 0.1 * np.sin(0.4)  # the root link is ahead of P
    expected = {"x": x, "y": y, "heading": 0.4, **arm, **wheels}
    assert ghost == pytest.approx(expected, abs=1e-5)


def test_simulation_is_announced_where_it_starts(tricycle: Robot) -> None:
    """Its page has the whole path, and the robot as the reference has it at the start."""

    def reference(t: float) -> ReferenceState:
        state = bend(0.5 - 0.1 * t)
        return state._replace(pose=np.array([1.0 + 0.5 * t, 2.0, 0.4]), joints=np.array([t, 0.2]))

    pages: list[str] = []

    def say(text: str) -> None:
        pages.append(ask(text.split()[0])[1].decode())

    with broadcast(tricycle, reference, 4.0, say):
        pass
    data = embedded(pages[0])
    shown = {joint["name"]: joint["position"] for joint in data["joints"]}
    assert shown["steer_joint"] == pytest.approx(np.arctan(0.8 * 0.5))
    assert (shown["swing_joint"], shown["slide_joint"]) == pytest.approx((0.0, 0.2))
    start = [1.0 + 0.1 * np.cos(0.4), 2.0 + 0.1 * np.sin(0.4), 0.4]
    assert data["start"] == pytest.approx(start)
    assert data["live"]["duration"] == 4.0
    dashes = trails(data["commands"])["trail-base-desired"]
    assert [dashes[:, 0].min(), dashes[:, 0].max()] == pytest.approx([1.0, 3.0], abs=0.3)


def test_live_page_has_the_desired_path_and_room_for_it(tricycle: Robot, golden: Run) -> None:
    show = LiveMotion("events", golden.q[1], golden.base_ref, 0.5)
    data = embedded(robot_page(tricycle, show))
    found = trails(data["commands"])
    assert [*found] == ["trail-base-desired"]  # the actual one grows in the page
    flat = golden.base_ref * [1.0, 1.0, 0.0]
    assert path_distances(found["trail-base-desired"] * [1.0, 1.0, 0.0], flat).max() < data["trail"]
    assert data["point"] == pytest.approx([-0.1, 0.0])
    assert data["start"] == pytest.approx([0.2, 0.03, 0.3])
    assert data["live"]["duration"] == 0.5
    low, high = np.array(data["area"])[:, :2]
    assert (low < golden.base_ref[:, :2].min(axis=0) - 0.5).all()
    assert (high > golden.base_ref[:, :2].max(axis=0) + 0.5).all()
    shown = {joint["name"]: joint["position"] for joint in data["joints"]}
    assert shown["steer_joint"] == pytest.approx(0.1)
    assert shown["slide_joint"] == pytest.approx(0.05)
