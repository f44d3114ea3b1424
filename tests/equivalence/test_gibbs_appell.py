"""The oracle: it is independent, and its G is what the gradient says."""

from __future__ import annotations

import numpy as np
import pytest

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.equivalence.gibbs_appell import GibbsAppell, Terms
from tests import closed_form


def test_the_closed_form(paper: Robot, rng: np.random.Generator) -> None:
    oracle = GibbsAppell(paper)
    for _ in range(20):
        theta1, eta, nu = rng.uniform(-2, 2), rng.uniform(0.35, 0.95), rng.normal(size=4)
        positions = {"arm_revolute_joint": theta1, "arm_prismatic_joint": eta}
        terms = oracle.reduced(paper.configuration(joints=positions), nu)
        np.testing.assert_allclose(terms.M, closed_form.inertia(theta1, eta), atol=1e-12)
        np.testing.assert_allclose(terms.h, closed_form.bias(theta1, eta, nu), atol=1e-12)
        np.testing.assert_allclose(terms.B, closed_form.actuation(), atol=1e-12)


def test_mimic_joints_follow() -> None:
    """Panda's fingers: one quasi-velocity for two joints, whose mass counts twice."""
    panda = rpctl.load("panda", free="panda_finger_*")
    assert [joint.name for joint in panda.mimics] == ["panda_finger_joint2"]
    q = panda.configuration(joints={"panda_finger_joint1": 0.02})
    assert panda.joint_position(q, "panda_finger_joint2") == 0.02
    nu = np.arange(panda.dof) / 10.0
    terms, dynamics = GibbsAppell(panda).reduced(q, nu), ReducedDynamics(panda)
    np.testing.assert_allclose(terms.M, dynamics.inertia(q), atol=1e-12)
    np.testing.assert_allclose(terms.h, dynamics.bias(q, nu), atol=1e-11)
    finger = panda.description.link["panda_leftfinger"].mass
    assert finger is not None
    assert terms.M[-1, -1] == 2 * finger


MOVING = ("mixed_chain", "swerve", "tricycle", "casters", "caster_drive", "mecanum")


@pytest.mark.parametrize("name", MOVING)
def test_many_states_are_as_each_alone(name: str, rng: np.random.Generator) -> None:
    robot = rpctl.load(name)
    oracle = GibbsAppell(robot)
    q = np.array([robot.random_configuration(rng) for _ in range(3)])
    v, nu, nu_dot = (rng.normal(size=(3, n)) for n in (robot.nv, robot.dof, robot.dof))
    free, rolling = oracle.full(q, v), oracle.reduced(q, nu)
    G = oracle.gibbs(q, nu, np.array([nu_dot, -nu_dot]))
    assert G.shape == (2, 3)
    for k in range(3):
        same_terms(free.of(k), oracle.full(q[k], v[k]))
        same_terms(rolling.of(k), oracle.reduced(q[k], nu[k]))
        alone = [oracle.gibbs(q[k], nu[k], each) for each in (nu_dot[k], -nu_dot[k])]
        np.testing.assert_allclose(G[:, k], alone, rtol=1e-12)


def same_terms(one: Terms, other: Terms) -> None:
    """Assert that two results are the same but for rounding, shapes included."""
    for name in ("M", "h", "h_size", "B", "root"):
        value, truth = getattr(one, name), getattr(other, name)
        assert value.shape == truth.shape
        np.testing.assert_allclose(value, truth, rtol=0, atol=1e-12 * np.abs(truth).max())
    assert one.rates.keys() == other.rates.keys()
    for name, row in one.rates.items():
        np.testing.assert_allclose(row, other.rates[name], rtol=0, atol=1e-11)
