"""A robot that a controller steps on measured samples."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from rpctl import Controller, ControllerOutput
from rpctl.arrays import Array
from rpctl.control.error import tracking_error
from rpctl.dynamics.motion import rk4_step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import configuration_along

PERIOD = 0.002


class Simulated:
    """A robot that a controller steps, in steps of Runge and Kutta.

    Args:
        controller: The controller.
        offset: How far it starts from its reference (3,): m, m, rad.
    """

    def __init__(self, controller: Controller, offset: tuple[float, ...] = (0.0, 0.0, 0.0)) -> None:
        self.controller, robot = controller, controller.robot
        self.dynamics = ReducedDynamics(robot)
        state = controller.reference(0.0)
        self.q = configuration_along(robot, state, np.asarray(state.pose) + offset)
        self.nu, self.t = np.zeros(robot.dof), 0.0
        self.outputs: list[ControllerOutput] = []
        self.arrived: Array | None = None

    def run(
        self,
        duration: float,
        measure: Callable[[float, Array, Array], tuple[Any, Any, Any] | None] | None = None,
        steps: Callable[[], float] = lambda: PERIOD,
        arriving: Callable[[Array], Array] = lambda tau: tau,
        tells: bool = False,
    ) -> list[float]:
        """Return the distances (m) from the reference; no measurement leaves the efforts on.

        Args:
            duration: s.
            measure: Makes what is measured of a time, a configuration and quasi-velocities.
            steps: Gives the time to the next sample, s.
            arriving: Makes what arrives of the efforts that are sent.
            tells: Whether the robot tells what arrived.
        """
        errors = []
        end = self.t + duration - 1e-9
        while self.t < end:
            sample = (self.t, self.q, self.nu)
            found = sample if measure is None else measure(*sample)
            if found is not None:
                told = self.arrived if tells else None
                t, q, nu = found
                self.outputs.append(self.controller.step(t, q, nu, applied=told))
            dt, self.arrived = steps(), arriving(self.outputs[-1].efforts)
            step = rk4_step(self.dynamics, self.q, self.nu, self.arrived, dt)
            self.q, self.nu, self.t = step.q, step.nu, self.t + dt
            reference = self.controller.reference(self.t)
            e = tracking_error(self.controller.robot, reference, self.q)
            errors.append(math.hypot(e[0], e[1]))
        return errors

    def error(self, t: float | None = None) -> Array:
        """Return e (3 + n_joints,) against the reference at a time (s), now if not given."""
        reference = self.controller.reference(self.t if t is None else t)
        return tracking_error(self.controller.robot, reference, self.q)

    def largest_jump(self, first: int = 0) -> float:
        """Return the largest change of an effort from sample to sample, over its limit.

        Args:
            first: Number of the first sample that counts; before sample 0 there were no efforts.
        """
        efforts = np.array([output.efforts for output in self.outputs])
        efforts = np.vstack([np.zeros(efforts.shape[1]), efforts])[first:]
        return float(np.abs(np.diff(efforts, axis=0) / self.controller.robot.effort_limits).max())
