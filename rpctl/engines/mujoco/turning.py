"""A robot in MuJoCo whose wheels stay on the ground while they scrub, behind the engines' protocol.

MuJoCo's friction is relaxed: what slides at a speed v lifts itself by μ b v/k, b the rate at which
friction ends slipping and k the stiffness under the load. With the defaults a wheel that scrubs
faster than g/(μ b) hops, spins up in the air and grips where it lands, and so holds a turn back.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rpctl.arrays import Array
from rpctl.engines.engine import EngineFault, EngineState
from rpctl.engines.mujoco.build import build
from rpctl.engines.mujoco.settings import ContactSettings
from rpctl.engines.mujoco.world import MujocoWorld
from rpctl.errors import DivergedError
from rpctl.robot.model import Robot

SETTINGS = ContactSettings(wheel_shape="crowned")  # those that ``rpctl export`` writes
LIFT = 0.7  # of a wheel's load, that scrubbing may take: a turn slips slower than the rims run
GRAVITY = 9.81  # m/s²
SETTING = (
    "give the wheels the crowned shapes and the contact pairs that `rpctl export` writes, and turn "
    "slowly: what slides faster than some .1 m/s hops there, too"
)


def calm_speed(friction: float) -> float:
    """Return the speed (m/s) below which what slides is not lifted off the ground.

    Args:
        friction: Coefficient between wheels and ground.
    """
    slipping_ends = 2.0 / SETTINGS.time_constant  # b, 1/s
    return LIFT * GRAVITY / (friction * slipping_ends)


class TurningRun:
    """A robot at rest; :class:`rpctl.engines.engine.EngineRun` has the attributes.

    Args:
        robot: The robot.
        q: Configuration (nq,).
        friction: Coefficient between wheels and ground.
    """

    def __init__(self, robot: Robot, q: Array, friction: float) -> None:
        self._robot = robot
        built: Any = build(robot, SETTINGS, friction)
        self.contacts, self.notes = tuple(built.contacts), tuple(built.notes)
        self._world, self._t = MujocoWorld(robot, built), 0.0
        self._world.place(q, -robot.drive.ground)
        try:
            self._world.settle()
        except DivergedError as error:
            raise EngineFault(str(error)) from None

    def advance(self, efforts: Mapping[str, float], dt: float) -> None:
        """Hold the efforts for ``dt``; :meth:`rpctl.engines.engine.EngineRun.advance`."""
        tau = np.array([efforts.get(name, 0.0) for name in self._robot.actuators])
        try:
            self._world.advance(tau, dt)
        except DivergedError as error:
            raise EngineFault(str(error)) from None
        self._t += dt

    def state(self) -> EngineState:
        """Return the state now."""
        robot, world = self._robot, self._world
        q, v = world.q, world.v
        joints = {
            name: (robot.joint_position(q, name), float(v[robot.velocity_index(name)]))
            for name in robot.moving_joint_names
        }
        return EngineState(self._t, world.pose, joints, world.loads(), world.slips(), world.energy)
