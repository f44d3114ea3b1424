"""Limits of joints as bounds on their accelerations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.scalars import clipped, reciprocal
from rpctl.robot.model import Robot

APPROACH_TIME = (
    0.06  # s: time constant with which a rate, or a joint at a position limit, comes to its bound
)
RETURN_PERIODS = 2.0  # control periods in which an exceeded bound is met again; 1: dead-beat
LIMIT_MARGIN = 1e-3  # of a limit, kept free: the prediction is of first order
BRAKE_FRACTION = 0.5  # of the deceleration possible for one joint alone: others brake as well
MIN_BRAKE, MAX_BRAKE = 0.1, 1e4  # rad/s² or m/s²; if efforts cannot hold, or have no limit
NO_LIMIT_GAP = 1e6  # rad or m; a gap beyond it stands for no limit


# A joint without position limits may have any rate below this one (rad/s or m/s), wherever it is,
# at any h1 up to 1000 s: √(2 · 0.1 · ½ · 10⁶) = 316.
NEVER_STOPPED = 300.0
ROUNDING = 1e-12  # N·m or N per unit of acceleration, or a rate per unit of ν: rounding


class JointBounds(NamedTuple):
    """Bounds on the joints' accelerations, and whether a position is why (or else a rate)."""

    lower: Any  # (k, 1)
    upper: Any  # (k, 1)
    by_lower: Any  # (k, 1)
    by_upper: Any  # (k, 1)


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
    joint that respects it now can respect it at the next sample. The formulas are over scalars.

    Args:
        period: Control period, s.
    """

    def __init__(self, robot: Robot, period: float) -> None:
        moving = (robot.description.joint[name] for name in robot.moving_joint_names)
        joints = [j for j in moving if np.isfinite([j.velocity, j.lower, j.upper]).any()]
        self.names = tuple(joint.name for joint in joints)
        self.indices = [robot.velocity_index(name) for name in self.names]
        # A joint without position limits may have two entries in q; none of them binds anything.
        self.entries = [robot.entries[name].index for name in self.names]
        beyond = RETURN_PERIODS * period
        self.times = (max(APPROACH_TIME, beyond), beyond)
        self.fastest = (1.0 - LIMIT_MARGIN) * np.array([joint.velocity for joint in joints])
        self.full = np.where(np.isfinite(self.fastest), self.fastest, 1.0)
        lower, upper = (np.array([getattr(j, end) for j in joints]) for end in ("lower", "upper"))
        margin = np.where(np.isfinite(upper - lower), LIMIT_MARGIN * (upper - lower), 0.0)
        self.lower, self.upper = lower + margin, upper - margin

    def rows(self, dynamics: SymbolicDynamics, q: Any, nu: Any) -> tuple[Any, Any]:
        """Return the joints' rows of S (k, dof) and Ṡν (k, 1): ẋ = rows ν, ẍ = rows ν̇ + drift."""
        at = dynamics.at(q)
        return at.S[self.indices, :], at.drift(nu)[self.indices]

    def bounds(self, q: Any, rate: Any, brakes: list[tuple[Any, Any]], horizon: Any) -> JointBounds:
        """Return the bounds on ẍ; none asks more of a joint than its actuator alone can give.

        Args:
            q: Configuration (nq, 1).
            rate: ẋ (k, 1), rad/s or m/s.
            brakes: Largest accelerations that the efforts can give each joint, down and up.
            horizon: Time constant h1 of the last approach to a position limit, s.
        """
        each = [self._bounds(j, q, rate[j], brake, horizon) for j, brake in enumerate(brakes)]
        parts = zip(*each, strict=True) if each else [()] * 4
        return JointBounds(*(math.vertcat(*part, math.SX(0, 1)) for part in parts))

    def _bounds(
        self, j: int, q: Any, rate: Any, brake: tuple[Any, Any], horizon: Any
    ) -> tuple[Any, Any, Any, Any]:
        lowers, uppers, by_lower, by_upper = [], [], math.SX(0), math.SX(0)
        kept = [clipped(BRAKE_FRACTION * a, MIN_BRAKE, MAX_BRAKE) for a in brake]
        for time in self.times:
            ahead = q[self.entries[j]] + time * rate
            rising, stops_up = self._stop(j, self.upper[j], ahead, kept[0], horizon)
            falling, stops_down = self._stop(j, -self.lower[j], -ahead, kept[1], horizon)
            lowers.append((math.fmin(-falling, rising) - rate) / time)
            uppers.append((rising - rate) / time)
            by_lower = math.logic_or(by_lower, stops_down)
            by_upper = math.logic_or(by_upper, stops_up)
        lower, upper = math.fmax(*lowers), math.fmin(*uppers)
        # An exceeded bound takes precedence over the opposite one.
        lower = math.if_else(upper < 0.0, math.fmin(lower, upper), lower)
        upper = math.fmax(lower, upper)
        return math.fmin(lower, brake[1]), math.fmax(upper, -brake[0]), by_lower, by_upper

    def _stop(self, j: int, limit: float, ahead: Any, brake: Any, horizon: Any) -> tuple[Any, Any]:
        """Return the fastest rate that stops below a limit, and whether that is why.

        Args:
            j: Number of the joint.
            limit: Upper one, rad or m.
            ahead: Where the joint is, rad or m.
            brake: Deceleration, positive.
            horizon: h1, s.
        """
        fastest, endless = float(self.fastest[j]), np.isinf(limit)
        if endless and fastest < NEVER_STOPPED:
            return math.SX(fastest), math.SX(0)
        gap = NO_LIMIT_GAP if endless else math.fmin(float(limit) - ahead, NO_LIMIT_GAP)
        straight = brake * horizon**2
        half = 0.5 * straight
        root = math.sqrt(2.0 * brake * math.fmax(gap - half, half))
        rate = math.if_else(gap < straight, gap / horizon, root)
        return math.fmin(rate, fastest), rate < fastest

    def doubtful(self, q: Any, rate: Any, acceleration: Any, horizon: Any) -> Any:
        """Return whether bounds may be broken, (1, 1), with what is known without M.

        No joint brakes less than MIN_BRAKE, and none of its bounds is tighter than with that.

        Args:
            q: Configuration (nq, 1).
            rate: ẋ (k, 1), rad/s or m/s.
            acceleration: ẍ (k, 1).
            horizon: h1, s.
        """
        found = math.SX(0)
        for j, entry in enumerate(self.entries):
            for time in self.times:
                ahead, then = q[entry] + time * rate[j], rate[j] + time * acceleration[j]
                for limit, sign in ((self.upper[j], 1.0), (-self.lower[j], -1.0)):
                    most, _ = self._stop(j, limit, sign * ahead, MIN_BRAKE, horizon)
                    found = math.logic_or(found, sign * then > most)
        return found


