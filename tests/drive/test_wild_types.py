"""Drives that a drive file, or the option, has to tell; every type's start is accepted."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics
from tests.drive.drive_cases import (
    Files,
    axles,
    rolling_speeds,
    tricycle,
    xml,
)
from tests.vehicles import KINDS, vehicle


def test_six_wheels_skid(files: Files) -> None:
    robot = files.load(axles(0.3, 0.0, -0.3), "skid-steer")
    assert len(robot.drive.wheels) == 6
    assert robot.drive.point == pytest.approx((0.0, 0.0))
    for name, speed in rolling_speeds(robot, [0.5, 1.0]).items():
        assert speed == pytest.approx(0.5 - 0.3 if "left" in name else 0.5 + 0.3)
    assert rpctl.verify(robot, samples=2).passed


def test_skid_steer_with_an_effective_track_and_centre(files: Files) -> None:
    """φ̇ r = v ∓ ω track/2, and the centre of rotation alone does not slide sideways."""
    drive_text = 'type = "skid-steer"\ntrack = 0.9\npoint = [0.05, 0.02]\n'
    robot = files.load(axles(0.25, -0.25), drive_text)
    assert robot.drive.track == 0.9
    assert robot.drive.point == (0.05, 0.02)
    v, omega = 0.5, 0.8
    speeds = rolling_speeds(robot, [v, omega])
    for name, speed in speeds.items():
        # P is 0.02 m left of the middle between the sides.
        assert speed == pytest.approx(v + omega * (0.02 + (-0.45 if "left" in name else 0.45)))
    S = ReducedDynamics(robot).basis(robot.configuration())
    assert (S @ [v, omega])[:3] == pytest.approx([v + 0.02 * omega, -0.05 * omega, omega])
    assert rpctl.verify(robot, samples=2).passed


def test_rollers_of_mecanum_wheels(files: Files) -> None:
    """At 45° the default; rollers at another angle c roll at vx + vy/tan c at each wheel."""
    default = files.load(axles(0.25, -0.25), "mecanum")
    lies = {"axle0_left": -1, "axle0_right": 1, "axle1_left": 1, "axle1_right": -1}

    def roller_drive_file(angle: float) -> str:
        wheels = (
            f'[[wheel]]\njoint = "{name}"\nroller_deg = {sign * angle}\n'
            for name, sign in lies.items()
        )
        return 'type = "mecanum"\n' + "".join(wheels)

    nu = [0.3, 0.2, -0.5]
    assert rolling_speeds(
        files.load(axles(0.25, -0.25), roller_drive_file(45)), nu
    ) == pytest.approx(rolling_speeds(default, nu))
    robot = files.load(axles(0.25, -0.25), roller_drive_file(30))
    for wheel in robot.drive.wheels:
        x, y = (0.25 if "0" in wheel.joint else -0.25), (0.3 if "left" in wheel.joint else -0.3)
        forward, left = 0.3 + 0.5 * y, 0.2 - 0.5 * x
        expected = forward + lies[wheel.joint] * np.tan(np.radians(30)) * left
        assert rolling_speeds(robot, nu)[wheel.joint] == pytest.approx(expected)


def test_free_steering_of_a_car(files: Files) -> None:
    """Each front wheel steers on its own; on average the two do not slip sideways."""
    robot = files.load(vehicle("car-like"), 'type = "car-like"\nsteering = "free"\n')
    assert robot.quasi_velocities == ("v", "steer_left", "steer_right", "arm_joint")
    both = robot.configuration(joints={"steer_left": 0.3, "steer_right": -0.3})  # axes differ
    omega = (ReducedDynamics(robot).basis(both) @ [1.0, 0.0, 0.0, 0.0])[2]
    assert omega == pytest.approx(np.tan(0.3) / 0.7)
    assert rpctl.verify(robot, samples=2).passed


@pytest.mark.parametrize(
    ("drive_text", "reason"),
    [
        (
            'type = "car-like"\n[[wheel]]\njoint = "frnt"',
            "wheel joint 'frnt' is not known; did you",
        ),
        (
            'type = "car-like"\n[[swivel]]\njoint = "stear"',
            "swivel joint 'stear' is not known; did",
        ),
        ('type = "tricycle"\n[[swivel]]\njoint = "rear_left"', 'joint "rear_left" is no swivel'),
        ('type = "tricycle"\n[[wheel]]\njoint = "steer"', 'joint "steer" cannot carry a wheel'),
        (
            'type = "fixed"\n[[wheel]]\njoint = "front"',
            "a fixed base has no wheel; leave [[wheel]]",
        ),
        ('type = "tricycle"\ntrack = 0.4', "track is of skid-steer drives only; leave it out"),
        ('type = "tricycle"\npoint = [0.1]', "point: is [0.1]; give 2 numbers"),
        ('type = "tricycle"\nsteering = "free"', "steering is of car-like drives only"),
        (
            'type = "tricycle"\n[[wheel]]\njoint = "front"\nroller_deg = 45',
            "roller_deg is of mecanum drives only",
        ),
        (
            'type = "mecanum"\n[[wheel]]\njoint = "front"\nroller_deg = 90',
            "roller_deg is 90; give degrees between -90 and 90",
        ),
        ('type = "tricycle"\n[[wheel]]\njoint = "front"\ndriven = 1', "give true or false"),
        (
            'type = "tricycle"\n[[swivel]]\njoint = "steer"\nrole = "free"',
            'role is "free"; give steered or caster',
        ),
        ('type = "omni"', "no omni drive: it takes three or more wheels, held by the root link"),
    ],
)
def test_a_drive_file_is_checked_with_the_same_care(
    files: Files, drive_text: str, reason: str
) -> None:
    assert reason in files.refusal(tricycle(), drive_text)


@pytest.mark.parametrize("kind", [*KINDS, "skid-steer", "mecanum"])
def test_the_start_of_every_type_is_accepted(files: Files, kind: str) -> None:
    """What a refusal offers, its type put right, is the drive that would have been found."""
    from rpctl.drive.drive_file import suggest

    four = kind in ("skid-steer", "mecanum")
    text = xml(axles(0.25, -0.25)) if four else vehicle(kind)
    drive = files.load(text, kind if four else "").drive
    radii = {wheel.joint: wheel.radius for wheel in drive.wheels}
    roles = {s.joint: "caster" if s.role == "caster" else "steered" for s in drive.swivels}
    start = suggest(drive.type, radii, roles)
    again = files.load(text, start).drive
    assert (again.type, again.point, again.track) == (drive.type, drive.point, drive.track)
    assert [w.joint for w in again.wheels] == [w.joint for w in drive.wheels]
    assert [(s.joint, s.role) for s in again.swivels] == [(s.joint, s.role) for s in drive.swivels]
    sized = files.load(text, start.replace("# radius", "radius")).drive
    assert [w.radius for w in sized.wheels] == [w.radius for w in drive.wheels]
    assert {w.source for w in sized.wheels} == {"drive file"}
