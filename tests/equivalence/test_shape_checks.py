"""The rows on the file's shapes: slip by paper and pencil, and what a person is told of it."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.equivalence import file_drive
from rpctl.equivalence import shape_checks as geometry
from rpctl.equivalence.certificate import Check
from rpctl.equivalence.file_drive import FileReading, read
from rpctl.equivalence.state import draw_state
from rpctl.equivalence.verify import Certificate
from rpctl.equivalence.wheel_slip import FileMotion, Slip, slip
from tests.drive.drive_cases import Files, body, meshed
from tests.proofs import failed
from tests.robots import SET_A, platform, write
from tests.vehicles import rear_axle, vehicle


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def row(proof: Certificate, name: str) -> Check:
    (found,) = (check for check in proof.checks if check.name == name)
    return found


def moved(
    reading: FileReading, twist: list[float], rates: dict[str, float], **positions: float
) -> Slip:
    raw = reading.raw
    return slip(
        FileMotion(raw, reading.drive, positions, np.array(twist), rates, raw.poses(positions))
    )


def test_slip_of_a_platform_by_hand(tmp_path: Path) -> None:
    """Track 1.5 m, radius .15 m, straight on at 1 m/s and 10 % too slow a left wheel."""
    reading = read(rpctl.load(write(tmp_path, platform(SET_A))))
    found = moved(reading, [1.0, 0.0, 0.0], {"left_joint": 6.0, "right_joint": 1.0 / 0.15})
    assert found.speed == pytest.approx(1.0)
    assert found.constrained["left_joint, forward"] == pytest.approx(0.1)
    assert found.constrained["right_joint, forward"] == pytest.approx(0.0, abs=1e-15)
    assert found.base == pytest.approx({"v": 1.0, "omega": 0.0})
    aside = moved(reading, [3.0, 4.0, 0.0], {"left_joint": 20.0, "right_joint": 20.0})
    assert aside.speed == pytest.approx(5.0)
    assert aside.constrained["left_joint, sideways"] == pytest.approx(0.8)
    assert aside.constrained["P, sideways"] == pytest.approx(0.8)
    turning = moved(reading, [0.0, 0.0, 2.0], {"left_joint": -10.0, "right_joint": 10.0})
    assert turning.speed == pytest.approx(1.5)
    assert max(turning.constrained.values()) < 1e-15
    assert turning.base == pytest.approx({"v": 0.0, "omega": 2.0})


def test_slip_of_a_steered_wheel_by_hand(tmp_path: Path) -> None:
    """Rear axle at x = −.1, front contact 3 cm ahead and 1 cm left of its pivot at x = .6."""
    reading = read(rpctl.load(write(tmp_path, vehicle("tricycle"))))
    rates = {"rear_left": 10.0, "rear_right": -10.0, "front": 10.0, "steer": 0.5}
    found = moved(reading, [1.0, 0.0, 0.0], rates)
    # The fork takes it along at .5 rad/s: 1.5 cm/s to the left and .5 cm/s back.
    assert found.constrained["front, sideways"] == pytest.approx(0.015)
    assert found.constrained["front, forward"] == pytest.approx(0.005)
    turned = moved(reading, [1.0, 0.0, 0.0], {**rates, "steer": 0.0}, steer=0.5)
    assert turned.constrained["front, sideways"] == pytest.approx(math.sin(0.5))
    assert turned.constrained["front, forward"] == pytest.approx(1.0 - math.cos(0.5))


def test_rollers_are_held_along_themselves_only() -> None:
    reading = read(rpctl.load("mecanum"))
    radius = reading.drive.wheels[0].radius
    names_ = [wheel.joint for wheel in reading.drive.wheels]
    spun = moved(reading, [0.7, 0.0, 0.0], dict.fromkeys(names_, 0.7 / radius))
    assert max(spun.constrained.values()) < 1e-15
    aside = moved(reading, [0.0, 0.7, 0.0], dict.fromkeys(names_, 0.0))
    assert set(aside.constrained) == {f"{name}, along its roller" for name in names_}
    np.testing.assert_allclose(list(aside.constrained.values()), math.sqrt(0.5))
    assert not aside.by_design


def test_what_slides_by_design_is_told_by_hand() -> None:
    """A skid-steer base: an axle a ahead of P slides sideways at a ω, and so it says."""
    robot = rpctl.load("skid_steer")
    reading = read(robot)
    drive, b = reading.drive, 0.5 * robot.drive.track
    ahead = float(file_drive.measure(robot, reading.raw)[0].point[0])
    rates = {w.joint: (0.5 - 0.25 * b * (1 if "left" in w.joint else -1)) / w.radius
             for w in drive.wheels}  # fmt: skip
    found = moved(reading, [0.5, 0.0, 0.25], rates)
    (a,) = {
        round(abs(float(reading.raw.poses({})[reading.raw.joint[w.joint].child][0, 3]) - ahead), 9)
        for w in drive.wheels
    }
    speed = math.hypot(0.5 + 0.25 * b, 0.25 * a)
    np.testing.assert_allclose(list(found.by_design.values()), 0.25 * a / speed)
    assert len(found.by_design) == 4
    proof = rpctl.verify(robot, samples=2, engines=())
    assert row(proof, "wheels' contact at S ν").note.startswith("by the drive's model wheel_")
    assert proof.passed


WIDE = """type = "skid-steer"
track = {track}
[[wheel]]
joint = "wheel_front_left_joint"
[[wheel]]
joint = "wheel_front_right_joint"
[[wheel]]
joint = "wheel_rear_left_joint"
[[wheel]]
joint = "wheel_rear_right_joint"
"""


def test_a_declared_track_is_where_the_wheels_grip(tmp_path: Path) -> None:
    """Of what its own track leaves, a wider one makes (T − t)/2 ω of slip, and says so."""
    plain = rpctl.load("skid_steer")
    track = 1.25 * plain.drive.track
    drive = write(tmp_path, WIDE.format(track=track), "drive.toml")
    robot = rpctl.load("skid_steer", drive=drive)
    proof = rpctl.verify(robot, samples=3, engines=())
    assert row(proof, "wheels' contact at S ν").residual < 1e-12
    assert proof.passed
    (declared_row,) = proof.declared
    assert declared_row.residual > 0.01
    reading = read(robot)
    radius, turn = robot.drive.wheels[0].radius, 0.6
    rates = {w.joint: 0.5 * track * turn / radius * (-1 if "left" in w.joint else 1)
             for w in robot.drive.wheels}  # fmt: skip
    found = moved(reading, [0.0, 0.0, turn], rates)
    forward = [size for key, size in found.constrained.items() if key.endswith("forward")]
    np.testing.assert_allclose(forward, 0.0, atol=1e-15)
    bare = dataclasses.replace(reading, drive=reading.measured)
    slips = [
        s for k, s in moved(bare, [0.0, 0.0, turn], rates).constrained.items() if "forward" in k
    ]
    expected = 0.5 * (track - plain.drive.track) * turn
    np.testing.assert_allclose(np.array(slips) * found.speed, expected, rtol=1e-12)


@pytest.mark.parametrize("degrees", [0.3, 0.8])
def test_toe_in_is_told_in_words(tmp_path: Path, degrees: float) -> None:
    text = platform(SET_A)
    for y, sign in (("0.75", 1), ("-0.75", -1)):
        turn = f'rpy="0 0 {math.radians(sign * degrees)!r}"'
        text = text.replace(f'xyz="0 {y} 0.15"', f'xyz="0 {y} 0.15" {turn}')
    robot = rpctl.load(write(tmp_path, text))
    assert robot.drive.heading == pytest.approx(0.0, abs=1e-15)  # it goes straight on
    check = row(rpctl.verify(robot, samples=20, engines=()), "wheels' contact at S ν")
    # A wheel slides sideways at the sine of its angle, of its own speed: the faster's at most.
    assert check.residual == pytest.approx(math.sin(math.radians(degrees)), rel=0.01)
    percent = f"{100.0 * check.residual:.2g} % of the robot's speed"
    assert check.entry.endswith(f"slides sideways at {percent}")
    assert check.passed


def test_a_record_that_contradicts_the_shapes_fails_in_words(paper: Robot) -> None:
    left, right = paper.drive.wheels
    larger = dataclasses.replace(left, radius=0.165)
    drive = dataclasses.replace(paper.drive, wheels=(larger, right))
    proof = rpctl.verify(dataclasses.replace(paper, drive=drive), samples=3, engines=())
    check = row(proof, "wheels' contact at S ν")
    assert check.residual == pytest.approx(1.0 - 0.15 / 0.165)
    assert check.entry == "wheel_left_joint slides forward at 9.1 % of the robot's speed"
    assert row(proof, "drive's geometry").entry == (
        "radius of wheel_left_joint: 0.165 in the drive, 0.15 as drawn"
    )
    assert not proof.passed


DECLARED = """type = "differential"
[[wheel]]
joint = "left_joint"
radius = 0.165
[[wheel]]
joint = "right_joint"
"""


def test_a_declared_number_is_told_and_fails_when_strict(files: Files) -> None:
    robot = files.load(platform(SET_A), DECLARED)
    proof = rpctl.verify(robot, samples=3, engines=())
    assert not failed(proof)
    (declared_row,) = proof.declared
    assert declared_row.residual == pytest.approx(1.0 - 0.15 / 0.165)
    assert declared_row.entry == "left_joint slides forward at 9.1 % of the robot's speed"
    assert "radius of left_joint: 0.165 in the drive, 0.15 as drawn" in declared_row.note
    assert proof.scope.shared == ("declared radius of left_joint",)
    strict = proof.strict()
    assert [check.name for check in failed(strict)] == ["declared numbers"]
    assert strict.declared == ()
    plain = json.loads(json.dumps(proof.to_dict(), allow_nan=False))
    assert plain["declared"][0]["name"] == "declared numbers"


def test_a_wheel_without_a_shape_is_told(files: Files) -> None:
    parts = body()
    rear_axle(parts)
    for name, y in (("front_left", 0.3), ("front_right", -0.3)):
        meshed(parts, name, f"0.5 {y} 0.1")
    robot = files.load(parts, "skid-steer")
    proof = rpctl.verify(robot, samples=2, engines=())
    (skipped,) = (each for each in proof.skipped if each.against == "the file's shapes")
    assert skipped.note.startswith("no shape of front_left, front_right can be read")
    assert proof.scope.shared[-1] == "radius of front_left, front_right, which have no shape"
    assert all(line.startswith("doubtful, no shape gives") for line in proof.scope.shared[:-1])
    assert not failed(proof)


def test_a_fixed_base_has_no_such_rows() -> None:
    proof = rpctl.verify(rpctl.load("arm"), samples=2, engines=())
    assert "the file's shapes" not in {check.against for check in proof.checks}


@pytest.mark.parametrize(("speed", "residual"), [(4.0, 0.5), (0.0, 2.0)])
def test_base_speeds_are_relative_to_the_robots(
    paper: Robot, monkeypatch: pytest.MonkeyPatch, speed: float, residual: float
) -> None:
    """The file makes v 2 m/s more than ν says: half of a speed of 4 m/s."""
    rows, state = geometry.Geometry(ReducedDynamics(paper), read(paper)), draw_state(paper, 0, 0)
    base = {"v": float(state.nu[0]) + 2.0, "omega": float(state.nu[1])}
    found = Slip(speed, {"a, forward": 0.0}, {}, base)
    monkeypatch.setattr(geometry, "slip", lambda motion: found)
    (check,) = (each for each in rows.at(state) if each.name == "base speeds ν")
    assert check.residual == pytest.approx(residual)
    assert check.entry == "v"
