"""The linear model of a robot about a motion: the formula of its dynamics, differentiated."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl import math as casadi
from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.dynamics.symbols.leaning import LeaningEquations
from rpctl.robot.leaning import FREE_NV, LeaningRobot
from rpctl.robot.model import Robot

KEPT_ROBOTS = 4  # whose formulas are kept


class LinearModel(NamedTuple):
    """ẋ = A x + B u near a motion, x = (δq, δν) and u = δτ; of size nv + dof, and n_act.

    δq (nv,) is the tangent: q ⊕ δq is the configuration beside the motion's q.
    """

    A: Array  # (nv + dof, nv + dof)
    B: Array  # (nv + dof, n_act)


class LinearDynamics:
    """The linear models of a robot: v = S ν and ν̇ at q ⊕ δ, differentiated at δ = 0.

    q ⊕ δ = ``pinocchio.integrate(model, q, δ)``, with the root link's shift (x, y) and turn in its
    own axes, then the joints in the order of the model. A configuration beside the motion keeps its
    distance as δ̇ = δv − [v, δ], with the bracket of SE(2) for the root: the axes in which δ is told
    turn with the robot.

    Args:
        robot: The robot.

    Attributes:
        dynamics: What is differentiated.
    """

    def __init__(self, robot: Robot) -> None:
        self._reduced, self.dynamics = ReducedDynamics(robot), SymbolicDynamics(robot)
        dynamics = self.dynamics
        q, nu = casadi.SX.sym("q", robot.nq), casadi.SX.sym("nu", robot.dof)
        tau, delta = casadi.SX.sym("tau", len(robot.actuators)), casadi.SX.sym("d", robot.nv)
        beside = dynamics.integrate(q, delta)
        v = dynamics.basis(beside) @ nu
        rates = casadi.vertcat(v, dynamics.forward(beside, nu, tau))
        A = casadi.densify(casadi.jacobian(rates, casadi.vertcat(delta, nu)))
        A[0, 1], A[0, 2], A[1, 0], A[1, 2] = (
            A[0, 1] + v[2],
            A[0, 2] - v[1],
            A[1, 0] - v[2],
            A[1, 2] + v[0],
        )
        B = casadi.densify(casadi.jacobian(rates, tau))
        found = casadi.substitute([A, B], [delta], [casadi.SX.zeros(robot.nv, 1)])
        self._function = casadi.Function("linear", [q, nu, tau], casadi.cse(found))

    def __call__(self, q: Array, nu: Array, tau: Array) -> LinearModel:
        """Return the linear model about a motion that passes (q, ν) under τ.

        Args:
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,), N·m or N.

        Raises:
            RpctlError: M is not positive definite at q, or the state is not finite.
            SingularBasisError: At q the steering angles do not determine a unique motion.
        """
        self._reduced.forward(q, nu, tau)  # it refuses
        return LinearModel(*(found.full() for found in self._function(q, nu, tau)))


class LeaningLinearDynamics:
    """The linear models of a robot that leans, as :class:`LinearDynamics`; the bracket is SE(3)'s.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: LeaningRobot) -> None:
        self._robot, self._reduced = robot, ReducedDynamics(robot)
        self._equations = LeaningEquations(robot)

    def __call__(self, q: Array, nu: Array, tau: Array) -> LinearModel:
        """Return the linear model about a motion that passes (q, ν) under τ.

        Raises:
            RpctlError: M is not positive definite at q, or the state is not finite.
            SingularBasisError: At q the wheels fix no one motion.
        """
        dynamics, nv, dof = self._reduced, self._robot.nv, self._robot.dof
        nu_dot, at = dynamics.forward(q, nu, tau), dynamics.at(q)
        v = at.S @ nu
        force, _ = dynamics.reaction(q, nu, tau)
        z = np.concatenate([v, at.S @ nu_dot + at.drift(nu), nu_dot, at.multipliers @ force])
        by = self._equations.derivatives(q, nu, tau, z)
        rates = np.vstack([by[:nv], by[2 * nv : 2 * nv + dof]])
        linear, angular = pin.skew(v[:3]), pin.skew(v[3:FREE_NV])
        rates[:3, :3] -= angular
        rates[:3, 3:FREE_NV] -= linear
        rates[3:FREE_NV, 3:FREE_NV] -= angular
        return LinearModel(rates[:, : nv + dof], rates[:, nv + dof :])


@lru_cache(maxsize=KEPT_ROBOTS)
def linear_dynamics(robot: Robot) -> LinearDynamics:
    """Return the linear models of a robot; those of the last robots are kept."""
    return LinearDynamics(robot)


@lru_cache(maxsize=KEPT_ROBOTS)
def leaning_linear_dynamics(robot: LeaningRobot) -> LeaningLinearDynamics:
    """Return the linear models of a robot that leans; those of the last robots are kept."""
    return LeaningLinearDynamics(robot)


def linearize(robot: Robot, q: Array, nu: Array, tau: Array) -> LinearModel:
    """Return A and B of ẋ = A x + B u about a motion through (q, ν) under τ.

    x = (δq, δν), u = δτ. δq (nv,) is Pinocchio's tangent: the root link's shift (x, y) in m and
    turn in rad, in its own axes (for a robot that leans, three shifts and three turns), then the
    positions of the joints in the order of ``robot.model``, wheels included. δν (dof,) has the
    order of ``robot.quasi_velocities``.

    Args:
        robot: The robot.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,), m/s or rad/s.
        tau: Actuator efforts (n_act,), N·m or N.

    Returns:
        A (nv + dof, nv + dof) and B (nv + dof, n_act).

    Raises:
        RpctlError: M is not positive definite at q, or the state is not finite.
        SingularBasisError: At q the steering angles do not determine a unique motion.
    """
    if isinstance(robot, LeaningRobot):
        return leaning_linear_dynamics(robot)(q, nu, tau)
    return linear_dynamics(robot)(q, nu, tau)
