"""The plant: the reduced dynamics under efforts held between two samples of the controller."""

from __future__ import annotations

import math

import numpy as np

from rpctl.description.records import Array
from rpctl.dynamics.motion import Step, rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError, RpctlError


def advance(
    dynamics: ReducedDynamics, q: Array, nu: Array, tau: Array, duration: float, longest: float
) -> Step:
    """Advance the robot by ``duration`` (s) under a constant τ, in equal steps.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,).
        duration: How far, s.
        longest: Longest step, s.

    Raises:
        DivergedError: The state left the finite numbers.
    """
    steps = max(1, math.ceil(duration / longest - 1e-9))
    work = 0.0
    try:
        for _ in range(steps):
            q, nu, done = rk4_step(dynamics, q, nu, tau, duration / steps)
            work += done
    except RpctlError as error:
        raise DivergedError(f"the motion diverged: {error}") from error
    if not (np.isfinite(q).all() and np.isfinite(nu).all()):
        raise DivergedError("the motion diverged; shorten the control period or lengthen horizons")
    return Step(q, nu, work)
