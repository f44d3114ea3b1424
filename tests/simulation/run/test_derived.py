"""What a log derives in batches is what the robot's own functions say of each sample alone."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import Plant, ReducedDynamics, ReferenceState, Robot, RpctlError, Run
from rpctl.arrays import Array
from rpctl.control.law import Command, Efforts, Limit
from rpctl.dynamics.ground_reaction import find_contacts, ground_reaction
from rpctl.reference.motion import Reference, end_effector_reference, reference_rates, steering
from rpctl.simulation.config import Config
from rpctl.simulation.loop import recorder
from rpctl.simulation.run.derived import Derivation
from rpctl.simulation.run.log import COLUMNS
from tests.grids import cells
from tests.robots import SET_A, platform, write
from tests.vehicles import vehicle

PERIOD, COUNT = 0.02, 20
KINDS = ["car-like", "casters"]  # whose S turns, and whose does not
CATALOGUE = ["skid_steer"]  # whose loads are intervals
SLOW = ["omni", "arm"]  # that moves sideways, and that has no wheels
REST = ["bicycle", "tricycle", "paper"]
QUICK = [*KINDS, *CATALOGUE]
FEW = pytest.mark.parametrize("robot", ["casters", "skid_steer"], indirect=True)


@pytest.fixture(autouse=True)
def small_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make batches small, so that a short run has several."""
    monkeypatch.setattr(recorder, "BATCH", 7)


@pytest.fixture(scope="module", params=cells([*QUICK, *SLOW, *REST], QUICK, SLOW))
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    if request.param in [*CATALOGUE, "arm", "paper"]:
        return rpctl.load(request.param)
    return rpctl.load(write(tmp_path_factory.mktemp("robot"), vehicle(request.param)))


def columns_of(run: Run) -> dict[str, Array]:
    """Return the columns of a run's log by name."""
    return {name: getattr(run.log, name) for name in COLUMNS}


def circling(robot: Robot) -> Reference:
    """Return a reference that goes round and round while its arm swings."""
    n, turn = len(robot.joints), 9.0 if robot.drive.base_speeds else 0.0

    def state(t: float) -> ReferenceState:
        angle, swing = turn * t, 0.2 * math.sin(t)
        heading = math.atan2(math.sin(angle), math.cos(angle))  # it jumps from π to −π
        place = [math.sin(angle), 1.0 - math.cos(angle), heading]
        return ReferenceState(
            np.array(place),
            np.array([turn, 0.0, turn]),
            np.zeros(3),
            robot.home + swing,
            np.full(n, 0.2 * math.cos(t)),
            np.full(n, -swing),
        )

    return state


