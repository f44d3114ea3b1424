"""The Boltzmann-Hamel equations of the paper's robot, by differences of its kinetic energy alone.

With quasi-velocities ν_r that belong to a frame of vector fields X_r on the configuration space,

    d/dt ∂T/∂ν_k − X_k(T) + Σ_rs γʳ_ks ν_s ∂T/∂ν_r = Q_k,    [X_k, X_s] = Σ_r γʳ_ks X_r,

where k and s run over the admissible directions but r over all of them: the momenta across the
constraint count although the speeds across it are zero.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from rpctl import ReducedDynamics, Robot
from rpctl.arrays import Array

STEP = 1e-5


def chart(robot: Robot, x: Array) -> Array:
    """Return q of the chart (x, y, θ, joint angles in the order of v)."""
    q = pin.neutral(robot.model)
    q[:4] = x[0], x[1], np.cos(x[2]), np.sin(x[2])
    for name in robot.model.names[2:]:
        robot.set_joint(q, name, float(x[robot.velocity_index(name)]))
    return q


def frame(robot: Robot, S: Array, x: Array) -> Array:
    """Return X (nv, nv): S's columns, completed to a basis, as velocities of the chart."""
    full = np.linalg.qr(S, mode="complete")[0]
    full[:, : S.shape[1]] = S
    turn = np.eye(robot.nv)
    turn[:2, :2] = [[np.cos(x[2]), -np.sin(x[2])], [np.sin(x[2]), np.cos(x[2])]]
    return turn @ full


def derivative(function: Callable[[Array], Array], x: Array, direction: Array) -> Array:
    ahead, behind = function(x + STEP * direction), function(x - STEP * direction)
    return (ahead - behind) / (2 * STEP)


def test_they_give_the_reduced_bias(paper: Robot, rng: np.random.Generator) -> None:
    dynamics, data = ReducedDynamics(paper), paper.model.createData()
    S = dynamics.basis(paper.configuration())
    n = paper.dof

    def mass(x: Array) -> Array:
        """Return the kinetic energy's Hessian in all nv quasi-velocities."""
        X = np.linalg.qr(S, mode="complete")[0]
        X[:, :n] = S
        return np.asarray(X.T @ pin.crba(paper.model, data, chart(paper, x)) @ X)

    for _ in range(5):
        x, nu = rng.uniform(-1.0, 1.0, paper.nv), rng.normal(size=n)
        speeds = np.concatenate([nu, np.zeros(paper.nv - n)])
        X = frame(paper, S, x)
        momentum_rate = derivative(mass, x, X @ speeds) @ speeds
        momentum = mass(x) @ speeds
        bias = np.empty(n)
        for k in range(n):
            slope = 0.5 * speeds @ derivative(mass, x, X[:, k]) @ speeds
            bracket = np.zeros(paper.nv)
            fields = partial(frame, paper, S)
            for s in range(n):
                forth = derivative(fields, x, X[:, k])[:, s]
                back = derivative(fields, x, X[:, s])[:, k]
                bracket += nu[s] * (forth - back)
            bias[k] = momentum_rate[k] - slope + np.linalg.solve(X, bracket) @ momentum
        np.testing.assert_allclose(bias, dynamics.bias(chart(paper, x), nu), atol=1e-6)
        assert np.abs(bias).max() > 0.1
