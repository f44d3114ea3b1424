"""Bounds of the jerk of commanded speeds, as a formula over scalars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.kernels.scalars import clipped

TINY = 1e-9  # m/s² or rad/s²: a change of acceleration that small is none


class Wanted(NamedTuple):
    """What is wanted of one sample, over scalars, each (dof, 1)."""

    nu_dot: Any  # the mean acceleration until the next sample, within all other limits
    rate: Any  # of the speed that is wanted
    before: Any  # the mean acceleration since the last sample
    nu: Any  # the speed that the commands so far have led to


@dataclass(frozen=True)
class JerkLimits:
    """The jerks of one robot's commanded motion, by the model of how it follows.

    The acceleration changes from sample to sample by at most J T_s. So that a speed does not
    overshoot, it comes near to what is wanted no faster than it can still be stopped there: the
    acceleration beyond the rate of what is wanted is at most φ(gap), where a = φ(e) solves
    e = a²/(2 J) + a T_s/2, the way that a acceleration goes which falls by J T_s each sample. All of
    the base's accelerations take the same share of their change, so that it keeps its path; those
    of the arm change one by one.

    Attributes:
        period: Control period T_s, s.
        share: Of the gap between command and speed, the acceleration (dof,), 1/s.
        jerks: J (dof,), m/s³ or rad/s³; inf where there is none.
        speeds: Largest speeds (dof,), m/s or rad/s, before which acceleration falls likewise.
        base: How many of the quasi-velocities are the base's.
    """

    period: float
    share: Array
    jerks: Array
    speeds: Array
    base: int

    def __call__(self, wanted: Wanted) -> tuple[Any, list[Any]]:
        """Return the accelerations (dof, 1), and of each bounded one whether that binds."""
        found, least = math.vertsplit(wanted.nu_dot), math.SX(1.0)
        changes, shares = dict[int, Any](), dict[int, Any]()
        for k in np.flatnonzero(np.isfinite(self.jerks)).tolist():
            toward = self._stoppable(k, wanted)
            changes[k] = toward - wanted.before[k]
            size = math.fabs(changes[k])
            most = float(self.jerks[k]) * self.period
            shares[k] = math.if_else(size > most, most / math.fmax(size, TINY), 1.0)
            if k < self.base:
                least = math.fmin(least, shares[k])
        binding = []
        for k, change in changes.items():
            own = least if k < self.base else shares[k]
            found[k] = wanted.before[k] + own * change
            binding.append(shares[k] < 1.0)
        return math.vertcat(*found), binding

    def _stoppable(self, k: int, wanted: Wanted) -> Any:
        """Return the acceleration that is wanted, as far as it can be stopped at what is wanted."""
        more, share = wanted.nu_dot[k] - wanted.rate[k], float(self.share[k])
        most = self._before_a_stop(k, math.fabs(more) / share)
        toward = wanted.rate[k] + clipped(more, -most, most)
        if np.isfinite(self.speeds[k]):
            limit, nu = float(self.speeds[k]), wanted.nu[k]
            ahead = self._before_a_stop(k, math.fmax(limit - nu, 0.0))
            behind = self._before_a_stop(k, math.fmax(limit + nu, 0.0))
            toward = clipped(toward, -behind, ahead)
        return toward

    def _before_a_stop(self, k: int, way: Any) -> Any:
        """Return φ of a way (m/s or rad/s), m/s² or rad/s²."""
        jerk, half = float(self.jerks[k]), 0.5 * self.period
        return jerk * (math.sqrt(half**2 + 2.0 * way / jerk) - half)
