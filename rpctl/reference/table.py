"""A reference at one time or at many: rows of numbers, side by side."""

from __future__ import annotations

import math as numbers
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeGuard

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.reference.motion import (
    Reference,
    ReferenceState,
    RowReference,
    configurations,
    require_state,
    row_of,
    state_of,
)
from rpctl.robot.model import BASE_NV, Robot


@dataclass(frozen=True, eq=False)
class ReferenceTable:
    """A reference at K times; :class:`~rpctl.reference.motion.ReferenceState` has the units.

    Attributes:
        robot: The robot that follows.
        t: Times (K,), s.
    """

    robot: Robot = field(repr=False)
    t: Array
    _rows: Array = field(repr=False)

    def __len__(self) -> int:
        """Return the number of times."""
        return len(self.t)

    @cached_property
    def state(self) -> ReferenceState:
        """All of it, the arrays with a row a time."""
        return state_of(self._rows)

    @cached_property
    def end_effector(self) -> Array:
        """Where the end effector is (K, 3) on the reference, in the world, m; (K, 0) without one.

        Base and arm are where the reference has them, wheels and swivels at 0.
        """
        if self.robot.end_effector is None:
            return np.empty((len(self), 0))
        q = configurations(self.robot, self.state.pose, self.state.joints)
        return self.robot.end_effector_poses(q)[:, :3, 3].copy()

    def rows(self) -> Array:
        """Return all of it side by side (K, 9 + 3 n_joints + 9), in the order of the state.

        Where the reference gives no direction, its twist, the twist's derivative and zeros stand
        for it.
        """
        return self._rows

    def at(self, chosen: slice) -> ReferenceTable:
        """Return it at some of its times."""
        return ReferenceTable(self.robot, self.t[chosen], self._rows[chosen])


def row_sizes(robot: Robot) -> list[int]:
    """Return how many numbers a row has of each of the table's arrays."""
    return [BASE_NV] * 3 + [len(robot.joints)] * 3 + [BASE_NV] * 3


def row_symbols(robot: Robot, row: Any) -> ReferenceState:
    """Return the scalars of a row (n, 1)."""
    ends = np.cumsum([0, *row_sizes(robot)]).tolist()
    parts: list[Any] = [math.vertsplit(part) for part in math.vertsplit(row, ends)]
    state = ReferenceState(*parts[:6])
    return state._replace(direction=parts[6:])  # type: ignore[arg-type]


def tabulate(robot: Robot, reference: Reference, times: Array) -> ReferenceTable:
    """Return a reference at many times.

    Args:
        times: Times (K,), s.

    Raises:
        WrongAnswerError: The reference returns something else than a state that fits the robot.
    """
    times = np.array(times, dtype=float)
    if len(times) and _tells_rows(reference):
        rows = reference.row(times)
        fits = np.isfinite(rows).all(axis=1) & (rows.shape[1] == sum(row_sizes(robot)))
        for t, row in zip(times[~fits].tolist(), rows[~fits], strict=True):
            require_state(robot, state_of(row), t)
        return ReferenceTable(robot, times, rows)
    return table_of(robot, times, [require_state(robot, reference(t), t) for t in times.tolist()])


def row_reader(robot: Robot, reference: Reference) -> Callable[[float], Array]:
    """Return a function that reads a reference at one time: a row of its table.

    It returns the row (9 + 3 n_joints + 9,) of :meth:`ReferenceTable.rows` at a time (s), number by
    number what :func:`tabulate` has there.

    Raises:
        WrongAnswerError: When it is called: as of :func:`tabulate`.
    """
    if not _tells_rows(reference):
        return lambda t: row_of(require_state(robot, reference(t), t))
    tell, width = reference.row, sum(row_sizes(robot))

    def read(t: float) -> Array:
        row = tell(t)
        if len(row) != width or not numbers.isfinite(row @ row):
            require_state(robot, state_of(row), t)
        return row

    return read


def _tells_rows(reference: Any) -> TypeGuard[RowReference]:
    """Return whether what a reference returns when called is its row."""
    return type(reference).__call__ is RowReference.__call__


def table_of(robot: Robot, times: Array, states: Sequence[ReferenceState]) -> ReferenceTable:
    """Return the table of states, one for each time (K,)."""
    rows = np.array([row_of(state) for state in states]).reshape(len(states), sum(row_sizes(robot)))
    return ReferenceTable(robot, times, rows)
