"""Wheels that roll without slipping: the reduced dynamics themselves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.motion import Outside, Step, step
from rpctl.dynamics.outside import quasi_force
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import DivergedError, RpctlError
from rpctl.robot.coordinates import read_root
from rpctl.simulation.plants.motion import Ground
from rpctl.simulation.plants.wrench import Wrench


class RollingMotion:
    """A robot that moves as the reduced dynamics say; see :class:`Motion`.

    Args:
        dynamics: Of the simulated robot.
        q: Configuration (nq,) at rest.
        longest: Longest step of the integration, s.
    """

    notes: tuple[str, ...] = ()

    def __init__(self, dynamics: ReducedDynamics, q: Array, longest: float) -> None:
        self._dynamics, self._longest = dynamics, longest
        self.q, self.nu = q, np.zeros(dynamics.robot.dof)

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): it stays level."""
        x, y, heading = read_root(self.q)
        height = -self._dynamics.robot.drive.ground
        return np.array([x, y, height, 0, 0, math.sin(0.5 * heading), math.cos(0.5 * heading)])

    def ground(self) -> Ground:
        """Return nothing: the log derives it from the motion."""
        return Ground()

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance the robot; see :class:`Motion`.

        Args:
            tau: Actuator efforts (n_act,), N·m or N.
            dt: For how long, s.
            wrenches: What pushes it besides.
        """
        outside = partial(quasi_force, self._dynamics, wrenches=wrenches) if wrenches else None
        found = advance(self._dynamics, self.q, self.nu, tau, dt, self._longest, outside)
        self.q, self.nu = found.q, found.nu
        return found


def substeps(duration: float, longest: float) -> int:
    """Return in how many equal steps of at most ``longest`` (s) a ``duration`` (s) is taken."""
    return max(1, math.ceil(duration / longest - 1e-9))


def advance(
    dynamics: ReducedDynamics,
    q: Array,
    nu: Array,
    tau: Array,
    duration: float,
    longest: float,
    outside: Outside | None = None,
) -> Step:
    """Advance the robot by ``duration`` (s) under a constant τ, in equal steps.

    Args:
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        nu: Quasi-velocities (dof,).
        tau: Actuator efforts (n_act,).
        duration: How far, s.
        longest: Longest step, s.
        outside: What pushes the robot besides; None: nothing.

    Raises:
        DivergedError: The state left the finite numbers.
    """
    steps = substeps(duration, longest)
    work = lost = 0.0
    try:
        for _ in range(steps):
            q, nu, done, gone = step(dynamics, q, nu, tau, duration / steps, outside)
            work, lost = work + done, lost + gone
    except RpctlError as error:
        raise DivergedError(f"the motion diverged: {error}") from error
    if not (np.isfinite(q).all() and np.isfinite(nu).all()):
        raise DivergedError("the motion diverged; shorten the control period or lengthen horizons")
    return Step(q, nu, work, lost)