def largest_accelerations(box: Array, holding: Any, gain: Any, rows: Any) -> list[tuple[Any, Any]]:
    """Return the largest accelerations of each joint alone, down and up.

    The accelerations of the other joints are zero, and every actuator stays within its limit.

    Args:
        box: Limits of the efforts (n_act,).
        holding: Efforts at zero acceleration (n_act, 1).
        gain: Derivative of the efforts by ν̇ (n_act, dof).
        rows: Rows of S of the joints (k, dof).
    """
    found = []
    limited = [(k, limit) for k, limit in enumerate(box.tolist()) if np.isfinite(limit)]
    for j in range(rows.shape[0]):
        row = rows[j, :]
        cost = gain @ (row.T / math.fmax(math.dot(row, row), ROUNDING))
        down = up = math.SX(np.inf)
        for k, limit in limited:
            size = math.fmax(math.fabs(cost[k]), ROUNDING)
            ease = reciprocal(size)
            # What is rounding has no sign: an actuator that the joint does not need holds nothing.
            pull = holding[k] * math.copysign(ease, cost[k])
            pull = math.if_else(size > ROUNDING, pull, 0.0)
            down, up = math.fmin(down, limit * ease + pull), math.fmin(up, limit * ease - pull)
        found.append((down, up))
    return found
