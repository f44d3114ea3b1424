"""A reference whose joints are read at other times than its base."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.reference.motion import Reference, ReferenceState


@dataclass(frozen=True, eq=False)
class Staggered:
    """What a robot follows whose arm obeys sooner or later than its base.

    Attributes:
        reference: What it follows at one time.
        shifts: How much later each joint is read (n_joints,), s.
    """

    reference: Reference
    shifts: Array

    def __call__(self, t: float) -> ReferenceState:
        """Return the state of the base at a time (s), and of the joints at their own."""
        found = self.reference(t)
        joints = np.array(found[3:6])
        for shift in {*self.shifts.tolist()} - {0.0}:
            other = np.array(self.reference(max(t + shift, 0.0))[3:6])
            joints = np.where(self.shifts == shift, other, joints)
        return ReferenceState(*found[:3], *joints, found.direction)
