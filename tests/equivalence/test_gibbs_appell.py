"""The oracle: it is independent, and its G is what the gradient says."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pinocchio as pin

import rpctl
from rpctl import ReducedDynamics, Robot
from rpctl.equivalence import gibbs_appell
from rpctl.equivalence.gibbs_appell import GibbsAppell
from tests import closed_form


def test_it_asks_neither_pinocchio_nor_the_dynamics() -> None:
    tree = ast.parse(Path(gibbs_appell.__file__).read_text(encoding="utf-8"))
    imported = {
        name
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        )
    }  # fmt: skip
    assert not any(name.startswith(("pinocchio", "rpctl.dynamics")) for name in imported)
    called = {node.attr for node in ast.walk(tree) if isinstance(node, ast.Attribute)}
    assert "model" in called  # names and indices are read from it, nothing is computed with it
    assert not called & {"crba", "rnea", "forwardKinematics", "createData"}


def test_the_free_tree(robot: Robot, rng: np.random.Generator) -> None:
    oracle, data = GibbsAppell(robot), robot.model.createData()
    for _ in range(5):
        q, v = robot.random_configuration(rng), rng.normal(size=robot.nv)
        terms = oracle.full(q, v)
        M = pin.crba(robot.model, data, q)
        h = pin.nonLinearEffects(robot.model, data, q, v)
        np.testing.assert_allclose(terms.M, M, atol=1e-12 * np.abs(M).max())
        np.testing.assert_allclose(terms.h, h, atol=1e-12 * np.abs(h).max())


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
    panda = rpctl.load("panda")
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
