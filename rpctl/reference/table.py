"""A reference at many times at once: arrays with a row a time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rpctl.arrays import Array
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.required import require_state
from rpctl.robot.model import Robot


@dataclass(frozen=True, eq=False)
class ReferenceTable:
    """A reference at K times; :class:`~rpctl.reference.motion.ReferenceState` has the units.

    Attributes:
        robot: The robot that follows.
        t: Times (K,), s.
        pose: Poses of P (K, 3).
        twist: Twists (K, 3).
        twist_dot: Their derivatives (K, 3).
        joints: Positions of the arm (K, n_joints).
        joint_rates: Rates (K, n_joints).
        joint_accelerations: Accelerations (K, n_joints).
        direction: Directions of travel and their two derivatives (K, 3, 3); NaN where the
            reference gives none.
    """

    robot: Robot = field(repr=False)
    t: Array
    pose: Array
    twist: Array
    twist_dot: Array
    joints: Array
    joint_rates: Array
    joint_accelerations: Array
    direction: Array

    def __len__(self) -> int:
        """Return the number of times."""
        return len(self.t)

    def rows(self) -> Array:
        """Return all of it side by side (K, 9 + 3 n_joints + 9), in the order of the attributes.

        Where the reference gives no direction, its twist, the twist's derivative and zeros stand
        for it.
        """
        twist = np.stack([self.twist, self.twist_dot, np.zeros_like(self.twist)], axis=1)
        direction = np.where(np.isnan(self.direction[:, :1, :1]), twist, self.direction)
        parts = self.pose, self.twist, self.twist_dot
        arm = self.joints, self.joint_rates, self.joint_accelerations
        return np.hstack([*parts, *arm, direction.reshape(len(self), 9)])


def tabulate(robot: Robot, reference: Reference, times: Array) -> ReferenceTable:
    """Return a reference at many times.

    Args:
        robot: The robot that follows.
        reference: The reference.
        times: Times (K,), s.

    Raises:
        WrongAnswerError: The reference returns something else than a state that fits the robot.
    """
    states = [require_state(robot, reference(t), t) for t in times.tolist()]
    return _table_of(robot, times, states)


def _table_of(robot: Robot, times: Array, states: list[ReferenceState]) -> ReferenceTable:
    """Return the table of states, one for each time (K,)."""

    def column(k: int, width: int) -> Array:
        found = np.array([state[k] for state in states], dtype=float)
        return found.reshape(-1, width)

    n, none = len(robot.joints), np.full((3, 3), np.nan)
    given = [none if state.direction is None else state.direction for state in states]
    return ReferenceTable(
        robot=robot,
        t=np.array(times, dtype=float),
        pose=column(0, 3),
        twist=column(1, 3),
        twist_dot=column(2, 3),
        joints=column(3, n),
        joint_rates=column(4, n),
        joint_accelerations=column(5, n),
        direction=np.array(given, dtype=float).reshape(-1, 3, 3),
    )
