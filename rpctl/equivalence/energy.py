"""The energy of the reduced dynamics: it changes by what actuators do and joints lose, no more."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.steering import is_regular
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import (
    DIFFERENCE_TOLERANCE,
    EPS,
    Check,
    allowed,
    difference_step,
    rate,
    worst,
)
from rpctl.equivalence.state import ForcedState, State, efforts
from rpctl.errors import RpctlError

POWER_TOLERANCE = 1e-6  # energy balance of a motion by RK4, extrapolated
POWER_ATTEMPTS = 8  # steps tried, each as one and as two halves: 24 steps of RK4, 0.1 s at most
MAX_POWER_STEP_S = 12.5e-3  # s; the longest
MAX_STEP_ERROR = 1e-7  # of the speeds, in one step: beyond it the step is tried shorter
MAX_FIRST_TURN = 0.1  # rad, of all joints together in the first step
MAX_FIRST_DECAY = 0.1  # of the speeds, by the losses: MAX_STEP_ERROR is that to the fifth / 120
MAX_STEP_GROWTH, MIN_STEP_GROWTH = 2.0, 0.1  # of a step, at most, from one to the next
STEP_SAFETY = 0.9  # of the step that the error allows
RK4_ORDER = 4  # of RK4: twice the step has 2⁴ times the error, in one step twice that
SPEED_SCALE = 0.1  # of the random speeds and accelerations: a motion that few steps resolve


def energy_rate(dynamics: ReducedDynamics, forced: ForcedState) -> Check:
    """Check that the energy changes at the rate at which actuators work and joints lose."""
    robot, q, nu, nu_dot = dynamics.robot, forced.state.q, forced.state.nu, forced.nu_dot
    v = dynamics.basis(q) @ nu

    def energy(time: float) -> Array:
        at = pin.integrate(robot.model, q, time * v)
        return np.array([dynamics.energy(at, nu + time * nu_dot)])

    terms = np.concatenate([nu * (dynamics.actuation(q) @ forced.tau), _lost(dynamics, v)])
    step = difference_step(v)
    gap = rate(energy, step) - terms.sum()
    size, kinetic = float(np.abs(terms).sum()), 0.5 * float(nu @ dynamics.inertia(q) @ nu)
    total = abs(dynamics.energy(q, nu))
    scale = max(min(1.0, kinetic), size, total)
    limit = allowed(DIFFERENCE_TOLERANCE, _products(dynamics, q, nu) / step, scale)
    return worst("energy rate", "power of τ", gap / scale, limit, ["energy"])


def power_balance(dynamics: ReducedDynamics, state: State) -> Check:
    """Follow a motion under constant efforts; its energy must change by their work less losses.

    Every step is made twice, whole and in halves. Where their speeds part, the motion is too fast
    for the step, and it is tried again, shorter: a fault of the energy does not show there. From
    the two gaps of the energy the truncation is extrapolated away (Richardson), a fault is not.
    The motion ends early where it steers to an angle at which ν determines no one motion.
    """
    robot, q, nu = dynamics.robot, state.q, SPEED_SCALE * state.nu
    tau = efforts(dynamics, q, nu, SPEED_SCALE * state.push)
    start, steered = 0.5 * float(nu @ dynamics.inertia(q) @ nu), robot.drive.steered
    step, steps, gap, moved = _first_step(dynamics, q, nu, tau), 0, 0.0, 0.0
    for _ in range(POWER_ATTEMPTS):
        if not is_regular(
            robot.drive, {s.joint: robot.joint_position(q, s.joint) for s in steered}
        ):
            break
        pair = _pair(dynamics, q, nu, tau, step)
        if pair.error <= MAX_STEP_ERROR:
            q, nu, gap, moved = pair.q, pair.nu, gap + pair.gap, moved + abs(pair.work)
            steps += 1
        wished = (MAX_STEP_ERROR / max(pair.error, EPS)) ** (1.0 / (RK4_ORDER + 1))
        step = min(
            MAX_POWER_STEP_S,
            step * float(np.clip(STEP_SAFETY * wished, MIN_STEP_GROWTH, MAX_STEP_GROWTH)),
        )
    if not steps:
        raise RpctlError(
            f"{robot.name}: no step of the motion, as short as {step:.0e} s, converges"
        )
    scale = max(moved, min(1.0, start + moved))
    limit = allowed(POWER_TOLERANCE, steps * _products(dynamics, q, nu), scale)
    return worst("power balance", "work of τ", np.array([gap / scale]), limit, ["energy"])


def _lost(dynamics: ReducedDynamics, v: Array) -> Array:
    """Return the power (nv,) of damping and friction at v (nv,), W; none is positive."""
    losses = dynamics.robot.losses
    return np.zeros_like(v) if losses is None else losses.force(v) * v


def _first_step(dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array) -> float:
    """Return a step (s) in which all joints turn little and losses take little of the speeds."""
    S = dynamics.basis(q)
    v = S @ nu
    rates = float(np.abs(v).sum())
    rates += MAX_POWER_STEP_S * float(np.abs(dynamics.forward(q, nu, tau)).sum())
    shares = [1.0 / MAX_POWER_STEP_S, rates / MAX_FIRST_TURN]
    losses = dynamics.robot.losses
    if losses is not None:
        decay = np.linalg.solve(dynamics.inertia(q), S.T @ (losses.slope(v)[:, None] * S))
        shares.append(float(np.abs(np.linalg.eigvals(decay)).max()) / MAX_FIRST_DECAY)
    return 1.0 / max(shares)


def _products(dynamics: ReducedDynamics, q: Array, nu: Array) -> float:
    """Return the magnitude of the terms summed into the energy, J: ½ |v|ᵀ|M||v| plus |E|."""
    robot, v = dynamics.robot, np.abs(dynamics.basis(q) @ nu)
    M = np.abs(pin.crba(robot.model, robot.model.createData(), q))
    return 0.5 * float(v @ M @ v) + abs(dynamics.energy(q, nu))


@dataclass(frozen=True)
class _StepPair:
    """A step made in two halves, compared with the same step made at once."""

    q: Array
    nu: Array
    work: float  # J
    gap: float  # J; energy gained less work done, truncation extrapolated away
    error: float  # of the speeds, relative; infinite where the motion broke down in the step


def _pair(dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array, step: float) -> _StepPair:
    """Return a step of the motion (s), made whole and in halves."""
    with np.errstate(over="ignore", invalid="ignore"):
        try:
            whole = rk4_step(dynamics, q, nu, tau, step)
            half = rk4_step(dynamics, q, nu, tau, 0.5 * step)
            end = rk4_step(dynamics, half.q, half.nu, tau, 0.5 * step)
        except RpctlError:
            return _StepPair(q, nu, 0.0, 0.0, np.inf)
    start = dynamics.energy(q, nu)
    work = half.work - half.lost + end.work - end.lost
    coarse = dynamics.energy(whole.q, whole.nu) - start - whole.work + whole.lost
    fine = dynamics.energy(end.q, end.nu) - start - work
    size = np.abs(end.nu).max() + np.abs(end.nu - nu).max()
    error = float(np.abs(end.nu - whole.nu).max() / size)
    error = error if math.isfinite(error) else np.inf
    return _StepPair(end.q, end.nu, work, fine + (fine - coarse) / (2.0**RK4_ORDER - 1.0), error)
