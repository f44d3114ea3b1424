"""The comparisons of the certificate, each at one random state."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.linalg import cho_factor, cho_solve, qr

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.dynamics.rolling import basis
from rpctl.equivalence.certificate import (
    DIFFERENCE_TOLERANCE,
    EXACT_TOLERANCE,
    Check,
    allowed,
    difference_step,
    rate,
    relative,
    worst,
)
from rpctl.equivalence.energy import energy_rate, power_balance
from rpctl.equivalence.gibbs_appell import GibbsAppell, RollingTerms, Terms
from rpctl.equivalence.mujoco_engine import MujocoEngine
from rpctl.equivalence.rolling_rows import FileRows
from rpctl.equivalence.state import (
    ForcedState,
    RoundingScales,
    State,
    inertia_spread,
    inverse,
    unit_diagonal,
)
from rpctl.robot.model import Robot

SCALED_TOLERANCE = 1e-10  # as EXACT, but an entry may be small against its row and column
FORWARD_TOLERANCE = 1e-10  # solving with M amplifies rounding; see Trial.size
GIBBS = "Gibbs-Appell"
MUJOCO = "MuJoCo"
PLANAR_SPEEDS = "vx", "vy", "omega"  # of the root link, in its own axes
FREE_SPEEDS = "vx", "vy", "vz", "wx", "wy", "wz"


def full_tree(robot: Robot, terms: Terms, state: State) -> Iterator[Check]:
    """Compare the free tree: Pinocchio against the Gibbs function.

    Args:
        terms: Its equations by the Gibbs function at the state.
    """
    data, names = robot.model.createData(), velocity_names(robot)
    inertia = pin.crba(robot.model, data, state.q)
    bias = pin.nonLinearEffects(robot.model, data, state.q, state.v)
    yield relative("full inertia", GIBBS, inertia, terms.M, names)
    yield worst(
        "full bias", GIBBS, (bias - terms.h) / (terms.h_size.max() or 1.0), EXACT_TOLERANCE, names
    )


def reduced(
    dynamics: ReducedDynamics,
    oracle: GibbsAppell,
    found: RollingTerms,
    scales: RoundingScales,
    state: State,
) -> Iterator[Check]:
    """Compare the reduced equations: projection against the oracle's in ν, and G."""
    robot, names, terms = dynamics.robot, dynamics.robot.quasi_velocities, found.terms
    q, nu, nu_dot = state.q, state.nu, state.nu_dot
    M = dynamics.inertia(q)
    yield relative("reduced inertia M", GIBBS, M, terms.M, names, float(scales.inertia.max()))
    scale = np.sqrt(np.abs(np.outer(np.diag(terms.M), np.diag(terms.M))))
    limit = allowed(SCALED_TOLERANCE, float((scales.inertia / scale).max()), 1.0)
    yield worst("M, entry by entry", GIBBS, (M - terms.M) / scale, limit, names)
    largest = scales.force
    limit = allowed(EXACT_TOLERANCE, float(scales.bias.max()), largest)
    yield worst("reduced bias h", GIBBS, (dynamics.bias(q, nu) - terms.h) / largest, limit, names)
    yield relative("actuation B", GIBBS, dynamics.actuation(q), terms.B, names)
    v, rates = dynamics.basis(q) @ nu, np.zeros(robot.nv)
    rates[: len(terms.root)] = terms.root @ nu
    for name, row in terms.rates.items():
        rates[robot.velocity_index(name)] = row @ nu
    yield relative("rolling wheels S ν", GIBBS, v, rates, velocity_names(robot))
    lost = oracle.losses(terms.rates, nu)
    taken = float(np.abs(lost).max(initial=0.0))
    if dynamics.robot.losses is not None or taken:
        yield relative("losses ℓ", GIBBS, dynamics.losses(q, nu), lost, names)
    force, gradient = dynamics.inverse(q, nu, nu_dot), terms.M @ nu_dot + terms.h - lost
    largest += taken
    largest += np.abs(terms.M @ nu_dot).max()
    products = float((scales.bias + scales.inertia @ np.abs(nu_dot)).max())
    limit = allowed(EXACT_TOLERANCE, products, largest)
    yield worst("inverse dynamics", "∂G/∂ν̇", (force - gradient) / largest, limit, names)
    power = largest * float(np.abs(nu).sum())
    gap = (0.5 * found.rise - lost @ nu - force @ nu) / power
    limit = max(limit, allowed(EXACT_TOLERANCE, found.rise_size, power))
    yield worst("inverse dynamics along ν", "G itself", np.array([gap]), limit, ["ν"])


