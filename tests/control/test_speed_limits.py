"""Commanded speeds: within every limit, the path kept, the base before the arm."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

import rpctl
from rpctl import Limit, ReducedDynamics, Robot, scale_limits, set_limits
from rpctl.arrays import Array
from rpctl.control.law import Command, Speeds
from rpctl.control.law_kernel import running_laws
from rpctl.control.velocity_output import VelocityOutput
from rpctl.dynamics.motion import follow, travel
from rpctl.errors import UnknownNameError
from tests.grids import cells


def limited(
    robot: Robot,
    wanted: Array,
    nu: Array | None = None,
    accelerations: dict[str, float] | None = None,
    period: float = 0.01,
    lag: float = 0.1,
    q: Array | None = None,
) -> Speeds:
    """Return the speeds that a robot at ν, at rest if not given, is sent for those wanted."""
    dynamics = ReducedDynamics(robot)
    q = robot.configuration_at(np.zeros(3), robot.home) if q is None else q
    nu = np.zeros(robot.dof) if nu is None else nu
    output = VelocityOutput(lag, accelerations=accelerations or {}, effort_ratio=1.0)
    running = running_laws(None, output, dynamics, period, None)
    running.model_nu[:] = nu
    # c = ν_d + (T + ½ T_s) ν̇_d
    assert running.follow(q, nu, Command(wanted, np.zeros(robot.dof)))
    return Speeds(running.answer.copy(), running.limits())


def strong(robot: Robot) -> Robot:
    """Return a robot whose efforts limit nothing."""
    return scale_limits(robot, effort=1e6)


def rates(robot: Robot, q: Array, nu: Array) -> dict[str, float]:
    """Return the ratio of each joint's rate to its velocity limit."""
    v, joint = ReducedDynamics(robot).basis(q) @ nu, robot.description.joint
    names = (n for n in robot.moving_joint_names if math.isfinite(joint[n].velocity))
    return {n: abs(v[robot.velocity_index(n)]) / joint[n].velocity for n in names}


@pytest.mark.parametrize("robot", ["paper", "mixed_chain"], indirect=True)
def test_what_is_within_all_limits_is_sent_as_it_is(robot: Robot) -> None:
    wanted = np.full(robot.dof, 1e-3)
    speeds = limited(robot, wanted)
    np.testing.assert_array_equal(speeds.nu, wanted)
    assert speeds.limits == ()


@pytest.mark.parametrize("name", ["paper", "tricycle", "omni"])
def test_no_limit_is_exceeded_whatever_is_wanted(name: str, rng: np.random.Generator) -> None:
    robot = rpctl.load(name)
    dynamics, box = ReducedDynamics(robot), robot.effort_limits
    wheels = slice(len(robot.actuators) - len(robot.joints))
    bound = 0
    for _ in range(30):
        q, lag = robot.random_configuration(rng), rng.uniform(0.0, 0.3)
        nu = rng.normal(size=robot.dof)
        nu /= max(1.0, *rates(robot, q, nu).values())
        wanted = 10.0 ** rng.uniform(-2.0, 2.0) * rng.normal(size=robot.dof)
        speeds = limited(robot, wanted, nu, period=0.01, lag=lag, q=q)
        assert max(rates(robot, q, speeds.nu).values()) <= 1.0
        after = follow(nu, speeds.nu[None], np.array([0.01]), np.full(robot.dof, lag))[0]
        still, moved = (
            np.abs(dynamics.efforts(q, dynamics.inverse(q, nu, a)))
            for a in (np.zeros(robot.dof), (after - nu) / 0.01)
        )
        held = still[wheels] <= box[wheels]
        assert (moved[wheels] <= box[wheels] * (1.0 + 1e-9))[held].all()
        bound += bool(speeds.limits)
        assert bool(speeds.limits) == (not np.array_equal(speeds.nu, wanted))
    assert bound > 10


def test_a_base_at_its_wheels_limit_keeps_the_curvature(paper: Robot) -> None:
    wanted = np.array([4.0, 3.0, 0.2, 0.1])
    speeds = limited(strong(paper), wanted)
    assert speeds.nu[0] < 3.0
    assert speeds.nu[1] / speeds.nu[0] == pytest.approx(0.75, rel=1e-12)
    np.testing.assert_array_equal(speeds.nu[2:], wanted[2:])  # the arm is not the base
    wheel = paper.actuators[1]  # the outer one of a turn to the left
    assert speeds.limits == (Limit(wheel, "velocity"),)
    q = paper.configuration_at(np.zeros(3), paper.home)
    assert rates(paper, q, speeds.nu)[wheel] == pytest.approx(1.0, abs=1e-8)


