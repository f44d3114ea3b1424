"""Derivatives of the reduced dynamics, and the linear model of a robot about a state.

The equations are F(q, ν, ν̇) = Sᵀ rnea(q, Sν, Sν̇ + Ṡν) = B τ. Pinocchio differentiates rnea
(Carpentier and Mansard, "Analytical derivatives of rigid body dynamics algorithms", RSS 2018); S
and Ṡν depend on q through the swivels' positions p alone, and Ṡν on ν. Where there are losses, rnea
is less their force, a function of v = Sν alone, whose derivative is diagonal:

    ∂F/∂q = Sᵀ (∂rnea/∂q + ∂rnea/∂v ∂(Sν)/∂q + M ∂(Sν̇ + Ṡν)/∂q) + (∂S/∂q)ᵀ rnea
    ∂F/∂ν = Sᵀ (∂rnea/∂v S + M ∂(Ṡν)/∂ν),    ∂F/∂ν̇ = SᵀMS

Derivatives by q are along its tangent δ (nv,), q ⊕ δ = ``pinocchio.integrate(model, q, δ)``: the
root link's shift (x, y) and turn in its own axes, then the joints in the order of the model.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import cho_factor, cho_solve

from rpctl.arrays import Array
from rpctl.dynamics.projection import Projection
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot


class InverseDerivatives(NamedTuple):
    """Derivatives of the quasi-force M ν̇ + h − ℓ, and, for given efforts, of B τ."""

    q: Array  # (dof, nv)
    nu: Array  # (dof, dof)
    nu_dot: Array  # (dof, dof): M
    efforts: Array  # (dof, nv): of B τ by q


class ForwardDerivatives(NamedTuple):
    """Derivatives of ν̇ under given efforts."""

    q: Array  # (dof, nv)
    nu: Array  # (dof, dof)
    tau: Array  # (dof, n_act): M⁻¹B


class LinearModel(NamedTuple):
    """ẋ = A x + B u near a motion, x = (δq, δν) and u = δτ; of size nv + dof, and n_act.

    δq (nv,) is the tangent: q ⊕ δq is the configuration beside the motion's q.
    """

    A: Array  # (nv + dof, nv + dof)
    B: Array  # (nv + dof, n_act)


def inverse_derivatives(
    dynamics: ReducedDynamics, q: Array, nu: Array, nu_dot: Array, tau: Array | None = None
) -> InverseDerivatives:
    """Return the derivatives of the quasi-force that a motion takes.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        nu_dot: Their derivatives (dof,).
        tau: Actuator efforts (n_act,), N·m or N, of which ∂(B τ)/∂q is asked for; None for 0.

    Raises:
        SingularBasisError: At q the steered wheels fix no one motion.
    """
    robot, at = dynamics.robot, dynamics.at(q)
    model, S = robot.model, at.S
    data, v = dynamics.data, S @ nu
    pin.computeRNEADerivatives(model, data, q, v, S @ nu_dot + at.drift(nu))
    by_v, force = data.dtau_dv, data.tau
    if robot.losses is not None:
        by_v, force = by_v + np.diag(robot.losses.slope(v)), force - robot.losses.force(v)
    mass = np.triu(data.M)
    mass = mass + np.triu(mass, 1).T
    by_q, by_nu = S.T @ data.dtau_dq, by_v @ S
    by_efforts = np.zeros((robot.dof, robot.nv))
    basis = at.derivatives(nu)
    if basis is not None:
        p = basis.entries
        moved = (basis.S @ nu_dot).T + basis.drift  # ∂(Sν̇ + Ṡν)/∂p (nv, n_swivels)
        by_q[:, p] += S.T @ (by_v @ basis.v + mass @ moved)
        by_q[:, p] += (force @ basis.S).T
        by_nu = by_nu + mass @ basis.drift_nu
        if tau is not None:
            by_efforts[:, p] = (at.projector.columns @ tau @ basis.S).T
    return InverseDerivatives(by_q, S.T @ by_nu, S.T @ mass @ S, by_efforts)


def forward_derivatives(
    dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array
) -> ForwardDerivatives:
    """Return the derivatives of ν̇ = M⁻¹(B τ − h + ℓ) at a state under efforts.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,), N·m or N.

    Raises:
        RpctlError: M is not positive definite at q, or the state is not finite.
        SingularBasisError: At q the steered wheels fix no one motion.
    """
    nu_dot = dynamics.forward(q, nu, tau)
    force = inverse_derivatives(dynamics, q, nu, nu_dot, tau)
    factor = cho_factor(force.nu_dot)
    return ForwardDerivatives(
        q=np.asarray(cho_solve(factor, force.efforts - force.q)),
        nu=np.asarray(cho_solve(factor, -force.nu)),
        tau=np.asarray(cho_solve(factor, dynamics.actuation(q))),
    )


def linear_model(dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array) -> LinearModel:
    """Return the linear model about a motion that passes (q, ν) under τ.

    A configuration beside the motion, q ⊕ δ, keeps its distance as δ̇ = δv − [v, δ], with the
    bracket of SE(2) for the root: the axes in which δ is told turn with the robot.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,), N·m or N.

    Raises:
        RpctlError: M is not positive definite at q, or the state is not finite.
        SingularBasisError: At q the steered wheels fix no one motion.
    """
    at, change = dynamics.at(q), forward_derivatives(dynamics, q, nu, tau)
    nv, dof = at.S.shape
    A, B = np.zeros((nv + dof, nv + dof)), np.zeros((nv + dof, len(tau)))
    A[:nv, :nv] = _drift_of_tangent(at, nu)
    A[:nv, nv:] = at.S
    A[nv:, :nv], A[nv:, nv:], B[nv:] = change
    return LinearModel(A, B)


def linearize(robot: Robot, q: Array, nu: Array, tau: Array) -> LinearModel:
    """Return A and B of ẋ = A x + B u about a motion that passes (q, ν) under τ.

    x = (δq, δν), u = δτ. δq (nv,) is the tangent of Pinocchio: the root link's shift (x, y) in m
    and turn in rad, in its own axes, then the positions of the joints in the order of
    ``robot.model``, wheels included. δν (dof,) has the order of ``robot.quasi_velocities``. A loop
    rather keeps a ``ReducedDynamics`` and asks :func:`linear_model`.

    Args:
        robot: The robot.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,), m/s or rad/s.
        tau: Actuator efforts (n_act,), N·m or N.

    Returns:
        A (nv + dof, nv + dof) and B (nv + dof, n_act).

    Raises:
        RpctlError: M is not positive definite at q, or the state is not finite.
        SingularBasisError: At q the steered wheels fix no one motion.
    """
    return linear_model(ReducedDynamics(robot), q, nu, tau)


def _drift_of_tangent(at: Projection, nu: Array) -> Array:
    """Return ∂δ̇/∂δ (nv, nv) at given ν: ∂(Sν)/∂q less the root's bracket with v."""
    nv = len(at.S)
    vx, vy, turn = (at.S @ nu)[:3]
    drift = np.zeros((nv, nv))
    drift[:2, :3] = [[0.0, turn, -vy], [-turn, 0.0, vx]]
    basis = at.derivatives(nu)
    if basis is not None:
        drift[:, basis.entries] += basis.v
    return drift
