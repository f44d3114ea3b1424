"""Limits of joint rates and positions, as bounds on the joints' present accelerations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.law import Limit
from rpctl.dynamics.reduced import ReducedDynamics

APPROACH_TIME = 0.06  # s: time constant with which a rate comes to its bound
RETURN_PERIODS = 2.0  # control periods in which an exceeded bound is met again; 1: dead-beat
LIMIT_MARGIN = 1e-3  # of a limit, kept free: the prediction is of first order
BRAKE_FRACTION = 0.5  # of the deceleration possible for one joint alone: others brake as well
MIN_BRAKE, MAX_BRAKE = 0.1, 1e4  # rad/s² or m/s²; if efforts cannot hold, or have no limit
NO_LIMIT_GAP = 1e6  # rad or m; a gap beyond it stands for no limit


class JointBounds(NamedTuple):
    """Bounds on the joints' accelerations, and whether a position is why (or else a rate)."""

    lower: Array  # (k,)
    upper: Array  # (k,)
    by_lower: NDArray[np.bool_]  # (k,)
    by_upper: NDArray[np.bool_]  # (k,)


class JointLimits:
    """The rate and position limits of all joints that have any: wheels, arm and passive ones.

    A rate ẋ, predicted over T, is to stay within

        |ẋ + T ẍ| ≤ velocity limit,    −stop(x − lower) ≤ ẋ + T ẍ ≤ stop(upper − x)

    with x taken at the end of T, for T = 0.06 s and for T = two control periods. The longer T
    shapes the approach to a bound: the rate converges as exp(−t/T), without overshoot if efforts
    are late by less than T/e = 22 ms. The shorter T brakes harder once a bound is exceeded: an
    unmodelled disturbance pushes a rate beyond it by at most T times its acceleration.

    stop(g) is the fastest rate from which the joint can stop within g: g/h1 near the limit, and
    √(2a (g − ½ a h1²)) from g = a h1² on, where the first would need more deceleration than a. A
    joint that respects it now can respect it at the next sample.

    Args:
        dynamics: The robot's dynamics.
        period: Control period, s.
        horizon: Time constant h1 of the last approach to a position limit, s.
    """

    def __init__(self, dynamics: ReducedDynamics, period: float, horizon: float) -> None:
        robot = dynamics.robot
        moving = (robot.description.joint[name] for name in robot.moving_joint_names)
        joints = [j for j in moving if np.isfinite([j.velocity, j.lower, j.upper]).any()]
        self.names = tuple(joint.name for joint in joints)
        self.indices = [robot.velocity_index(name) for name in self.names]
        # A joint without position limits may have two entries in q; none of them binds anything.
        self.entries = [robot.entries[name].index for name in self.names]
        self._horizon, beyond = horizon, RETURN_PERIODS * period
        self.times = np.array([[max(APPROACH_TIME, beyond)], [beyond]])
        self.fastest = (1.0 - LIMIT_MARGIN) * np.array([joint.velocity for joint in joints])
        self.full = np.where(np.isfinite(self.fastest), self.fastest, 1.0)
        lower, upper = (np.array([getattr(j, end) for j in joints]) for end in ("lower", "upper"))
        margin = np.where(np.isfinite(upper - lower), LIMIT_MARGIN * (upper - lower), 0.0)
        self.lower, self.upper = lower + margin, upper - margin

    def rows(self, dynamics: ReducedDynamics, q: Array, nu: Array) -> tuple[Array, Array]:
        """Return the joints' rows of S (k, dof) and Ṡν (k,): ẋ = rows ν, ẍ = rows ν̇ + drift.

        Args:
            dynamics: The robot's dynamics.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
        """
        return dynamics.basis(q)[self.indices], dynamics.basis_drift(q, nu)[self.indices]

    def bounds(self, q: Array, rate: Array, brakes: tuple[Array, Array]) -> JointBounds:
        """Return the bounds on ẍ; none asks more of a joint than its actuator alone can give.

        Args:
            q: Configuration (nq,).
            rate: ẋ (k,), rad/s or m/s.
            brakes: Largest accelerations (k,) down and up that the efforts can give each joint.
        """
        down, up = (np.clip(BRAKE_FRACTION * a, MIN_BRAKE, MAX_BRAKE) for a in brakes)
        ahead = q[self.entries] + self.times * rate  # (2, k)
        rising, falling = self._stop(self.upper - ahead, down), self._stop(ahead - self.lower, up)
        highest = np.minimum(rising, self.fastest)
        lowest = np.minimum(np.maximum(-falling, -self.fastest), highest)
        lower = ((lowest - rate) / self.times).max(axis=0)
        upper = ((highest - rate) / self.times).min(axis=0)
        # An exceeded bound takes precedence over the opposite one.
        lower = np.where(upper < 0.0, np.minimum(lower, upper), lower)
        upper = np.maximum(lower, upper)
        by_lower, by_upper = falling < self.fastest, rising < self.fastest
        return JointBounds(
            np.minimum(lower, brakes[1]),
            np.maximum(upper, -brakes[0]),
            np.asarray(by_lower.any(axis=0)),
            np.asarray(by_upper.any(axis=0)),
        )

    def limit(self, index: int, bounds: JointBounds, upper: bool) -> Limit:
        """Return the limit that a joint's upper or lower bound comes from.

        Args:
            index: Index of the joint in ``names``.
            bounds: Bounds of all joints.
            upper: Whether the upper bound is meant.
        """
        by_position = bounds.by_upper[index] if upper else bounds.by_lower[index]
        kind = ("upper" if upper else "lower") if by_position else "velocity"
        return Limit(self.names[index], kind)

    def _stop(self, gap: Array, brake: Array) -> Array:
        """Return the fastest rates (k,) that stop within the gaps (k,); negative beyond a limit."""
        gap = np.minimum(gap, NO_LIMIT_GAP)
        straight = brake * self._horizon**2
        root = np.sqrt(2.0 * brake * np.maximum(gap - 0.5 * straight, 0.5 * straight))
        return np.where(gap < straight, gap / self._horizon, root)
