"""The predictive law of a holonomic base: three inputs, three outputs, each decays at 1/h."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import PaperKinematic, ReducedDynamics, Robot
from rpctl.control.error import error_rate, tracking_error
from rpctl.description.records import Array
from rpctl.reference.motion import ReferenceState, reference_by_name

LAW = PaperKinematic(horizon=0.4)
STEP = 1e-6


@pytest.fixture(scope="module")
def mecanum() -> Robot:
    return rpctl.load("mecanum")


def sideways(t: float, robot: Robot) -> ReferenceState:
    """Return a reference that also moves to the left: an eight with a sway of the base."""
    state = reference_by_name(robot, "eight")(t)
    nu, nu_dot = state.nu.copy(), state.nu_dot.copy()
    nu[1], nu_dot[1] = 0.2 * np.sin(t), 0.2 * np.cos(t)
    return state._replace(nu=nu, nu_dot=nu_dot)


def off(robot: Robot, pose: Array, rng: np.random.Generator) -> Array:
    return robot.configuration_at(pose + rng.normal(size=3) * [0.3, 0.3, 0.5], robot.home)


def test_errors_and_law_change_as_they_say(mecanum: Robot, rng: np.random.Generator) -> None:
    """ė and ν̇_d against differences along an actual motion; the reference follows its own ν."""
    dynamics = ReducedDynamics(mecanum)
    for t in (2.0, 5.0, 9.0):
        state, nu = sideways(t, mecanum), rng.normal(size=mecanum.dof)
        q = off(mecanum, state.pose, rng)
        v = dynamics.basis(q) @ nu
        ahead_of = mecanum.configuration_at(state.pose, state.joints)
        v_ref = dynamics.basis(ahead_of) @ state.nu

        def at(step: float) -> tuple[Array, Array]:
            moved = pin.integrate(mecanum.model, ahead_of, step * v_ref)  # noqa: B023
            then = sideways(t + step, mecanum)._replace(pose=mecanum.base_pose(moved))  # noqa: B023
            e = tracking_error(mecanum, then, pin.integrate(mecanum.model, q, step * v))  # noqa: B023
            return e, LAW(then, e, nu).nu_d  # noqa: B023

        (e_ahead, nu_ahead), (e_behind, nu_behind) = at(STEP), at(-STEP)
        e = tracking_error(mecanum, state, q)
        rate, command = error_rate(e, state, nu), LAW(state, e, nu)
        np.testing.assert_allclose((e_ahead - e_behind) / (2 * STEP), rate, atol=1e-6)
        slope = (nu_ahead - nu_behind) / (2 * STEP)
        np.testing.assert_allclose(command.nu_d_dot, slope, atol=1e-5 * np.abs(slope).max())


def test_every_output_decays(mecanum: Robot, rng: np.random.Generator) -> None:
    for t in (2.0, 5.0, 9.0):
        state = sideways(t, mecanum)
        e = tracking_error(mecanum, state, off(mecanum, state.pose, rng))
        nu_d = LAW(state, e, np.zeros(mecanum.dof)).nu_d
        np.testing.assert_allclose(error_rate(e, state, nu_d), -e / LAW.horizon, atol=1e-12)
