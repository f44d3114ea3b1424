"""Limits of joint rates and positions, as bounds on what the joints may accelerate now."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpctl.control.law import Limit
from rpctl.description.records import Array
from rpctl.dynamics.reduced import ReducedDynamics

AHEAD = 2.0  # control periods after which a rate is back within its bounds; 1 would be dead-beat
ROOM = 1e-3  # of a limit, kept free: the prediction is of first order
BRAKE_SHARE = 0.5  # of what the efforts could do to one joint: others want to brake as well
LEAST_BRAKE, HARDEST_BRAKE = 0.1, 1e4  # rad/s² or m/s²; where efforts cannot hold, or know no limit
FAR = 1e6  # rad or m; a gap beyond it stands for no limit


class JointBounds(NamedTuple):
    """Bounds on the joints' accelerations, and the limit that each of them comes from."""

    lower: Array  # (k,)
    upper: Array  # (k,)
    lower_limits: tuple[Limit, ...]
    upper_limits: tuple[Limit, ...]


class JointLimits:
    """The rate and position limits of all joints that have any: wheels, arm and passive ones.

    A rate ẋ, predicted over T = 2 control periods, is to stay within

        |ẋ + T ẍ| ≤ velocity limit,    −stop(x − lower) ≤ ẋ + T ẍ ≤ stop(upper − x)

    with x at the end of T. stop(g) is the fastest rate that can still be braked within the gap g:
    g/h1 near the limit, and √(2a (g − ½ a h1²)) from g = a h1² on, where the former would brake
    harder than a. So a joint that obeys now is able to obey later.

    Args:
        dynamics: The robot's dynamics.
        control_period: s.
        horizon: Time constant h1 of the last approach to a position limit, s.
    """

    def __init__(self, dynamics: ReducedDynamics, control_period: float, horizon: float) -> None:
        robot = dynamics.robot
        moving = (robot.description.joint[name] for name in robot.model.names[2:])
        joints = [j for j in moving if np.isfinite([j.velocity, j.lower, j.upper]).any()]
        self.names = tuple(joint.name for joint in joints)
        self._rows = [robot.velocity_index(name) for name in self.names]
        self._robot, self._horizon, self._ahead = robot, horizon, AHEAD * control_period
        self._fastest = (1.0 - ROOM) * np.array([joint.velocity for joint in joints])
        lower, upper = np.array([joint.lower for joint in joints]), [j.upper for j in joints]
        room = np.where(np.isfinite(upper - lower), ROOM * (upper - lower), 0.0)
        self._lower, self._upper = lower + room, upper - room

    def rows(self, dynamics: ReducedDynamics, q: Array, nu: Array) -> tuple[Array, Array]:
        """Return the joints' rows of S (k, dof) and Ṡν (k,): ẋ = rows ν, ẍ = rows ν̇ + drift."""
        return dynamics.basis(q)[self._rows], dynamics.basis_drift(q, nu)[self._rows]

    def bounds(self, q: Array, rate: Array, brakes: tuple[Array, Array]) -> JointBounds:
        """Return the bounds on ẍ; none asks more of a joint than its actuator alone can give.

        Args:
            q: Configuration (nq,).
            rate: ẋ (k,), rad/s or m/s.
            brakes: Largest accelerations (k,) down and up that the efforts can give each joint.
        """
        down, up = (np.clip(BRAKE_SHARE * a, LEAST_BRAKE, HARDEST_BRAKE) for a in brakes)
        position = np.array([self._robot.joint_position(q, name) for name in self.names])
        ahead = position + self._ahead * rate
        rising, falling = self._stop(self._upper - ahead, down), self._stop(ahead - self._lower, up)
        highest = np.minimum(rising, self._fastest)
        lowest = np.minimum(np.maximum(-falling, -self._fastest), highest)
        return JointBounds(
            np.minimum((lowest - rate) / self._ahead, brakes[1]),
            np.maximum((highest - rate) / self._ahead, -brakes[0]),
            self._limits("lower", falling),
            self._limits("upper", rising),
        )

    def _stop(self, gap: Array, brake: Array) -> Array:
        """Return the fastest rate (k,) that can be braked within each gap; beyond it, a retreat."""
        gap = np.minimum(gap, FAR)
        straight = brake * self._horizon**2
        root = np.sqrt(2.0 * brake * np.maximum(gap - 0.5 * straight, 0.5 * straight))
        return np.where(gap < straight, gap / self._horizon, root)

    def _limits(self, kind: str, stop: Array) -> tuple[Limit, ...]:
        kinds = np.where(stop < self._fastest, kind, "velocity").tolist()
        return tuple(map(Limit, self.names, kinds))
