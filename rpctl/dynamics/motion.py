"""One step of the motion on the configuration manifold, SE(2) × joints."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.reduced import ReducedDynamics

FRICTION_RATE = 0.05  # rad/s or m/s: a joint that is slower has less than its dry friction


class Step(NamedTuple):
    """State after a step, and the work that the efforts did in it."""

    q: Array  # (nq,)
    nu: Array  # (dof,)
    work: float  # J


def friction_efforts(friction: Array, rates: Array) -> Array:
    """Return the efforts (n_act,) of dry friction: −f q̇/√(q̇² + ε²), smooth where q̇ changes sign.

    Args:
        friction: Its size f of each actuator's joint (n_act,), N·m or N.
        rates: Rates q̇ of these joints (n_act,), rad/s or m/s.
    """
    return np.asarray(-friction * rates / np.sqrt(rates**2 + FRICTION_RATE**2))


def rk4_step(
    dynamics: ReducedDynamics,
    q: Array,
    nu: Array,
    tau: Array,
    dt: float,
    friction: Array | None = None,
) -> Step:
    """Advance M ν̇ + h = B τ by ``dt`` (s) under a constant τ, and dry friction if any.

    A Runge-Kutta-Munthe-Kaas method of order 4: the stages live in the Lie algebra of the planar
    root, so q stays on the manifold and the order is that of the classical method.

    Args:
        dynamics: The reduced dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,), N·m or N.
        dt: Step, s.
        friction: Dry friction of each actuator's joint (n_act,), N·m or N; None: none.

    Returns:
        The state after ``dt`` and the work done by τ and friction.
    """
    model = dynamics.robot.model

    def stage(slide: Array, speed: Array) -> tuple[Array, Array, float]:
        place = pin.integrate(model, q, slide)
        at = dynamics.at(place)
        push = tau if friction is None else tau + friction_efforts(friction, at.B.T @ speed)
        power = float((at.B @ push) @ speed)
        return dexpinv(slide, at.S @ speed), dynamics.forward(place, speed, push), power

    v1, a1, p1 = stage(np.zeros(model.nv), nu)
    v2, a2, p2 = stage(0.5 * dt * v1, nu + 0.5 * dt * a1)
    v3, a3, p3 = stage(0.5 * dt * v2, nu + 0.5 * dt * a2)
    v4, a4, p4 = stage(dt * v3, nu + dt * a3)
    sixth = dt / 6.0
    return Step(
        q=np.asarray(pin.integrate(model, q, sixth * (v1 + 2.0 * (v2 + v3) + v4))),
        nu=nu + sixth * (a1 + 2.0 * (a2 + a3) + a4),
        work=sixth * (p1 + 2.0 * (p2 + p3) + p4),
    )


def dexpinv(slide: Array, v: Array) -> Array:
    """Return dexp⁻¹ of the planar root to second order: v + ½[u, v] + ¹⁄₁₂[u, [u, v]].

    Only the root's three velocities (body frame) fail to commute.
    """
    x, y, turn = slide[:3]
    bx, by = turn * -v[1] + v[2] * y, turn * v[0] - v[2] * x
    corrected = v.copy()
    corrected[0] += 0.5 * bx - turn * by / 12.0
    corrected[1] += 0.5 * by + turn * bx / 12.0
    return corrected
