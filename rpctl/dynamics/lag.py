"""Speeds that follow their commands by a first-order lag, and the motion at such speeds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.dynamics.motion import dexpinv
from rpctl.dynamics.reduced import ReducedDynamics

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
    x = np.asarray(durations)[:, None] / np.maximum(lag, NO_LAG)  # (n, dof)
    left = np.exp(-x)  # of the distance to the command, after the stretch
    mean = -np.expm1(-x) / x
    change = np.where(
        x > SERIES_RATIO, 12.0 * ((mean - left) / x - 0.5 * mean), x * (0.5 * x - 1.0)
    )
    stretches = []
    for k, duration in enumerate(durations):
        gap = nu - commands[k]
        stretches.append(Stretch(float(duration), commands[k] + gap * mean[k], gap * change[k]))
        nu = commands[k] + gap * left[k]
    return nu, stretches


def joined(stretches: list[Stretch], longest: float) -> list[Stretch]:
    """Return neighbouring stretches joined until they are as long as ``longest`` (s).

    The integral and the first moment of ν stay exact.
    """
    found, group, length = [], list[Stretch](), 0.0
    for stretch in stretches:
        if group and length + stretch.duration > longest:
            found.append(_one(group, length))
            group, length = [], 0.0
        group.append(stretch)
        length += stretch.duration
    return [*found, _one(group, length)] if group else found


def _one(group: list[Stretch], length: float) -> Stretch:
    """Return one stretch of this length (s) for those of a group."""
    if len(group) == 1:
        return group[0]
    total, moment, start = np.zeros_like(group[0].mean), np.zeros_like(group[0].mean), 0.0
    for duration, mean, change in group:
        total = total + duration * mean
        middle = start + 0.5 * (duration - length)
        moment = moment + duration * (middle * mean + duration * change / 12.0)
        start += duration
    return Stretch(length, total / length, 12.0 * moment / length**2)


def travel(dynamics: ReducedDynamics, q: Array, stretch: Stretch) -> Array:
    """Return q (nq,) after a stretch: q̇ = S(q) ν, by the method of :func:`rk4_step`.

    Args:
        dynamics: The reduced dynamics.
        q: Configuration at the beginning (nq,).
        stretch: ν on the way.

    Raises:
        SingularBasisError: On the way the steered wheels fix no one motion.
    """
    model = dynamics.robot.model
    dt, mean, change = stretch

    def stage(slide: Array, speed: Array) -> Array:
        S = dynamics.basis(q if dynamics.constant else pin.integrate(model, q, slide))
        return dexpinv(slide, S @ speed)

    v1 = stage(np.zeros(model.nv), mean - 0.5 * change)
    v2 = stage(0.5 * dt * v1, mean)
    v3 = stage(0.5 * dt * v2, mean)
    v4 = stage(dt * v3, mean + 0.5 * change)
    return np.asarray(pin.integrate(model, q, dt / 6.0 * (v1 + 2.0 * (v2 + v3) + v4)))
