"""A robot in MuJoCo that takes speeds and positions: its joints have servos of their own."""

from __future__ import annotations

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.law import Rest
from rpctl.drive.steering import follower_positions
from rpctl.dynamics.motion import NO_LAG
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import RpctlError
from rpctl.simulation.config import Config
from rpctl.simulation.loop.periods import delay_periods
from rpctl.simulation.plants.contact import MujocoMotion
from rpctl.simulation.plants.interfaces import FollowedSpeeds, HeldCommands, PlantState, felt
from rpctl.simulation.plants.rolling import substeps

WHEEL_TIME = 0.01  # s in which a wheel's servo comes to its speed, were there no limit of effort
STIFFNESS = 40.0  # rad/s: bandwidth of the servos of arm and steering, critically damped


class ServoInterface:
    """A robot in MuJoCo whose servos follow what it is sent, within its effort limits.

    Commands act after the dead time of each quasi-velocity and pass its lag. A servo of speed turns
    each driven wheel as a base that rolls would; servos of position hold the joints of arm and
    steering where their commanded rates lead to. They begin without sag, as those that know
    the robot's weight at the start.

    Args:
        motion: The robot in MuJoCo.
        dynamics: Of the simulated robot, with what the plant adds.
        config: Its plant, and how its controller takes it to follow.
        rest: Where it stands, and the efforts that hold it.
    """

    def __init__(
        self, motion: MujocoMotion, dynamics: ReducedDynamics, config: Config, rest: Rest
    ) -> None:
        robot, plant, run = dynamics.robot, config.plant, config.run
        if config.output is None:
            raise RpctlError("the controller sends efforts, not speeds")
        truth, names = plant.velocity_interface(config.output.on(robot)), robot.quasi_velocities
        late = delay_periods(plant.delay, run.control_period) * run.control_period
        self._motion, self._dynamics, self._longest = motion, dynamics, run.plant_step
        self._lag, self._nu = np.maximum(truth.lag_of(names), NO_LAG), np.zeros(robot.dof)
        dead_times = truth.dead_times_of(names) + late
        self._held = [(dead, dead_times == dead, HeldCommands(self._nu)) for dead in
                      np.unique(dead_times)]  # fmt: skip
        self._followed = FollowedSpeeds(robot, rest.q, run.control_period)
        M, B = dynamics.inertia(rest.q), dynamics.actuation(rest.q)
        placed = [name in names or name in (s.joint for s in robot.drive.followers)
                  for name in robot.actuators]  # fmt: skip
        self._placed = np.array(placed, dtype=bool)
        felt_inertia = 1.0 / np.einsum("ij,ij->j", B, np.linalg.solve(M, B))
        own = {name: float(M[k, k]) for k, name in enumerate(names)}
        inertia = np.array([own.get(n, x) for n, x in zip(robot.actuators, felt_inertia,
                                                          strict=True)])  # fmt: skip
        stiffness = np.where(self._placed, STIFFNESS**2 * inertia, 0.0)
        damping = np.where(self._placed, 2.0 * STIFFNESS * inertia, inertia / WHEEL_TIME)
        motion.serve(stiffness, damping)
        self._ahead = np.where(self._placed, 2.0 / STIFFNESS, 1.0)
        self._sag = np.divide(rest.tau, stiffness, where=self._placed, out=np.zeros(len(placed)))
        self._index = {name: k for k, name in enumerate(names)}
        self._places = {n: robot.joint_position(rest.q, n) for n in names if n in robot.entries}
        self._rows = [robot.velocity_index(name) for name in robot.actuators]
        self._t = self._work = self._lost = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """What was assumed or mended so far, in sentences."""
        return self._motion.notes

    @property
    def state(self) -> PlantState:
        """See :class:`~rpctl.simulation.plants.interfaces.Interface`."""
        motion = self._motion
        return PlantState(motion.q, motion.nu, self._work, self._lost, felt(motion))

    def take(self, output: ControllerOutput, late: float = 0.0) -> Array:
        """Take what is sent; return the efforts (n_act,) that the servos have now."""
        speeds = self._followed(output)
        for dead, _, held in self._held:
            held.send(self._t + late + dead, speeds)
        return np.array(self._motion.data.actuator_force)

    def advance(self, duration: float) -> None:
        """Advance the robot to the next sample; see the protocol."""
        steps = substeps(duration, self._longest)
        dt = duration / steps
        for _ in range(steps):
            for _, which, held in self._held:
                gap = held.at(self._t)[which] - self._nu[which]
                self._nu[which] += -np.expm1(-dt / self._lag[which]) * gap
            done = self._motion.advance(self._targets(dt), dt)
            self._work, self._lost = self._work + done.work, self._lost + done.lost
            self._t += dt

    def _targets(self, dt: float) -> Array:
        """Return what the servos are to reach in a step of dt (s): rad/s, or rad and m."""
        robot, q = self._dynamics.robot, self._motion.q
        rates = (self._dynamics.basis(q) @ self._nu)[self._rows]
        for name in self._places:
            self._places[name] += dt * self._nu[self._index[name]]
        places = {**self._places, **follower_positions(robot.drive, self._places)}
        at = np.array([places.get(name, 0.0) for name in robot.actuators])
        return np.asarray(at + self._sag + self._ahead * rates)
