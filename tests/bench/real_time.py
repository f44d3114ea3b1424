"""What a step of a controller takes while samples come in real time, beside another one's."""

from __future__ import annotations

import time

import numpy as np

from rpctl import Controller, ReducedDynamics
from rpctl.arrays import Array
from rpctl.dynamics.motion import step
from rpctl.reference.motion import configuration_along

AWAKE_S = 4e-4  # s before a sample from which on nobody sleeps
OFF = np.array([-0.05, 0.05, 0.05])  # m, m, rad: where the base starts beside its reference


def step_seconds(controller: Controller, floor: Controller, duration: float) -> Array:
    """Return the processor time (s) of each step of two controllers on one robot (2, samples).

    The robot moves as its model does, under the first one's efforts; the other one gets the same
    samples half a period later, as rested as the first. What the second one's slowest steps take is
    the machine's: an interrupt, or the host at other work, counts as time of who is running.

    Args:
        controller: Not stepped yet.
        floor: Likewise, with laws in machine code.
        duration: Of samples, s.
    """
    robot, period = controller.robot, controller.period
    dynamics, state = ReducedDynamics(robot), controller.reference(0.0)
    q, nu = configuration_along(robot, state, state.pose + OFF), np.zeros(robot.dof)
    took, start = np.empty((2, round(duration / period))), time.perf_counter()
    for k in range(took.shape[1]):
        sent = []
        for number, stepped in enumerate((controller, floor)):
            _await(start + (k + 0.5 * number) * period)
            began = time.thread_time()
            sent.append(stepped.step(k * period, q, nu).efforts)
            took[number, k] = time.thread_time() - began
        q, nu, *_ = step(dynamics, q, nu, sent[0], period)
    return took


def _await(instant: float) -> None:
    """Wait for an instant of the performance counter (s), awake at last."""
    while (left := instant - time.perf_counter()) > 0.0:
        if left > AWAKE_S:
            time.sleep(left - AWAKE_S)
