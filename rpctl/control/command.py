"""What a kinematic law gives: quasi-velocities to follow, from a twist of the base and the arm."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from rpctl.arrays import Array
from rpctl.control.error import BASE_ERRORS, Tracking
from rpctl.control.steering import base_command
from rpctl.control.twist import Twist
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference


class Command(NamedTuple):
    """Quasi-velocities to follow, and their derivative along the actual motion."""

    nu_d: Array  # (dof,)
    nu_d_dot: Array  # (dof,)


class KinematicLaw(Protocol):
    """Anything that says how a robot should move to follow a reference."""

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> Command:
        """Return the command.

        Args:
            dynamics: The robot's dynamics.
            reference: The reference.
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities of the robot (dof,).
        """


def command(
    dynamics: ReducedDynamics,
    tracking: Tracking,
    q: Array,
    nu: Array,
    twist: Twist,
    horizon: float,
) -> Command:
    """Return the quasi-velocities that give the base a twist and take the arm to its reference.

    The joints' errors, predicted to first order over the horizon, vanish: q̇_d = q̇_r + (q_r − q)/h
    ([MS21, Eq. 20]).

    Args:
        dynamics: The robot's dynamics.
        tracking: Reference and error.
        q: Configuration (nq,).
        nu: Quasi-velocities of the robot (dof,).
        twist: The base's twist; see :func:`rpctl.control.steering.base_command` for how steered
            wheels come by it.
        horizon: Prediction time h, s.
    """
    state, e, e_dot = tracking
    base, base_rate = base_command(dynamics, state, q, nu, twist, horizon)
    rates = state.joint_rates + e[BASE_ERRORS:] / horizon
    accelerations = state.joint_accelerations + e_dot[BASE_ERRORS:] / horizon
    return Command(np.concatenate([base, rates]), np.concatenate([base_rate, accelerations]))
