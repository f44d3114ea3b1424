"""Measured samples: which of them a controller can use, and a controlled stop without them."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.fallback import FAILURES
from rpctl.dynamics.motion import step
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.robot.model import Robot

MAX_POSITION = 1e9  # m or rad: nothing is there
MAX_SPEED = 1e6  # m/s or rad/s: nothing moves so
MAX_NORM_ERROR = 1e-3  # of cos² + sin²: rounding of single precision is far below
BRAKING_TIME = 0.3  # s: time constant with which the speeds decay
LONGEST_STEP = 0.01  # s, of the model's motion
LONGEST_PREDICTION = 1.0  # s: after a longer silence nothing is known of the motion


class MeasuredSample(NamedTuple):
    """A measured state that can be used: its own copy, of the right lengths, finite."""

    t: float  # s
    q: Array  # (nq,)
    nu: Array  # (dof,)


class SampleReader:
    """Reads the measured states of one robot."""

    def __init__(self, robot: Robot) -> None:
        self._bounds = {"q": (robot.nq, MAX_POSITION), "nu": (robot.dof, MAX_SPEED)}
        model = robot.model
        starts = [int(joint.idx_q + joint.nq - 2) for joint in model.joints if joint.nq > joint.nv]
        self._cos = np.array(starts, dtype=int)  # the root's and those of continuous joints

    def read(self, t: Any, q: Any, nu: Any, last: float) -> MeasuredSample | str:
        """Return a sample, or what is wrong with it.

        Args:
            last: Time of the sample before, s.
        """
        try:
            sample = MeasuredSample(float(t), np.array(q, dtype=float), np.array(nu, dtype=float))
        except (TypeError, ValueError) as error:
            return f"the sample holds what is no number: {error}"
        return self._fault(sample, last) or sample

    def _fault(self, sample: MeasuredSample, last: float) -> str:
        """Return what is wrong with a sample; nothing, if it can be used."""
        t, q, nu = sample
        for name, values in (("q", q), ("nu", nu)):
            length, largest = self._bounds[name]
            if values.shape != (length,):
                return f"{name} has the shape {values.shape}; give {length} numbers"
            if not np.abs(values).max(initial=0.0) <= largest:
                return f"{name} holds numbers that are not finite or larger than {largest:g}"
        if not math.isfinite(t):
            return f"t is {t}"
        if t <= last:
            return f"t is {t:g} s, not later than the {last:g} s of the sample before"
        norms = q[self._cos] ** 2 + q[self._cos + 1] ** 2
        if np.abs(norms - 1.0).max() > MAX_NORM_ERROR:
            return "q holds a cosine and a sine that belong to no angle"
        return ""


class Braking:
    """Brakes a robot from its last measured state: ν̇ = −ν/T along the motion of its model.

    The efforts stay inside their limits; where these are too narrow, it brakes more slowly. Once
    the model stands, they are those that hold it.
    """

    def __init__(self, dynamics: ReducedDynamics, sample: MeasuredSample) -> None:
        self._dynamics = dynamics
        self._t, self._q, self._nu = sample

    def efforts(self, t: float, sent: Array) -> Array | None:
        """Return the efforts (n_act,) to send now; None where the model has none.

        Args:
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
