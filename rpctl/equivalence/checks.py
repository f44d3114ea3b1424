"""The comparisons of the certificate, each at one random state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from rpctl.description.records import Array
from rpctl.dynamics.basis import basis, selection
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import Check
from rpctl.equivalence.gibbs_appell import GibbsAppell, Terms
from rpctl.equivalence.lagrange import constrained_motion, effort_columns, pinocchio_motion
from rpctl.robot.model import BASE_NV, Robot
from rpctl.robot.steering import regular

if TYPE_CHECKING:
    from rpctl.equivalence.mujoco_engine import MujocoEngine

EXACT = 1e-12  # float64 rounding over a tree of tens of links, with two decades to spare
SCALED = 1e-10  # as EXACT, but an entry may be small against its row and column
FORWARD = 1e-10  # solving with M amplifies rounding by cond M; see FORWARD_CONDITION
FORWARD_CONDITION = 10.0  # times machine epsilon times cond M
DIFFERENCE = 1e-6  # central differences: truncation h² against rounding eps/h
DIFFERENCE_STEP = 1e-5  # s; near the cube root of machine epsilon
POWER = 1e-6  # energy balance of a motion by RK4 at POWER_STEP
POWER_STEP = 1e-3  # s
POWER_STEPS = 100
GIBBS = "Gibbs-Appell"
MUJOCO = "MuJoCo"


@dataclass(frozen=True)
class State:
    """A random state, reproducible from a seed and an index."""

    q: Array  # (nq,) joints inside their limits
    v: Array  # (nv,) of the free tree
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)


def draw_state(robot: Robot, seed: int, sample: int) -> State:
    """Return the random state that :func:`rpctl.verify` compares at a sample of a seed."""
    rng = np.random.default_rng([seed, sample])
    q = robot.random_configuration(rng)
    v, nu, nu_dot = (rng.normal(size=n) for n in (robot.nv, robot.dof, robot.dof))
    return State(q, v, nu, nu_dot)


def full_tree(robot: Robot, oracle: GibbsAppell, state: State) -> Iterator[Check]:
    """Compare the free tree: Pinocchio against the Gibbs function."""
    data = robot.model.createData()
    terms, names = oracle.full(state.q, state.v), velocity_names(robot)
    inertia = pin.crba(robot.model, data, state.q)
    bias = pin.nonLinearEffects(robot.model, data, state.q, state.v)
    yield relative("full inertia", GIBBS, inertia, terms.M, names)
    yield worst("full bias", GIBBS, (bias - terms.h) / (terms.h_size.max() or 1.0), EXACT, names)


def reduced(
    dynamics: ReducedDynamics, oracle: GibbsAppell, terms: Terms, state: State
) -> Iterator[Check]:
    """Compare the reduced equations: projection against the oracle's ``terms`` in ν, and G."""
    robot, q, nu, nu_dot = dynamics.robot, state.q, state.nu, state.nu_dot
    names = robot.quasi_velocities
    M = dynamics.inertia(q)
    scale = np.sqrt(np.outer(np.diag(terms.M), np.diag(terms.M)))
    yield relative("reduced inertia M", GIBBS, M, terms.M, names)
    yield worst("M, entry by entry", GIBBS, (M - terms.M) / scale, SCALED, names)
    size = terms.h_size.max() or 1.0
    bias = dynamics.bias(q, nu)
    yield worst("reduced bias h", GIBBS, (bias - terms.h) / size, EXACT, names)
    yield relative("actuation B", GIBBS, dynamics.actuation(q), terms.B, names)
    v, rates = dynamics.basis(q) @ nu, np.zeros(robot.nv)
    rates[:BASE_NV] = terms.root @ nu
    for name, row in terms.rates.items():
        rates[robot.velocity_index(name)] = row @ nu
    yield relative("rolling wheels S ν", GIBBS, v, rates, velocity_names(robot))
    yield from _coriolis(dynamics, state, size)
    inverse, gradient = dynamics.inverse(q, nu, nu_dot), terms.M @ nu_dot + terms.h
    size += np.abs(terms.M @ nu_dot).max()
    yield worst("inverse dynamics", "∂G/∂ν̇", (inverse - gradient) / size, EXACT, names)
    # G is quadratic in ν̇, so this difference over a whole step is its derivative, not near it.
    rise = oracle.gibbs(q, nu, nu_dot + nu) - oracle.gibbs(q, nu, nu_dot - nu)
    gap = (0.5 * rise - inverse @ nu) / (size * np.abs(nu).sum())
    yield worst("inverse dynamics along ν", "G itself", np.array([gap]), EXACT, ["ν"])


