"""The end effector first: its error vanishes at its horizon, term by term and in motion."""

from __future__ import annotations

import math
from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import (
    Disc,
    Horizon,
    PaperKinematic,
    ReducedDynamics,
    Robot,
    RpctlError,
)
from rpctl.arrays import Array
from rpctl.control import end_effector
from rpctl.control.end_effector import EndEffector, Nearest, Task, nearest
from rpctl.control.error import tracking_error
from rpctl.control.law import Command, KinematicLaw, as_law
from rpctl.reference.motion import Reference, ReferenceState, end_effector_reference
from rpctl.reference.named import reference_by_name
from tests.grids import cells
from tests.robots import SET_B, platform, write
from tests.vehicles import vehicle

STEP = 1e-6
SLOW = PaperKinematic()  # a law of the base that leaves the arm enough to do


@pytest.fixture(scope="module")
def any_robot(request: pytest.FixtureRequest) -> Robot:
    """Of TIAGo the arm has more joints than a position takes, though not all of its own."""
    lock = ["arm_[67]_joint", "head_*"] if request.param == "tiago" else []
    return rpctl.load(request.param, lock=lock)


def beside(robot: Robot, reference: Reference, error: tuple[float, float, float]) -> Array:
    """Return q (nq,) whose base is off the reference's start, arm on it."""
    state = reference(0.0)
    return robot.configuration_at(state.pose - np.array(error), state.joints)


def obey(
    law: KinematicLaw,
    robot: Robot,
    reference: Reference,
    q: Array,
    duration: float,
) -> tuple[Array, Array, Array]:
    """Move a robot that does at once what the law asks (midpoint rule, 100 Hz).

    Returns:
        Times (K,), configurations (K, nq) and what was asked there (K, dof).
    """
    dynamics, step = ReducedDynamics(robot), 0.01
    controller = law.start(dynamics, step)
    still = np.zeros(robot.dof)
    times = np.arange(0.0, duration, step)
    path, asked = [], []
    for t in times:
        nu = controller(dynamics, reference, t, q, still).nu_d
        path.append(q)
        asked.append(nu)
        half = pin.integrate(robot.model, q, 0.5 * step * dynamics.basis(q) @ nu)
        nu = controller(dynamics, reference, t + 0.5 * step, half, still).nu_d
        q = pin.integrate(robot.model, q, step * dynamics.basis(half) @ nu)
    return times, np.array(path), np.array(asked)


def errors(robot: Robot, reference: Reference, times: Array, path: Array) -> tuple[Array, Array]:
    """Return distance (m) and angle (rad) of the end effector from its reference, (K,) each."""
    data, gaps = robot.model.createData(), []
    for t, q in zip(times, path, strict=True):
        is_at = robot.end_effector_pose(data, q)
        should = end_effector_reference(robot, data, reference(t))
        turn = pin.log3(is_at.rotation.T @ should.rotation)
        gaps.append([np.linalg.norm(v) for v in (should.translation - is_at.translation, turn)])
    distance, angle = np.array(gaps).T
    return distance, angle


@pytest.mark.parametrize(
    ("any_robot", "orientation"),
    cells(
        product(("mecanum", "tiago"), (False, True)),
        [("mecanum", False), ("mecanum", True), ("tiago", False)],
    ),
    indirect=["any_robot"],
)
def test_the_derivative_is_that_of_the_law_along_the_actual_motion(
    any_robot: Robot, rng: np.random.Generator, orientation: bool
) -> None:
    """Bounds are active in some of these states."""
    reference, dynamics = reference_by_name(any_robot, "eight"), ReducedDynamics(any_robot)
    law = EndEffector(base=SLOW, orientation=orientation).start(dynamics, 0.01)
    wheeled = bool(any_robot.drive.base_speeds)
    for t in (2.0, 5.0, 9.0, 14.0):
        nu = rng.normal(size=any_robot.dof)
        pose = reference(t).pose + wheeled * rng.normal(size=3) * [0.1, 0.1, 0.2]
        joints = any_robot.home + 0.05 * rng.normal(size=len(any_robot.joints))
        q = any_robot.configuration_at(pose, joints)
        v = dynamics.basis(q) @ nu

        def asked(s: float) -> Array:
            at = pin.integrate(any_robot.model, q, s * v)  # noqa: B023 - called in this turn only
            return law(dynamics, reference, t + s, at, nu).nu_d  # noqa: B023

        rate = law(dynamics, reference, t, q, nu).nu_d_dot
        slope = (asked(STEP) - asked(-STEP)) / (2 * STEP)
        np.testing.assert_allclose(rate, slope, atol=1e-6 * (1 + np.abs(rate).max()))


