"""The prediction: where it leads, and its derivatives against differences."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array
from rpctl.control.horizon.constraints import ForceBounds
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.settings import Bounds
from rpctl.control.horizon.target import EndEffectorKinematics, Sample, Target
from rpctl.dynamics.ground_reaction import find_contacts, ground_reaction
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
    jacobian = model.jacobian(motion)

    def after(pose: Array, joints: Array, nu: Array, nu_dot: Array) -> Array:
        held = np.tile(nu_dot, (STEPS, 1))
        return model.predict(model.configuration(joints, pose), nu, held).pose[1]

    for k in range(STEPS):
        at = [motion.pose[k], motion.joints[k], motion.nu[k], motion.nu_dot[k]]

        def change(part: int, index: int) -> Array:
            ends = []
            for sign in (1.0, -1.0):
                moved = [values.copy() for values in at]  # noqa: B023
                moved[part][index] += sign * STEP
                ends.append(after(*moved))
            return (ends[0] - ends[1]) / (2.0 * STEP)

        np.testing.assert_allclose(jacobian.heading[k], change(0, 2)[:2], atol=NEAR)
        for index in range(model.base_columns):
            np.testing.assert_allclose(jacobian.nu[k, :, index], change(2, index), atol=NEAR)
            np.testing.assert_allclose(jacobian.nu_dot[k, :, index], change(3, index), atol=NEAR)
        for index in range(model.steered):
            np.testing.assert_allclose(jacobian.steering[k, :, index], change(1, index), atol=NEAR)


def test_the_end_effectors_jacobian(model: Model, rng: np.random.Generator) -> None:
    pose, joints, *_ = state(model, rng)
    arm = EndEffectorKinematics(model, [0])
    position, jacobian = arm.jacobian(pose, joints)
    expected = model.robot.end_effector_pose(
        model.robot.model.createData(), model.configuration(joints, pose)
    )
    np.testing.assert_allclose(position, expected.translation, atol=1e-12)
    both = np.concatenate([pose, joints]) if model.base else joints
    for column in range(len(both)):
        step = STEP * np.eye(len(both))[column]
        ends = [
            arm.position(*(np.split(moved, [3]) if model.base else (pose, moved)))
            for moved in (both + step, both - step)
        ]
        np.testing.assert_allclose(jacobian[:, column], (ends[0] - ends[1]) / (2 * STEP), atol=NEAR)


@pytest.mark.parametrize("name", ["paper", "tiago", "mecanum"])
def test_forces_and_their_jacobian(name: str, rng: np.random.Generator) -> None:
    robot: Robot = rpctl.load(name)
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    model = Model(dynamics, STEPS, DT)
    forces = ForceModel(model, contacts, tip_margin=0.02, grip=0.9)
    margins = forces.ground
    assert margins is not None
    _, joints, nu, nu_dot = state(model, rng)
    nu, nu_dot = 0.3 * nu, 0.3 * nu_dot[0]
    q = robot.configuration_at(rng.normal(size=3), joints)
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot))
    full = forces.at(q, nu, nu_dot, robot.dof, model.base_columns)
    np.testing.assert_allclose(forces.efforts(full)[:, 0], tau, atol=1e-9)

    # The least row of the polygon's edges is the margin, at the share of the weight that bears.
    ground = ground_reaction(dynamics, contacts, q, nu, tau)
    edges = margins.rows - 8 * len(contacts.along)
    weight = robot.mass * 9.81
    rows = margins(full)
    assert ground.tip_margin is not None
    expected = (ground.tip_margin - 0.02) * ground.force[2] / weight
    assert rows[:edges, 0].min() == pytest.approx(expected, abs=1e-9)

    def value(nu: Array, nu_dot: Array) -> Array:
        found = forces.at(q, nu, nu_dot)
        efforts, room = forces.efforts(found), margins(found)
        return np.concatenate([efforts[:, 0], room[:edges, 0]])

    jacobian = np.vstack([forces.efforts(full), rows[:edges]])
    for column in range(robot.dof):
        step = np.eye(robot.dof)[column]
        by = 0.5 * (value(nu, nu_dot + step) - value(nu, nu_dot - step))
        np.testing.assert_allclose(jacobian[:, 1 + column], by, atol=1e-9)
    for column in range(model.base):
        step = np.eye(robot.dof)[column]
        by = 0.5 * (value(nu + step, nu_dot) - value(nu - step, nu_dot))
        np.testing.assert_allclose(jacobian[:, 1 + robot.dof + column], by, atol=1e-9)


def test_contacts_that_let_go_and_take_hold_bound_both_ways(tiago: Robot) -> None:
    """Braking lifts TIAGo's rear casters: the grip of before binds on, beside that of now."""
    dynamics = ReducedDynamics(tiago)
    model, bounds = Model(dynamics, STEPS, DT), Bounds()
    forces = ForceModel(model, find_contacts(dynamics), bounds.tip_margin, bounds.grip)
    margins = forces.ground
    assert margins is not None
    rows, still = ForceBounds(model, bounds, forces), np.zeros((STEPS, tiago.dof))
    q, nu = tiago.configuration(), np.eye(tiago.dof)[0] * 0.4
    load_splits, found = [], []
    for braking in (0.0, -1.5):
        motion = model.predict(q, nu, still + braking * np.eye(tiago.dof)[0])
        now = rows.linearise(Sample(motion, Target(motion.pose, motion.joints, motion.nu), None))[1]
        at = forces.at(q, nu, motion.nu_dot[0], measured=dynamics)
        load_splits.append(margins.load_split(at))
        found.append((-now.value[0], [margins.grip(at, piece)[:, 0] for piece in load_splits]))
    assert not np.array_equal(load_splits[0], load_splits[1])
    assert found[0][0].shape == found[1][0].shape
    for has, (_, wanted) in zip((found[0][0], found[1][0]), found, strict=True):
        assert has[-len(load_splits) * 16 :].min() == min(each.min() for each in wanted)
    assert found[1][1][0].min() != found[1][1][1].min()


def test_rows_of_the_grip_tell_slipping(rng: np.random.Generator) -> None:
    """Wherever a polygon's row is positive the wheel keeps its share of the grip."""
    robot = rpctl.load("paper")
    dynamics = ReducedDynamics(robot)
    contacts = find_contacts(dynamics)
    assert contacts is not None
    model = Model(dynamics, STEPS, DT)
    forces = ForceModel(model, contacts, tip_margin=0.02, grip=0.9)
    margins = forces.ground
    assert margins is not None
    said = set()
    for _ in range(300):
        nu, nu_dot = rng.normal(size=(2, robot.dof)) * [[1.0, 1.0, 0.3, 0.1], [2.0, 2.0, 0.3, 0.1]]
        q = robot.configuration_at(np.zeros(3), robot.home)
        tau = dynamics.efforts(q, dynamics.inverse(q, nu, nu_dot))
        ground = ground_reaction(dynamics, contacts, q, nu, tau)
        if ground.load.min() <= 0.0:
            continue
        rows = margins(forces.at(q, nu, nu_dot))[-16:, 0]
        held = bool(rows.min() >= 0.0)
        said.add(held)
        # The polygon lies inside the circle, and touches it from within by 1 - cos(π/8).
        most = ground.slip_ratio.max()
        assert most <= 0.9 if held else most >= 0.9 * np.cos(np.pi / 8)
    assert said == {True, False}
