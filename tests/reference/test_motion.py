"""References: consistent derivatives, inside the limits, end effector by forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import Robot
from rpctl.errors import UnknownNameError
from rpctl.reference.motion import reference_rates
from rpctl.reference.named import BASE_PATHS, reference_by_name
from rpctl.robot.catalog import names
from tests.grids import cells
from tests.reference.differences import check_derivatives

ROBOTS = names()
STEP = 1e-6


@pytest.mark.parametrize("name", BASE_PATHS)
def test_speeds_and_accelerations_are_the_poses_derivatives(mixed_chain: Robot, name: str) -> None:
    reference = reference_by_name(mixed_chain, name)
    check_derivatives(reference, np.linspace(0.05, 25.0, 40))
    for t in np.linspace(0.05, 25.0, 40):
        state, before, after = reference(t), reference(t - STEP), reference(t + STEP)
        nu, nu_dot = reference_rates(mixed_chain, state)
        np.testing.assert_array_equal(nu, [*state.twist[[0, 2]], *state.joint_rates])
        ends = (reference_rates(mixed_chain, each).nu for each in (after, before))
        np.testing.assert_allclose(np.subtract(*ends) / (2 * STEP), nu_dot, atol=1e-6)
        assert state.direction is not None
        np.testing.assert_allclose(np.cross(state.direction[0], state.twist), 0.0, atol=1e-12)


@pytest.mark.parametrize("name", cells(ROBOTS, ("mixed_chain",)))
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
