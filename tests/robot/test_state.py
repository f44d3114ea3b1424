"""States by names, there and back; the Jacobian of a link in ν."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rpctl


@pytest.mark.parametrize("name", ["paper", "mixed_chain", "car", "swerve", "tiago", "ur5"])
def test_a_state_comes_back(name: str) -> None:
    robot = rpctl.load(name)
    rng = np.random.default_rng(3)
    q, nu = robot.random_configuration(rng), rng.normal(size=robot.dof)
    again_q, again_nu = robot.state(**robot.state_of(q, nu)._asdict())
    np.testing.assert_allclose(again_q, q, atol=1e-14)
    np.testing.assert_array_equal(again_nu, nu)


def test_a_state_by_names() -> None:
    """A rate that nobody measures is not known; it was taken for rest."""
    robot = rpctl.load("paper")
    revolute, prismatic = robot.joint_names
    q, nu = robot.state(
        (1.0, 2.0, 0.5), (0.3, -0.2), joints={prismatic: 0.4}, rates={revolute: 0.7}
    )
    np.testing.assert_array_equal(nu, [0.3, -0.2, 0.7, np.nan])
    np.testing.assert_array_equal(q, robot.configuration(1.0, 2.0, 0.5, joints={prismatic: 0.4}))
    state = robot.state_of(q, nu)
    assert state.pose == pytest.approx((1.0, 2.0, 0.5))
    assert state.twist == (0.3, -0.2)
    assert state.joints[prismatic] == pytest.approx(0.4)
    assert state.rates == pytest.approx({revolute: 0.7, prismatic: np.nan}, nan_ok=True)
    assert np.isnan(robot.state()[1]).all()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"pose": (0.0, 1.0)}, "must be x, y in m and a heading in rad"),
        ({"twist": (0.3,)}, "must be v, omega of paper"),
        ({"joints": {"no_joint": 1.0}}, "'no_joint' is not known"),
        ({"rates": {"wheel_left_joint": 1.0}}, "joint of the arm 'wheel_left_joint' is not known"),
        ({"pose": (0.0, float("nan"), 0.0)}, "not finite"),
        ({"twist": (0.0, float("inf"))}, "not finite"),
    ],
)
def test_wrong_states_are_refused(given: dict[str, object], message: str) -> None:
    with pytest.raises(rpctl.RpctlError, match=message):
        rpctl.load("paper").state(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["mixed_chain", "car", "mecanum"])
def test_the_jacobian_is_the_links_velocity(name: str) -> None:
    """Against finite differences of the link's pose along the motion that ν makes."""
    robot = rpctl.load(name)
    dynamics, rng = rpctl.ReducedDynamics(robot), np.random.default_rng(1)
    q, nu, step = robot.random_configuration(rng), rng.normal(size=robot.dof), 1e-6
    v, data = dynamics.basis(q) @ nu, robot.model.createData()
    for link in (robot.description.root, robot.end_effector or robot.drive.wheels[0].joint):
        frame = robot.model.getFrameId(link)
        poses = []
        for sign in (-1.0, 1.0):
            pin.forwardKinematics(robot.model, data, pin.integrate(robot.model, q, sign * step * v))
            poses.append(pin.updateFramePlacement(robot.model, data, frame).copy())
        velocity = (poses[1].translation - poses[0].translation) / (2.0 * step)
        turning = pin.log3(poses[1].rotation @ poses[0].rotation.T) / (2.0 * step)
        if not robot.model.existBodyName(link):
            continue
        found = rpctl.ReducedDynamics(robot).jacobian(q, link) @ nu
        np.testing.assert_allclose(found, [*velocity, *turning], atol=1e-8)
