"""What a step of a controller takes while samples come in real time."""

from __future__ import annotations

import time

import numpy as np

from rpctl import Controller, ReducedDynamics
from rpctl.arrays import Array
from rpctl.dynamics.motion import step
from rpctl.reference.motion import configuration_along

AWAKE_S = 4e-4  # s before a sample from which on nobody sleeps
OFF = np.array([-0.05, 0.05, 0.05])  # m, m, rad: where the base starts beside its reference


def step_seconds(controller: Controller, duration: float) -> Array:
    """Return the processor time of each step (s), of a robot that moves as its model does.

    On a machine with other work, wall clock tells of that work.

    Args:
        controller: Not stepped yet.
        duration: Of samples, s.
    """
    robot, period = controller.robot, controller.period
    dynamics, state = ReducedDynamics(robot), controller.reference(0.0)
    q, nu = configuration_along(robot, state, state.pose + OFF), np.zeros(robot.dof)
    took, start = np.empty(round(duration / period)), time.perf_counter()
    for k in range(len(took)):
        while (left := start + k * period - time.perf_counter()) > 0.0:
            if left > AWAKE_S:
                time.sleep(left - AWAKE_S)
        began = time.thread_time()
        output = controller.step(k * period, q, nu)
        took[k] = time.thread_time() - began
        q, nu, *_ = step(dynamics, q, nu, output.efforts, period)
    return took