def coriolis(dynamics: ReducedDynamics, scales: RoundingScales, state: State) -> Iterator[Check]:
    """Check C = Sᵀ(C_full S + M_full Ṡ): C ν + g = h, and Ṁ − 2C is skew-symmetric.

    The root link is put to the world's origin. C does not depend on where the robot stands, but
    Pinocchio takes C's inertias about that origin, and loses digits with the distance.
    """
    robot, q, nu = dynamics.robot, state.q.copy(), state.nu
    q[:2] = 0.0
    data, S, names = robot.model.createData(), dynamics.basis(q), robot.quasi_velocities
    v = S @ nu
    step = difference_step(v)

    def along(time: float) -> Array:
        at = pin.integrate(robot.model, q, time * v)
        return np.vstack([dynamics.basis(at), dynamics.inertia(at)])

    S_dot, M_dot = np.split(rate(along, step), [robot.nv])
    C_full = pin.computeCoriolisMatrix(robot.model, data, q, v)
    C = S.T @ (C_full @ S + pin.crba(robot.model, data, q) @ S_dot)
    gap = C @ nu + dynamics.bias(q, np.zeros_like(nu)) - dynamics.bias(q, nu)
    scale = max(scales.force, float(np.abs(C).max() * np.abs(nu).max()))
    limit = (
        DIFFERENCE_TOLERANCE if S_dot.any() else EXACT_TOLERANCE
    )  # a basis that moves is known by differences here
    limit = allowed(limit, _swing(inertia_spread(dynamics, q, np.zeros(3)), nu), scale)
    yield worst("Coriolis C ν + g", "h", gap / scale, limit, names)
    skew = M_dot - 2.0 * C
    small = float(np.abs(dynamics.inertia(q)).max() * np.abs(nu).max())
    scale = max(min(1.0, small), np.abs(C).max(), np.abs(M_dot).max())
    limit = allowed(DIFFERENCE_TOLERANCE, float(scales.inertia.max()) / step, scale)
    yield worst("Ṁ − 2C skew-symmetric", "differences", (skew + skew.T) / scale, limit, names)


def definite(dynamics: ReducedDynamics, state: State) -> Iterator[Check]:
    """Check that M is positive definite, whatever its units: their scale is divided out."""
    scaled, _ = unit_diagonal(dynamics.inertia(state.q))
    lost = 0.0 if np.linalg.eigvalsh(scaled)[0] > 0.0 else np.inf
    yield worst("M positive definite", "least eigenvalue", np.array([lost]), EXACT_TOLERANCE, ["M"])


def multipliers(
    dynamics: ReducedDynamics, rolling: FileRows, oracle: GibbsAppell, forced: ForcedState
) -> Iterator[Check]:
    """Compare accelerations and constraint forces with the Lagrange-multiplier path.

    Args:
        oracle: The Gibbs-Appell derivation; it has the file's losses on each joint's own rate.
    """
    robot, q, nu, tau = dynamics.robot, forced.state.q, forced.state.nu, forced.tau
    names, v, against = velocity_names(robot), dynamics.basis(q) @ nu, "Lagrange multipliers"
    v_dot = dynamics.basis(q) @ forced.nu_dot + dynamics.basis_drift(q, nu)
    push = effort_columns(robot) @ tau + oracle.losses(oracle.free_rates(), v)
    lagrange = constrained_motion(robot, rolling, q, v, push)
    own = pinocchio_motion(robot, rolling, q, v, push)
    data = robot.model.createData()
    torques = pin.rnea(robot.model, data, q, v, v_dot).copy()
    M = pin.crba(robot.model, data, q)
    # The tree's light parts, as wheels, get theirs as what little the forces on them leave.
    parts = np.abs(torques) + np.abs(push) + np.abs(lagrange.force)
    size = max(forced.size, float((np.abs(inverse(M)) @ parts).max()))
    for who, theirs in ((against, lagrange.v_dot), ("Pinocchio, constrained", own)):
        largest = float(np.abs(theirs).max())
        limit = allowed(FORWARD_TOLERANCE, size, largest)
        yield worst("accelerations", who, (v_dot - theirs) / (largest or 1.0), limit, names)
    force = torques - push
    scale = max(np.abs(torques).max(), np.abs(tau).max(initial=0.0)) or 1.0  # of nothing that acts
    products = np.abs(M @ forced.response) @ forced.forces + parts
    swing = _swing(inertia_spread(dynamics, q, np.array([*q[:2], 0.0])), nu)
    limit = allowed(FORWARD_TOLERANCE, max(float(products.max()), swing), scale)
    yield worst("constraint forces Aᵀ λ", against, (force - lagrange.force) / scale, limit, names)


