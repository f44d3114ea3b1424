"""Computing takes time: answers that come late, and samples that a busy controller misses."""

from __future__ import annotations

import time

from rpctl.arrays import Array
from rpctl.control.controller import Controller, ControllerOutput
from rpctl.control.horizon.law import SimulatedTime

TIME_ROUNDING = 1e-9  # s: rounding of a sample's time


class ComputingController:
    """A controller whose computing takes simulated time.

    A law that plans now and then takes it for its plans, any other law at each sample. What is
    computed beside the samples delays what it brings, and no sample.

    Args:
        controller: The controller, made within ``simulated``.
        simulated: What computing takes.
    """

    def __init__(self, controller: Controller, simulated: SimulatedTime) -> None:
        self._controller, self._simulated = controller, simulated
        self._busy_until = 0.0  # s
        self._output: ControllerOutput | None = None

    def step(self, t: float, q: Array, nu: Array) -> ControllerOutput:
        """Return the controller's answer to a sample, or its last one as long as it computes.

        Args:
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
        """
        if self._output is not None and t < self._busy_until - TIME_ROUNDING:
            return self._output
        before, beside = self._controller.kinematic_report(), self._simulated.spent_in_background
        began = time.thread_time()
        self._output = output = self._controller.step(t, q, nu)
        spent = time.thread_time() - began - (self._simulated.spent_in_background - beside)
        self._busy_until = t + self._charge(before, self._controller.kinematic_report(), spent)
        return output

    def late(self, t: float) -> float:
        """Return how much after a sample's time (s) the controller sends its answer, s."""
        return max(self._busy_until - t, 0.0)

    def _charge(self, before: dict[str, float], after: dict[str, float], spent: float) -> float:
        """Return what a sample takes, s.

        Args:
            before: What the kinematic law had counted before it.
            after: What it has now.
            spent: Processor time, s.
        """
        stated = self._simulated.computing_time
        if isinstance(stated, str):
            return spent
        if "solves" not in after:
            return stated
        beside = "largest_delay" in after
        return stated if after["solves"] > before["solves"] and not beside else 0.0
