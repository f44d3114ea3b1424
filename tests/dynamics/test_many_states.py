"""Dynamics at many states at once against Pinocchio's at each of them alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot, RpctlError
from rpctl.arrays import Array
from rpctl.dynamics import many_states
from rpctl.dynamics.many_states import ManyStates, solve_positive_many
from rpctl.robot.placements import aligned_tree, end_effector_frame, placements
from tests import urdf
from tests.robots import SET_A, platform, write
from tests.vehicles import vehicle

COUNT = 23  # states, in blocks of 10
# Entries against the largest of their kind; M of TIAGo has a condition number of some 1e5.
TOLERANCE = 1e-11


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(many_states, "BLOCK", 10)


def odd_arm(folder: Path) -> Robot:
    """Return a platform whose arm turns, slides, turns without end and mimics, all askew."""
    heavy = urdf.inertial(2.0, (0.03, 0.05, 0.04), (0.05, -0.1, 0.2), "0.3 -0.2 0.5")
    bound = urdf.limit(-1.0, 1.0, 50, 2)
    dynamics = '<dynamics damping="0.3" friction="0.7"/>'
    mimic = '<mimic joint="turn" multiplier="-0.5" offset="0.1"/>'
    parts = [
        *(urdf.link(name, heavy) for name in ("upper", "slider", "hand", "flap")),
        urdf.joint(
            "turn", "revolute", ("base", "upper"), "0.1 0.2 0.5", "1 2 3", bound + dynamics, "1 0 2"
        ),
        urdf.joint("slide", "prismatic", ("upper", "slider"), "0.2 0 0.1", "0 -1 1", bound),
        urdf.joint("roll", "continuous", ("slider", "hand"), "0 0.1 0.3", "-1 0 0"),
        urdf.joint("lift", "revolute", ("slider", "flap"), "0 -0.1 0.3", "0 1 0", bound + mimic),
    ]
    return rpctl.load(write(folder, platform(SET_A, extra="\n".join(parts))))


@pytest.fixture(scope="module", params=["tiago", "skid_steer", "odd", "omni", "casters", "arm"])
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    if request.param in ("tiago", "skid_steer", "arm"):
        return rpctl.load(request.param)
    folder = tmp_path_factory.mktemp("robot")
    if request.param == "odd":
        return odd_arm(folder)
    return rpctl.load(write(folder, vehicle(request.param)))


def states(robot: Robot) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(11)
    q = np.array([robot.random_configuration(rng) for _ in range(COUNT)])
    return q, rng.normal(size=(COUNT, robot.dof)), rng.normal(size=(COUNT, len(robot.actuators)))


def close(found: Array, wanted: Array) -> None:
    np.testing.assert_allclose(found, wanted, rtol=0.0, atol=TOLERANCE * np.abs(wanted).max())


def test_reactions_and_energy(robot: Robot) -> None:
    dynamics = ReducedDynamics(robot)
    if not dynamics.constant:
        with pytest.raises(RpctlError, match="not the same at all states"):
            ManyStates(dynamics)
        return
    q, nu, tau = states(robot)
    found = ManyStates(dynamics).reactions(q, nu, tau)
    alone = [dynamics.reaction(*state) for state in zip(q, nu, tau, strict=True)]
    close(found.residual, np.array([residual for residual, _ in alone]))
    close(found.wrench, np.array([wrench for _, wrench in alone]))
    close(found.energy, np.array([dynamics.energy(*state) for state in zip(q, nu, strict=True)]))


def test_armature_counts_for_inertia_and_energy(paper: Robot) -> None:
    geared = rpctl.load("paper")
    geared.model.armature[:] = np.linspace(0.0, 0.7, geared.nv)
    q, nu, tau = states(geared)
    for robot in (geared, paper):
        dynamics = ReducedDynamics(robot)
        found = ManyStates(dynamics).reactions(q, nu, tau)
        alone = [dynamics.reaction(*state) for state in zip(q, nu, tau, strict=True)]
        close(found.residual, np.array([residual for residual, _ in alone]))
        energy = [dynamics.energy(*state) for state in zip(q, nu, strict=True)]
        close(found.energy, np.array(energy))


def test_places_of_all_joints(robot: Robot) -> None:
    tree, data = aligned_tree(robot), robot.model.createData()
    q, _, _ = states(robot)
    found = placements(tree, q)
    for k, configuration in enumerate(q):
        pin.forwardKinematics(robot.model, data, configuration)
        for number, joint in enumerate(tree.joints):
            place = data.oMi[1].actInv(data.oMi[number + 2])
            np.testing.assert_allclose(
                found.origins[number + 1, :, k], place.translation, atol=1e-14
            )
            axes = (place.rotation @ joint.turned).T
            np.testing.assert_allclose(found.axes[number + 1, :, :, k], axes, atol=1e-14)


def test_the_end_effector(robot: Robot) -> None:
    tree, data = aligned_tree(robot), robot.model.createData()
    if robot.end_effector is None:
        with pytest.raises(RpctlError, match="has no arm"):
            end_effector_frame(tree)
        return
    q, _, _ = states(robot)
    axes, places = end_effector_frame(tree).at(q)
    for k, configuration in enumerate(q):
        pose = robot.end_effector_pose(data, configuration)
        np.testing.assert_allclose(places[k], pose.translation, atol=1e-13)
        seen = data.oMi[1].rotation.T @ pose.rotation
        np.testing.assert_allclose(axes[:, :, k], seen.T, atol=1e-14)


def test_equations_that_are_not_positive_definite_are_refused() -> None:
    good = np.array([[2.0, 1.0], [1.0, 3.0]])
    M = np.stack([good, good], axis=-1)
    x = solve_positive_many(M.copy(), np.array([[3.0, 5.0], [4.0, 10.0]]))
    np.testing.assert_allclose(x, [[1.0, 1.0], [1.0, 3.0]], rtol=1e-15)
    M[1, 1, 1] = 0.5  # of the second, whose determinant is 0
    with pytest.raises(RpctlError, match="not positive definite"):
        solve_positive_many(M, np.ones((2, 2)))
