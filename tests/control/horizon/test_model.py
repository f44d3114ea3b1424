"""The prediction: where it leads, and its derivatives against differences."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics
from rpctl.arrays import Array
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.target import EndEffectorKinematics, Target
from tests.differences import slopes
from tests.robots import write
from tests.vehicles import vehicle

STEP = 1e-6
NEAR = 1e-6  # of central differences, relative
STEPS, DT = 4, 0.05


SWIVELS = ["car-like", "twin", "casters"]


@pytest.fixture(scope="module", params=["mixed_chain", "mecanum", "panda", *SWIVELS])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Model:
    source = request.param
    if source in SWIVELS:
        source = write(tmp_path_factory.mktemp("vehicles"), vehicle(source))
    return Model(ReducedDynamics(rpctl.load(source)), STEPS, DT)


def state(model: Model, rng: np.random.Generator) -> tuple[Array, Array, Array, Array]:
    robot = model.robot
    pose = rng.normal(size=3) if model.base else np.zeros(3)
    joints = 0.1 * rng.normal(size=len(model.joints))
    joints[model.steered :] += robot.home
    return pose, joints, rng.normal(size=robot.dof), rng.normal(size=(STEPS, robot.dof))


def test_it_leads_where_the_motion_leads(model: Model, rng: np.random.Generator) -> None:
    """Against fine steps on the manifold; halving the step quarters what is left."""
    robot, dynamics = model.robot, model.dynamics
    pose, joints, nu, nu_dot = state(model, rng)
    gaps = []
    for split in (1, 2):
        fine = Model(dynamics, split * STEPS, DT / split)
        q, at = model.configuration(joints, pose), nu.copy()
        motion = fine.predict(q, nu, np.repeat(nu_dot, split, axis=0))
        count = 400
        for k in range(STEPS * count):
            middle = at + 0.5 * DT / count * nu_dot[k // count]
            q = pin.integrate(robot.model, q, DT / count * (dynamics.basis(q) @ middle))
            at = at + DT / count * nu_dot[k // count]
        gaps.append(np.abs(motion.pose[-1] - robot.base_pose(q))[:2].max())
        np.testing.assert_allclose(motion.joints[-1], model.joint_positions(q), atol=1e-9)
        np.testing.assert_allclose(motion.nu[-1], at, atol=1e-9)
    assert gaps[0] < 2e-3
    assert gaps[1] < 0.3 * gaps[0] + 1e-7


def test_the_jacobian_is_that_of_the_prediction(model: Model, rng: np.random.Generator) -> None:
    if not model.base:
        pytest.skip("a fixed base has no jacobian")
    pose, joints, nu, nu_dot = state(model, rng)
    motion = model.predict(model.configuration(joints, pose), nu, nu_dot)

    moving = model.base_columns
    ends = np.cumsum([1, model.steered, moving])
    places = slice(2, 3), slice(model.steered), slice(moving), slice(moving)

    def moved(at: list[Array], beside: Array) -> Array:
        pose, joints, nu, nu_dot = parts = [part.copy() for part in at]
        for part, place, values in zip(parts, places, np.split(beside, ends), strict=True):
            part[place] = values
        q = model.configuration(joints, pose)
        return model.predict(q, nu, np.tile(nu_dot, (STEPS, 1))).pose[1] - pose

    for k in range(STEPS):
        at = [part[k] for part in motion[1:5]]  # pose, joints, ν and ν̇
        beside = np.concatenate([part[place] for part, place in zip(at, places, strict=True)])
        found = slopes(partial(moved, at), beside, STEP)
        np.testing.assert_allclose(motion.jacobian[k], found, atol=NEAR)


def test_the_end_effectors_jacobian(model: Model, rng: np.random.Generator) -> None:
    pose, joints, *_ = state(model, rng)
    arm = EndEffectorKinematics(model, [0])
    motion = Target(np.tile(pose, (2, 1)), np.tile(joints, (2, 1)), np.empty(0))
    _, (position,), (jacobian,) = arm(motion)
    data, both = model.robot.model.createData(), np.concatenate([pose, joints])

    def place(at: Array) -> Array:
        found = model.robot.end_effector_pose(data, model.configuration(at[3:], at[:3]))
        return np.array(found.translation)

    np.testing.assert_allclose(position, place(both), atol=1e-12)
    np.testing.assert_allclose(jacobian, slopes(place, both, STEP), atol=NEAR)