def simulated(robot: Robot, log_every: int = 1) -> Run:
    """Return a short run in which a hidden effort and dry friction act and limits bind."""
    n = len(robot.actuators)
    bound = [Limit(name, "effort") for name in robot.actuators]
    count = iter(range(1000))

    def law(dynamics: ReducedDynamics, q: Array, nu: Array, command: Command) -> Efforts:
        k = next(count)
        return Efforts(0.3 * np.sin(0.3 * k + np.arange(n)), (bound[k // 9 % n],) * (k % 3 == 1))

    plant = Plant(tau_bias={robot.actuators[0]: 0.4}, joint_friction={robot.actuators[-1]: 0.1})
    return rpctl.track(
        robot,
        circling(robot),
        duration=COUNT * PERIOD,
        dynamic=law,
        control_period=PERIOD,
        plant=plant,
        log_every=log_every,
    )


@pytest.fixture(scope="module")
def run(robot: Robot) -> Run:
    """The run whose samples are all logged."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recorder, "BATCH", 7)
        return simulated(robot)


def test_a_slip_is_told(tmp_path: Path) -> None:
    """A base that moves 0.3 m/s to its left slides so; one wheel at 2 rad/s alone skids by 2 r."""
    robot = rpctl.load(write(tmp_path, platform(SET_A)))
    derivation = Derivation(ReducedDynamics(robot), Config())
    v = np.zeros((3, robot.nv))
    v[0, 1], v[1, robot.velocity_index("left_joint")] = 0.3, 2.0
    q = np.tile(robot.configuration(), (3, 1))
    found = derivation._motion(q, v)["constraint_residual"]
    np.testing.assert_allclose(found, [0.3, 2.0 * SET_A["r"], 0.0], atol=1e-12)


def test_columns_are_what_the_robot_says_of_each_sample(robot: Robot, run: Run) -> None:
    log, dynamics = run.log, ReducedDynamics(robot)
    simulated_dynamics = run.config.plant.simulated_dynamics(dynamics)
    contacts, data, reference = find_contacts(dynamics), robot.model.createData(), circling(robot)
    assert len(run.t) == COUNT + 1
    for k, (q, nu, tau) in enumerate(zip(run.q, run.nu, run.tau, strict=True)):
        at, state = dynamics.at(q), reference(float(run.t[k]))
        v, rates = at.S @ nu, at.B.T @ nu
        expected = {
            "rates": rates,
            "nu_ref": reference_rates(robot, state).nu,
            "joints": robot.joint_positions(q),
            "joints_ref": state.joints,
            "steering": [robot.joint_position(q, name) for name in run.robot.steering_names],
            "others": [robot.joint_position(q, name) for name in run.robot.other_names],
            "other_rates": [v[robot.velocity_index(name)] for name in run.robot.other_names],
            "energy": dynamics.energy(q, nu),
            "constraint_residual": np.abs(at.A @ v).max(initial=0.0),
        }
        base = np.stack([robot.base_pose(q), log.base[k], state.pose, log.base_ref[k]])
        for true, logged in (base[:2], base[2:]):
            np.testing.assert_allclose(true[:2], logged[:2], rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(
                np.exp(1j * true[2]), np.exp(1j * logged[2]), rtol=1e-12, atol=1e-12
            )
        if robot.end_effector is not None:
            actual = robot.end_effector_pose(data, q)
            wanted = end_effector_reference(robot, data, state)
            turn = pin.log3(actual.rotation.T @ wanted.rotation)
            expected |= {"ee": actual.translation, "ee_ref": wanted.translation}
            expected["ee_angle"] = np.linalg.norm(turn)
        if contacts is not None:
            push = tau + 0.4 * np.eye(len(tau))[0]
            ground = ground_reaction(simulated_dynamics, contacts, q, nu, push)
            expected |= {"wheel_force": ground.longitudinal, "axle_force": ground.lateral}
            expected |= {"contact_load": ground.load, "zmp": ground.zmp}
            if ground.tip_margin is not None:
                expected |= {"tip_margin": ground.tip_margin, "slip_ratio": ground.slip_ratio.max()}
        for name, value in expected.items():
            logged = getattr(log, name)[k]
            np.testing.assert_allclose(logged, value, rtol=1e-12, atol=1e-10, err_msg=name)


def test_headings_have_no_jumps(robot: Robot, run: Run) -> None:
    """The reference's goes round at 9 rad/s; each batch continues the one before."""
    if not robot.drive.base_speeds:
        return
    log = run.log
    np.testing.assert_allclose(log.base_ref[:, 2], 9.0 * log.t, atol=1e-9)
    assert log.base_ref[-1, 2] > math.pi
    assert np.abs(np.diff(log.base[:, 2])).max() < 1.0


def test_reference_robot_rolls_by_what_its_basis_says(robot: Robot, run: Run) -> None:
    """Euler's method by hand, wheels from 0; steering where the reference has it.

    Each step is from what is logged before it: where casters swing, rounding grows.
    """
    log, dynamics, reference = run.log, ReducedDynamics(robot), circling(robot)
    casters = {s.joint for s in robot.drive.swivels if s.role == "caster"}
    wheels = {wheel.joint for wheel in robot.drive.wheels}
    angles = dict.fromkeys(wheels, 0.0)
    angles |= {name: robot.joint_position(log.q[0], name) for name in casters}
    for k, t in enumerate(log.t.tolist()):
        state = reference(t)
        q = robot.configuration_at(state.pose, state.joints, steering(robot, state)[0])
        for name, angle in angles.items():
            robot.set_joint(q, name, angle)
        np.testing.assert_allclose(log.q_ref[k], q, rtol=1e-12, atol=1e-12)
        v = dynamics.basis(log.q_ref[k]) @ reference_rates(robot, state).nu
        logged = dict(zip(run.robot.wheels_ref, log.wheels_ref[k], strict=True))
        angles = {name: logged[name] + PERIOD * v[robot.velocity_index(name)] for name in angles}


@FEW
@pytest.mark.parametrize("every", cells((3, 8, 30), [8], [30]))
def test_every_nth_sample_and_the_last_are_rows_of_the_whole_log(
    robot: Robot, run: Run, every: int
) -> None:
    """Also what adds up over all samples: work, full turns, the reference's wheels."""
    whole, run = columns_of(run), simulated(robot, every)
    chosen = sorted({*range(0, COUNT + 1, every), COUNT})
    for name, column in columns_of(run).items():
        if name != "active_limits":
            expected = whole[name][chosen]
            np.testing.assert_allclose(column, expected, rtol=1e-12, atol=1e-12, err_msg=name)
    assert run.config.run.duration == pytest.approx(COUNT * PERIOD)
    assert any(f"one sample of {every} is logged" in note for note in run.notes)


@FEW
def test_limits_of_a_thinned_log_are_those_that_bind_at_its_samples(robot: Robot, run: Run) -> None:
    whole, thinned = run.log, simulated(robot, 4).log
    chosen = range(0, COUNT + 1, 4)
    expected = {
        limit: column[chosen].tolist()
        for limit, column in zip(whole.bound_limits, whole.active_limits.T, strict=True)
        if column[chosen].any()
    }
    assert expected
    columns = thinned.active_limits.T.tolist()
    assert dict(zip(thinned.bound_limits, columns, strict=True)) == expected


@pytest.mark.parametrize("every", [0, -1, 1.5, True, "2"])
def test_log_every_is_a_whole_number(paper: Robot, every: Any) -> None:
    with pytest.raises(RpctlError, match=f"log_every is {every}; give a whole number, 1 or more"):
        rpctl.track(paper, "line", duration=0.1, log_every=every)


def test_the_slip_of_a_run_is_that_of_its_fastest_contact(paper: Robot) -> None:
    """At 0.2 m/s ahead and 0.1 to the left with wheels that stand, all contacts slide by 0.2."""
    derivation = Derivation(ReducedDynamics(paper), Config())
    q, v = np.tile(paper.configuration(), (3, 1)), np.zeros((3, paper.nv))
    v[1, :2] = 0.2, 0.1
    v[2, 1] = -0.1
    slip = derivation._motion(q, v)["constraint_residual"]
    assert slip == pytest.approx([0.0, 0.2, 0.1])