def consistent(dynamics: ReducedDynamics, forced: ForcedState) -> Iterator[Check]:
    """Check the reduced dynamics against themselves."""
    robot, q, nu = dynamics.robot, forced.state.q, forced.state.nu
    M, v, speeds = dynamics.inertia(q), dynamics.basis(q) @ nu, robot.quasi_velocities

    def along(time: float) -> Array:
        at = dynamics.at(pin.integrate(robot.model, q, time * v))
        return basis(at.A, at.W)

    change = rate(along, difference_step(v)) @ nu - dynamics.basis_drift(q, nu)
    drift = change / max(1.0, float(np.abs(v).max()))
    yield worst(
        "basis drift Ṡ ν", "differences", drift, DIFFERENCE_TOLERANCE, velocity_names(robot)
    )
    left_over = dynamics.inverse(q, nu, forced.nu_dot) - dynamics.actuation(q) @ forced.tau
    # B τ and h cancel but for M ν̇, and each is rounded: what h alone makes of ν̇ is the scale.
    alone = dynamics.forward(q, nu, np.zeros_like(forced.tau))
    scale = float(np.abs([alone, forced.nu_dot]).max()) or 1.0
    limit = allowed(FORWARD_TOLERANCE, forced.size, scale)
    gap = np.linalg.solve(M, left_over) / scale
    yield worst("forward ∘ inverse", "identity", gap, limit, speeds)
    yield energy_rate(dynamics, forced)


def motion(dynamics: ReducedDynamics, state: State) -> Iterator[Check]:
    """Follow a short motion from the state."""
    yield power_balance(dynamics, state)


def engine(
    dynamics: ReducedDynamics, other: MujocoEngine, scales: RoundingScales, state: State
) -> Iterator[Check]:
    """Compare the reduced equations with another physics engine's.

    Args:
        other: The same robot in the other engine.
    """
    q, nu, names = state.q, state.nu, dynamics.robot.quasi_velocities
    # Places in the world round with its distance, and a wheel's rate squared multiplies them: their
    # equations, which know no place, are taken at the origin.
    theirs, M = other.reduced(np.array([0.0, 0.0, *q[2:]]), nu), dynamics.inertia(q)
    fused = f"part of the body that carries it: {'; '.join(other.refused)}" if other.refused else ""
    data = dynamics.robot.model.createData()
    centre = pin.centerOfMass(dynamics.robot.model, data, q)  # MuJoCo takes inertias about it
    spread = inertia_spread(dynamics, q, centre)
    products = float(max(scales.inertia.max(), (spread**2).max()))
    inertia = relative("reduced inertia M", MUJOCO, M, theirs.M, names, products)
    yield replace(inertia, note=fused)
    products = max(_swing(spread, nu), _spin(dynamics, q, nu))
    limit = allowed(EXACT_TOLERANCE, products, scales.force)
    gap = (dynamics.bias(q, nu) - theirs.h) / scales.force
    yield worst("reduced bias h", MUJOCO, gap, limit, names)
    yield relative("actuation B", MUJOCO, dynamics.actuation(q), theirs.B, names)
    losses = dynamics.robot.losses
    if losses is not None:
        S = dynamics.basis(q)
        v = S @ nu
        dry = losses.friction * v / np.hypot(v, losses.rate)
        note = "friction is left out, a constraint there" if dry.any() else ""
        damping, products = (
            dynamics.losses(q, nu) + S.T @ dry,
            float((np.abs(S.T) @ abs(dry)).max()),
        )
        row = relative("damping of ℓ", MUJOCO, damping, theirs.damping, names, products)
        yield replace(row, note=note)


def _swing(spread: Array, nu: Array) -> float:
    """Return the size of velocity terms whose inertias are spread out, N·m or N."""
    return float(spread.max() * (spread @ np.abs(nu)) * np.abs(nu).max())


