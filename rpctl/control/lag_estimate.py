"""How late a robot follows its speeds, learnt while it moves: lags and a dead time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array

STRIDE = 0.02  # s between two comparisons; shorter periods are averaged over as much
LAGS = (0.0, 0.02, 0.04, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4, 0.56, 0.8, 1.13, 1.6)  # s, tried
DEAD_TIMES = 0.3  # s: as far from the told one the dead time is looked for
MEMORY = 10.0  # s: time constant with which older errors are forgotten
SILENCE = 0.3  # s without measured speeds, after which the robot's motion is taken anew
SURE = 60.0  # variances: a model that much better than another is so beyond chance
FINEST = 2e-3, 1e-4  # of the rms motion, and m/s or rad/s: errors below that tell nothing
WORST = 0.1  # of the variance of the motion: a model that leaves more is none of it
TOLERANCE = 0.01, 0.1  # s, and of a lag: what is nearer to what was told is the same
TAKEN_IN = 0.3  # s: time constant with which an estimate is put to use
DECIDED = 5  # strides between two decisions


class LagEstimate:
    """Lags by quasi-velocity and a common dead time of a robot, T ν̇(t) = c(t − T_d) − ν(t).

    Each pair of a row of lags and a row of dead times is a model that answers the sent commands;
    how far its speeds are from the measured ones adds up, and is forgotten slowly. Models do not
    see what is measured but for their start, so noise that comes anew with each sample biases
    nothing, and a loop that is closed with it neither. Between neighbours of the row the error is
    taken for a parabola of the lag.

    What was told is used until a model beats it by far more than chance and explains the motion;
    without motion all models do as well, and nothing is learnt. The dead time is one of the whole
    robot: it is changed where all quasi-velocities together speak for another, in whole strides.
    Lag and dead time of a slow motion stand for each other, and only their sum is told apart then.
    What is learnt replaces what was used within some .3 s.

    Args:
        told: T (dof,), s.
        dead_time: T_d that was told, s.
        period: Control period, s.

    Attributes:
        lag: What is to be used now (dof,), s.
        dead_time: Likewise, s.
        learnt: Which lags are no longer those told (dof,).
    """

    def __init__(self, told: Array, dead_time: float, period: float) -> None:
        self._told, self._told_dead = told, dead_time
        self.lag, self.dead_time = told.copy(), dead_time
        self.learnt = np.zeros(len(told), dtype=bool)
        self._found, self._found_dead = told.copy(), dead_time
        self._stride = period * max(1, round(STRIDE / period))
        self._half, self._forget = 0.5 * period, math.exp(-self._stride / MEMORY)
        self._held = self._stride < 1.5 * period  # a stride is a sample: commands hold through it
        around = math.ceil(DEAD_TIMES / self._stride)
        dead_times = dead_time + self._stride * np.arange(-around, around + 1)
        self._dead_times = dead_times[dead_times >= 0.0]
        self._at = int(np.abs(self._dead_times - dead_time).argmin())
        self._knots = 2 + math.ceil(2.0 * self._dead_times[-1] / self._stride)
        self._time = self._sent_at = self._width = math.nan
        self._command = np.zeros(len(told))

    def sent(self, t: float, command: Array) -> None:
        """Take note of a command (dof,) that is sent at a time (s)."""
        self._hold(t)
        self._command = command

    def measured(self, t: float, nu: Array) -> None:
        """Take note of measured speeds (dof,) at a time (s), later than those before."""
        elapsed = t - self._time
        if not elapsed <= SILENCE:
            return self._restart(t, nu)
        self._hold(t)
        self._time = t
        self._speeds += elapsed * nu
        self._passed += elapsed
        if self._passed > self._stride - self._half:
            self._advance(t, self._passed)
            self._compare(nu if self._held else self._speeds / self._passed)
            self._speeds, self._passed = 0.0 * nu, 0.0
        rate = -math.expm1(-elapsed / TAKEN_IN)
        self.lag = self.lag + rate * (self._found - self.lag)
        self.dead_time += rate * (self._found_dead - self.dead_time)
        return None

    def sentence(self, names: Sequence[str]) -> str:
        """Return what was learnt, in words; "" if nothing was.

        Args:
            names: Of the quasi-velocities.
        """
        if not self.learnt.any():
            return ""
        each = ", ".join(
            f"{names[k]} {self._found[k]:.2g} s (told: {self._told[k]:g} s)"
            for k in np.flatnonzero(self.learnt)
        )
        late = f" after a dead time of {self._found_dead:.2g} s (told: {self._told_dead:g} s)"
        return (
            f"the robot follows its speeds later than was told, with a lag of {each}{late}; give "
            "--actuator-lag and --dead-time, or VelocityOutput(lag, dead_time, lags)"
        )

    def _restart(self, t: float, nu: Array) -> None:
        """Begin anew with speeds (dof,) at a time (s); what was learnt stays."""
        rows, fresh = len(self._dead_times), math.isnan(self._time)
        self._models = np.broadcast_to(nu, (rows, len(LAGS), len(nu))).copy()
        if fresh:
            self._command = nu
            self._errors = np.zeros_like(self._models)
            self._count, self._sum, self._squares = 0.0, np.zeros(len(nu)), np.zeros(len(nu))
        # The way that was commanded, at times from which on it is taken for a straight one.
        self._times = np.full(self._knots, -math.inf)
        self._ways = np.zeros((self._knots, len(nu)))
        self._times[-1], self._way = t, np.zeros(len(nu))
        self._asked = np.broadcast_to(self._command, (rows, len(nu))).copy()
        self._before = -self._dead_times[:, None] * self._command
        self._known_from = t if fresh else t + self._dead_times[-1]
        self._decide = DECIDED
        self._speeds, self._passed = np.zeros(len(nu)), 0.0
        self._time = self._sent_at = t
        self._first = self._command

    def _hold(self, t: float) -> None:
        """Let the last command hold until a time (s)."""
        if t > self._sent_at:
            self._way = self._way + (t - self._sent_at) * self._command
            self._sent_at = t

    def _advance(self, t: float, width: float) -> None:
        """Let all models follow the commands of a stride that ends at a time (s).

        Args:
            width: Of the stride, s.
        """
        times, ways = self._times, self._ways
        times[:-1], ways[:-1] = times[1:], ways[1:]
        times[-1], ways[-1] = t, self._way
        acts = t - self._dead_times
        # Of the straight pieces, that in which each lies; before all of them the first held.
        after = np.clip(np.searchsorted(times, acts), 1, len(times) - 1)
        start, end = times[after - 1], times[after]
        early = ~np.isfinite(start)
        share = np.where(early, 0.0, (acts - start) / np.where(early, 1.0, end - start))
        way = ways[after - 1] + share[:, None] * (ways[after] - ways[after - 1])
        way[early] = ways[after[early]] - (end - acts)[early, None] * self._first
        asked = (way - self._before) / width
        self._before = way
        if width != self._width:
            self._width, x = width, width / np.maximum(LAGS, 1e-9)
            self._left = np.exp(-x)[:, None]
            new = -np.expm1(-x) if self._held else 1.0 + np.expm1(-x) / x
            self._new, self._old = new[:, None], 1.0 - self._left - new[:, None]
        new, old = asked[:, None, :], self._asked[:, None, :]
        self._models = self._left * self._models + self._new * new + self._old * old
        self._asked = asked

    def _compare(self, seen: Array) -> None:
        """Compare all models with speeds (dof,) that were measured."""
        if self._time < self._known_from:
            return
        self._errors *= self._forget
        self._errors += (self._models - seen) ** 2
        self._count = self._forget * self._count + 1.0
        self._sum = self._forget * self._sum + seen
        self._squares = self._forget * self._squares + seen**2
        self._decide -= 1
        if self._decide <= 0:
            self._decide = DECIDED
            self._choose()

    def _choose(self) -> None:
        """Choose between what is told, what is used and what the models say."""
        errors = self._errors
        spread = np.maximum(self._squares - self._sum**2 / self._count, 0.0)
        best = errors.min(axis=(0, 1))
        finest = FINEST[0] ** 2 * self._squares / self._count + FINEST[1] ** 2
        variance = np.maximum(best / self._count, finest)
        explained = best < WORST * spread
        if not explained.any():
            return
        # Of each dead time, how far the best lags are from what was measured, all together.
        totals = (errors.min(axis=1) / variance)[:, explained].sum(axis=1)
        row = int(totals.argmin())
        if totals[self._at] - totals[row] < SURE:
            row = self._at
        for k in np.flatnonzero(explained):
            lag, least = _lowest(errors[row, :, k])
            told = float(np.interp(self._told[k], LAGS, errors[self._at, :, k]))
            used = float(np.interp(self._found[k], LAGS, errors[row, :, k]))
            near = abs(lag - self._told[k]) <= TOLERANCE[0] + TOLERANCE[1] * self._told[k]
            if self.learnt[k] or row != self._at:
                near = False
            if not near and max(told, used) - least > SURE * variance[k]:
                self._found[k], self.learnt[k] = lag, True
        if self.learnt.any():
            self._found_dead = float(self._dead_times[row])


def _lowest(errors: Array) -> tuple[float, float]:
    """Return the lag with the least error (s), and that error, by a parabola through three."""
    k = min(max(int(errors.argmin()), 1), len(LAGS) - 2)
    x, y = np.array(LAGS[k - 1 : k + 2]), errors[k - 1 : k + 2]
    left, right = (y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1])
    bend = (right - left) / (x[2] - x[0])
    if not bend > 0.0:
        return float(LAGS[int(errors.argmin())]), float(errors.min())
    lag = min(max(0.5 * (x[0] + x[1]) - 0.5 * left / bend, float(x[0])), float(x[2]))
    return lag, float(errors.min())
