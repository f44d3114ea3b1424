"""A base path at one pace, and an arm motion beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpctl.reference import paths
from rpctl.reference.motion import ReferenceState
from rpctl.reference.pointwise import Numbers, beside, split_rows, stack_rows
from rpctl.reference.sizing import Sizing
from rpctl.reference.waves import Waves

DEFAULT_DURATION = 20.0  # s, of a reference without a name


@dataclass(frozen=True)
class PathReference:
    """A base path and an arm motion, both started softly from rest.

    Attributes:
        path: The base's path; None for a fixed base.
        rate: Pace of the path, units of its parameter a second.
        arm: The arm's motion.
        ramp: Duration of the soft start, s.
        default_duration: How long it is tracked if nobody says, s.
        sizing: How large and fast it is, and why; None where it has no name.
    """

    path: paths.Path | None
    rate: float
    arm: Waves
    ramp: float
    default_duration: float = DEFAULT_DURATION
    sizing: Sizing | None = None

    def __call__(self, t: Numbers) -> ReferenceState:
        """Return the reference at time ``t`` (s), or at times (K,), a row each."""
        arm = self.arm(paths.ramped_time(t, 1.0, self.ramp))
        if self.path is None:
            pose, twist, twist_dot = np.zeros((3, *np.shape(t), 3))
            return ReferenceState(pose, twist, twist_dot, *arm)
        s, *rates = paths.ramped_time(t, self.rate, self.ramp)
        point, (ds, dds) = self.path(s), map(beside, rates)
        along, bend, twice = split_rows(point.direction)
        return ReferenceState(
            point.pose,
            along * ds,
            bend * ds**2 + along * dds,
            *arm,
            direction=stack_rows(along, bend * ds, twice * ds**2 + bend * dds),
        )
