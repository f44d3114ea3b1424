"""Slip and base speeds by paper and pencil, on wheels whose signs and places differ."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl.equivalence.file_drive import read
from rpctl.equivalence.wheel_slip import FileMotion, Slip, slip
from rpctl.robot.idealised import idealisations
from tests.robots import write
from tests.vehicles import rear_axle, start, trailer, vehicle


def moved(
    folder: Path, kind: str, twist: tuple[float, float, float], rates: dict[str, float],
    positions: dict[str, float],
) -> Slip:  # fmt: skip
    return text_moved(folder, vehicle(kind), twist, rates, positions)


def text_moved(
    folder: Path, text: str, twist: tuple[float, float, float], rates: dict[str, float],
    positions: dict[str, float],
) -> Slip:  # fmt: skip
    reading = read(rpctl.load(write(folder, text)))
    joint_rates = dict.fromkeys((wheel.joint for wheel in reading.drive.wheels), 0.0) | rates
    at = dict.fromkeys((swivel.joint for swivel in reading.drive.swivels), 0.0) | positions
    return slip(
        FileMotion(
            reading.raw, reading.drive, at, np.array(twist), joint_rates, reading.raw.poses(at)
        )
    )


def test_a_single_wheel_at_p_is_held_sideways(tmp_path: Path) -> None:
    """P is its centre: no arm from P tells that it is abreast of it."""
    found = moved(tmp_path, "bicycle", (0.3, 0.4, 0.0), {}, {})
    assert found.speed == pytest.approx(0.5)
    assert found.constrained["rear, sideways"] == pytest.approx(0.8)
    assert found.constrained["rear, forward"] == pytest.approx(0.6)
    assert found.constrained["P, sideways"] == pytest.approx(0.8)
    assert not found.by_design


def test_a_robot_that_only_steers_has_a_speed(tmp_path: Path) -> None:
    """Its tyre, of 0.1 m, twists at 2 rad/s: what moves 2 mm/s beside it is 1 % of 0.2 m/s."""
    found = moved(tmp_path, "bicycle", (0.0, 0.002, 0.0), {"steer": -2.0}, {})
    assert found.speed == pytest.approx(0.2)
    assert found.constrained["rear, sideways"] == pytest.approx(0.01)


def test_what_shares_a_lateral_force_slides_on_average(tmp_path: Path) -> None:
    """Straight on at 1 m/s with wheels at .4 and .36 rad, their axles to the left and right."""
    at = {"steer_left": 0.4, "steer_right": -0.36}  # its axis points down
    found = moved(tmp_path, "parallel", (1.0, 0.0, 0.0), {}, at)
    mean = 0.5 * (math.sin(0.4) + math.sin(0.36))
    assert found.constrained["steer_left and steer_right, sideways on average"] == pytest.approx(
        mean
    )
    assert found.by_design["front_left, sideways"] == pytest.approx(math.sin(0.4))
    assert found.by_design["front_right, sideways"] == pytest.approx(math.sin(0.36))
    assert found.constrained["front_right, forward"] == pytest.approx(math.cos(0.36))


@pytest.mark.parametrize(
    ("kind", "rates", "speed"),
    [
        ("steered", {"fl_wheel": -5.0, "fr_wheel": 9.0}, 0.5),  # its axle points right
        ("twin", {"fl_l_wheel": 5.0, "fl_r_wheel": 7.0, "rl_l_wheel": 9.0}, 0.6),
    ],
)
@pytest.mark.parametrize("angle", [0.0, 0.5, 2.5])
def test_the_speed_of_a_base_without_an_axle_is_its_first_swivels(
    tmp_path: Path, kind: str, rates: dict[str, float], speed: float, angle: float
) -> None:
    """The rims' mean speed along the swivel's heading, wherever that points."""
    found = moved(tmp_path, kind, (1.0, 0.0, 0.0), rates, {"fl_steer": angle})
    assert found.base == pytest.approx({"v": speed})


def tandem() -> str:
    """Return a base that pulls a trailer, whose axles are 0.6 and 0.8 m behind its hitch."""
    parts = start()
    rear_axle(parts)
    trailer(parts, "cart", "base", "-0.3 0 0.2", 0.6, "0 0 1")
    parts.wheel("cart_left_rear", "cart_body", "-0.8 0.23 -0.1")
    parts.wheel("cart_right_rear", "cart_body", "-0.8 -0.21 -0.1")
    return parts.text("tandem")


@pytest.mark.parametrize(
    ("rate", "average", "front", "rear"),
    [(0.0, 0.5, 0.45, 0.55), (-0.5 - 0.15 / 0.7, 0.0, 0.15 / 7, 0.15 / 7)],
)
def test_a_trailers_two_axles_are_held_sideways_on_average(
    tmp_path: Path, rate: float, average: float, front: float, rear: float
) -> None:
    """The base turns at 0.5 rad/s about P: its hitch, 0.3 m behind, goes 0.15 m/s to the right."""
    found = text_moved(tmp_path, tandem(), (1.0, 0.0, 0.5), {"cart_hitch": rate}, {})
    held = {key: size * found.speed for key, size in found.constrained.items()}
    sliding = {key: size * found.speed for key, size in found.by_design.items()}
    assert held["cart_hitch, sideways on average"] == pytest.approx(average, abs=1e-12)
    assert sliding["cart_left, sideways"] == pytest.approx(front)
    assert sliding["cart_right_rear, sideways"] == pytest.approx(rear)
    assert len(sliding) == 4


def test_a_trailer_of_two_axles_is_verified_and_told(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, tandem()))
    assert rpctl.verify(robot, samples=5, engines=()).passed
    told = [each for each in idealisations(robot) if each.what == "axles apart"]
    assert [each.value for each in told] == pytest.approx([0.1])
    assert '2 axles on "cart_hitch" (line 1) share one lateral' in told[0].sentence
