"""Limits of joint rates and positions in symbols; see :mod:`rpctl.control.joint_limits`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import casadi

from rpctl.arrays import Array
from rpctl.control.bounded import ROUNDING
from rpctl.control.joint_limits import (
    BRAKE_FRACTION,
    MAX_BRAKE,
    MIN_BRAKE,
    NO_LIMIT_GAP,
    JointLimits,
)
from rpctl.simulation.compiled.symbols.choices import clipped
from rpctl.simulation.compiled.symbols.dynamics import SymbolicDynamics
from rpctl.simulation.compiled.symbols.linear import reciprocal

# A joint without position limits may have any rate below this one (rad/s or m/s), wherever it is,
# at any h1 up to 1000 s: √(2 · 0.1 · ½ · 10⁶) = 316.
NEVER_STOPPED = 300.0


@dataclass(frozen=True, eq=False)
class SymbolicBounds:
    """As :class:`rpctl.control.joint_limits.JointBounds`, (k, 1) each."""

    lower: Any
    upper: Any
    by_lower: Any
    by_upper: Any


class SymbolicJointLimits:
    """:class:`JointLimits` in symbols.

    Args:
        limits: Those of a robot.
        horizon: Time constant h1 of the last approach to a position limit, s.
    """

    def __init__(self, limits: JointLimits, horizon: Any) -> None:
        self._limits, self._horizon = limits, horizon

    def rows(self, dynamics: SymbolicDynamics, q: Any, nu: Any) -> tuple[Any, Any]:
        """Return the joints' rows of S (k, dof) and Ṡν (k, 1): ẋ = rows ν, ẍ = rows ν̇ + drift.

        Args:
            dynamics: The robot's dynamics.
            q: Configuration (nq, 1).
            nu: Quasi-velocities (dof, 1).
        """
        indices, at = self._limits.indices, dynamics.at(q)
        return at.S[indices, :], at.drift(nu)[indices]

    def brakes(self, box: Array, holding: Any, gain: Any, rows: Any) -> list[tuple[Any, Any]]:
        """Return the largest accelerations of each joint alone, down and up.

        Args:
            box: Limits of the efforts (n_act,).
            holding: Efforts at zero acceleration (n_act, 1).
            gain: Derivative of the efforts by ν̇ (n_act, dof).
            rows: Rows of S of the joints (k, dof).
        """
        found = []
        for j in range(rows.shape[0]):
            row = rows[j, :]
            cost = gain @ (row.T / casadi.fmax(casadi.dot(row, row), ROUNDING))
            down, up = casadi.SX(math.inf), casadi.SX(math.inf)
            for k, limit in enumerate(box.tolist()):
                if math.isfinite(limit):
                    size = casadi.fmax(casadi.fabs(cost[k]), ROUNDING)
                    ease = reciprocal(size)
                    room, pull = limit * ease, holding[k] * casadi.copysign(ease, cost[k])
                    pull = casadi.if_else(size > ROUNDING, pull, 0.0)
                    down, up = casadi.fmin(down, room + pull), casadi.fmin(up, room - pull)
            found.append((down, up))
        return found

    def bounds(self, q: Any, rate: Any, brakes: list[tuple[Any, Any]]) -> SymbolicBounds:
        """Return the bounds on ẍ; none asks more of a joint than its actuator alone can give.

        Args:
            q: Configuration (nq, 1).
            rate: ẋ (k, 1), rad/s or m/s.
            brakes: Largest accelerations of each joint, down and up.
        """
        each = [self._bounds(j, q, rate[j], *pair) for j, pair in enumerate(brakes)]
        none = casadi.SX(0, 1)
        parts = zip(*each, strict=True) if each else ((), (), (), ())
        return SymbolicBounds(*(casadi.vertcat(*part, none) for part in parts))

    def _bounds(self, j: int, q: Any, rate: Any, down: Any, up: Any) -> tuple[Any, Any, Any, Any]:
        limits = self._limits
        braking = [clipped(BRAKE_FRACTION * a, MIN_BRAKE, MAX_BRAKE) for a in (down, up)]
        fastest = float(limits.fastest[j])
        lowers, uppers, by_lower, by_upper = [], [], casadi.SX(0), casadi.SX(0)
        for time in limits.times.ravel().tolist():
            ahead = q[limits.entries[j]] + time * rate
            rising, stops_up = self._stop(float(limits.upper[j]), ahead, braking[0], fastest)
            falling, stops_down = self._stop(-float(limits.lower[j]), -ahead, braking[1], fastest)
            lowest = casadi.fmin(-falling, rising)
            lowers.append((lowest - rate) / time)
            uppers.append((rising - rate) / time)
            by_lower = casadi.logic_or(by_lower, stops_down)
            by_upper = casadi.logic_or(by_upper, stops_up)
        lower, upper = casadi.fmax(*lowers), casadi.fmin(*uppers)
        # An exceeded bound takes precedence over the opposite one.
        lower = casadi.if_else(upper < 0.0, casadi.fmin(lower, upper), lower)
        upper = casadi.fmax(lower, upper)
        return casadi.fmin(lower, up), casadi.fmax(upper, -down), by_lower, by_upper

    def _stop(self, limit: float, ahead: Any, brake: Any, fastest: float) -> tuple[Any, Any]:
        """Return the fastest rate that stops below a limit, and whether that is why.

        Args:
            limit: Upper one, rad or m.
            ahead: Where the joint is, rad or m.
            brake: Deceleration, positive.
            fastest: The largest rate anyway.
        """
        if math.isinf(limit) and fastest < NEVER_STOPPED:
            return casadi.SX(fastest), casadi.SX(0)
        gap = NO_LIMIT_GAP if math.isinf(limit) else casadi.fmin(limit - ahead, NO_LIMIT_GAP)
        straight = brake * self._horizon**2
        half = 0.5 * straight
        root = casadi.sqrt(2.0 * brake * casadi.fmax(gap - half, half))
        rate = casadi.if_else(gap < straight, gap / self._horizon, root)
        return casadi.fmin(rate, fastest), rate < fastest

    def doubtful(self, q: Any, rate: Any, acceleration: Any) -> Any:
        """Return whether bounds may be broken, (1, 1), with what is known without M.

        No joint brakes less than MIN_BRAKE, and none of its bounds is tighter than with that.

        Args:
            q: Configuration (nq, 1).
            rate: ẋ (k, 1), rad/s or m/s.
            acceleration: ẍ (k, 1).
        """
        limits, found = self._limits, casadi.SX(0)
        for j, fastest in enumerate(limits.fastest.tolist()):
            for time in limits.times.ravel().tolist():
                place, moved = (
                    q[limits.entries[j]] + time * rate[j],
                    rate[j] + time * acceleration[j],
                )
                for limit, sign in ((limits.upper[j], 1.0), (-limits.lower[j], -1.0)):
                    most, _ = self._stop(float(limit), sign * place, MIN_BRAKE, fastest)
                    found = casadi.logic_or(found, sign * moved > most)
        return found

    def broken(self, acceleration: Any, bounds: SymbolicBounds) -> Any:
        """Return whether an acceleration (k, 1) is out of bounds, (1, 1).

        Args:
            acceleration: ẍ.
            bounds: Of it.
        """
        found = casadi.SX(0)
        for j in range(acceleration.numel()):
            found = casadi.logic_or(found, acceleration[j] < bounds.lower[j])
            found = casadi.logic_or(found, acceleration[j] > bounds.upper[j])
        return found
