"""``NamedState``: a robot's state by names, as sensors give it."""

from __future__ import annotations

from typing import NamedTuple


class NamedState(NamedTuple):
    """A robot's pose and speeds: what :meth:`Robot.state` takes and :meth:`Robot.state_of` gives.

    Attributes:
        pose: Of the root link: x and y in m, heading in rad.
        twist: The base's quasi-velocities in the order of ``robot.drive.base_speeds``; m/s, rad/s.
        joints: Position of each moving joint by name, wheels included; rad or m.
        rates: Rate of each of the arm's joints by name; rad/s or m/s.
    """

    pose: tuple[float, float, float]
    twist: tuple[float, ...]
    joints: dict[str, float]
    rates: dict[str, float]
