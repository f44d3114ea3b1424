"""The clock by which the horizon law reads its reference: it slows down ahead of what is too fast.

A reference is a motion in time. One that would tip the robot, or ask for more than its limits, is
followed along the same path at a pace that the robot can keep, and made up for later.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from rpctl.arrays import Array
from rpctl.control.horizon.bounds import Bounds
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.model import Model
from rpctl.control.horizon.sample import Reading
from rpctl.reference.motion import Reference
from rpctl.reference.rates import Rates, reference_rates, steering

RESERVE = 0.9  # of what the limits leave: the rest is for bringing errors back
CAUGHT_UP = 1e-6  # s: a lag below it is rounding
HASTE = 1.5  # the largest pace, while a lag is made up for
SLOW = 1e-2  # m/s: a reference slower than this is not waited for, it hardly moves
PASSES = 3  # Newton steps to the time that a leash asks for
EVERY = 3  # steps: how far apart the reference ahead is looked at


class Clock:
    """Reads a reference late where the robot cannot keep up with it.

    At a pace p a motion's speeds scale with p, and what accelerations and speeds take with p²: the
    largest pace within the limits is found at places ahead, and the clock slows down in time for
    it, at a rate ṗ that costs the base no more than half its acceleration. Besides, the lag is
    at least what keeps the base within a leash behind the reference.

    Args:
        model: The prediction's model.
        forces: Efforts and ground reactions.
        bounds: Bounds of the motion.
        leash: m.
    """

    def __init__(self, model: Model, forces: ForceModel, bounds: Bounds, leash: float) -> None:
        self._model, self._forces, self._bounds, self._leash = model, forces, bounds, leash
        self._efforts, self._rates = bounds.efforts(model.robot), bounds.rates(model.robot)
        self._then: float | None = None
        self._read, self._pace = 0.0, 1.0
        self.largest = 0.0

    def __call__(self, reference: Reference, t: float, pose: Array) -> Reading:
        """Return when to read the reference for the steps from ``t`` (s), the base at ``pose``."""
        model = self._model
        if self._then is None:
            self._then = self._read = t
        elapsed, self._then = t - self._then, t
        latest = min(self._read + self._pace * elapsed, t)
        self._read = max(self._wait(reference, pose, latest), self._read)
        self.largest = max(self.largest, t - self._read)
        ahead = np.asarray(self._read + model.dt * np.arange(0, model.steps + 1, EVERY))
        limits, change = self._limits(reference, ahead)
        squares = np.minimum(limits, HASTE) ** 2
        for j in range(len(squares) - 2, -1, -1):  # in time for what comes
            squares[j] = min(squares[j], squares[j + 1] + 2.0 * change * EVERY * model.dt)
        self._pace += change * elapsed
        return self._run(t, lambda at: math.sqrt(np.interp(at, ahead, squares)), change)

    def _run(self, t: float, limit: Callable[[float], float], change: float) -> Reading:
        """Let the clock run on, up to the time: within the limit, gaining pace at a rate (1/s)."""
        model = self._model
        times, paces = np.empty(model.steps + 1), np.empty(model.steps + 1)
        at, pace = self._read, self._pace
        for k in range(model.steps + 1):
            now = t + k * model.dt
            if at > now - CAUGHT_UP:
                at, pace = now, min(pace, 1.0)
            pace = min(pace, limit(at))
            times[k], paces[k] = at, pace
            at, pace = at + pace * model.dt, pace + change * model.dt
        self._pace = float(paces[0])
        return Reading(times, paces)

    def _limits(self, reference: Reference, times: Array) -> tuple[Array, float]:
        """Return the largest pace at each time, and the rate (1/s) at which a pace may change."""
        robot, limits, fastest = self._model.robot, np.empty(len(times)), SLOW
        for j, at in enumerate(times.tolist()):
            state = reference(at)
            posture = np.concatenate([steering(robot, state)[0], state.joints])
            limits[j] = self._limit(posture, reference_rates(robot, state))
            fastest = max(fastest, math.hypot(*state.twist[:2]))
        return limits, 0.5 * self._bounds.base_acceleration / fastest

    def _limit(self, joints: Array, rates: Rates) -> float:
        """Return the largest pace of the reference at a posture."""
        q, still = self._model.configuration(joints), np.zeros_like(rates.nu)
        rest = self._room(q, still, still)
        spent = rest - self._room(q, *rates)
        holds = (rest > 0.0) & (spent > 0.0)
        square = (RESERVE * rest[holds] / spent[holds]).min(initial=HASTE**2)
        B = self._model.dynamics.actuation(q)
        limited, most = self._rates
        speed = (np.abs(B.T[limited] @ rates.nu) / most).max(initial=1.0 / HASTE)
        return min(math.sqrt(square), 1.0 / speed)

    def _room(self, q: Array, nu: Array, nu_dot: Array) -> Array:
        """Return what is left of the efforts' and the ground's limits, over these limits."""
        forces = self._forces.value(q, nu, nu_dot)
        limited, most = self._efforts
        tau = self._forces.efforts(forces)[limited, 0] / most
        room = [1.0 - tau, 1.0 + tau]
        if self._forces.rows:
            room.append(self._forces.ground(forces)[:, 0])
        return np.concatenate(room)

    def _wait(self, reference: Reference, pose: Array, latest: float) -> float:
        """Return the last time up to ``latest`` at which the base is within the leash."""
        at = latest
        for _ in range(PASSES):
            state = reference(at)
            cos, sin = math.cos(state.pose[2]), math.sin(state.pose[2])
            vx, vy, _ = state.twist
            speed = math.hypot(vx, vy)
            if speed < SLOW:
                break
            x, y = state.pose[0] - pose[0], state.pose[1] - pose[1]
            behind = (x * (cos * vx - sin * vy) + y * (sin * vx + cos * vy)) / speed
            at = min(at - (behind - self._leash) / speed, latest)
        return at
