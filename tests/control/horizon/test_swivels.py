"""The horizon law on wheels that swivel: it steers within limits, and casters do not mislead it."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, Run, summarize, track
from rpctl.arrays import Array
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.prediction import Steering, make_model
from rpctl.control.horizon.preview import Preview
from rpctl.control.horizon.target import TimeScaling, look_ahead
from rpctl.description.records import Joint
from rpctl.drive.steering import turning_radius
from rpctl.errors import SingularBasisError
from rpctl.reference import paths
from rpctl.reference.load import load_reference
from rpctl.reference.motion import Reference
from rpctl.reference.named import RAMP_TIME, reference_by_name
from rpctl.reference.path_reference import PathReference
from rpctl.reference.quasi_velocities import reference_rates, steering
from rpctl.reference.waves import waves
from tests.grids import cells
from tests.robots import write
from tests.vehicles import KINDS, vehicle

OFF = (0.1, -0.1, 0.1)
PERIOD = 0.01  # s
AXLES = ("car-like", "parallel", "tricycle", "bicycle")  # no turning on the spot


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind)))


def halved(robot: Robot) -> Robot:
    """Return a robot with half the limits, the range of its steering included."""
    swivels = {swivel.joint for swivel in robot.drive.swivels}

    def tighter(joint: Joint) -> Joint:
        share = 0.5 if joint.name in swivels else 1.0
        lower, upper = share * joint.lower, share * joint.upper
        effort, velocity = 0.5 * joint.effort, 0.5 * joint.velocity
        return replace(joint, effort=effort, velocity=velocity, lower=lower, upper=upper)

    joints = tuple(map(tighter, robot.description.joints))
    description = replace(robot.description, joints=joints)
    return replace(robot, description=description, joints=tuple(map(tighter, robot.joints)))


def run_of(robot: Robot, reference: str | Reference, duration: float) -> Run:
    return track(
        robot, reference, duration, OFF, Horizon(), control_period=PERIOD, plant_step=PERIOD
    )


def angles(robot: Robot, run: Run) -> Array:
    steered = robot.drive.steered
    return np.array([[robot.joint_position(q, s.joint) for s in steered] for q in run.q])


GRID = [
    (kind, name)
    for kind in KINDS
    for name in ("line", "reverse", "circle", "eight", "spin")
    if name != "spin" or kind not in AXLES
]
IN_CI = {
    ("bicycle", "line"),
    ("car-like", "eight"),
    ("parallel", "line"),
    ("tricycle", "circle"),
    ("bicycle", "reverse"),
    ("steered", "line"),
    ("twin", "eight"),
    ("omni", "circle"),
    ("powered", "eight"),
}


@pytest.mark.parametrize(("kind", "name"), cells(GRID, slow=IN_CI))
def test_it_tracks(tmp_path: Path, kind: str, name: str) -> None:
    figures = summarize(run_of(load(tmp_path, kind), name, 12.0))
    assert figures.final_base_error < (1e-3 if name != "spin" else 5e-3)
    assert not figures.limits_violated
    report = figures.kinematic_report
    assert report["fallbacks"] == report["softened"] == 0
    assert report["largest_lag"] == 0.0  # nothing made it wait


@pytest.mark.slow
def test_a_bend_near_the_steering_limit(tmp_path: Path) -> None:
    """The wheels stop at their limit, and what room there is brings the base back."""
    robot = halved(load(tmp_path, "car-like"))
    circle = paths.circle()
    speed, _, turn = circle(0.0).direction[0]
    radius = 1.05 * turning_radius(robot.drive, robot.description.joint)
    path = paths.scaled(circle, radius * turn / speed)
    run = run_of(robot, PathReference(path, 0.3 / radius, waves(robot), RAMP_TIME), 20.0)
    limit = robot.description.joint["steer_left"].upper
    reached = angles(robot, run).max()
    assert limit - 0.03 < reached <= limit
    assert summarize(run).final_base_error < 2e-3
    assert not summarize(run).limits_violated


@pytest.mark.slow
def test_a_swerve_spins_within_halved_limits(tmp_path: Path) -> None:
    robot = halved(load(tmp_path, "steered"))
    run = run_of(robot, "spin", 6.0)
    assert summarize(run).final_base_error < 5e-3
    assert not summarize(run).limits_violated


@pytest.mark.slow
def test_driven_wheels_keep_their_speed(tmp_path: Path) -> None:
    """A car whose wheels are slower than its reference follows the line as fast as they turn."""
    robot = load(tmp_path, "car-like")
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    joints = tuple(
        replace(joint, velocity=2.0) if joint.name in wheels else joint
        for joint in robot.description.joints
    )
    slow = replace(robot, description=replace(robot.description, joints=joints))
    run = run_of(slow, load_reference(robot, "line"), 6.0)
    assert np.abs(run.log.rates).max() <= 2.0
    assert np.abs(run.nu[-1, 0]) > 0.9 * 2.0 * 0.1  # m/s: radius 0.1 m
    assert np.abs(run.log.base[-1, 1]) < 0.01


@pytest.mark.parametrize("turns", [0, 1, -2])
def test_wheels_that_head_back_are_asked_for_the_angle_nearest(tmp_path: Path, turns: int) -> None:
    """Half turns on, the target is the reference's motion all the same."""
    robot = load(tmp_path, "twin")
    model, reference = (
        make_model(ReducedDynamics(robot), 10, 0.1),
        reference_by_name(robot, "eight"),
    )
    times = np.asarray(4.0 + 0.1 * np.arange(11), dtype=float)
    state = reference(4.0)
    now = np.concatenate([steering(robot, state)[0] + math.pi * turns, state.joints])
    target = look_ahead(model, Preview(robot, reference), TimeScaling(times, np.ones(11)), now)
    assert np.abs(np.diff(np.vstack([now, target.joints]), axis=0)).max() < 0.2
    for k, t in enumerate(times.tolist()):
        q = model.configuration(target.joints[k], target.pose[k])
        twist = model.dynamics.twist(q, target.nu[k])
        np.testing.assert_allclose(twist, reference(t).twist, atol=1e-9)
        sign = (-1.0) ** turns
        assert target.nu[k, 0] == pytest.approx(sign * reference_rates(robot, reference(t)).nu[0])


def test_steering_that_is_singular_ahead_is_left_to_the_fallback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def singular(self: Steering, angles: Array) -> Array:
        raise SingularBasisError("the steered wheels fix no one motion ahead")

    robot = load(tmp_path, "twin")
    monkeypatch.setattr(Steering, "maps", singular)
    run = run_of(robot, "circle", 0.1)
    assert summarize(run).kinematic_report["fallbacks"] == 6
    unified = track(robot, "circle", 0.1, OFF, control_period=PERIOD, plant_step=PERIOD)
    np.testing.assert_array_equal(run.log.nu_d, unified.log.nu_d)


def test_angles_that_fix_no_one_motion_are_told(tmp_path: Path) -> None:
    """Both leading wheels of the swerve drive sideways: their axles are one line."""
    steered = Steering(load(tmp_path, "steered"))
    steered.maps(np.array([[0.5, 0.5]]))
    with pytest.raises(SingularBasisError, match="fix no one motion"):
        steered.maps(np.array([[0.5 * math.pi, 0.5 * math.pi]]))
