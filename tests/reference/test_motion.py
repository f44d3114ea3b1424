"""References: consistent derivatives, inside the limits, end effector by forward kinematics."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.arrays import Array
from rpctl.errors import UnknownNameError
from rpctl.reference.motion import Reference, reference_rates
from rpctl.reference.named import BASE_PATHS, reference_by_name
from rpctl.robot.catalog import names
from tests.grids import cells

ROBOTS = names()
STEP = 1e-6


def difference(values: Callable[[float], Array], t: float) -> Array:
    return (values(t + STEP) - values(t - STEP)) / (2 * STEP)


def direction(reference: Reference, t: float) -> Array:
    found = reference(t).direction
    assert found is not None
    return found


@pytest.mark.parametrize("name", BASE_PATHS)
def test_speeds_and_accelerations_are_the_poses_derivatives(mixed_chain: Robot, name: str) -> None:
    reference = reference_by_name(mixed_chain, name)
    for t in np.linspace(0.05, 25.0, 40):
        state = reference(t)
        rate = difference(lambda x: reference(x).pose, t)
        rate[2] = math.remainder(rate[2] * 2 * STEP, 2 * math.pi) / (2 * STEP)
        v, _, omega = state.twist
        cos, sin = math.cos(state.pose[2]), math.sin(state.pose[2])
        np.testing.assert_allclose(rate, [v * cos, v * sin, omega], atol=1e-7)
        joint_rates = difference(lambda x: reference(x).joints, t)
        np.testing.assert_allclose(joint_rates, state.joint_rates, atol=1e-7)
        slope = difference(lambda x: reference_rates(mixed_chain, reference(x)).nu, t)
        nu, nu_dot = reference_rates(mixed_chain, state)
        np.testing.assert_allclose(slope, nu_dot, atol=1e-6)
        np.testing.assert_array_equal(nu, [v, omega, *state.joint_rates])
        assert state.direction is not None
        path = [difference(lambda x: direction(reference, x)[i], t) for i in (0, 1)]  # noqa: B023
        np.testing.assert_allclose(path, state.direction[1:], atol=2e-6)
        np.testing.assert_allclose(np.cross(state.direction[0], state.twist), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", cells(ROBOTS, ("paper",), ("tiago",)))
def test_arms_stay_inside_their_limits(name: str) -> None:
    robot = rpctl.load(name)
    reference = reference_by_name(robot, "eight")
    for t in np.linspace(0.0, 60.0, 400):
        state = reference(t)
        moved = zip(robot.joints, state.joints, state.joint_rates, strict=True)
        for joint, position, rate in moved:
            assert joint.lower <= position <= joint.upper
            assert abs(rate) <= joint.velocity


def test_a_fixed_base_moves_its_arm_only() -> None:
    panda = rpctl.load("panda")
    state = reference_by_name(panda, "eight")(5.0)
    assert reference_rates(panda, state).nu.shape == (panda.dof,)
    assert not state.pose.any()


def test_unknown_references_are_told(tiago: Robot) -> None:
    with pytest.raises(UnknownNameError, match="did you mean eight"):
        reference_by_name(tiago, "eigth")
