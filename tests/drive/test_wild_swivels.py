"""Swivels, casters and balls as they are found in the wild, and what is driven."""

from __future__ import annotations

from math import atan2

import pytest

import rpctl
from rpctl import ReducedDynamics
from tests.drive.drive_cases import (
    TRANSMISSION,
    Files,
    body,
    tricycle,
    xml,
)
from tests.vehicles import caster, rear_axle, vehicle


def test_ackermann_hubs_among_passive_joints(files: Files) -> None:
    """A lidar spins, a steering wheel turns in the cabin, the hubs have no limits."""
    parts = body()
    rear_axle(parts)
    for side, y in (("left", 0.25), ("right", -0.25)):
        parts.swivel(f"{side}_hub", f"0.7 {y} 0.1", "continuous")
        parts.wheel(f"front_{side}", f"{side}_hub_fork", "0 0.02 0")
    parts.link("lidar", 0.5)
    parts.joint("lidar_joint", "continuous", ("base", "lidar"), "0.2 0 0.6", "0 0 1")
    parts.link("cabin_wheel", 0.5)
    parts.joint("cabin_joint", "continuous", ("base", "cabin_wheel"), "0.3 0 0.6", "0.6 0 0.8")
    robot = files.load(parts)
    assert robot.drive.type == "car-like"
    assert robot.quasi_velocities == ("v", "left_hub", "lidar_joint", "cabin_joint")
    assert [s.role for s in robot.drive.swivels] == ["steered", "follower"]


def test_an_arm_of_continuous_joints_is_no_wheel(files: Files) -> None:
    parts = body()
    for k, axis in enumerate(("0 0 1", "0 1 0", "0 1 0")):
        parent = f"link_{k - 1}" if k else "base"
        parts.link(f"link_{k}", 1.0)
        parts.joint(f"joint_{k}", "continuous", (parent, f"link_{k}"), "0 0 0.3", axis)
    robot = files.load(parts)
    assert robot.drive.type == "fixed"
    assert robot.drive.doubts[0].startswith("no joint could carry a wheel, so the base is taken")
    assert "say --drive fixed" in files.refusal(parts, strict=True)


def test_nothing_moves(files: Files) -> None:
    refusal_text = files.refusal(body())
    assert refusal_text.endswith(
        "no known drive: no joint could carry a wheel; it needs continuous joints about level "
        'axles that reach the ground, held by the root link "base"; make the wheels\' joints '
        'type="continuous" with the axle as <axis>, or say --drive fixed for an arm'
    )


