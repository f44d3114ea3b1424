"""The energy of the reduced dynamics: it changes by what actuators do and joints lose, no more."""

from __future__ import annotations

from functools import partial

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.drive.steering import is_regular
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.equivalence.certificate import (
    DIFFERENCE_TOLERANCE,
    Check,
    allowed,
    difference_step,
    rate,
    worst,
)
from rpctl.equivalence.state import ForcedState, State, efforts
from rpctl.errors import RpctlError
from rpctl.libraries import library
from rpctl.robot.model import Robot

POWER_TOLERANCE = 1e-6  # energy balance of a motion, with decades to spare
POWER_SPAN_S = 0.1  # s; of the motion, at most
FIRST_STEP_S = 1e-3  # s; tried: SciPy's own guess may be no number, and is then tried for ever
POWER_EVALUATIONS = 70  # no step begins after these: a fast motion is followed for less time
ACCURACY = 1e-10  # of a step of the integrator
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
    scale = max(min(1.0, kinetic), size, abs(dynamics.energy(q, nu)))
    limit = allowed(DIFFERENCE_TOLERANCE, _products(dynamics, q, nu) / step, scale)
    return worst("energy rate", "power of τ", gap / scale, limit, ["energy"])


def power_balance(dynamics: ReducedDynamics, state: State) -> Check:
    """Follow a motion under constant efforts; its energy must change by their work less losses.

    SciPy's integrator follows it, the work among its unknowns; no step is the product's own. The
    motion ends early where it steers to an angle at which ν determines no one motion.
    """
    robot, q, nu = dynamics.robot, state.q, SPEED_SCALE * state.nu
    tau = efforts(dynamics, q, nu, SPEED_SCALE * state.push)
    start, before = 0.5 * float(nu @ dynamics.inertia(q) @ nu), dynamics.energy(q, nu)
    follow = partial(_rates, dynamics, q, tau)
    here = np.concatenate([np.zeros(robot.nv), nu, [0.0]])
    rates = np.abs(follow(0.0, here))
    size = (
        POWER_SPAN_S * rates[: robot.nv].max(),
        np.abs(nu).max(),
        start + POWER_SPAN_S * rates[-1],
    )
    floor = ACCURACY * np.repeat(size, [robot.nv, robot.dof, 1])
    steps, moved = 0, 0.0
    with np.errstate(over="ignore", invalid="ignore"):
        solver = library("scipy.integrate").DOP853(
            follow, 0.0, here, POWER_SPAN_S, first_step=FIRST_STEP_S, rtol=ACCURACY, atol=floor
        )
        while solver.nfev < POWER_EVALUATIONS:
            angles = {s.joint: robot.joint_position(q, s.joint) for s in robot.drive.steered}
            if not is_regular(robot.drive, angles):  # ν determines no one motion there
                break
            solver.step()
            if solver.status == "failed":
                break
            steps, moved = steps + 1, moved + abs(float(solver.y[-1] - here[-1]))
            here = solver.y
            q, nu = _place(robot, state.q, here), here[robot.nv : -1]
            if solver.status == "finished":
                break
    if not steps:
        raise RpctlError(f"{robot.name}: no step of the motion, however short, converges")
    gap = dynamics.energy(q, nu) - before - here[-1]
    scale = max(moved, min(1.0, start + moved))
    limit = allowed(POWER_TOLERANCE, steps * _products(dynamics, q, nu), scale)
    return worst("power balance", "work of τ", np.array([gap / scale]), limit, ["energy"])


def _rates(dynamics: ReducedDynamics, start: Array, tau: Array, _: float, y: Array) -> Array:
    """Return the rates of what was travelled, of ν and of the work; NaN where there are none.

    Args:
        start: Configuration (nq,) from which y's first nv entries are travelled: x and y (and z) in
            the world, m, then angles (a rotation vector of a root that leans) and slides.
    """
    robot = dynamics.robot
    q, nu = _place(robot, start, y), y[robot.nv : -1]
    try:
        nu_dot = dynamics.forward(q, nu, tau)
    except RpctlError:
        return np.full_like(y, np.nan)
    at = dynamics.at(q)
    v = at.S @ nu
    power = nu @ at.B @ tau + _lost(dynamics, v).sum()
    if robot.drive.leans:
        travelled = pin.exp3(y[3:6])
        v[3:6] = pin.Jlog3(travelled) @ v[3:6]
        v[:3] = pin.Quaternion(q[3:7]).matrix() @ v[:3]
    else:
        cos, sin = q[2:4]
        v[:2] = cos * v[0] - sin * v[1], sin * v[0] + cos * v[1]
    return np.array([*v, *nu_dot, power])


def _place(robot: Robot, start: Array, y: Array) -> Array:
    """Return the configuration (nq,) after what was travelled."""
    slides = 3 if robot.drive.leans else 2
    q = pin.integrate(robot.model, start, np.array([*np.zeros(slides), *y[slides : robot.nv]]))
    q[:slides] += y[:slides]
    return np.asarray(q)


def _lost(dynamics: ReducedDynamics, v: Array) -> Array:
    """Return the power (nv,) of damping and friction at v (nv,), W; none is positive."""
    losses = dynamics.robot.losses
    return np.zeros_like(v) if losses is None else losses.force(v) * v


def _products(dynamics: ReducedDynamics, q: Array, nu: Array) -> float:
    """Return the magnitude of the terms summed into the energy, J: ½ |v|ᵀ|M||v| plus |E|."""
    robot, v = dynamics.robot, np.abs(dynamics.basis(q) @ nu)
    M = np.abs(pin.crba(robot.model, robot.model.createData(), q))
    return 0.5 * float(v @ M @ v) + abs(dynamics.energy(q, nu))
