"""The planar geometry of steered wheels: one centre of rotation, and how angles follow a twist."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.arrays import Array
from rpctl.drive.rows import angle_of, lateral_row
from rpctl.drive.steering import (
    follower_positions,
    free_twist,
    heading_along,
    is_regular,
    steer,
    steering_limits,
)
from tests.robots import write
from tests.vehicles import vehicle

STEERED = ["car-like", "parallel", "tricycle", "bicycle", "steered", "twin", "articulated"]
STEP = 1e-4  # s; second differences lose eight digits


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind)))


def drawn(robot: Robot, rng: np.random.Generator) -> Array:
    """Return a twist that the base can have, ahead or back, and two derivatives (3, 3)."""
    direction = rng.uniform(-0.3, 0.3, (3, 3))
    direction[0, 0] += 0.8
    direction *= rng.choice([1.0, -1.0])
    if robot.drive.has_axle:  # P moves along the heading only
        direction[:, 1] = -robot.drive.point[0] * direction[:, 2]
        direction[:, 0] += robot.drive.point[1] * direction[:, 2]
    return direction


@pytest.mark.parametrize("kind", STEERED)
def test_rates_and_accelerations_are_those_of_the_angles(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    robot = load(tmp_path, kind)
    for _ in range(10):
        twist, rate, bend = drawn(robot, rng)

        def along(t: float) -> Array:
            at = (twist + t * rate + 0.5 * t**2 * bend, rate + t * bend, bend)  # noqa: B023
            return steer(robot.drive, np.array(at))

        behind, here, ahead = along(-STEP), along(0.0), along(STEP)
        slope, curve = (ahead[0] - behind[0]) / (2 * STEP), (ahead[1] - behind[1]) / (2 * STEP)
        np.testing.assert_allclose(here[1], slope, atol=1e-6)
        np.testing.assert_allclose(here[2], curve, atol=1e-5)


@pytest.mark.parametrize("kind", STEERED)
def test_the_steering_leaves_the_twist_that_it_was_set_for(
    tmp_path: Path, kind: str, rng: np.random.Generator
) -> None:
    robot = load(tmp_path, kind)
    drive = robot.drive
    for _ in range(10):
        direction = drawn(robot, rng)
        twist = direction[0]
        positions = steer(drive, direction)[0]
        names = [swivel.joint for swivel in drive.steered]
        if kind not in ("tricycle", "articulated"):
            N = free_twist(drive, dict(zip(names, positions, strict=True)))
            np.testing.assert_allclose(np.cross(N, twist), 0.0, atol=1e-12)
            continue
        # The contact lies k ahead of the axis: in a steady bend it does not move sideways.
        (swivel,) = drive.steered
        angle = angle_of(swivel, positions[0])
        sideways = lateral_row(swivel.pivot, angle) @ twist + swivel.trail * twist[2]
        assert sideways == pytest.approx(0.0, abs=1e-12)


def test_a_bend_tighter_than_the_trail_asks_for_a_right_angle(tmp_path: Path) -> None:
    """The pivot stands on the centre: its wheel, 0.03 m ahead, circles about it."""
    robot = load(tmp_path, "tricycle")
    (swivel,) = robot.drive.steered
    for sign in (1.0, -1.0):
        x, y = swivel.pivot
        still = sign * np.array([[y, -x, 1.0], [0, 0, 0], [0, 0, 0]])
        offset = heading_along(swivel, still[0])
        found = steer(robot.drive, still)
        np.testing.assert_allclose(found[0] - offset, sign * 0.5 * math.pi)
        assert not found[1:].any()


def test_steering_is_regular_short_of_a_right_angle(tmp_path: Path) -> None:
    """Of a bicycle N = (L cos δ, 0, sin δ): regular while |cos δ| > 0.1."""
    drive = load(tmp_path, "bicycle").drive
    for delta in (0.0, 1.0, 1.46, -1.46):
        assert is_regular(drive, {"steer": delta})
    for delta in (1.48, -1.48, 0.5 * math.pi, 1.66):
        assert not is_regular(drive, {"steer": delta})
    assert is_regular(drive, {"steer": math.pi})


def test_steering_is_regular_short_of_the_line_of_pivots(tmp_path: Path) -> None:
    """Two at δ, 0.75 m apart: N = −0.75 cos δ (cos δ, sin δ, 0), along the first wheel; its k is
    (cos δ, sin δ, 0.4 sin δ − 0.3 cos δ), and lengths count by 0.5 m, the first one's distance."""
    drive = load(tmp_path, "steered").drive
    for delta in (0.0, 1.0, 1.47, 1.5, 1.56, -1.45, -1.48, -1.55):
        cos, sin = math.cos(delta), math.sin(delta)
        least = 0.1 * 0.5 * math.sqrt(1.0 + (2.0 * (0.4 * sin - 0.3 * cos)) ** 2)
        turned = {"fl_steer": delta, "rl_steer": delta}
        assert is_regular(drive, turned) == (0.75 * abs(cos) > least)


def test_a_follower_may_turn_no_faster_than_it_can(tmp_path: Path) -> None:
    """dδ_R/dδ_L = (sin δ_R/sin δ_L)², largest at the lower limit, where the right is inside."""
    arm, left_one, right_one, rest = re.split("<limit [^>]*>", vehicle("car-like"))
    own = '<limit lower="-0.5" upper="0.6" effort="40" velocity="5"/>'
    followers = '<limit lower="-1.2" upper="1.2" effort="40" velocity="3"/>'
    robot = rpctl.load(write(tmp_path, arm + own + left_one + own + right_one + followers + rest))
    left, right = -0.5, -math.atan2(1.0, -(1.0 / math.tan(-0.5) + 0.5 / 0.7))
    gain = (math.sin(right) / math.sin(left)) ** 2
    assert gain > 1.5
    limits = steering_limits(robot.drive, robot.description.joint)
    assert (limits.lower[0], limits.upper[0]) == pytest.approx((-0.5, 0.6))
    assert limits.fastest[0] == pytest.approx(3.0 / gain, rel=0.01)
    assert follower_positions(robot.drive, {"steer_left": left})["steer_right"] == pytest.approx(
        -right
    )
