"""Bases on powered casters: what makes one, which joints drive, and what is refused."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics
from rpctl.errors import ActuationError
from tests import urdf
from tests.drive.drive_cases import Files, body
from tests.vehicles import Parts, caster, rear_axle, vehicle

PLACES = [(0.3, 0.2), (0.3, -0.2), (-0.3, 0.0)]  # m


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path)


def casters(trails: list[float], *motors: str, twin: bool = False) -> Parts:
    """Return a base on casters of these trails (m), with motors at these joints."""
    parts = body()
    for k, ((x, y), trail) in enumerate(zip(PLACES, trails, strict=False)):
        caster(parts, f"caster_{k}", x, y, trail, twin)
    parts.xml.append(urdf.actuated(*motors))
    return parts


def both(*numbers: int) -> list[str]:
    """Return the swivel and the wheel of each caster."""
    return [name for k in numbers for name in (f"caster_{k}", f"caster_{k}_roller")]


def test_motors_at_wheels_and_swivels_make_the_drive(files: Files) -> None:
    drive = files.load(casters([0.05, 0.06, 0.07], *both(0, 1))).drive
    assert drive.type == "powered-casters"
    assert drive.base_speeds == ("vx", "vy", "omega")
    assert drive.omnidirectional
    assert drive.doubts == ()
    driven = {w.joint for w in drive.wheels if w.driven} | {
        s.joint for s in drive.swivels if s.driven
    }
    assert driven == set(both(0, 1))
    assert [s.joint for s in drive.powered_casters] == ["caster_0", "caster_1"]
    assert [s.joint for s in drive.idle_casters] == ["caster_2"]
    assert "a transmission drives it" in drive.swivels[0].why
    assert drive.swivels[0].why.startswith("contact 50 mm off its axis")


def test_contacts_ahead_of_the_axis_trail_the_other_way(files: Files) -> None:
    """At 0 the first wheel is ahead of its axis, so it rolls backwards as the base moves ahead."""
    drive = files.load(casters([-0.05, 0.06, 0.07], *both(0, 1, 2))).drive
    first, second, _ = drive.swivels
    assert [first.trail, second.trail] == pytest.approx([-0.05, -0.06])
    assert abs(first.heading) == pytest.approx(math.pi)
    assert second.heading == pytest.approx(0.0)


def test_a_wheel_that_drives_alone_is_powered(files: Files) -> None:
    """Two driven wheels on one caster turn its swivel, too: their difference does."""
    motors = [f"caster_{k}_roller_{side}" for k in (0, 1) for side in "lr"]
    robot = files.load(casters([0.05, 0.06], *motors, twin=True))
    assert [s.joint for s in robot.drive.powered_casters] == ["caster_0", "caster_1"]
    assert not any(s.driven for s in robot.drive.swivels)
    assert robot.actuators == tuple(motors)
    B = ReducedDynamics(robot).actuation(robot.configuration())
    assert np.linalg.matrix_rank(B) == 3


def test_a_drive_that_is_named_takes_all_joints_and_says_so(files: Files) -> None:
    drive = files.load(casters([0.05, 0.06, 0.07]), "powered-casters").drive
    assert all(w.driven for w in drive.wheels)
    assert all(s.driven for s in drive.swivels)
    (doubt,) = drive.doubts
    assert "no transmission says which joints of the casters are driven" in doubt
    text = 'type = "powered-casters"\n'
    for name in both(0, 1, 2):
        kind = "wheel" if "roller" in name else "swivel"
        text += f'[[{kind}]]\njoint = "{name}"\ndriven = {str("2" not in name).lower()}\n'
    told = files.load(casters([0.05, 0.06, 0.07]), text).drive
    assert told.doubts == ()
    assert [s.joint for s in told.idle_casters] == ["caster_2"]


def test_casters_without_motors_are_refused(files: Files) -> None:
    refusal = files.refusal(casters([0.05, 0.06, 0.07]))
    assert "all of them trail, and nothing says that motors drive them" in refusal
    assert "give --drive powered-casters if motors do" in refusal
    assert 'type = "powered-casters"' in refusal


def test_wheels_under_their_axes_are_swerves(files: Files) -> None:
    """Trail tells the two apart, not motors; a swerve base cannot be told to be on casters."""
    parts = casters([0.001, 0.001, 0.001], *both(0, 1, 2))
    assert files.load(parts).drive.type == "steered"
    assert "wheels that all trail upright joints" in files.refusal(parts, "powered-casters")


def test_wheels_on_the_root_link_make_another_drive(files: Files) -> None:
    parts = casters([0.05], "rear_left", "rear_right")
    rear_axle(parts)
    assert files.load(parts).drive.type == "differential"
    assert "none that the root link holds" in files.refusal(parts, "powered-casters")


def test_a_caster_that_would_run_into_limits_is_told(files: Files) -> None:
    parts = casters([0.05, 0.06, 0.07], *both(0, 1, 2))
    end = urdf.limit(-2.0, 2.0, 20.0, 5.0)
    for k, part in enumerate(parts.xml):
        if '<joint name="caster_1" ' in part:
            parts.xml[k] = part.replace("</joint>", f"{end}</joint>").replace(
                "continuous", "revolute"
            )
    (doubt,) = files.load(parts).drive.doubts
    assert doubt == '"caster_1" is a caster but has limits, which it would reach'


def test_one_powered_caster_leaves_a_motion_undriven(files: Files) -> None:
    """With both of its motors held the base still turns about its contact with the ground."""
    robot = files.load(casters([0.05, 0.06, 0.07], *both(0)))
    dynamics = ReducedDynamics(robot)
    q, angle = robot.configuration(joints={"caster_0": 0.4}), -0.4  # its axis points down
    with pytest.raises(ActuationError, match="no actuator drives vx, vy, omega of wild"):
        dynamics.efforts(q, np.ones(3))
    cos, sin = math.cos(angle), math.sin(angle)
    x, y = 0.3 - 0.05 * cos - 0.004 * sin, 0.2 - 0.05 * sin + 0.004 * cos
    np.testing.assert_allclose(np.array([y, -x, 1.0]) @ dynamics.actuation(q), 0.0, atol=1e-12)


def test_twin_wheels_under_a_swivel_steer_it(tmp_path: Path) -> None:
    """Their difference does (PR2's casters): without motors at the swivels all of ν is driven."""
    names = [f"{x}{y}" for x in "fr" for y in "lr"]
    wheels = [f"{name}_{side}_wheel" for name in names for side in "lr"]
    text = vehicle("twin").replace("</robot>", urdf.actuated(*wheels) + "</robot>")
    told = "".join(f'[[swivel]]\njoint = "{name}_steer"\ndriven = false\n' for name in names)
    robot = Files(tmp_path).load(text, 'type = "steered"\n' + told)
    assert robot.drive.type == "steered"
    assert set(robot.actuators) == {*wheels, "arm_joint"}
    dynamics = ReducedDynamics(robot)
    q = robot.configuration(joints={"fl_steer": 0.3, "rl_steer": -0.2})
    force = np.array([3.0, 0.4, -0.2, 1.0])
    tau = dynamics.efforts(q, force)
    np.testing.assert_allclose(dynamics.actuation(q) @ tau, force, atol=1e-12)
    assert rpctl.verify(robot, samples=5).passed