def test_two_drive_wheels_among_four_casters(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    places = [(0.4, 0.2), (0.4, -0.2), (-0.4, 0.2), (-0.4, -0.2)]
    for k, (x, y) in enumerate(places):
        caster(parts, f"pivot_{k}", x, y, 0.05, twin=k > 1)
    drive = files.load(parts).drive
    assert drive.type == "differential"
    assert [wheel.joint for wheel in drive.wheels if wheel.driven] == ["rear_left", "rear_right"]
    assert [len(drive.carried(swivel)) for swivel in drive.swivels] == [1, 1, 2, 2]
    assert [s.role for s in drive.swivels] == ["caster"] * 4
    for swivel, doubt in zip(drive.swivels, drive.doubts, strict=True):
        assert swivel.trail == pytest.approx(-0.05)
        assert doubt.startswith(f'"{swivel.joint}" is taken for a caster')
    named = xml(parts).replace("pivot_", "caster_")
    assert files.load(named).drive.doubts == ()


def test_a_drive_file_tells_the_role(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    caster(parts, "pivot", 0.4, 0.0, 0.05, twin=False)
    drive_file = 'type = "{}"\n[[swivel]]\njoint = "pivot"\nrole = "{}"\n'
    drive = files.load(parts, drive_file.format("tricycle", "steered")).drive
    assert drive.base_speeds == ("v", "pivot")
    assert drive.swivels[0].why == "the drive file says so"
    assert files.load(parts, drive_file.format("differential", "caster"), strict=True).dof == 2
    refusal_text = files.refusal(parts, drive_file.format("differential", "steered"))
    assert "no differential drive: it takes one pair of wheels on one axle" in refusal_text


def test_balls_on_continuous_joints(files: Files) -> None:
    """Front and rear ball make no second axle, and no drive of four wheels."""
    parts = body()
    rear_axle(parts)
    for name, x in (("front_ball", 0.3), ("rear_ball", -0.3)):
        shape = '<collision><geometry><sphere radius="0.04"/></geometry></collision>'
        parts.link(f"{name}_link", 0.2, shape)
        parts.joint(name, "continuous", ("base", f"{name}_link"), f"{x} 0 0.04", "1 0 0")
    robot = files.load(parts)
    assert robot.drive.type == "differential"
    assert robot.actuators == ("rear_left", "rear_right")
    assert robot.drive.wheels[2].why.endswith("a ball, which slides sideways, too")
    assert "balls, held by the root link: front_ball, rear_ball" in robot.drive.evidence
    # It rolls about its axle, so across the robot: with ω = 1 it moves at its lever arm.
    S = ReducedDynamics(robot).basis(robot.configuration())
    rate = S[robot.velocity_index("front_ball")] @ [0.0, 1.0]
    assert abs(rate) == pytest.approx(0.3 / 0.04)
    assert rpctl.verify(robot, samples=2).passed


def test_a_lone_wheel_rolls_its_own_way_and_leaves_the_heading_to_the_pair(files: Files) -> None:
    """Rolling directions are across the axles, (a_y, -a_x), the axle turned to the left."""
    for axle, direction in (
        ("0.6 0.8 0", (0.8, -0.6)),
        ("0.6 -0.8 0", (0.8, 0.6)),
        ("0 1 0", (1.0, 0.0)),
        ("1 0.001 0", (0.0, 1.0)),  # across the pair's: left of it is no side of the pair
    ):
        parts = body()
        parts.wheel("lone", "base", "0.5 0.1 0.1", axle, turn=atan2(*direction[::-1]))
        parts.wheel("left", "base", "0 0.3 0.1")
        parts.wheel("right", "base", "0 -0.3 0.1")
        drive = files.load(parts, 'type = "differential"\n').drive
        assert drive.heading == 0.0
        lone = next(wheel for wheel in drive.wheels if wheel.joint == "lone")
        assert lone.slides
        assert lone.direction == pytest.approx(direction, abs=2e-3)
        assert "-0.0" not in map(str, lone.direction)


def test_transmissions_tell_what_is_driven(files: Files) -> None:
    parts = tricycle()
    robot = files.load(parts)
    assert robot.actuators == ("rear_left", "rear_right", "steer")
    assert robot.drive.doubts[0].startswith("no transmission tells which wheels are driven")
    parts.xml += [TRANSMISSION.format(name) for name in ("front", "steer")]
    robot = files.load(parts, strict=True)
    assert robot.actuators == ("front", "steer")
    assert rpctl.verify(robot, samples=2).passed


def test_effort_limits_tell_what_is_driven(files: Files) -> None:
    limit = '<axis xyz="0 1 0"/><limit effort="20" velocity="30"/></joint>'
    text = xml(tricycle())
    front = text.index('<joint name="front"')
    text = text[:front] + text[front:].replace('<axis xyz="0 1 0"/></joint>', limit)
    robot = files.load(text, strict=True)
    assert robot.actuators == ("front", "steer")


def test_wheels_that_all_steer_do_not_mimic(files: Files) -> None:
    """Front and rear of a double Ackermann: in the model they follow without the mimic."""
    text, mimic = vehicle("steered"), '<mimic joint="fl_steer" multiplier="-1"/>'
    rear = text.index('<joint name="rl_steer"')
    end = text.index("</joint>", rear)
    refusal_text = files.refusal(text[:end] + mimic + text[end:])
    assert (
        'the swivel "rl_steer" mimics "fl_steer", but no multiple keeps all wheels on'
        in refusal_text
    )


def test_steering_that_is_locked_holds_its_wheel(files: Files) -> None:
    drive = files.load(tricycle(), lock=["steer"]).drive
    assert (drive.type, drive.swivels) == ("differential", ())
    assert [wheel.joint for wheel in drive.wheels if wheel.slides] == ["front"]