def multipliers(dynamics: ReducedDynamics, state: State) -> Iterator[Check]:
    """Compare accelerations and constraint forces with the Lagrange-multiplier path."""
    robot, q, nu = dynamics.robot, state.q, state.nu
    names, v = velocity_names(robot), dynamics.basis(q) @ nu
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, state.nu_dot))
    v_dot = dynamics.basis(q) @ dynamics.forward(q, nu, tau) + dynamics.basis_drift(q, nu)
    lagrange = constrained_motion(robot, q, v, tau)
    limit = forward_limit(dynamics.inertia(q))
    yield relative("accelerations", "Lagrange multipliers", v_dot, lagrange.v_dot, names, limit)
    own = pinocchio_motion(robot, q, v, tau)
    yield relative("accelerations", "Pinocchio, constrained", v_dot, own, names, limit)
    torques = pin.rnea(robot.model, robot.model.createData(), q, v, v_dot)
    force = torques - effort_columns(robot) @ tau
    size = max(np.abs(torques).max(), np.abs(force).max(), np.abs(tau).max())
    gap = (force - lagrange.force) / size
    yield worst("constraint forces Aᵀ λ", "Lagrange multipliers", gap, limit, names)


def consistent(dynamics: ReducedDynamics, state: State) -> Iterator[Check]:
    """Check the reduced dynamics against themselves."""
    robot, q, nu = dynamics.robot, state.q, state.nu
    S, A, M = dynamics.basis(q), dynamics.constraint(q), dynamics.inertia(q)
    slack = A @ S / max(1.0, float(np.abs(A).max(initial=0.0) * np.abs(S).max()))
    yield worst("no slip A S", "0", slack, EXACT, [f"row {i}" for i in range(len(A))])
    pace = _pace(S @ nu)
    step = pace * (S @ nu)
    ahead, behind = (pin.integrate(robot.model, q, s) for s in (step, -step))
    W = selection(robot, dynamics.rolling)
    ahead_S, behind_S = (basis(dynamics.constraint(at), W).S for at in (ahead, behind))
    S_dot = (ahead_S - behind_S) / (2.0 * pace)
    change = S_dot @ nu - dynamics.basis_drift(q, nu)
    scale = max(1.0, float(np.abs(S @ nu).max()))
    names = velocity_names(robot)
    yield worst("basis drift Ṡ ν", "differences", change / scale, DIFFERENCE, names)
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, state.nu_dot))
    back, limit, speeds = dynamics.forward(q, nu, tau), forward_limit(M), robot.quasi_velocities
    # B τ and h cancel but for M ν̇, and each is rounded: what h alone makes of ν̇ is the scale.
    alone = dynamics.forward(q, nu, np.zeros_like(tau))
    size = float(np.abs([alone, state.nu_dot]).max())
    gap = (back - state.nu_dot) / size
    yield worst("forward ∘ inverse", "identity", gap, limit, speeds)
    asymmetry = (M - M.T) / np.abs(M).max()
    yield worst("M symmetric", "Mᵀ", asymmetry, EXACT, speeds)
    lost = np.array([0.0 if np.linalg.eigvalsh(M)[0] > 0.0 else np.inf])
    yield worst("M positive definite", "least eigenvalue", lost, EXACT, ["M"])
    yield _energy_rate(dynamics, state)
    yield from _power(dynamics, state)


def engine(
    dynamics: ReducedDynamics, terms: Terms, other: MujocoEngine, state: State
) -> Iterator[Check]:
    """Compare the reduced equations with another physics engine's; ``terms`` scale the bias."""
    q, nu, names = state.q, state.nu, dynamics.robot.quasi_velocities
    theirs, M = other.reduced(q, nu), dynamics.inertia(q)
    size = terms.h_size.max() or 1.0
    fused = f"part of the body that carries it: {'; '.join(other.refused)}" if other.refused else ""
    yield replace(relative("reduced inertia M", MUJOCO, M, theirs.M, names), note=fused)
    gap = (dynamics.bias(q, nu) - theirs.h) / size
    yield worst("reduced bias h", MUJOCO, gap, EXACT, names)
    yield relative("actuation B", MUJOCO, dynamics.actuation(q), theirs.B, names)