def test_the_error_decays_at_the_horizon_while_the_base_converges(tiago: Robot) -> None:
    reference, law = reference_by_name(tiago, "eight"), EndEffector(base=SLOW)
    times, path, _ = obey(law, tiago, reference, beside(tiago, reference, (0.04, 0.06, 0.1)), 1.6)
    distance, _ = errors(tiago, reference, times, path)
    np.testing.assert_allclose(distance, distance[0] * np.exp(-times / law.horizon), rtol=0.01)
    base = [tracking_error(tiago, reference(times[k]), path[k])[:2] for k in (0, -1)]
    assert np.linalg.norm(base[1]) > 0.4 * np.linalg.norm(base[0])
    assert distance[-1] < 0.02 * distance[0]


def unbounded(task: Task, strongest: float) -> Nearest:
    wide = np.full(len(task.posture), np.inf)
    return nearest(task._replace(lower=-wide, upper=wide), strongest)


@pytest.mark.slow
def test_limits_hold_where_the_end_effector_would_break_them(
    tiago: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    reference = reference_by_name(tiago, "eight")
    lower, upper, fastest = (
        np.array([getattr(joint, key) for joint in tiago.joints])
        for key in ("lower", "upper", "velocity")
    )

    def worst() -> tuple[float, float]:
        """Return how far positions leave their limits, and the largest share of full speed."""
        q = beside(tiago, reference, (0.3, 0.5, 0.8))
        _, path, asked = obey(EndEffector(base=SLOW), tiago, reference, q, 4.0)
        positions = np.array([tiago.joint_positions(q) for q in path])
        beyond = float(np.maximum(positions - upper, lower - positions).max())
        return beyond, float((np.abs(asked[:, 2:]) / fastest).max())

    beyond, share = worst()
    assert beyond <= 0.0
    assert share <= 1.0 + 1e-12
    monkeypatch.setattr(end_effector, "nearest", unbounded)
    beyond, share = worst()
    assert beyond > 0.1
    assert share > 1.1


@pytest.mark.slow
def test_rates_stay_bounded_near_a_stretched_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    """A UR5 with its elbow almost straight, asked to draw its hand in along the arm."""
    robot = rpctl.load("ur5")
    dynamics = ReducedDynamics(robot)
    law = EndEffector(base=SLOW).start(dynamics, 0.01)
    monkeypatch.setattr(end_effector, "nearest", unbounded)
    reference = reference_by_name(robot, "eight")
    goal = reference(0.0)._replace(joints=np.array([0.0, 0.0, 0.5, 0.0, 0.0, 0.0]))
    for bend in np.logspace(-9, -1, 17):
        joints = np.array([0.0, 0.0, bend, -0.5 * math.pi, 0.0, 0.0])
        q = robot.configuration_at(goal.pose, joints)
        rates = law(dynamics, lambda _: goal, 0.0, q, np.zeros(6)).nu_d
        assert np.abs(rates - (goal.joints - joints) / 0.8).max() < 10.0
    J = dynamics.jacobian(q, str(robot.end_effector))[:3]  # at the largest bend
    assert np.linalg.svd(J)[1][-1] < 0.05  # without damping the rates would go with 1/bend


@pytest.mark.slow
def test_the_whole_robot_follows() -> None:
    """With the dynamics: the second of 2 s beside the paper's law, joints within their limits."""
    tiago = rpctl.load("tiago", home="zero")  # the arm half stretched: it reaches over the error
    rms = {}
    fastest = [joint.velocity for joint in tiago.joints]
    for law in (PaperKinematic(), EndEffector(base=SLOW)):
        run = rpctl.track(
            tiago,
            "eight",
            duration=2.0,
            initial_error=(0.3, 0.5, 0.8),
            kinematic=law,
            dynamic=rpctl.PaperDynamic(),
            collisions=False,
        )
        distance = np.linalg.norm(run.log.ee - run.log.ee_ref, axis=1)
        assert (np.abs(run.nu[:, 2:]) <= fastest).all()
        assert (
            (run.log.joints >= run.robot.lower_limits) & (run.log.joints <= run.robot.upper_limits)
        ).all()
        rms[type(law)] = math.sqrt(float(np.mean(distance[500:] ** 2)))
    assert rms[EndEffector] < 0.15 * rms[PaperKinematic]


def test_robots_without_an_arm_are_told(tmp_path: Path) -> None:
    robot = rpctl.load(write(tmp_path, platform(SET_B)))
    with pytest.raises(RpctlError, match=r"platform has no arm.*take a kinematic law of the base"):
        EndEffector(base=SLOW).start(ReducedDynamics(robot), 0.01)


def test_obstacles_of_the_end_effector_are_not_passed_over() -> None:
    base = Horizon(end_effector_obstacles=(Disc(1.0, 0.0, 0.2),))
    with pytest.raises(RpctlError, match="avoid end_effector_obstacles; take the horizon"):
        EndEffector(base=base)
    EndEffector(base=Horizon(base_obstacles=(Disc(1.0, 0.0, 0.2),)))


NOW = 4.0  # s
REACH = 0.5  # m: of the boom
BOOM = f"""<link name="boom"><inertial><origin xyz="0.2 0 0"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link>
  <joint name="boom_joint" type="revolute"><parent link="base"/><child link="boom"/>
  <origin xyz="0.1 0 0.5"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="9" velocity="5"/></joint>
  <link name="tip"/><joint name="tip_joint" type="fixed"><parent link="boom"/><child link="tip"/>
  <origin xyz="{REACH} 0 0"/></joint>"""
HAND = """<link name="hand"/><joint name="hand_joint" type="fixed"><parent link="arm"/>
  <child link="hand"/><origin xyz="0.5 -0.2 0.1"/></joint></robot>"""


def asks(change: Array, start: Array) -> KinematicLaw:
    """Return a law that asks for ν at time ``NOW``, changing at a constant rate."""

    def law(dynamics: ReducedDynamics, reference: Reference, t: float, *_: Array) -> Command:
        return Command(start + (t - NOW) * change, change)

    return as_law(law)


@pytest.fixture
def boomed(tmp_path: Path) -> Robot:
    return rpctl.load(write(tmp_path, platform(SET_B, extra=BOOM)), end_effector="tip")


@pytest.mark.parametrize("lever", [0.3, 2.0])
def test_the_lever_weighs_turning_against_travelling(boomed: Robot, lever: float) -> None:
    """One joint cannot mend both: the least of (d q̇ − a)² + L² (q̇ − b)² is at
    (d a + L² b)/(d² + L²), with a = aside/h and b = turned/h."""
    dynamics, still = ReducedDynamics(boomed), np.zeros(boomed.dof)
    law = EndEffector(base=asks(still, still), orientation=True, lever=lever, damping=1e-6)
    started = law.start(dynamics, 0.01)
    state = ReferenceState(*np.zeros((3, 3)), *np.zeros((3, 1)))
    aside, turned, d = 0.02, 0.03, REACH
    away = boomed.configuration_at(np.array([0.0, -aside, 0.0]), np.zeros(1))
    bent = boomed.configuration_at(np.zeros(3), np.array([-turned]))
    rate = started(dynamics, lambda t: state, NOW, away, still).nu_d[2]
    assert rate == pytest.approx(d * aside / law.horizon / (d**2 + lever**2), rel=1e-4)
    # A bent boom needs turned/h for either: nothing is weighed.
    rate = started(dynamics, lambda t: state, NOW, bent, still).nu_d[2]
    assert rate == pytest.approx(turned / law.horizon, rel=1e-2)
    # A boom that is bent, its tip where it should be: only turning is left to mend.
    hub, tip = np.array([0.1, 0.0]), np.array([0.1 + d, 0.0])
    swung = hub + d * np.array([np.cos(turned), -np.sin(turned)])
    moved = boomed.configuration_at(np.array([*(tip - swung), 0.0]), np.array([-turned]))
    rate = started(dynamics, lambda t: state, NOW, moved, still).nu_d[2]
    expected = lever**2 * turned / law.horizon / (d**2 + lever**2)
    assert rate == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(("kind", "orientation"), [("car-like", False), ("steered", True)])
def test_the_derivative_knows_that_steering_turns_the_basis(
    tmp_path: Path, kind: str, orientation: bool, rng: np.random.Generator
) -> None:
    """The rates of S(q) ν_d, whatever the base does by now; no bound holds the arm's rate."""
    text = vehicle(kind).replace("</robot>", HAND)
    robot = rpctl.load(write(tmp_path, text), end_effector="hand")
    dynamics, reference = ReducedDynamics(robot), reference_by_name(robot, "eight")
    pose, *_, (arm,), _, _, _ = reference(NOW)
    for _ in range(3):
        nu, nu_d, change = 0.3 * rng.normal(size=(3, robot.dof))
        law = EndEffector(base=asks(change, nu_d), orientation=orientation).start(dynamics, 0.01)
        steered = {s.joint: a for s, a in zip(robot.drive.steered, (0.4, -0.3), strict=False)}
        x, y, theta = pose + 0.02 * rng.normal(size=3)
        q = robot.configuration(x, y, theta, joints={**steered, "arm_joint": arm + 0.1})
        v = dynamics.basis(q) @ nu

        def asked(s: float) -> Array:
            at = pin.integrate(robot.model, q, s * v)  # noqa: B023 - called in this turn only
            return law(dynamics, reference, NOW + s, at, nu).nu_d  # noqa: B023

        assert abs(arm + 0.1 + 0.4 * asked(0.0)[-1]) < 1.1  # h later; its limits are ±1.2 rad
        slope = (asked(STEP) - asked(-STEP)) / (2 * STEP)
        rate = law(dynamics, reference, NOW, q, nu).nu_d_dot
        np.testing.assert_allclose(rate, slope, atol=1e-6 * (1 + np.abs(slope).max()))


def test_rates_stop_at_limits_by_paper_and_pencil(boomed: Robot) -> None:
    """Of a boom that reaches .5 m and turns at up to 5 rad/s, between ±2 rad; h = .4 s."""
    dynamics, still = ReducedDynamics(boomed), np.zeros(boomed.dof)
    state = ReferenceState(*np.zeros((3, 3)), *np.zeros((3, 1)))

    def rate(aside: float, bend: float, damping: float = 1e-6) -> float:
        law = EndEffector(base=asks(still, still), damping=damping).start(dynamics, 0.01)
        q = boomed.configuration_at(np.array([0.0, -aside, 0.0]), np.array([bend]))
        return float(law(dynamics, lambda t: state, NOW, q, still).nu_d[-1])

    assert rate(0.1, 0.0) == pytest.approx(0.1 / 0.4 / 0.5, rel=1e-4)  # nothing binds
    assert rate(3.0, 0.0) == pytest.approx(4.5, rel=1e-12)  # .9 of its speed
    assert rate(-3.0, 0.0) == pytest.approx(-4.5, rel=1e-12)
    assert rate(3.0, 1.0) == pytest.approx(2.5, rel=1e-12)  # (2 - 1)/h: its position's limit
    assert rate(-3.0, -0.8) == pytest.approx(-3.0, rel=1e-12)
    # Its full speed, 1 rad/s, moves the tip at σ = .5 m/s: at most σ/damping of full speed.
    assert rate(3.0, 0.0, damping=1.0) == pytest.approx(0.5, rel=1e-9)
