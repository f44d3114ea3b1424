"""The reference at the instants that the horizon law asks about, each read once.

Successive solves ask about the same instants again: their periods divide the prediction's steps.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Generic, NamedTuple, TypeVar

from rpctl.arrays import Array
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.quasi_velocities import reference_rates, steering
from rpctl.robot.model import Robot

TIME_DIGITS = 11  # of a time in s: two sums that mean the same instant differ by rounding
MAX_REMEMBERED = 4000  # instants: 20 steps of .1 s at a period of .5 ms

Value = TypeVar("Value")
Key = TypeVar("Key", bound=Hashable)


class Memory(Generic[Key, Value]):
    """Remembers what was computed for the last keys.

    Args:
        capacity: Number of keys.
    """

    def __init__(self, capacity: int = MAX_REMEMBERED) -> None:
        self._capacity, self._values = capacity, dict[Key, Value]()

    def __call__(self, key: Key, compute: Callable[[Key], Value]) -> Value:
        """Return the value of a key, computed if it is not remembered."""
        found = self._values.get(key)
        if found is None:
            found = self._values[key] = compute(key)
            if len(self._values) > self._capacity:
                del self._values[next(iter(self._values))]
        return found

    def forget(self) -> None:
        """Forget everything."""
        self._values.clear()


class ReferencePoint(NamedTuple):
    """The reference at one instant, in the robot's quasi-velocities."""

    state: ReferenceState
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)
    angles: Array  # (n_steered,) rad, of the steered joints


class Preview:
    """Reads the reference of one robot, as a function of time.

    Args:
        robot: The robot.
        reference: The reference; None: :meth:`follow` sets it.
    """

    def __init__(self, robot: Robot, reference: Reference | None = None) -> None:
        self._robot, self._reference = robot, reference
        self._points = Memory[float, ReferencePoint]()

    def follow(self, reference: Reference) -> bool:
        """Set the reference that is read from now on; return whether it is another."""
        if reference is self._reference:
            return False
        self._reference = reference
        self._points.forget()
        return True

    def __call__(self, t: float) -> ReferencePoint:
        """Return the reference at a time (s), to 1e-11 s.

        Raises:
            ValueError: There is no reference yet.
        """
        return self._points(round(t, TIME_DIGITS), self._read)

    def _read(self, t: float) -> ReferencePoint:
        if self._reference is None:
            raise ValueError("no reference to read")
        state = self._reference(t)
        angles = steering(self._robot, state)[0]
        return ReferencePoint(state, *reference_rates(self._robot, state), angles)