def _coriolis(dynamics: ReducedDynamics, state: State, size: float) -> Iterator[Check]:
    """Check C = Sᵀ(C_full S + M_full Ṡ): C ν + g = h, and Ṁ − 2C is skew-symmetric.

    ``size`` is the scale of h.
    """
    robot, q, nu = dynamics.robot, state.q, state.nu
    data, S, names = robot.model.createData(), dynamics.basis(q), robot.quasi_velocities
    pace = _pace(S @ nu)
    step = pace * (S @ nu)
    ahead, behind = (pin.integrate(robot.model, q, s) for s in (step, -step))
    S_dot = (dynamics.basis(ahead) - dynamics.basis(behind)) / (2.0 * pace)
    M_dot = (dynamics.inertia(ahead) - dynamics.inertia(behind)) / (2.0 * pace)
    C_full = pin.computeCoriolisMatrix(robot.model, data, q, S @ nu)
    C = S.T @ (C_full @ S + pin.crba(robot.model, data, q) @ S_dot)
    gap = C @ nu + dynamics.bias(q, np.zeros_like(nu)) - dynamics.bias(q, nu)
    size = max(size, float(np.abs(C).max() * np.abs(nu).max()))
    limit = DIFFERENCE if S_dot.any() else EXACT  # a basis that moves is known by differences here
    yield worst("Coriolis C ν + g", "h", gap / size, limit, names)
    skew = M_dot - 2.0 * C
    scale = max(1.0, np.abs(C).max(), np.abs(M_dot).max())
    yield worst("Ṁ − 2C skew-symmetric", "differences", (skew + skew.T) / scale, DIFFERENCE, names)


def _power(dynamics: ReducedDynamics, state: State) -> Iterator[Check]:
    """Follow a motion; its energy must change by the actuators' work.

    A tenth of the random speeds and accelerations keeps the motion within what the step resolves.
    It ends early where it steers to an angle at which ν determines no one motion.
    """
    robot, q, nu = dynamics.robot, state.q, 0.1 * state.nu
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, 0.1 * state.nu_dot))
    start, work, moved = dynamics.energy(q, nu), 0.0, 0.0
    steered = robot.drive.steered
    for _ in range(POWER_STEPS):
        if not regular(robot.drive, {s.joint: robot.joint_position(q, s.joint) for s in steered}):
            break
        q, nu, done = rk4_step(dynamics, q, nu, tau, POWER_STEP)
        work, moved = work + done, moved + abs(done)
    gap = (dynamics.energy(q, nu) - start - work) / max(moved, 1.0)
    yield worst("power balance", "work of τ", np.array([gap]), POWER, ["energy"])


def _energy_rate(dynamics: ReducedDynamics, state: State) -> Check:
    """Check that the energy changes at the rate at which the actuators work."""
    robot, q, nu = dynamics.robot, state.q, state.nu
    tau = dynamics.efforts(q, dynamics.inverse(q, nu, state.nu_dot))
    v = dynamics.basis(q) @ nu
    h = _pace(v)
    ahead, behind = (
        dynamics.energy(pin.integrate(robot.model, q, step * v), nu + step * state.nu_dot)
        for step in (h, -h)
    )
    terms = nu * (dynamics.actuation(q) @ tau)
    gap = (ahead - behind) / (2.0 * h) - terms.sum()
    scale = max(1.0, float(np.abs(terms).sum()), abs(dynamics.energy(q, nu)))
    return worst("energy rate", "power of τ", np.array([gap / scale]), DIFFERENCE, ["energy"])


def _pace(v: Array) -> float:
    """Return the time (s) of a central difference along v: shorter where casters spin fast."""
    return DIFFERENCE_STEP / max(1.0, float(np.abs(v).max()))


def forward_limit(M: Array) -> float:
    """Return the limit of accelerations: rounding, as the condition of M amplifies it."""
    return max(FORWARD, FORWARD_CONDITION * float(np.finfo(float).eps * np.linalg.cond(M)))


def velocity_names(robot: Robot) -> list[str]:
    """Return the names of v's entries."""
    names = ["vx", "vy", "omega"] + [""] * (robot.nv - BASE_NV)
    for name in robot.model.names[2:]:
        names[robot.velocity_index(name)] = name
    return names


def relative(
    name: str,
    against: str,
    value: Array,
    truth: Array,
    names: Sequence[str],
    limit: float = EXACT,
) -> Check:
    """Compare two arrays relative to the largest entry."""
    scale = float(np.abs(truth).max()) if truth.size else 0.0
    return worst(name, against, (value - truth) / (scale or 1.0), limit, names)


def worst(name: str, against: str, gap: Array, limit: float, names: Sequence[str]) -> Check:
    """Return the largest deviation of an array and its entry; NaN counts as infinite."""
    if not gap.size:
        return Check(name, against, 0.0, limit)
    size = np.where(np.isfinite(gap), np.abs(gap), np.inf)
    index = np.unravel_index(int(np.argmax(size)), size.shape)
    labels = [names[int(i)] if i < len(names) else str(i) for i in index]
    return Check(name, against, float(size[index]), limit, entry=", ".join(labels))
