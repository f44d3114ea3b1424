"""A controlled stop without measurements: the model says how the robot moves on, and brakes it."""

from __future__ import annotations

import math

import numpy as np

from rpctl.arrays import Array
from rpctl.control.guarded import FAILURES
from rpctl.control.measured import MeasuredSample
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics

BRAKING_TIME = 0.3  # s: time constant with which the speeds decay
LONGEST_STEP = 0.01  # s, of the model's motion
LONGEST_PREDICTION = 1.0  # s: after a longer silence nothing is known of the motion


class Braking:
    """Brakes a robot from its last measured state: ν̇ = −ν/T along the motion of its model.

    The efforts stay inside their limits; where these are too narrow, it brakes more slowly. Once
    the model stands, they are those that hold it.

    Args:
        dynamics: The robot's dynamics.
        sample: Its last measured state.
    """

    def __init__(self, dynamics: ReducedDynamics, sample: MeasuredSample) -> None:
        self._dynamics = dynamics
        self._t, self._q, self._nu = sample

    def efforts(self, t: float, sent: Array) -> Array | None:
        """Return the efforts (n_act,) to send now; None where the model has none.

        Args:
            t: Time, s.
            sent: Efforts (n_act,) that were sent until now.
        """
        dynamics, box = self._dynamics, self._dynamics.robot.effort_limits
        try:
            self._advance(t - self._t, sent)
            push = dynamics.inverse(self._q, self._nu, -self._nu / BRAKING_TIME)
            tau = np.clip(dynamics.efforts(self._q, push), -box, box)
        except FAILURES:
            return None
        self._t = t
        return tau if np.isfinite(tau).all() else None

    def _advance(self, elapsed: float, tau: Array) -> None:
        """Let the model move under efforts (n_act,) for a time (s)."""
        steps = math.ceil(min(elapsed, LONGEST_PREDICTION) / LONGEST_STEP)
        for _ in range(steps):
            self._q, self._nu, *_ = step(
                self._dynamics, self._q, self._nu, tau, min(elapsed / steps, LONGEST_STEP)
            )
