"""A robot in MuJoCo that takes speeds and positions: its joints have servos of their own."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.simulation.config import Config
from rpctl.simulation.plants.contact import MujocoMotion
from rpctl.simulation.plants.interfaces import PlantState, SpeedInterface, felt

WHEEL_TIME = 0.01  # s in which a wheel's servo comes to its speed, were there no limit of effort
WHEEL_REST = 0.05  # s in which it makes up for what resists it
BANDWIDTH = 40.0  # rad/s: least one of the other servos, damped critically or more
FIRM = 0.02  # rad or m by which a joint is off where its servo has its whole effort, or less


class ServoInterface(SpeedInterface):
    """A robot in MuJoCo whose servos follow what it is sent, within its effort limits.

    They are to follow the motion that a robot would have which follows its commands exactly as late
    as the plant says. Servos of speed, proportional and integral, turn driven wheels like those of
    a base that rolls; servos of position hold the joints of arm and steering where their rates lead
    to. They begin without sag, as those that know the robot's weight at the start, and nothing
    winds up while an effort is at its limit. MuJoCo takes their damping implicitly, so that what
    they do and what is lost cannot be told apart: the work is what the robot's energy gains.

    Args:
        motion: The robot in MuJoCo.
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and how its controller takes it to follow.
        rest: Where it stands, and the efforts that hold it.
    """

    def __init__(
        self, motion: MujocoMotion, dynamics: ReducedDynamics, config: Config, rest: Rest
    ) -> None:
        super().__init__(dynamics, config, rest)
        robot, self._motion, self._ideal = dynamics.robot, motion, np.zeros(dynamics.robot.dof)
        M, B = dynamics.inertia(rest.q), dynamics.actuation(rest.q)
        each = 1.0 / np.diag(B.T @ np.linalg.solve(M, B))  # what a motor moves, all others free
        own = dict(zip(robot.quasi_velocities, np.diag(M), strict=True))
        felt_by = np.array([own.get(n, x) for n, x in zip(robot.actuators, each, strict=True)])
        wheels = {wheel.joint for wheel in robot.drive.wheels}
        rolls, limits = np.array([n in wheels for n in robot.actuators]), robot.effort_limits
        firm = np.maximum(BANDWIDTH**2 * felt_by, np.where(np.isfinite(limits), limits / FIRM, 0.0))
        stiffness = np.where(rolls, felt_by / (WHEEL_TIME * WHEEL_REST), firm)
        self._ahead = np.where(rolls, WHEEL_REST, 2.0 / BANDWIDTH)  # s of a rate
        motion.serve(stiffness, self._ahead * stiffness)
        self._at, self._reach = motion.places + rest.tau / stiffness, limits / stiffness
        self._rows = [robot.velocity_index(name) for name in robot.actuators]
        self.state = self.state._replace(q=motion.q, felt=felt(motion))
        self.notes = motion.notes

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take what is sent; return the efforts (n_act,) that the servos have now."""
        super().take(output, late)
        return np.array(self._motion.data.actuator_force)

    def advance(self, duration: float) -> None:
        """Advance the robot by a control period; see the protocol."""
        work, motion = self.state.work, self._motion
        self._ideal, stretches = self._plant.course(motion.q, self._ideal)
        for dt, nu, _ in stretches:
            rates = (self._dynamics.basis(motion.q) @ nu)[self._rows]
            places = motion.places
            self._at = np.clip(self._at + dt * rates, places - self._reach, places + self._reach)
            done = motion.advance(self._at + self._ahead * rates, dt)
            work += done.work - done.lost  # what the energy gains
        self.state = PlantState(motion.q, motion.nu, work, 0.0, felt(motion))
