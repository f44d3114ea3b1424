"""The predictive law of an omnidirectional base: three inputs and outputs, each decays at 1/h."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import PaperKinematic, ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.error import base_error_rate, tracking_error
from rpctl.reference.motion import ReferenceState, reference_rates
from rpctl.reference.named import reference_by_name

LAW = PaperKinematic(horizon=0.4)
STEP = 1e-6


@pytest.fixture(scope="module")
def mecanum() -> Robot:
    return rpctl.load("mecanum")


def sideways(t: float, robot: Robot) -> ReferenceState:
    """Return a reference that also moves to the left: an eight with a sway of the base."""
    state = reference_by_name(robot, "eight")(t)
    twist, twist_dot = state.twist.copy(), state.twist_dot.copy()
    twist[1], twist_dot[1] = 0.2 * np.sin(t), 0.2 * np.cos(t)
    return state._replace(twist=twist, twist_dot=twist_dot)


def off(robot: Robot, pose: Array, rng: np.random.Generator) -> Array:
    return robot.configuration_at(pose + rng.normal(size=3) * [0.3, 0.3, 0.5], robot.home)


def test_the_law_changes_as_it_says(mecanum: Robot, rng: np.random.Generator) -> None:
    """ν̇_d against differences along an actual motion; the reference follows its own ν."""
    dynamics = ReducedDynamics(mecanum)
    for t in (2.0, 5.0, 9.0):
        state, nu = sideways(t, mecanum), rng.normal(size=mecanum.dof)
        q = off(mecanum, state.pose, rng)
        v = dynamics.basis(q) @ nu
        ahead_of = mecanum.configuration_at(state.pose, state.joints)
        v_ref = dynamics.basis(ahead_of) @ reference_rates(mecanum, state).nu

        def at(step: float) -> Array:
            moved = pin.integrate(mecanum.model, ahead_of, step * v_ref)  # noqa: B023
            then = sideways(t + step, mecanum)._replace(pose=mecanum.base_pose(moved))  # noqa: B023
            place = pin.integrate(mecanum.model, q, step * v)  # noqa: B023
            return LAW(dynamics, lambda _: then, 0.0, place, nu).nu_d  # noqa: B023

        command = LAW(dynamics, lambda _: state, 0.0, q, nu)  # noqa: B023
        slope = (at(STEP) - at(-STEP)) / (2 * STEP)
        np.testing.assert_allclose(command.nu_d_dot, slope, atol=1e-5 * np.abs(slope).max())


def test_every_output_decays(mecanum: Robot, rng: np.random.Generator) -> None:
    dynamics = ReducedDynamics(mecanum)
    for t in (2.0, 5.0, 9.0):
        state = sideways(t, mecanum)
        q = off(mecanum, state.pose, rng)
        nu_d = LAW(dynamics, lambda _: state, 0.0, q, np.zeros(mecanum.dof)).nu_d  # noqa: B023
        e = tracking_error(mecanum, state, q)
        rate = base_error_rate(e, state.twist, dynamics.twist(q, nu_d))
        np.testing.assert_allclose(rate, -e[:3] / LAW.horizon, atol=1e-12)
        rates = state.joint_rates - nu_d[3:]
        np.testing.assert_allclose(rates, -e[3:] / LAW.horizon, atol=1e-12)
