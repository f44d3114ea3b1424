"""What a page is told of a simulation: the robot as it is, the reference as it should be."""

from __future__ import annotations

import numpy as np
import pytest

from rpctl import Robot, Run
from rpctl.reference.motion import ReferenceState
from rpctl.simulation.loop.recorder import LoopSample
from rpctl.view.serve.live import Broadcast
from rpctl.view.serve.server import Stream
from tests.view.serve.test_live import Unopened, frames


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
    sample = LoopSample(0.0, golden.q[5], golden.log.e[5], golden.tau[5], bend(curvature))
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
