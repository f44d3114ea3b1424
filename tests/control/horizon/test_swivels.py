"""The horizon law on wheels that swivel: it steers within limits, and foresees powered casters."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rpctl
from rpctl import PaperDynamic, ReducedDynamics, Robot, Run, summarize, track
from rpctl.arrays import Array
from rpctl.control.horizon.constraints import WheelSpeeds
from rpctl.control.horizon.law import Horizon
from rpctl.control.horizon.prediction import Model, PredictedMotion
from rpctl.control.horizon.settings import Bounds
from rpctl.control.horizon.target import Preview, Sample, Target, TimeScaling, look_ahead
from rpctl.errors import SingularBasisError
from rpctl.reference.motion import Reference, reference_rates, steering
from rpctl.reference.named import reference_by_name
from tests import random_vehicles
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
        collisions=False,
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
IN_CI = {("car-like", "eight")}


@pytest.mark.parametrize(("kind", "name"), cells(GRID, slow=IN_CI))
def test_it_tracks(tmp_path: Path, kind: str, name: str) -> None:
    figures = summarize(run_of(load(tmp_path, kind), name, 12.0))
    assert figures.final_base_error < (1e-3 if name != "spin" else 5e-3)
    assert not figures.limits_violated
    report = figures.kinematic_report
    assert report["fallbacks"] == report["softened"] == 0
    assert report["largest_lag"] == 0.0  # nothing made it wait


@pytest.mark.parametrize("turns", cells([0, 1, -2], [1, -2]))
def test_wheels_that_head_back_are_asked_for_the_angle_nearest(tmp_path: Path, turns: int) -> None:
    """Half turns on, the target is the reference's motion all the same."""
    robot = load(tmp_path, "twin")
    model, reference = (
        Model(ReducedDynamics(robot), 10, 0.1),
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
    def singular(self: Model, *_: Array) -> PredictedMotion:
        raise SingularBasisError("the steered wheels do not determine the motion ahead")

    robot = load(tmp_path, "twin")
    monkeypatch.setattr(Model, "predict", singular)
    settings: dict[str, Any] = {"control_period": PERIOD, "plant_step": PERIOD, "collisions": False}
    settings |= {"dynamic": PaperDynamic(), "backend": "pinocchio"}
    run, unified = (
        track(robot, "circle", duration=0.1, initial_error=OFF, kinematic=law, **settings)
        for law in (Horizon(), None)
    )
    assert summarize(run).kinematic_report["fallbacks"] == 6
    np.testing.assert_allclose(run.log.nu_d, unified.log.nu_d, atol=1e-12)


def test_angles_that_fix_no_one_motion_are_told(tmp_path: Path) -> None:
    """Both leading wheels of the swerve drive sideways: their axles are one line."""
    model = Model(ReducedDynamics(load(tmp_path, "steered")), STEPS, DT)
    still = np.zeros(model.robot.dof), np.zeros((STEPS, model.robot.dof))
    q = [model.configuration(np.array([a, a, 0.0])) for a in (0.5, 0.5 * math.pi)]
    model.predict(q[0], *still)
    with pytest.raises(SingularBasisError, match="do not determine the motion"):
        model.predict(q[1], *still)


STEPS, DT = 5, 0.1
SEED = 0  # of a base on four casters


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Return a base on four casters of any headings, some of whose axes point down."""
    text, _ = random_vehicles.vehicle("powered", SEED)
    return rpctl.load(write(tmp_path_factory.mktemp("casters"), text))


def turned(robot: Robot, q: Array, twist: Array, duration: float) -> Array:
    """Return the casters' positions after a time (s) of a constant twist, by the basis's rates."""
    dynamics, names = ReducedDynamics(robot), [s.joint for s in robot.drive.swivels]
    index = [robot.velocity_index(name) for name in names]
    nu = np.append(twist, np.zeros(robot.dof - 3))

    def rates(_: float, positions: Array) -> Array:
        at = robot.configuration(joints=dict(zip(names, positions, strict=True)))
        return np.asarray((dynamics.basis(at) @ nu)[index])

    start = [robot.joint_position(q, name) for name in names]
    return np.asarray(solve_ivp(rates, (0.0, duration), start, rtol=1e-10, atol=1e-10).y[:, -1])


@pytest.mark.parametrize(
    "twist",
    [(0.6, 0.2, 0.0), (-0.3, 0.4, 0.9), (0.0, 0.0, 0.0), (0.0, 0.02, -0.8)],
    ids=["straight", "bend", "still", "almost on the spot"],
)
def test_casters_turn_as_the_constraints_have_it(
    robot: Robot, rng: np.random.Generator, twist: tuple[float, float, float]
) -> None:
    require_turned(robot, robot.random_configuration(rng), np.array(twist))


def followed(robot: Robot, q: Array, nu: Array, dt: float) -> Array:
    """Return the casters' positions (4, n) after steps of constant speeds of the base."""
    whole = np.append(nu, np.zeros(robot.dof - 3))
    return Model(ReducedDynamics(robot), 3, dt).predict(q, whole, np.zeros((3, robot.dof))).casters


def require_turned(robot: Robot, q: Array, twist: Array) -> None:
    found = followed(robot, q, twist, DT)
    start = [robot.joint_position(q, swivel.joint) for swivel in robot.drive.swivels]
    np.testing.assert_allclose(found[0], start, atol=1e-14)
    expected = turned(robot, q, twist, 3.0 * DT)
    np.testing.assert_allclose(np.exp(1j * found[-1]), np.exp(1j * expected), atol=1e-7)


def test_casters_that_head_back_stay_or_swing_round(tmp_path: Path) -> None:
    """Backwards they are in a balance that nothing holds; a hair off, they swing round."""
    robot = rpctl.load(write(tmp_path, vehicle("powered")))
    names, ahead = [swivel.joint for swivel in robot.drive.swivels], np.array([0.8, 0.0, 0.0])
    for off, held in ((0.0, 1), (1e-3, 0)):
        q = robot.configuration(joints=dict.fromkeys(names, math.pi - off))
        found = followed(robot, q, ahead, 10.0)
        np.testing.assert_allclose(np.cos(found[1 if held else -1]), 1 - 2 * held, atol=1e-9)


def test_wheel_speeds_are_those_of_the_motion(rng: np.random.Generator) -> None:
    """Rates over their limits: ν after each step, casters turned as the constraints do before."""
    robot = rpctl.load("caster_drive")
    dynamics, bounds = ReducedDynamics(robot), Bounds()
    model = Model(dynamics, STEPS, DT)
    q, nu = robot.random_configuration(rng), np.array([0.4, 0.1, 0.3, 0.2, 0.1])
    motion = model.predict(q, nu, 0.5 * rng.normal(size=(STEPS, robot.dof)))
    target = Target(motion.pose, motion.joints, motion.nu)
    (found,) = WheelSpeeds(model, bounds)(Sample(motion, target, []))
    driven = len(robot.actuators) - len(robot.joints)
    limits = bounds.rates(robot)[1][:driven]
    names = [swivel.joint for swivel in robot.drive.swivels]
    for k in range(STEPS):
        rates = dynamics.actuation(q).T[:driven] @ motion.nu[k + 1] / limits
        np.testing.assert_allclose(found.value[k], [*(rates - 1.0), *(-rates - 1.0)], atol=1e-7)
        twist = motion.nu[k, :3] + 0.5 * DT * motion.nu_dot[k, :3]  # of the base's own speeds
        positions = turned(robot, q, twist, DT)
        q = robot.configuration(joints=dict(zip(names, positions, strict=True)))