def _spin(dynamics: ReducedDynamics, q: Array, nu: Array) -> float:
    """Return the size of what a wheel's centripetal acceleration would make of its inertia.

    A wheel's centre has none, but lies off its axle by what rounds of its place.
    """
    robot, data = dynamics.robot, dynamics.robot.model.createData()
    joints = [robot.model.getJointId(wheel.joint) for wheel in robot.drive.wheels]
    at = [robot.model.joints[joint].idx_v for joint in joints]
    S, inertia = np.abs(dynamics.basis(q)[at]), np.diag(pin.crba(robot.model, data, q))[at]
    pin.forwardKinematics(robot.model, data, q)
    off = [np.linalg.norm(data.oMi[each].translation - data.oMi[1].translation) for each in joints]
    pulled = inertia * off * (S @ np.abs(nu)) ** 2 * S.max(axis=1, initial=0.0)
    return float((S.T @ pulled).max())


def velocity_names(robot: Robot) -> list[str]:
    """Return the names of v's entries."""
    root = FREE_SPEEDS if robot.drive.leans else PLANAR_SPEEDS
    names = [*root, *([""] * (robot.nv - len(root)))]
    for name in robot.moving_joint_names:
        names[robot.velocity_index(name)] = name
    return names


# The oracle's own margin, of the largest: below it a row of A, seen through M⁻¹, repeats others.
RANK_MARGIN = 1e-9


@dataclass(frozen=True)
class ConstrainedMotion:
    """What the constraints make of the efforts.

    Attributes:
        v_dot: Acceleration of the tree (nv,).
        force: Aᵀ λ (nv,), which is determinate.
    """

    v_dot: Array
    force: Array


def constrained_motion(
    robot: Robot, rolling: FileRows, q: Array, v: Array, push: Array
) -> ConstrainedMotion:
    """Solve the tree's equations with multipliers, whatever the rank of A.

    Args:
        push: Generalised force (nv,) of actuators and losses, N·m or N.
    """
    data = robot.model.createData()
    A, drift = rolling.at(q, v)
    force = push - pin.nonLinearEffects(robot.model, data, q, v)
    M = pin.crba(robot.model, data, q)
    factor = cho_factor(M)
    response = cho_solve(factor, A.T)  # acceleration by each multiplier (nv, rows)
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("ij,ji->i", A, response), np.finfo(float).tiny))
    mobility = scale[:, None] * (A @ response) * scale
    inverse = np.linalg.pinv(mobility, rcond=RANK_MARGIN, hermitian=True)
    v_dot, multipliers = np.zeros(len(v)), np.zeros(len(A))
    # What the constraints take back of the free acceleration may be nearly all: the first pass
    # loses those digits, the second solves for what is left of both equations.
    for _ in range(2):
        free = cho_solve(factor, force - M @ v_dot + A.T @ multipliers)
        more = scale * (inverse @ (scale * (-drift - A @ (v_dot + free))))
        v_dot, multipliers = v_dot + free + response @ more, multipliers + more
    return ConstrainedMotion(v_dot, A.T @ multipliers)


def pinocchio_motion(robot: Robot, rolling: FileRows, q: Array, v: Array, push: Array) -> Array:
    """Return v̇ (nv,) by Pinocchio's own constrained dynamics.

    It is well posed for independent rows only, so as many rows of A are handed over as A has rank.

    Args:
        push: Generalised force (nv,) of actuators and losses, N·m or N.
    """
    data = robot.model.createData()
    A, drift = rolling.at(q, v)
    if not len(A):
        return np.asarray(pin.aba(robot.model, data, q, v, push))
    _, triangle, order = qr(A.T, mode="economic", pivoting=True)
    sizes = np.abs(np.diag(triangle))
    rows = order[: np.count_nonzero(sizes > RANK_MARGIN * sizes[0])]
    acceleration = pin.forwardDynamics(
        robot.model, data, q, v, push, np.ascontiguousarray(A[rows]), drift[rows]
    )
    return np.asarray(acceleration).copy()


def effort_columns(robot: Robot) -> Array:
    """Return B_q (nv, n_act): the generalised force of each actuator's unit effort."""
    return np.eye(robot.nv)[:, [robot.velocity_index(name) for name in robot.actuators]]
