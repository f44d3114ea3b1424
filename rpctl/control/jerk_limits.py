"""Bounds of the jerk of commanded speeds, as a formula over scalars."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.kernels.scalars import clipped

EASE = 0.85  # of a jerk, by which an acceleration is planned to fall: samples round it up by 1/8


@dataclass(frozen=True)
class JerkLimits:
    """The jerks of one robot's commanded motion, by the model of how it follows.

    An acceleration a changes from sample to sample by at most J T_s. So that the speed does not
    overshoot, it closes a gap g to what is wanted no faster than it can be stopped there: a is at
    most φ(g) beyond the rate of what is wanted. Near by a robot with a lag closes the gap by
    a = s g, where s is the acceleration that a command by 1 beyond the speed gives; a then falls by
    s a, which J allows from a = J/s on. Before that a falls by J T_s each sample, and

        g = a²/(2 J) + a T_s/2 + (1/s - T_s) J/(2 s).

    Attributes:
        period: Control period T_s, s.
        share: s of each quasi-velocity (dof, 1), 1/s, scalars.
        jerks: J (dof,), m/s³ or rad/s³; inf where there is none.
        speeds: Largest speeds (dof,), m/s or rad/s, before which a falls likewise.
        accelerations: Largest |a| (dof,), m/s² or rad/s²; what is wanted may ask for more.
    """

    period: float
    share: Any
    jerks: Array
    speeds: Array
    accelerations: Array

    def __call__(self, nu_dot: Any, rate: Any, model: tuple[Any, Any]) -> tuple[Any, list[Any]]:
        """Return the accelerations (dof, 1), and of each bounded one whether that binds.

        Args:
            nu_dot: Those within all other limits (dof, 1).
            rate: Of the speeds that are wanted (dof, 1).
            model: What the commands so far have led to, ν and its mean rate (each dof, 1).
        """
        (model_nu, before), found, binding = model, math.vertsplit(nu_dot), []
        for k in np.flatnonzero(np.isfinite(self.jerks)).tolist():
            share, limit, nu = self.share[k], self.speeds[k], model_nu[k]
            more, largest = nu_dot[k] - rate[k], float(self.accelerations[k])
            most = self._stoppable(k, math.fabs(more) / share)
            toward = clipped(rate[k] + clipped(more, -most, most), -largest, largest)
            if np.isfinite(limit):
                ahead, behind = (self._stoppable(k, math.fmax(g, 0.0)) for g in
                                 (limit - nu, limit + nu))  # fmt: skip
                toward = clipped(toward, -behind, ahead)
            change = float(self.jerks[k]) * self.period
            binding.append(math.fabs(toward - before[k]) > change)
            found[k] = clipped(toward, before[k] - change, before[k] + change)
        return math.vertcat(*found), binding

    def _stoppable(self, k: int, gap: Any) -> Any:
        """Return φ of a gap (m/s or rad/s), m/s² or rad/s²."""
        jerk, share, half = EASE * float(self.jerks[k]), self.share[k], 0.5 * self.period
        far = gap - (0.5 / share - half) * jerk / share
        falling = jerk * (math.sqrt(half**2 + 2.0 * math.fmax(far, 0.0) / jerk) - half)
        return math.if_else(gap <= jerk / share**2, share * gap, falling)
