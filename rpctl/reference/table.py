"""A reference at many times at once: arrays with a row a time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.errors import RpctlError
from rpctl.reference.function import FunctionReference
from rpctl.reference.motion import Reference, ReferenceState, configurations, require_state
from rpctl.reference.path_reference import PathReference, TimedPath
from rpctl.reference.pose_goal import GoalMotion
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

    @cached_property
    def end_effector(self) -> Array:
        """Where the end effector is (K, 3) on the reference, in the world, m; (K, 0) without one.

        Base and arm are where the reference has them, wheels and swivels at 0.
        """
        if self.robot.end_effector is None:
            return np.empty((len(self), 0))
        q = configurations(self.robot, self.pose, self.joints)
        return self.robot.end_effector_poses(q)[:, :3, 3].copy()

    @property
    def state(self) -> Any:
        """All of it as one ``ReferenceState``, whose arrays have a row a time."""
        return ReferenceState(*(getattr(self, name) for name in ReferenceState._fields))

    def states(self) -> Iterator[ReferenceState]:
        """Yield the state at each time."""
        for row in map(ReferenceState, *self.state):
            known = row.direction is not None and not np.isnan(row.direction[0, 0])
            yield row if known else row._replace(direction=None)

    def at(self, chosen: slice) -> ReferenceTable:
        """Return it at some of its times."""
        return ReferenceTable(
            self.robot, self.t[chosen], *(column[chosen] for column in self.state)
        )

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


# What is called where these, or what inherits from them, are: it takes arrays of times.
ARRAY_CALLS = {kind.__call__ for kind in (PathReference, TimedPath, GoalMotion, FunctionReference)}


def tabulate(robot: Robot, reference: Reference, times: Array) -> ReferenceTable:
    """Return a reference at many times.

    Args:
        times: Times (K,), s.

    Raises:
        WrongAnswerError: The reference returns something else than a state that fits the robot.
    """
    times = np.array(times, dtype=float)
    found = _at_once(robot, reference, times)
    if found is None:
        states = [require_state(robot, reference(t), t) for t in times.tolist()]
        found = table_of(robot, times, states)
    return found


def _at_once(robot: Robot, reference: Any, times: Array) -> ReferenceTable | None:
    """Return the table of a reference that takes arrays; None where something is wrong with it.

    What is wrong, and at which time, shows when it is asked for one time after the other.
    """
    if type(reference).__call__ not in ARRAY_CALLS or not len(times):
        return None
    try:
        state = reference(times)
    except RpctlError:
        return None
    count, n = len(times), len(robot.joints)
    direction = np.full((count, 3, 3), np.nan) if state.direction is None else state.direction
    shapes = [column.shape for column in state[:6]]
    if shapes != [(count, 3)] * 3 + [(count, n)] * 3 or not all(
        np.isfinite(column).all() for column in state[:6]
    ):
        return None
    return ReferenceTable(robot, times, *state._replace(direction=direction))


def table_of(robot: Robot, times: Array, states: Sequence[ReferenceState]) -> ReferenceTable:
    """Return the table of states, one for each time (K,)."""
    count, n, none = len(states), len(robot.joints), np.full((3, 3), np.nan)
    columns: list[Array] = [
        np.array([state[k] for state in states], dtype=float).reshape(count, width)
        for k, width in enumerate((3, 3, 3, n, n, n))
    ]
    given = [none if state.direction is None else state.direction for state in states]
    columns.append(np.array(given, dtype=float).reshape(-1, 3, 3))
    return ReferenceTable(robot, times, *columns)
