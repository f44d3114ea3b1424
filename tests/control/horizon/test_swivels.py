"""The horizon law on wheels that swivel: it steers within limits, and casters do not mislead it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, Run, summarize, track
from rpctl.arrays import Array
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.prediction import Steering, make_model
from rpctl.control.horizon.target import Preview, TimeScaling, look_ahead
from rpctl.errors import SingularBasisError
from rpctl.reference.motion import Reference, reference_rates, steering
from rpctl.reference.named import reference_by_name
from tests.grids import cells
from tests.robots import write
from tests.vehicles import KINDS, vehicle

OFF = (0.1, -0.1, 0.1)
PERIOD = 0.01  # s
AXLES = ("car-like", "parallel", "tricycle", "bicycle")  # no turning on the spot


def load(folder: Path, kind: str) -> Robot:
    return rpctl.load(write(folder, vehicle(kind)))


def run_of(robot: Robot, reference: str | Reference, duration: float) -> Run:
    return track(
        robot,
        reference,
        duration=duration,
        initial_error=OFF,
        kinematic=Horizon(),
        control_period=PERIOD,
        plant_step=PERIOD,
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
IN_CI = {("car-like", "eight"), ("twin", "eight")}


@pytest.mark.parametrize(("kind", "name"), cells(GRID, slow=IN_CI))
def test_it_tracks(tmp_path: Path, kind: str, name: str) -> None:
    figures = summarize(run_of(load(tmp_path, kind), name, 12.0))
    assert figures.final_base_error < (1e-3 if name != "spin" else 5e-3)
    assert not figures.limits_violated
    report = figures.kinematic_report
    assert report["fallbacks"] == report["softened"] == 0
    assert report["largest_lag"] == 0.0  # nothing made it wait


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
    unified = track(
        robot, "circle", duration=0.1, initial_error=OFF, control_period=PERIOD, plant_step=PERIOD
    )
    np.testing.assert_array_equal(run.log.nu_d, unified.log.nu_d)


def test_angles_that_fix_no_one_motion_are_told(tmp_path: Path) -> None:
    """Both leading wheels of the swerve drive sideways: their axles are one line."""
    steered = Steering(load(tmp_path, "steered"))
    steered.maps(np.array([[0.5, 0.5]]))
    with pytest.raises(SingularBasisError, match="fix no one motion"):
        steered.maps(np.array([[0.5 * math.pi, 0.5 * math.pi]]))
