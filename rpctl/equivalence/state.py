"""The random states at which derivations are compared, their efforts, and what rounding may do."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot

EFFORT_RANK_MARGIN = (
    1e-9  # of the largest: below it a direction of τ moves nothing that the others do not
)


@dataclass(frozen=True)
class State:
    """A random state, reproducible from a seed and an index.

    ``push`` is normal: the accelerations (rad/s² or m/s²) that each actuator alone would give its
    own joint, besides what :func:`rpctl.equivalence.state.efforts` adds to hold the robot.
    """

    q: Array  # (nq,) joints inside their limits
    v: Array  # (nv,) of the free tree
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)
    push: Array  # (n_act,)


def draw_state(robot: Robot, seed: int, sample: int) -> State:
    """Return the random state of one sample of :func:`rpctl.verify`.

    Args:
        robot: The robot.
        seed: Seed of the certificate.
        sample: Index of the sample, from 0.

    Returns:
        q (nq,), v (nv,) of the free tree, ν and ν̇ (dof,), and ``push`` (n_act,), see
        :class:`State`.
    """
    rng = np.random.default_rng([seed, sample])
    q = robot.random_configuration(rng)
    v, nu, nu_dot = (rng.normal(size=n) for n in (robot.nv, robot.dof, robot.dof))
    return State(q, v, nu, nu_dot, rng.normal(size=len(robot.actuators)))


@dataclass(frozen=True)
class RoundingScales:
    """How large the products are that the equations are summed from: rounding is EPS of them.

    Attributes:
        inertia: Of M, |S|ᵀ |M_full| |S| (dof, dof).
        bias: Of h (dof,).
        force: The scale of residuals of h, N·m or N: the largest product in the oracle's sum.
    """

    inertia: Array
    bias: Array
    force: float


@dataclass(frozen=True)
class ForcedState:
    """A state under random efforts.

    Attributes:
        state: The random state.
        tau: Actuator efforts τ (n_act,), N·m or N.
        nu_dot: ν̇ (dof,) under them.
        response: S M⁻¹ (nv, dof): what a unit of quasi-force adds to v̇.
        forces: Sizes of the products of M ν̇, h and B τ together (dof,).
    """

    state: State
    tau: Array
    nu_dot: Array
    response: Array
    forces: Array

    @property
    def size(self) -> float:
        """Size of the products that the largest entry of v̇ is made of.

        Over |v̇| it is the condition of this very v̇. cond M is not: units alone make it large, and
        it knows nothing of a gravity that cancels.
        """
        return float((np.abs(self.response) @ self.forces).max())


def find_rounding_scales(
    dynamics: ReducedDynamics, state: State, bias: Array | None
) -> RoundingScales:
    """Return the sizes at a state.

    Args:
        bias: Size of h (dof,) as the oracle knows it, or None where it broke down.
    """
    robot, q, nu, S = dynamics.robot, state.q, state.nu, dynamics.basis(state.q)
    data, drift = robot.model.createData(), dynamics.basis_drift(q, nu)
    force = np.abs(S).T @ np.abs(pin.rnea(robot.model, data, q, S @ nu, drift))
    inertia = np.abs(S).T @ np.abs(pin.crba(robot.model, data, q)) @ np.abs(S)
    known = force if bias is None else bias
    return RoundingScales(inertia, np.maximum(force, known), float(known.max()) or 1.0)


def force_state(dynamics: ReducedDynamics, state: State, scales: RoundingScales) -> ForcedState:
    """Return a state with the efforts that push it and the accelerations they give."""
    q = state.q
    tau = efforts(dynamics, q, state.nu, state.push)
    nu_dot = dynamics.forward(q, state.nu, tau)
    forces = scales.inertia @ np.abs(nu_dot) + scales.bias
    forces += np.abs(dynamics.actuation(q)) @ np.abs(tau)
    return ForcedState(state, tau, nu_dot, dynamics.basis(q) @ inverse(dynamics.inertia(q)), forces)


def efforts(dynamics: ReducedDynamics, q: Array, nu: Array, push: Array) -> Array:
    """Return efforts τ (n_act,) that cause moderate accelerations, for any actuation map B.

    B is not inverted, so robots with fewer actuators than speeds have them too. G = Bᵀ M⁻¹ B is
    what τ makes of the actuators' own accelerations: they get ``push``_i/G_ii each, and besides the
    τ of Gauss's least constraint, which comes nearest to ν̇ = 0: G τ = Bᵀ M⁻¹ h.

    Args:
        push: Accelerations (n_act,), rad/s² or m/s².
    """
    B, M = dynamics.actuation(q), dynamics.inertia(q)
    response = inverse(M) @ B
    G = B.T @ response
    moving = np.diag(G)  # 0 of an actuator that moves nothing: it gets no effort
    unit = np.divide(1.0, np.sqrt(moving), out=np.zeros_like(moving), where=moving > 0.0)
    wanted = unit * (response.T @ dynamics.bias(q, nu))
    hold = np.linalg.lstsq(unit[:, None] * G * unit, wanted, rcond=EFFORT_RANK_MARGIN)[0]
    return np.asarray(unit * hold + push * unit**2)


def unit_diagonal(M: Array) -> tuple[Array, Array]:
    """Return M (n, n) with rows and columns divided by √|M_ii|, and those (n,).

    Units cost no digits then, and no eigenvalue is small for its unit only.
    """
    size = np.abs(np.diag(M))
    root = np.sqrt(np.where(size > 0.0, size, 1.0))
    return M / np.outer(root, root), root


def inverse(M: Array) -> Array:
    """Return M⁻¹ (n, n) of an inertia.

    Raises:
        RpctlError: M is not positive definite.
    """
    scaled, root = unit_diagonal(M)
    if not np.linalg.eigvalsh(scaled)[0] > 0.0:
        raise RpctlError("the inertia M is not positive definite")
    return np.asarray(np.linalg.inv(scaled) / np.outer(root, root))


def inertia_spread(dynamics: ReducedDynamics, q: Array, point: Array) -> Array:
    """Return Σ |S_j| √m_j d_j (dof,) over the joints j, d_j the distance to a point (world), m.

    An engine that takes all inertias about one point has that of a wheel about its own axle as
    what is left of m d². The square of the spread is the size of M there.

    Args:
        point: The point (3,) about which inertias are taken, world frame, m.
    """
    model, data = dynamics.robot.model, dynamics.robot.model.createData()
    pin.forwardKinematics(model, data, q)
    pin.computeSubtreeMasses(model, data)
    S, spread = np.abs(dynamics.basis(q)), np.zeros(dynamics.robot.dof)
    for joint in range(2, model.njoints):
        distance = float(np.linalg.norm(data.oMi[joint].translation - point))
        spread += S[model.joints[joint].idx_v] * math.sqrt(data.mass[joint]) * distance
    return spread
