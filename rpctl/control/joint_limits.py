"""Limits of joints: as bounds on their accelerations, and on the speeds that are commanded."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.law import Limit
from rpctl.dynamics.motion import NO_LAG
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import UnknownNameError

APPROACH_TIME = (
    0.06  # s: time constant with which a rate, or a joint at a position limit, comes to its bound
)
RETURN_PERIODS = 2.0  # control periods in which an exceeded bound is met again; 1: dead-beat
LIMIT_MARGIN = 1e-3  # of a limit, kept free: the prediction is of first order
BRAKE_FRACTION = 0.5  # of the deceleration possible for one joint alone: others brake as well
MIN_BRAKE, MAX_BRAKE = 0.1, 1e4  # rad/s² or m/s²; if efforts cannot hold, or have no limit
NO_LIMIT_GAP = 1e6  # rad or m; a gap beyond it stands for no limit
APPROACH_PERIODS = 2.0  # control periods that the approach to a position takes at least
SPEED_MARGIN = 1e-9  # of a velocity limit: rounding of a product


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
        """Return the joints' rows of S (k, dof) and Ṡν (k,): ẋ = rows ν, ẍ = rows ν̇ + drift."""
        return dynamics.basis(q)[self.indices], dynamics.basis_drift(q, nu)[self.indices]

    def bounds(self, q: Array, rate: Array, brakes: tuple[Array, Array]) -> JointBounds:
        """Return the bounds on ẍ; none asks more of a joint than its actuator alone can give.

        Args:
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


class Speeds(NamedTuple):
    """Quasi-velocities to send to a velocity interface, and the limits that bind them."""

    nu: Array  # (dof,)
    limits: tuple[Limit, ...] = ()


class Actuation(NamedTuple):
    """How speeds follow a command for one control period, from a state on."""

    q: Array  # (nq,)
    nu: Array  # (dof,)
    model_nu: Array  # (dof,): by the commands alone
    period: float  # s
    lag: Array  # (dof,), s: of the first-order lag


class _Rows(NamedTuple):
    """Efforts without acceleration, what acceleration adds to them, their limits and labels."""

    start: Array  # (n,)
    change: Array  # (n,)
    limit: Array  # (n,)
    labels: tuple[Limit, ...]


class SpeedLimits:
    """The limits of one robot's commanded speeds.

    The base comes first, then the arm, each in proportion:

    - Speeds. All of the base's quasi-velocities are scaled by one factor, so that no wheel or
      steering joint is asked for more than its velocity limit: the robot slows down on the path
      that it was asked for. Rates of the arm are limited one by one.
    - Positions. With a lag T a joint that is asked to stop comes to rest at y = x + T ẋ, and
      ẏ = c: the command c keeps y, and so x, within the position limits if it is at most
      (limit − y)/T_s.
    - Accelerations. The command is drawn towards the speeds that it has led to so far, until the
      mean acceleration over the period takes no effort beyond the limits (τ = B⁻ (M ν̇ + h)) and no
      acceleration beyond the settings. These speeds are the model's: where the robot lags more
      than it says, measured ones would keep the command from ever getting away from them. First
      the base, with an arm that does not accelerate; then the arm, beside this base. What already
      takes more without acceleration is left out.

    Speeds are limited last once more, so they hold whatever the robot does.

    Args:
        accelerations: Largest |ν̇| by name of the quasi-velocity, m/s² or rad/s².
        effort_ratio: Fraction of the effort limits that accelerations may take.

    Raises:
        UnknownNameError: An acceleration is of no quasi-velocity of the robot.
    """

    def __init__(
        self, dynamics: ReducedDynamics, accelerations: Mapping[str, float], effort_ratio: float
    ) -> None:
        robot = dynamics.robot
        for name in accelerations:
            if name not in robot.quasi_velocities:
                raise UnknownNameError("quasi-velocity", name, robot.quasi_velocities)
        self._base = len(robot.drive.base_speeds)
        joint = robot.description.joint
        fast = [name for name in robot.moving_joint_names if np.isfinite(joint[name].velocity)]
        self._rows = [robot.velocity_index(name) for name in fast]
        self._fastest = (1.0 - SPEED_MARGIN) * np.array([joint[name].velocity for name in fast])
        self._speed_limits = tuple(Limit(name, "velocity") for name in fast)
        # Joints whose own rate is a quasi-velocity, the last ones of ν: steered ones and the arm's.
        own = [swivel.joint for swivel in robot.drive.steered] + list(robot.joint_names)
        self._own, self._first = own, robot.dof - len(own)
        # A joint without position limits may have two entries in q; none of them binds anything.
        self._entries = [robot.entries[name].index for name in own]
        self._lower, self._upper = (
            np.array([getattr(joint[name], end) for name in own]) for end in ("lower", "upper")
        )
        self._accelerations = np.array(
            [accelerations.get(name, np.inf) for name in robot.quasi_velocities]
        )
        self._acceleration_limits = tuple(
            Limit(name, "acceleration") for name in robot.quasi_velocities
        )
        self._box = effort_ratio * robot.effort_limits
        self._effort_limits = tuple(Limit(name, "effort") for name in robot.actuators)
        self._wheels = len(robot.actuators) - len(robot.joint_names)  # actuators of the base

    def __call__(self, dynamics: ReducedDynamics, wanted: Array, at: Actuation) -> Speeds:
        """Return the speeds to send, and the limits that bind them.

        Args:
            wanted: Speeds without limits (dof,).
            at: The state from which they count, and how they are followed.
        """
        found: dict[Limit, None] = {}
        rows = dynamics.basis(at.q)[self._rows]
        speeds = self._within_speeds(rows, self._within_positions(wanted, at, found), found)
        speeds = self._within_accelerations(dynamics, speeds, at, found)
        return Speeds(self._within_speeds(rows, speeds, found), tuple(found))

    def _within_positions(self, wanted: Array, at: Actuation, found: dict[Limit, None]) -> Array:
        """Return speeds that take no joint beyond its position limits."""
        own = slice(self._first, None)
        time = max(APPROACH_TIME, APPROACH_PERIODS * at.period)
        rest = at.q[self._entries] + at.lag[own] * at.nu[own]
        lowest, highest = (self._lower - rest) / time, (self._upper - rest) / time
        speeds = wanted.copy()
        speeds[own] = np.clip(wanted[own], lowest, highest)
        for kind, binding in (("lower", wanted[own] < lowest), ("upper", wanted[own] > highest)):
            found |= {Limit(self._own[k], kind): None for k in np.flatnonzero(binding)}
        return speeds

    def _within_speeds(self, rows: Array, wanted: Array, found: dict[Limit, None]) -> Array:
        """Return speeds that take no joint beyond its velocity limit.

        Args:
            wanted: Speeds (dof,).
            found: Gets the limits that bind.
        """
        speeds, base, arm = wanted.copy(), slice(self._base), slice(self._base, None)
        ratios = np.abs(rows[:, base] @ wanted[base]) / self._fastest
        worst = float(ratios.max(initial=1.0))
        speeds[base] /= worst
        binding = (ratios == worst) & (worst > 1.0)
        moved = np.abs(rows[:, arm])
        most = np.divide(
            self._fastest[:, None], moved, out=np.full_like(moved, np.inf), where=moved > 0.0
        )
        highest = most.min(axis=0, initial=np.inf)
        held = np.abs(wanted[arm]) > highest
        speeds[arm] = np.clip(wanted[arm], -highest, highest)
        binding |= (most[:, held] == highest[held]).any(axis=1)
        found |= {self._speed_limits[k]: None for k in np.flatnonzero(binding)}
        return speeds

    def _within_accelerations(
        self, dynamics: ReducedDynamics, wanted: Array, at: Actuation, found: dict[Limit, None]
    ) -> Array:
        """Return speeds between the model's and those wanted, that the limits allow to reach.

        Args:
            wanted: Speeds (dof,).
            at: The state from which they count, and how they are followed.
            found: Gets the limits that bind.
        """
        gap = wanted - at.model_nu
        nu_dot = gap * -np.expm1(-at.period / np.maximum(at.lag, NO_LAG)) / at.period
        still = dynamics.efforts(at.q, dynamics.bias(at.q, at.model_nu))
        gain = dynamics.efforts(at.q, dynamics.inertia(at.q))  # (n_act, dof)
        fractions, base, arm = np.ones_like(gap), slice(self._base), slice(self._base, None)
        push = gain[:, base] @ nu_dot[base]
        wheels = slice(self._wheels)
        first = _Rows(still[wheels], push[wheels], self._box[wheels], self._effort_limits[wheels])
        fractions[base] = fraction = self._fraction(first, nu_dot, base, found)
        loaded = still + fraction * push
        rest = _Rows(loaded, gain[:, arm] @ nu_dot[arm], self._box, self._effort_limits)
        fractions[arm] = self._fraction(rest, nu_dot, arm, found)
        return np.asarray(wanted - (1.0 - fractions) * gap)

    def _fraction(
        self, efforts: _Rows, nu_dot: Array, part: slice, found: dict[Limit, None]
    ) -> float:
        """Return the largest fraction, at most 1, of accelerations that the limits allow.

        Args:
            efforts: What the accelerations take.
            found: Gets the limits that bind.
        """
        start = np.concatenate([efforts.start, np.zeros_like(nu_dot[part])])
        change = np.concatenate([efforts.change, nu_dot[part]])
        limit = np.concatenate([efforts.limit, self._accelerations[part]])
        labels = efforts.labels + self._acceleration_limits[part]
        counts = (np.abs(start) <= limit) & (np.abs(start + change) > limit)
        allowed = np.ones_like(start)
        np.divide(limit - np.sign(change) * start, np.abs(change), out=allowed, where=counts)
        least = float(allowed.min(initial=1.0))
        found |= {labels[k]: None for k in np.flatnonzero(counts & (allowed == least))}
        return least
