"""Time scaling: the horizon law slows the reference down ahead of parts too fast for the robot.

A reference that would tip the robot or exceed its limits is followed along the same path more
slowly, and the lag is made up later.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.constraints import Bounds
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.prediction import Model
from rpctl.control.horizon.target import TimeScaling
from rpctl.reference.motion import Reference
from rpctl.reference.quasi_velocities import ReferenceRates, reference_rates, steering

LIMIT_FRACTION = 0.9  # of what the limits leave: the rest is for bringing errors back
NO_LAG_S = 1e-6  # s: a lag below it is rounding
MAX_PACE = 1.5  # the largest pace, while a lag is made up for
SLOW_REFERENCE_SPEED = 1e-2  # m/s: a reference slower than this is not waited for, it hardly moves
NEWTON_STEPS = 3  # Newton steps to the time that a leash asks for
PACE_STRIDE = 3  # steps: how far apart the reference ahead is looked at


class TimeScaler:
    """Scales the reference's time so that the robot can keep up with it.

    At a time rate p (the pace), speeds scale with p and the part of the efforts due to motion with
    p². The largest admissible p is found at points ahead, and the pace is lowered in advance at a
    rate ṗ that costs at most half of the base's acceleration. In addition the lag keeps the base
    within the leash of the reference.

    Args:
        model: The prediction's model.
        forces: Efforts and ground reactions of the prediction.
        bounds: Bounds of the motion.
        leash: Largest distance of the base behind the reference, m.
    """

    def __init__(self, model: Model, forces: ForceModel, bounds: Bounds, leash: float) -> None:
        self._model, self._forces, self._bounds, self._leash = model, forces, bounds, leash
        self._efforts, self._rates = bounds.efforts(model.robot), bounds.rates(model.robot)
        self._last_call: float | None = None
        self._reference_time, self._pace = 0.0, 1.0
        self.largest_lag = 0.0

    def __call__(self, reference: Reference, t: float, pose: Array) -> TimeScaling:
        """Return the reference times of the steps.

        Args:
            reference: The reference.
            t: Time, s.
            pose: Measured pose of P (3,).
        """
        model = self._model
        if self._last_call is None:
            self._last_call = self._reference_time = t
        elapsed, self._last_call = t - self._last_call, t
        latest = min(self._reference_time + self._pace * elapsed, t)
        self._reference_time = max(
            self._time_within_leash(reference, pose, latest), self._reference_time
        )
        self.largest_lag = max(self.largest_lag, t - self._reference_time)
        ahead = np.asarray(
            self._reference_time + model.dt * np.arange(0, model.steps + 1, PACE_STRIDE)
        )
        limits, change = self._limits(reference, ahead)
        squares = np.minimum(limits, MAX_PACE) ** 2
        for j in range(len(squares) - 2, -1, -1):  # in time for what comes
            squares[j] = min(squares[j], squares[j + 1] + 2.0 * change * PACE_STRIDE * model.dt)
        self._pace += change * elapsed
        return self._advance(t, lambda at: math.sqrt(np.interp(at, ahead, squares)), change)

    def _advance(self, t: float, limit: Callable[[float], float], change: float) -> TimeScaling:
        """Return the reference times and paces of the N steps, never ahead of real time.

        Args:
            t: Time, s.
            limit: Largest pace at a reference time.
            change: Rate at which the pace grows, 1/s.
        """
        model = self._model
        times, paces = np.empty(model.steps + 1), np.empty(model.steps + 1)
        at, pace = self._reference_time, self._pace
        for k in range(model.steps + 1):
            now = t + k * model.dt
            if at > now - NO_LAG_S:
                at, pace = now, min(pace, 1.0)
            pace = min(pace, limit(at))
            times[k], paces[k] = at, pace
            at, pace = at + pace * model.dt, pace + change * model.dt
        self._pace = float(paces[0])
        return TimeScaling(times, paces)

    def _limits(self, reference: Reference, times: Array) -> tuple[Array, float]:
        """Return the largest pace at each time (K,), and the rate (1/s) at which it may change."""
        robot, limits, fastest = self._model.robot, np.empty(len(times)), SLOW_REFERENCE_SPEED
        for j, at in enumerate(times.tolist()):
            state = reference(at)
            posture = np.concatenate([steering(robot, state)[0], state.joints])
            limits[j] = self._limit(posture, reference_rates(robot, state))
            fastest = max(fastest, math.hypot(*state.twist[:2]))
        return limits, 0.5 * self._bounds.base_acceleration / fastest

    def _limit(self, joints: Array, rates: ReferenceRates) -> float:
        """Return the largest pace of the reference at a posture."""
        q, still = self._model.configuration(joints), np.zeros_like(rates.nu)
        rest = self._margins(q, still, still)
        used = rest - self._margins(q, *rates)
        limiting = (rest > 0.0) & (used > 0.0)
        square = (LIMIT_FRACTION * rest[limiting] / used[limiting]).min(initial=MAX_PACE**2)
        B = self._model.dynamics.actuation(q)
        limited, limit_values = self._rates
        speed = (np.abs(B.T[limited] @ rates.nu) / limit_values).max(initial=1.0 / MAX_PACE)
        return min(math.sqrt(square), 1.0 / speed)

    def _margins(self, q: Array, nu: Array, nu_dot: Array) -> Array:
        """Return the margins of efforts, tipping and slipping, each as a fraction of its limit."""
        forces = self._forces.value(q, nu, nu_dot)
        limited, limit_values = self._efforts
        tau = self._forces.efforts(forces)[limited, 0] / limit_values
        margins = [1.0 - tau, 1.0 + tau]
        if self._forces.rows:
            margins.append(self._forces.ground(forces)[:, 0])
        return np.concatenate(margins)

    def _time_within_leash(self, reference: Reference, pose: Array, latest: float) -> float:
        """Return the last time up to ``latest`` at which the base is within the leash."""
        at = latest
        for _ in range(NEWTON_STEPS):
            state = reference(at)
            cos, sin = math.cos(state.pose[2]), math.sin(state.pose[2])
            vx, vy, _ = state.twist
            speed = math.hypot(vx, vy)
            if speed < SLOW_REFERENCE_SPEED:
                break
            x, y = state.pose[0] - pose[0], state.pose[1] - pose[1]
            behind = (x * (cos * vx - sin * vy) + y * (sin * vx + cos * vy)) / speed
            at = min(at - (behind - self._leash) / speed, latest)
        return at
