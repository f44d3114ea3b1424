"""Limits of the speeds that a velocity interface is sent, as a formula over scalars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.jerk_limits import JerkLimits
from rpctl.control.joint_limits import APPROACH_TIME
from rpctl.control.law import Limit
from rpctl.dynamics.motion import NO_LAG
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.errors import require_known
from rpctl.kernels.scalars import clipped
from rpctl.robot.model import Robot

APPROACH_PERIODS = 2.0  # control periods that the approach to a position takes at least
SPEED_MARGIN = 1e-9  # of a velocity limit: rounding of a product
EFFORT_ROUNDING = 1e-12  # of an effort limit


class Lateness(NamedTuple):
    """How late quasi-velocities follow their commands, numbers or scalars."""

    lag: Any  # (dof, 1): T, to first order, s
    share: Any  # (dof, 1): of the way to a command that a period brings, over the period, 1/s

    @classmethod
    def of(cls, lag: Array, period: float) -> Lateness:
        """Return that of lags (dof,), s, sampled with a period (s)."""
        return cls(lag, -np.expm1(-period / np.maximum(lag, NO_LAG)) / period)


class SpeedSample(NamedTuple):
    """A state from which commanded speeds count, over scalars."""

    q: Any  # (nq, 1)
    nu: Any  # (dof, 1)
    model_nu: Any  # (dof, 1): what the commands so far have led to, by the model
    model_nu_dot: Any  # (dof, 1): its mean rate since the last sample


class _Found(NamedTuple):
    """Speeds within some limits, and which of these bind."""

    nu: Any  # (dof, 1)
    binding: Any  # (n, 1)


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

    - Jerks, where any are bounded; see :class:`~rpctl.control.jerk_limits.JerkLimits`. A joint that
      is kept off its stop knows none.

    Speeds are limited last once more, so they hold whatever the robot does.

    Args:
        period: Control period, s.
        late: How late the quasi-velocities follow.
        accelerations: Largest |ν̇| by name of the quasi-velocity, m/s² or rad/s².
        effort_ratio: Fraction of the effort limits that accelerations may take.
        speeds: Largest |ν| by name of the quasi-velocity, m/s or rad/s, besides the URDF's.
        jerks: Largest rate of ν̇ likewise, m/s³ or rad/s³.

    Attributes:
        labels: The limits, in the order of the flags of what binds.

    Raises:
        UnknownNameError: A bound is of no quasi-velocity of the robot.
    """

    def __init__(
        self,
        robot: Robot,
        period: float,
        late: Lateness,
        accelerations: Mapping[str, float],
        effort_ratio: float,
        speeds: Mapping[str, float],
        jerks: Mapping[str, float],
    ) -> None:
        names = robot.quasi_velocities
        require_known("quasi-velocity", [*accelerations, *speeds, *jerks], names)
        self._robot, self._base = robot, len(robot.drive.base_speeds)
        joint = robot.description.joint
        fast = [name for name in robot.moving_joint_names if np.isfinite(joint[name].velocity)]
        self._rows = [robot.velocity_index(name) for name in fast]
        self._fastest = [(1.0 - SPEED_MARGIN) * joint[name].velocity for name in fast]
        slow = [name for name in names if name in speeds]
        self._fastest += [(1.0 - SPEED_MARGIN) * speeds[name] for name in slow]
        self._own_rows = np.eye(robot.dof)[[names.index(name) for name in slow]]
        # Joints whose own rate is a quasi-velocity, the last ones of ν: steered ones and the arm's.
        own = [swivel.joint for swivel in robot.drive.steered] + list(robot.joint_names)
        first = robot.dof - len(own)
        # A joint without position limits may have two entries in q; none of them binds anything.
        self._own = [
            (k, robot.entries[name].index, joint[name].lower, joint[name].upper)
            for k, name in enumerate(own, start=first)
        ]
        self._time = max(APPROACH_TIME, APPROACH_PERIODS * period)
        self._lag, self._share = late
        most = [accelerations.get(name, np.inf) for name in names]
        bounds = (
            np.array([of.get(name, np.inf) for name in names])
            for of in (jerks, speeds, accelerations)
        )
        self._jerks = JerkLimits(period, self._share, *bounds)
        self._most = np.concatenate([effort_ratio * robot.effort_limits, most])
        self._wheels = len(robot.actuators) - len(robot.joint_names)  # actuators of the base
        kinds: dict[str, Sequence[str]] = {
            "lower": own,
            "upper": own,
            "velocity": fast,
            "speed": slow,
        }
        kinds |= {"effort": robot.actuators, "acceleration": names}
        kinds["jerk"] = [name for name in names if name in jerks]
        self.labels = tuple(Limit(name, kind) for kind, names in kinds.items() for name in names)

    def __call__(
        self, dynamics: SymbolicDynamics, wanted: Any, at: SpeedSample, rate: Any
    ) -> tuple[Any, Any]:
        """Return the speeds to send (dof, 1), and 1 of each limit of ``labels`` that binds.

        Args:
            wanted: Speeds without limits (dof, 1).
            rate: Of those (dof, 1).
        """
        rows = math.vertcat(dynamics.basis(at.q)[self._rows, :], math.DM(self._own_rows))
        kept = self._within_positions(wanted, at)
        slow = self._within_speeds(rows, kept.nu)
        soft = self._within_accelerations(dynamics, slow.nu, at)
        calm = self._within_jerks(soft.nu, _Found(slow.nu - wanted, kept.binding), at, rate)
        last = self._within_speeds(rows, calm.nu)
        fast = [math.logic_or(*pair) for pair in _pairs(slow.binding, last.binding)]
        return last.nu, math.vertcat(kept.binding, *fast, soft.binding, calm.binding)

    def _within_positions(self, wanted: Any, at: SpeedSample) -> _Found:
        """Return speeds that take no joint beyond its position limits."""
        speeds, below, above = math.vertsplit(wanted), list[Any](), list[Any]()
        for k, entry, lower, upper in self._own:
            rest, asked = at.q[entry] + self._lag[k] * at.nu[k], speeds[k]
            lowest = (lower - rest) / self._time if np.isfinite(lower) else -np.inf
            highest = (upper - rest) / self._time if np.isfinite(upper) else np.inf
            speeds[k] = clipped(asked, lowest, highest)
            below.append(asked < lowest)
            above.append(asked > highest)
        return _Found(math.vertcat(*speeds), math.vertcat(*below, *above, math.SX(0, 1)))

    def _within_speeds(self, rows: Any, wanted: Any) -> _Found:
        """Return speeds that take no joint beyond its velocity limit.

        Args:
            rows: Of S, of the joints that have one (k, dof).
            wanted: Speeds (dof, 1).
        """
        base, speeds = self._base, math.vertsplit(wanted)
        turned = math.fabs(rows[:, :base] @ wanted[:base])
        ratios = [turned[j] / most for j, most in enumerate(self._fastest)]
        worst = math.SX(1.0)
        for ratio in ratios:
            worst = math.fmax(worst, ratio)
        binding = [math.logic_and(ratio == worst, worst > 1.0) for ratio in ratios]
        speeds[:base] = [speed / worst for speed in speeds[:base]]
        for k in range(base, len(speeds)):
            asked, most = speeds[k], {}
            for j in range(rows.shape[0]):
                moved = math.fabs(rows[j, k])
                if not moved.is_zero():
                    most[j] = math.if_else(moved > 0.0, self._fastest[j] / moved, np.inf)
            highest = math.SX(np.inf)
            for each in most.values():
                highest = math.fmin(highest, each)
            speeds[k] = math.fmax(math.fmin(asked, highest), -highest)
            held = math.fabs(asked) > highest
            for j, each in most.items():
                binding[j] = math.logic_or(binding[j], math.logic_and(held, each == highest))
        return _Found(math.vertcat(*speeds), math.vertcat(*binding, math.SX(0, 1)))

    def _within_accelerations(
        self, dynamics: SymbolicDynamics, wanted: Any, at: SpeedSample
    ) -> _Found:
        """Return speeds between the model's and those wanted, that the limits allow to reach.

        Args:
            wanted: Speeds (dof, 1).
        """
        gap, base, count = wanted - at.model_nu, self._base, len(self._robot.actuators)
        nu_dot = gap * self._share
        zeros = math.SX.zeros(self._robot.dof, 1)
        still = math.vertcat(dynamics.efforts(at.q, dynamics.bias(at.q, at.model_nu)), zeros)
        gain = math.vertcat(
            dynamics.at(at.q).allocation @ dynamics.inertia(at.q), math.SX.eye(self._robot.dof)
        )
        push = gain[:, :base] @ nu_dot[:base]
        wheels = [*range(self._wheels), *range(count, count + base)]
        share, first = self._fraction(still, push, wheels)
        arm = [*range(count), *range(count + base, len(self._most))]
        rest, second = self._fraction(still + share * push, gain[:, base:] @ nu_dot[base:], arm)
        shares = math.vertcat(*[share] * base, *[rest] * (self._robot.dof - base))
        binding = [math.logic_or(*pair) for pair in _pairs(first, second)]
        return _Found(wanted - (1.0 - shares) * gap, math.vertcat(*binding))

    def _within_jerks(self, wanted: Any, cut: _Found, at: SpeedSample, rate: Any) -> _Found:
        """Return speeds that change the accelerations no faster than is bounded.

        Args:
            wanted: Speeds within all other limits (dof, 1).
            cut: What positions and speeds took off, and which positions bind.
            rate: Of what is wanted without limits (dof, 1); none is known of what is limited.
        """
        if not np.isfinite(self._jerks.jerks).any():
            return _Found(wanted, math.SX(0, 1))
        share, free = self._share, math.fabs(cut.nu) <= SPEED_MARGIN
        nu_dot = (wanted - at.model_nu) * share
        toward = math.if_else(free, rate, 0.0)
        nu_dot, binding = self._jerks(nu_dot, toward, (at.model_nu, at.model_nu_dot))
        speeds = math.vertsplit(at.model_nu + nu_dot / share)
        for j, (k, *_) in enumerate(self._own):
            held = math.logic_or(cut.binding[j], cut.binding[j + len(self._own)])
            speeds[k] = math.if_else(held, wanted[k], speeds[k])
        return _Found(math.vertcat(*speeds), math.vertcat(*binding))

    def _fraction(self, start: Any, change: Any, which: list[int]) -> tuple[Any, Any]:
        """Return the largest fraction, at most 1, of accelerations that the limits allow.

        Args:
            start: Efforts and accelerations without them (n_act + dof, 1).
            change: What they add.
            which: Whose limits count.
        """
        least, allowed = math.SX(1.0), {}
        for k in which:
            limit = float(self._most[k])
            if np.isfinite(limit):
                # The base may have taken an effort to its limit already.
                inside = math.fabs(start[k]) <= limit * (1.0 + EFFORT_ROUNDING)
                counts = math.logic_and(inside, math.fabs(start[k] + change[k]) > limit)
                size = math.if_else(counts, math.fabs(change[k]), 1.0)
                room = math.fmax(limit - math.sign(change[k]) * start[k], 0.0)
                allowed[k] = counts, math.if_else(counts, room / size, 1.0)
                least = math.fmin(least, allowed[k][1])
        binding = [math.SX(0)] * len(self._most)
        for k, (counts, share) in allowed.items():
            binding[k] = math.logic_and(counts, share == least)
        return least, math.vertcat(*binding)


def _pairs(a: Any, b: Any) -> list[tuple[Any, Any]]:
    return [(a[k], b[k]) for k in range(a.numel())]
