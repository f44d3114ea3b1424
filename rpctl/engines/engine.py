"""``Engine``: another simulator of a robot on flat ground, as the referee asks it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.switches import Switch, Switches
from rpctl.errors import RpctlError
from rpctl.robot.model import Robot


class EngineMissing(RpctlError):
    """An engine is not installed; the message has the command that installs it."""


class EngineFault(RpctlError):
    """An engine refuses a robot, or its motion diverges; its own words are in the message."""


@dataclass(frozen=True, eq=False)
class EngineState:
    """State of a robot in an engine at one instant.

    Attributes:
        t: Time since the start, s.
        pose: Root link's x, y, z (m) and quaternion x, y, z, w (7,), in the world; the ground is
            the plane z = 0.
        joints: Position (rad or m; turns are counted, not taken off) and rate of the moving joints.
        load: Vertical force (N) of each contact, as :attr:`EngineRun.contacts` names them (n,).
        slip: Velocity (m/s) of each drive's wheel's contact point, the point of the wheel below its
            centre, along its rolling direction and to its left (n_wheels, 2).
        energy: Kinetic plus potential energy, J, of the engine's own masses; the zero is free.
    """

    t: float
    pose: Array
    joints: Mapping[str, tuple[float, float]]
    load: Array
    slip: Array
    energy: float

    @property
    def tilt(self) -> float:
        """How far the root link leans out of the level, rad."""
        x, y = self.pose[3:5]
        return float(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))

    @property
    def planar(self) -> Array:
        """The root link's x, y (m) and heading (rad) seen from above (3,)."""
        x, y, z, w = self.pose[3:]
        turn = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        return np.array([self.pose[0], self.pose[1], turn])


class EngineRun(Protocol):
    """A robot in an engine, from its start on.

    Attributes:
        contacts: Names of the contacts, those of ``Contacts.names`` in their order: the wheels'
            joints, then the supports.
        notes: What was assumed or left out, in sentences.
    """

    contacts: tuple[str, ...]
    notes: tuple[str, ...]

    def advance(self, efforts: Mapping[str, float], dt: float) -> None:
        """Hold the efforts (N·m or N, by joint) for ``dt`` (s), a multiple of the engine's tick.

        Raises:
            EngineFault: The motion diverges.
        """

    def state(self) -> EngineState:
        """Return the state now; loads are those of the last step."""


class Engine(Protocol):
    """A simulator."""

    @property
    def name(self) -> str:
        """As its makers write it: ``"MuJoCo"``, ``"Drake"``, ``"PyBullet"``."""

    @property
    def version(self) -> str:
        """As it gives it."""

    @property
    def tick(self) -> float:
        """How long the referee holds efforts, s: a multiple of its steps, default and mended."""

    def switches(self, robot: Robot) -> tuple[Switch, ...]:
        """Return the switches that mean something here, of this robot."""

    def start(self, robot: Robot, q: Array, switches: Switches, friction: float) -> EngineRun:
        """Return the robot at rest at q, its wheels at the height of the ground; not yet settled.

        Args:
            robot: The robot.
            q: Configuration (nq,).
            switches: What is left as the engine's default, and what is mended.
            friction: Coefficient between wheels and ground where ``friction`` is mended.

        Raises:
            EngineFault: The engine refuses the robot.
        """
