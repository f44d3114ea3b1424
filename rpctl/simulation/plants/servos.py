"""A robot in MuJoCo that takes speeds and positions: its joints have servos of their own."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.simulation.config import Config
from rpctl.simulation.plants.contact import MujocoMotion
from rpctl.simulation.plants.interfaces import PlantState, SpeedInterface, felt

WHEEL_TIME = 0.01  # s in which a wheel's servo comes to its speed
BANDWIDTH = 40.0  # rad/s: least one of the servos of arm and steering, damped critically or more
FIRM = 0.02  # rad or m by which a joint is off where its servo has its whole effort, or less


class ServoInterface(SpeedInterface):
    """A robot in MuJoCo whose servos follow what it is sent, within its effort limits.

    They are to follow the motion that a robot would have which follows its commands exactly as late
    as the plant says. A servo of speed turns each driven wheel as a base that rolls would; servos
    of position hold the joints of arm and steering where their rates lead to. These begin without
    sag, as those that know the robot's weight at the start.

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
        self._places = dict(self._placed)  # where servos of position are to be
        servos = {*self._places, *(swivel.joint for swivel in robot.drive.followers)}
        placed = np.array([name in servos for name in robot.actuators], dtype=bool)
        felt_by = np.array([own.get(n, x) for n, x in zip(robot.actuators, each, strict=True)])
        limits = np.where(np.isfinite(robot.effort_limits), robot.effort_limits, 0.0)
        stiffness = placed * np.maximum(BANDWIDTH**2 * felt_by, limits / FIRM)
        self._ahead = np.where(placed, 2.0 / BANDWIDTH, 1.0)  # s of a position's rate; or the rate
        motion.serve(stiffness, np.where(placed, self._ahead * stiffness, felt_by / WHEEL_TIME))
        self._sag = np.where(placed, rest.tau / np.where(placed, stiffness, 1.0), 0.0)
        self._rows = [robot.velocity_index(name) for name in robot.actuators]
        self.state = self.state._replace(q=motion.q, felt=felt(motion))
        self.notes = motion.notes

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take what is sent; return the efforts (n_act,) that the servos have now."""
        super().take(output, late)
        return np.array(self._motion.data.actuator_force)

    def advance(self, duration: float) -> None:
        """Advance the robot by a control period; see the protocol."""
        work, lost, motion = self.state.work, self.state.lost, self._motion
        self._ideal, stretches = self._plant.follow(self._ideal)
        for dt, nu, _ in stretches:
            done = motion.advance(self._targets(dt, nu), dt)
            work, lost = work + done.work, lost + done.lost
        self.state = PlantState(motion.q, motion.nu, work, lost, felt(motion))

    def _targets(self, dt: float, nu: Array) -> Array:
        """Return what the servos are to reach (n_act,): rad/s, or rad and m.

        Args:
            dt: In how long, s.
            nu: The mean quasi-velocities until then (dof,).
        """
        robot, rates = self._dynamics.robot, self._dynamics.basis(self._motion.q) @ nu
        moved = dict(zip(robot.quasi_velocities, dt * nu, strict=True))
        self._places = {name: place + moved[name] for name, place in self._places.items()}
        places = {**self._places, **follower_positions(robot.drive, self._places)}
        at = np.array([places.get(name, 0.0) for name in robot.actuators])
        return np.asarray(at + self._sag + self._ahead * rates[self._rows])
