"""One step of the motion on the configuration manifold, SE(2) × joints, or SE(3) × joints.

[ARS97] U. M. Ascher, S. J. Ruuth, R. J. Spiteri, "Implicit-explicit Runge-Kutta methods for
time-dependent partial differential equations", Applied Numerical Mathematics 25, 1997.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg.lapack import dposv

from rpctl.arrays import Array
from rpctl.dynamics.projection import dexpinv
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.robot.losses import Losses

GAMMA = 1.0 - math.sqrt(0.5)  # of ARS(2,2,2)
DELTA = 1.0 - 0.5 / GAMMA
RK4_WEIGHTS = np.array([1.0, 2.0, 2.0, 1.0])  # of its stages, in sixths of the step


Outside = Callable[[Array], Array]  # from q (nq,) to a quasi-force (dof,) from outside


class Step(NamedTuple):
    """State after a step, the work that was done in it, and what losses took of it.

    The work is that of the efforts and of what pushes the robot from outside.
    """

    q: Array  # (nq,)
    nu: Array  # (dof,)
    work: float  # J
    lost: float = 0.0  # J


def step(
    dynamics: ReducedDynamics,
    q: Array,
    nu: Array,
    tau: Array,
    dt: float,
    outside: Outside | None = None,
) -> Step:
    """Advance M ν̇ + h = B τ + ℓ by ``dt`` (s) under a constant τ.

    Losses may be stiff: friction stops a light joint within far less than a step. A robot that has
    any is advanced by :func:`imex_step`, another by :func:`rk4_step`; both have these arguments.

    Args:
        dynamics: The reduced dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,), N·m or N.
        dt: Step, s.
        outside: What pushes the robot besides; None: nothing.
    """
    advance = rk4_step if dynamics.robot.losses is None else imex_step
    return advance(dynamics, q, nu, tau, dt, outside)


def rk4_step(
    dynamics: ReducedDynamics,
    q: Array,
    nu: Array,
    tau: Array,
    dt: float,
    outside: Outside | None = None,
) -> Step:
    """Advance M ν̇ + h = B τ + ℓ by ``dt`` (s) under a constant τ, explicitly.

    A Runge-Kutta-Munthe-Kaas method of order 4: the stages live in the Lie algebra of the
    root, so q stays on the manifold and the order is that of the classical method.
    """
    if outside is None and (done := dynamics.stepped(q, nu, tau, dt)) is not None:
        return Step(*done)
    model, losses = dynamics.robot.model, dynamics.robot.losses

    def stage(slide: Array, speed: Array) -> tuple[Array, Array, float]:
        place = pin.integrate(model, q, slide)
        push = None if outside is None else outside(place)
        v, nu_dot, power = dynamics.rates(place, speed, tau, outside=push)
        motion.append(v)
        return dynamics.dexpinv(slide, v), nu_dot, power

    motion: list[Array] = []
    half, sixth = 0.5 * dt, dt / 6.0
    v1, a1, p1 = stage(np.zeros(model.nv), nu)
    v2, a2, p2 = stage(half * v1, nu + half * a1)
    v3, a3, p3 = stage(half * v2, nu + half * a2)
    v4, a4, p4 = stage(dt * v3, nu + dt * a3)
    lost = 0.0
    if losses is not None:
        v = np.array(motion)
        lost = -float((losses.force(v) * v).sum(axis=1).dot(RK4_WEIGHTS))
    return Step(
        q=dynamics.integrate(q, sixth * (v1 + 2.0 * (v2 + v3) + v4)),
        nu=nu + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        work=float(sixth * (p1 + 2.0 * (p2 + p3) + p4)),
        lost=sixth * lost,
    )


def imex_step(
    dynamics: ReducedDynamics,
    q: Array,
    nu: Array,
    tau: Array,
    dt: float,
    outside: Outside | None = None,
) -> Step:
    """Advance M ν̇ + h = B τ + ℓ by ``dt`` (s) under a constant τ, implicit in the losses.

    ARS(2,2,2) of [ARS97]: of order 2, explicit in all but ℓ, for which it is L-stable: a joint
    that friction holds stands still (but for its creep); what it stops within a step may swing back
    by an eighth of what it could take. Work and loss are impulses times the mean of the speeds
    before and after: where M and S are constant, the energy's balance closes to rounding.
    """
    model, losses, own = dynamics.robot.model, dynamics.robot.losses, GAMMA * dt
    if losses is None:
        raise RpctlError(f"{dynamics.robot.name} loses nothing")
    start = dynamics.at(q)
    pushed = outside or (lambda q: np.zeros(len(nu)))
    M, push = dynamics.lossless(q, nu, tau)
    given = pushed(q)
    a1, v1 = solve_positive(M, push + given), start.S @ nu
    slide = own * v1
    place = pin.integrate(model, q, slide)
    S = dynamics.basis(place)
    middle = braked(losses, dynamics.inertia(place), S, nu + own * a1, own, nu)
    M, push = dynamics.lossless(place, middle, tau)
    v2 = S @ middle
    brake = losses.force(v2)
    push = (1.0 - DELTA) * (push + pushed(place)) + (1.0 - GAMMA) * (S.T @ brake)
    a2 = solve_positive(M, push)
    way = DELTA * v1 + (1.0 - DELTA) * dynamics.dexpinv(slide, v2)
    end = dynamics.integrate(q, dt * way)
    at = dynamics.at(end)
    after = braked(losses, dynamics.inertia(end), at.S, nu + dt * (DELTA * a1 + a2), own, middle)
    v3 = at.S @ after
    impulse = dt * ((1.0 - GAMMA) * brake + GAMMA * losses.force(v3))
    work = tau @ (start.B.T @ nu + at.B.T @ after) + given @ nu + pushed(end) @ after
    lost = -0.5 * float(impulse @ (v1 + v3))
    return Step(end, after, 0.5 * dt * float(work), lost)


CONVERGED = 1e-9  # of the largest rate: the error after a correction that small is its square
NEWTON_STEPS = 25  # tried before only the sure ones are; from rest or from sliding it takes 1 to 4
SURE_STEPS = 500
OVERSHOOT = 0.5  # of the slope along a Newton step at its start: more at its end is too far


def braked(losses: Losses, M: Array, S: Array, nu: Array, weight: float, guess: Array) -> Array:
    """Return the ν (dof,) that M (ν − ν₀) = w ℓ(ν), ℓ(ν) = Sᵀ force(S ν), leaves of ν₀.

    It is the one minimum of the strictly convex ½ |ν − ν₀|²_M + w Σ potential(S ν). Newton's steps
    find it in a few; a step that crosses the bend of the friction law goes too far, and one with
    the curvature f/√(q̇² + ε²) is taken instead, which never does (it minimises a parabola that lies
    above the potential).

    Args:
        losses: The losses.
        M: Reduced inertia (dof, dof).
        S: Basis (nv, dof).
        nu: ν₀ (dof,).
        weight: w, s.
        guess: Where to start (dof,).

    Raises:
        RpctlError: M is not positive definite, or a number is not finite.
    """
    found, v = guess, S.dot(guess)
    gradient = M.dot(found - nu) - weight * S.T.dot(losses.force(v))
    for attempt in range(NEWTON_STEPS + SURE_STEPS):
        step = solve_positive(M + S.T.dot((weight * losses.slope(v))[:, None] * S), -gradient)
        ahead = found + step
        v_ahead = S.dot(ahead)
        gradient_ahead = M.dot(ahead - nu) - weight * S.T.dot(losses.force(v_ahead))
        bound = OVERSHOOT * abs(float(gradient.dot(step)))
        small = np.abs(v_ahead - v).max() <= CONVERGED * (losses.rate.min() + np.abs(v).max())
        if not small and (attempt >= NEWTON_STEPS or abs(float(gradient_ahead.dot(step))) > bound):
            step = solve_positive(M + S.T.dot((weight * losses.secant(v))[:, None] * S), -gradient)
            ahead = found + step
            v_ahead = S.dot(ahead)
            gradient_ahead = M.dot(ahead - nu) - weight * S.T.dot(losses.force(v_ahead))
        if small:
            return np.asarray(ahead)
        found, v, gradient = ahead, v_ahead, gradient_ahead
    raise RpctlError(
        "the friction in the joints does not determine the speeds; its numbers are not finite"
    )


def solve_positive(H: Array, force: Array) -> Array:
    """Return H⁻¹ force (dof,).

    Raises:
        RpctlError: H is not positive definite.
    """
    _, found, info = dposv(H, force)
    if info:
        raise RpctlError("the reduced inertia is not positive definite")
    return np.asarray(found)


NO_LAG = 1e-12  # s: a shorter lag is none
SERIES_RATIO = 1e-3  # of duration to lag: below it a series keeps the digits of a difference


class Stretch(NamedTuple):
    """ν over a stretch of time: the line nearest to it, which has its integral and first moment."""

    duration: float  # s
    mean: Array  # (dof,)
    change: Array  # (dof,): of the line, from the beginning to the end


def follow(nu: Array, commands: Array, durations: Array, lag: Array) -> tuple[Array, list[Stretch]]:
    """Return ν after a sequence of constant commands, and the stretches on the way; exact.

    T ν̇ = c − ν gives ν = c + (ν₀ − c) e^(−t/T); without a lag ν is c at once.

    Args:
        nu: Quasi-velocities at the beginning (dof,).
        commands: c of each stretch (n, dof).
        durations: Of the stretches (n,), all positive, s.
        lag: T of each quasi-velocity (dof,), s.
    """
    x = durations[:, None] / np.maximum(lag, NO_LAG)  # (n, dof)
    left, mean, change = of_gap(x, np.tanh(0.5 * x), np.where)
    gaps = np.empty_like(x)
    for gap, command, share in zip(gaps, commands, left, strict=True):
        gap[:] = nu - command
        nu = command + gap * share
    return nu, list(map(Stretch, durations.tolist(), commands + gaps * mean, gaps * change))


def of_gap(x: Any, half: Any, chosen: Any) -> tuple[Any, Any, Any]:
    """Return, of the gap to a held command, what a lag leaves, the mean, and the line's change.

    Args:
        x: t/T, numbers or symbols, above 0.
        half: tanh(x/2), of which e⁻ˣ is made.
        chosen: What takes a condition and what holds where it is true, and where not.
    """
    left, mean = (1.0 - half) / (1.0 + half), 2.0 * half / (1.0 + half) / x
    far = 12.0 * ((mean - left) / x - 0.5 * mean)
    return left, mean, chosen(x > SERIES_RATIO, far, x * (0.5 * x - 1.0))


def travel(dynamics: Any, q: Any, stretch: Stretch) -> Any:
    """Return q (nq,) after a stretch: q̇ = S(q) ν, by the method of :func:`rk4_step`.

    Args:
        dynamics: The reduced dynamics, or the symbolic ones of symbols.
        q: Configuration at the beginning (nq,).
        stretch: ν on the way.

    Raises:
        SingularBasisError: On the way the steered wheels fix no one motion.
    """
    dt, mean, change = stretch

    def stage(slide: Any, speed: Any) -> Any:
        S = dynamics.basis(q if dynamics.constant else dynamics.integrate(q, slide))
        return dexpinv(slide, S @ speed)

    v1 = stage(np.zeros(dynamics.robot.nv), mean - 0.5 * change)
    v2 = stage(0.5 * dt * v1, mean)
    v3 = stage(0.5 * dt * v2, mean)
    v4 = stage(dt * v3, mean + 0.5 * change)
    return dynamics.integrate(q, dt / 6.0 * (v1 + 2.0 * (v2 + v3) + v4))
