"""A robot whose wheels slip: the whole tree on tyres, without the rolling constraint."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpctl.arrays import Array
from rpctl.dynamics.motion import Step, step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError, require_positive
from rpctl.robot.coordinates import read_root
from rpctl.robot.model import Robot
from rpctl.simulation.plants.motion import Ground
from rpctl.simulation.plants.wrench import Wrench


@dataclass(frozen=True)
class Slipping:
    """How the tyres of a slipping robot grip; the table [plant.slipping].

    Attributes:
        slip_stiffness: Force of a tyre per load and per slip, its slip velocity over its rolling
            speed; no unit. A rolling cylinder has 2R/a with a contact 2a long [J85, Sec. 8.3], so
            20 where a is a tenth of the radius, as of solid rubber; pneumatic tyres have 10 to 20
            [P12, Ch. 4]. The higher, the nearer to wheels that roll without slipping.
        creep_speed: Rolling speed, m/s, below which a tyre is as soft as at it: one that stands
            still under a force creeps, by force over load times this over the slip stiffness.
        rolling_resistance: Moment against a wheel's rolling, per load and radius; no unit. Hard
            floors and solid rubber have .01 to .02.
    """

    slip_stiffness: float = 20.0
    creep_speed: float = 0.01
    rolling_resistance: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no tyre has."""
        for name in ("slip_stiffness", "creep_speed"):
            require_positive(name, getattr(self, name))
        if not (math.isfinite(self.rolling_resistance) and 0.0 <= self.rolling_resistance < 1.0):
            raise RpctlError(
                f"rolling_resistance is {self.rolling_resistance:g}; give a ratio of force to "
                "load from 0 to less than 1"
            )


class SlippingMotion:
    """A robot that moves on tyres.

    Args:
        robot: The robot.
        settings: Its tyres.
        friction: Coefficient between wheels and ground.
        q: Where it stands at the start (nq,), at rest.
        longest: Longest step, s.
    """

    def __init__(
        self, robot: Robot, settings: Slipping, friction: float, q: Array, longest: float
    ) -> None:
        self._dynamics, self._longest = ReducedDynamics(robot), longest
        self.q, self.nu = q, np.zeros(robot.dof)
        self.notes: tuple[str, ...] = ()

    @property
    def pose(self) -> Array:
        """Pose of the root link (7,): x, y, z (m), quaternion x, y, z, w; world."""
        x, y, theta = read_root(self.q)
        z = -self._dynamics.robot.drive.ground
        return np.array([x, y, z, 0.0, 0.0, math.sin(0.5 * theta), math.cos(0.5 * theta)])

    def ground(self) -> Ground:
        """Return what the ground does to it."""
        return Ground()

    def advance(self, tau: Array, dt: float, wrenches: Sequence[Wrench] = ()) -> Step:
        """Advance it under constant efforts; as of :class:`~rpctl.simulation.plants.motion.Motion`.

        Args:
            tau: Actuator efforts (n_act,), N·m or N.
            dt: For how long, s.
            wrenches: What pushes it besides.
        """
        done = step(self._dynamics, self.q, self.nu, tau, dt)
        self.q, self.nu = done.q, done.nu
        return done
