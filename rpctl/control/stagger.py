"""Base and arm that follow their commands after dead times of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rpctl.arrays import Array
from rpctl.control.sampling import MeasuredSample
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import Robot


class Stagger:
    """What each dead time of a robot is of.

    A law is given the base as it will be after the base's dead time, and each joint of the arm as
    it will be after its own; and a reference with its joints at these same times.

    Args:
        robot: The robot.
        dead_times: Of each quasi-velocity (dof,), s.

    Attributes:
        dead_times: Those that differ, s; the base's comes first.
    """

    def __init__(self, robot: Robot, dead_times: Array) -> None:
        count = len(robot.drive.base_speeds)
        own = dict.fromkeys(dead_times.tolist())
        self.dead_times = tuple(own)
        arm = dead_times[count:]
        self._joints = [(dead, np.flatnonzero(arm == dead)) for dead in own]
        self._entries = [
            [robot.entries[robot.joint_names[k]] for k in which] for _, which in self._joints
        ]
        self._count = count
        self._kept: tuple[Reference, Reference] | None = None

    def joined(self, parts: Sequence[MeasuredSample]) -> MeasuredSample:
        """Return the sample whose base and joints are each predicted over their own dead time.

        Args:
            parts: The whole robot after each of ``dead_times``.
        """
        t, q, nu = parts[0].t, parts[0].q.copy(), parts[0].nu.copy()
        for part, entries, (_, which) in zip(parts, self._entries, self._joints, strict=True):
            nu[self._count + which] = part.nu[self._count + which]
            for entry in entries:
                entry.write(q, entry.read(part.q))
        return MeasuredSample(t, q, nu)

    def reference(self, reference: Reference) -> Reference:
        """Return a reference whose joints are those of their own times; the same for the same."""
        if self._kept is None or self._kept[0] is not reference:
            self._kept = reference, self._shifted(reference)
        return self._kept[1]

    def _shifted(self, reference: Reference) -> Callable[[float], ReferenceState]:
        shifts = [(dead - self.dead_times[0], which) for dead, which in self._joints]

        def state(t: float) -> ReferenceState:
            found = reference(t)
            places = [np.array(each, dtype=float) for each in found[3:6]]
            for shift, which in shifts:
                if shift and len(which):
                    later = reference(max(t + shift, 0.0))
                    for own, other in zip(places, later[3:6], strict=True):
                        own[which] = other[which]
            return found._replace(
                joints=places[0], joint_rates=places[1], joint_accelerations=places[2]
            )

        return state
