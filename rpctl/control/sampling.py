"""Measured samples as laws can use them: numbers checked, and a clock that may be set."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.robot.leaning import FREE_NQ, FREE_NV
from rpctl.robot.model import Robot

MAX_POSITION = 1e9  # m or rad: nothing is there
MAX_TIME = 1e10  # s: doubles beyond it do not tell one sample from the next
MAX_SPEED = 1e6  # m/s or rad/s: nothing moves so
MAX_NORM_ERROR = 1e-3  # of cos² + sin²: rounding of single precision is far below
LONGEST_SILENCE = 1.0  # s between two samples; a clock that advances by more was set
TIME_ROUNDING = 1e-9  # s: rounding of a sample's time
CONSISTENT = 3  # samples in a row that go on from a clock that was set: it is taken anew
JUMP = 0.05  # m or rad, beyond what the motion so far explains: the pose's frame has moved
FASTEST_CHANGE = 10.0  # m/s² or rad/s², of a base


class MeasuredSample(NamedTuple):
    """A measured state that can be used: its own copy, of the right lengths, finite."""

    t: float  # s
    q: Array  # (nq,)
    nu: Array  # (dof,)


class SampleReader:
    """Reads the measured states of one robot.

    Args:
        robot: The robot.
        period: Control period, s.
        delay: Time from a measurement to the efforts it leads to, s: the clock counts the latter.
        needs_rates: Whether a sample is bad that lacks rates, which are NaN then.

    Attributes:
        time: Of the last sample, s, by a clock that only advances. Where the given one is set, this
            one goes on as if it had not been.
        clock_changes: How often that was.
    """

    def __init__(
        self, robot: Robot, period: float, delay: float = 0.0, needs_rates: bool = True
    ) -> None:
        self._needs_rates = needs_rates
        self._bounds = {"q": (robot.nq, MAX_POSITION), "nu": (robot.dof, MAX_SPEED)}
        model = robot.model
        self._free = robot.drive.leans  # its root's attitude is a quaternion
        turning = [
            joint for joint in model.joints if joint.nq == joint.nv + 1 and joint.nv < FREE_NV
        ]
        self._cos = [int(joint.idx_q + joint.nq - 2) for joint in turning]
        self._period = period
        self.time, self.clock_changes = -math.inf, 0
        self._given, self._offset = -math.inf, -delay  # as given with the last sample; minus time
        self._candidate, self._streak = math.nan, 0  # of a clock that was set

    def read(self, t: Any, q: Any, nu: Any) -> MeasuredSample | str:
        """Return a sample in the time of this clock, or what is wrong with it."""
        try:
            given = float(t)
        except Exception as error:  # whatever it raises
            self._pass_a_period()
            return f"the sample has entries that are not numbers: {error}"
        fault = self._clock_fault(given)
        try:
            sample = MeasuredSample(self.time, np.array(q, dtype=float), np.array(nu, dtype=float))
        except Exception as error:  # whatever its numbers raise where they are made floats
            return f"the sample has entries that are not numbers: {error}"
        return self._state_fault(sample) or fault or sample

    def _clock_fault(self, t: float) -> str:
        """Take the time that a sample gives, s; return what is wrong with it, if anything is."""
        if not abs(t) <= MAX_TIME:
            self._pass_a_period()
            return f"t is {t:g} s; give a time of at most {MAX_TIME:g} s"
        last, first = self._given, math.isinf(self._given)
        if first or (t - last <= LONGEST_SILENCE and t - self._offset > self.time):
            self._given, self.time, self._streak = t, t - self._offset, 0
            return ""
        expected = self.time + self._offset
        self._pass_a_period()
        goes_on = 0.0 < t - self._candidate <= LONGEST_SILENCE
        self._candidate, self._streak = t, self._streak + 1 if goes_on else 1
        if self._streak == CONSISTENT:
            self.clock_changes, self._streak = self.clock_changes + 1, 0
            self._given, self._offset = t, t - self.time
            return ""
        if t <= expected:
            return f"t is {t:g} s, not later than the {expected:g} s of the sample before"
        return f"t is {t:g} s, {t - last:g} s later than the sample before: the clock was set"

    def _pass_a_period(self) -> None:
        self.time = self.time + self._period if math.isfinite(self.time) else 0.0

    def _state_fault(self, sample: MeasuredSample) -> str:
        """Return what is wrong with a state; nothing, if it can be used."""
        _, q, nu = sample
        places = q.tolist()
        for name, values, told in (("q", q, places), ("nu", nu, nu.tolist())):
            length, largest = self._bounds[name]
            if values.shape != (length,):
                return f"{name} has the shape {values.shape}; give {length} numbers"
            if math.hypot(*told) <= largest:  # found sooner than the largest of them
                continue
            if name == "nu" and not self._needs_rates:
                values = values[~np.isnan(values)]
            if not np.abs(values).max(initial=0.0) <= largest:
                return f"{name} has numbers that are not finite, or larger than {largest:g}"
        for k in self._cos:
            cos, sin = places[k], places[k + 1]
            if abs(cos * cos + sin * sin - 1.0) > MAX_NORM_ERROR:
                return "q has a cosine and a sine that are not those of an angle"
        if self._free and abs(math.hypot(*places[3:FREE_NQ]) - 1.0) > MAX_NORM_ERROR:
            return "q has a quaternion whose length is not 1"
        return ""


class JumpWatch:
    """Tells where a measured pose jumps, as that of a localisation does that corrects itself."""

    def __init__(self) -> None:
        self._t, self._place = math.nan, [0.0] * 4  # s; m, m, cosine and sine
        self._speed = math.inf  # m/s and rad/s, the length of both; not known yet

    def jumps(self, t: float, place: list[float]) -> bool:
        """Return whether a pose is farther from the last one than its motion explains.

        Args:
            t: Time, s.
            place: x and y (m) of the root, cosine and sine of its heading.
        """
        elapsed, (x, y, cos, sin), before = t - self._t, place, self._place
        self._t, self._place = t, place
        turned = math.atan2(sin * before[2] - cos * before[3], cos * before[2] + sin * before[3])
        size = math.hypot(x - before[0], y - before[1], turned)
        if size > JUMP + elapsed * (2.0 * self._speed + FASTEST_CHANGE * elapsed):
            return True
        self._speed = size / elapsed if elapsed > 0.0 else math.inf
        return False
