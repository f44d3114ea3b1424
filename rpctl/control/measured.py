"""Measured samples: which of them a controller can use, and why not the others."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.model import Robot

MAX_POSITION = 1e9  # m or rad: nothing is there
MAX_SPEED = 1e6  # m/s or rad/s: nothing moves so
MAX_NORM_ERROR = 1e-3  # of cos² + sin²: rounding of single precision is far below


class MeasuredSample(NamedTuple):
    """A measured state that can be used: its own copy, of the right lengths, finite."""

    t: float  # s
    q: Array  # (nq,)
    nu: Array  # (dof,)


class SampleReader:
    """Reads the measured states of one robot.

    Args:
        robot: The robot.
    """

    def __init__(self, robot: Robot) -> None:
        self._bounds = {"q": (robot.nq, MAX_POSITION), "nu": (robot.dof, MAX_SPEED)}
        model = robot.model
        starts = [int(joint.idx_q + joint.nq - 2) for joint in model.joints if joint.nq > joint.nv]
        self._cos = np.array(starts, dtype=int)  # the root's and those of continuous joints

    def read(self, t: Any, q: Any, nu: Any, last: float) -> MeasuredSample | str:
        """Return a sample, or what is wrong with it.

        Args:
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
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