def test_a_joint_at_its_limit_slows_nothing_else(paper: Robot) -> None:
    joint = paper.joints[0]
    wanted = np.array([0.3, 0.2, -5.0 * joint.velocity, 0.1])
    speeds = limited(strong(paper), wanted)
    np.testing.assert_allclose(speeds.nu, [0.3, 0.2, -joint.velocity, 0.1], rtol=1e-8)
    assert speeds.limits == (Limit(joint.name, "velocity"),)


@pytest.mark.parametrize(
    ("lag", "sign"), cells(product((0.0, 0.1, 0.5), (-1.0, 1.0)), [(0.0, 1.0), (0.5, -1.0)])
)
def test_a_joint_comes_to_its_position_limit_and_not_beyond(
    paper: Robot, lag: float, sign: float
) -> None:
    robot, period = strong(paper), 0.02
    joint = robot.joints[1]
    limit = joint.upper if sign > 0.0 else joint.lower
    dynamics, lags = ReducedDynamics(robot), np.full(robot.dof, lag)
    q, nu = robot.configuration_at(np.zeros(3), robot.home), np.zeros(robot.dof)
    wanted, reached, kinds = np.array([0.0, 0.0, 0.0, 9.0 * sign]), list[float](), set[Limit]()
    for _ in range(200):
        speeds = limited(robot, wanted, nu, None, period, lag, q)
        nu, (stretch,) = follow(nu, speeds.nu[None], np.array([period]), lags)
        q = travel(dynamics, q, stretch)
        reached.append(float(robot.joint_positions(q)[1]))
        kinds |= {*speeds.limits}
    beyond = sign * (np.array(reached) - limit)
    assert beyond.max() < 1e-9
    assert beyond[-1] > -1e-3
    kind = "upper" if sign > 0.0 else "lower"
    assert kinds == {Limit(joint.name, kind), Limit(joint.name, "velocity")}


def test_efforts_bound_the_acceleration(paper: Robot) -> None:
    """On a straight line the wheels' efforts are all that counts: M₁₁ a = 2 τ/r."""
    weak = set_limits(paper, effort=dict.fromkeys(paper.actuators[:2], 1.5))
    dynamics = ReducedDynamics(weak)
    q = weak.configuration_at(np.zeros(3), weak.home)
    speeds = limited(weak, np.array([0.5, 0.0, 0.0, 0.0]), period=0.01, lag=0.0)
    taken = dynamics.efforts(q, dynamics.inverse(q, np.zeros(4), speeds.nu / 0.01))
    assert np.abs(taken[:2]).max() == pytest.approx(1.5, rel=1e-9)
    assert {limit.kind for limit in speeds.limits} == {"effort"}
    np.testing.assert_array_equal(speeds.nu[1:], 0.0)
    lagging = limited(weak, np.array([0.5, 0.0, 0.0, 0.0]), period=0.01, lag=0.1)
    assert lagging.nu[0] * -math.expm1(-0.1) == pytest.approx(speeds.nu[0], rel=1e-9)


def test_accelerations_of_the_base_are_bounded_in_proportion(paper: Robot) -> None:
    wanted, nu = np.array([1.0, 0.4, 0.3, 0.0]), np.array([0.2, 0.0, 0.0, 0.0])
    speeds = limited(strong(paper), wanted, nu, {"omega": 2.0}, period=0.02, lag=0.0)
    np.testing.assert_allclose(speeds.nu, [0.2 + 0.1 * 0.8, 0.1 * 0.4, 0.3, 0.0], rtol=1e-12)
    assert speeds.limits == (Limit("omega", "acceleration"),)


def test_the_base_comes_before_the_arm(paper: Robot) -> None:
    """Wheels that a jerk of the arm would overload slow the arm, not the base."""
    dynamics = ReducedDynamics(paper)
    q, a = paper.configuration_at(np.zeros(3), paper.home), np.array([0.3, 0.0, 0.0, 0.0])
    taken = float(np.abs(dynamics.efforts(q, dynamics.inverse(q, np.zeros(4), a))[:2]).max())
    weak = set_limits(paper, effort=dict.fromkeys(paper.actuators[:2], 1.01 * taken))
    speeds = limited(weak, np.array([0.003, 0.0, 0.0, 0.05]), lag=0.0)
    assert speeds.nu[0] == 0.003
    assert 0.0 < speeds.nu[3] < 0.05


def test_an_acceleration_of_nothing_is_refused(paper: Robot) -> None:
    with pytest.raises(UnknownNameError, match="quasi-velocity 'omgea' is not known; did you mean"):
        limited(paper, np.zeros(4), accelerations={"omgea": 1.0})
