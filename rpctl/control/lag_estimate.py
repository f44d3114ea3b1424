"""How late a robot follows its speeds, learnt while it moves: lags and dead times."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rpctl.arrays import Array

STRIDE = 0.02  # s between two comparisons; shorter periods are averaged over as much
LAGS = np.array([0.0, 0.02, 0.04, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4, 0.56, 0.8, 1.13, 1.6])  # s
DEAD_TIMES = 0.3  # s: as far from the told one the dead time is looked for
MEMORY = 10.0  # s: time constant with which older errors are forgotten
SILENCE = 0.3  # s or 2.5 periods without measured speeds: after that models begin anew, and ...
RESUMED = 1.0  # s later than the longest dead time they have forgotten that they knew no commands
SURE = 60.0  # variances: a model that much better than another is so beyond chance, ...
CLEARLY = 0.25  # and of its own error: errors of another kind follow one another
FINEST = 2e-3, 1e-3  # of the rms motion, and m/s or rad/s: errors below that tell nothing
WORST = 0.1  # of the variance of the motion: a model that leaves more is none of it
TOLERANCE = 0.01, 0.1  # s, and of a lag: what is nearer to what was told is the same
TAKEN_IN = 0.3  # s: time constant with which an estimate is put to use
DECIDED = 5  # strides between two decisions


class LagEstimate:
    """Lags and dead times of a robot by quasi-velocity, T ν̇(t) = c(t − T_d) − ν(t).

    Each pair of a lag, of a row or as told, and of a dead time, as told or sooner or later by whole
    strides, is a model that answers the sent commands;
    how far its speeds are from the measured ones adds up, and is forgotten slowly. Models do not
    see what is measured but for their start, so noise that comes anew with each sample biases
    nothing, and a loop that is closed with it neither. Between neighbours of the row the error is
    taken for a parabola of the lag.

    What was told is used until a model beats it by far more than chance and explains the motion;
    without motion all models do as well, and nothing is learnt. Quasi-velocities of one told dead
    time are a group that has one: it is changed where all of them together speak for another. Lag
    and dead time of a slow motion stand for each other, and only their sum is told apart then. What
    is learnt replaces what was used within some .3 s.

    Args:
        told: T (dof,), s.
        dead_times: T_d that was told, likewise.
        period: Control period, s.

    Attributes:
        lag: What is to be used now (dof,), s.
        dead_times: Likewise; the same array, whose numbers change.
        learnt: Which lags are no longer those told (dof,).
    """

    def __init__(self, told: Array, dead_times: Array, period: float) -> None:
        self._told, self._told_dead = told, dead_times
        self.lag, self.dead_times = told.copy(), dead_times.copy()
        self.learnt = np.zeros(len(told), dtype=bool)
        self._found, self._found_dead = told.copy(), dead_times.copy()
        self._group = dead_times[:, None] == dead_times  # whether two are of one
        self._each = np.arange(len(told))
        lags = np.vstack([np.tile(LAGS[:, None], len(told)), told])
        self._lags = np.maximum(lags, 1e-9)  # of the models (N, dof), s
        self._stride = period * max(1, round(STRIDE / period))
        self._half, self._forget = 0.5 * period, math.exp(-self._stride / MEMORY)
        self._held = self._stride < 1.5 * period  # a stride is a sample: commands hold through it
        later = math.ceil(DEAD_TIMES / self._stride)
        self._at = min(later, math.ceil(dead_times.max() / self._stride))  # the row of those told
        changes = self._stride * np.arange(-self._at, later + 1)
        self._dead_times = np.maximum(dead_times + changes[:, None], 0.0)  # of the models (M, dof)
        self._row = np.full(len(told), self._at)
        self._knots = 2 + math.ceil(2.0 * self._dead_times.max() / self._stride)
        self._time = self._sent_at = self._width = math.nan
        self._passed, self._settled = 0.0, True  # s; whether what is found is what is used
        self._command, self._speeds, self._nu = told * 0.0, told * 0.0, told * 0.0

    def sent(self, t: float, command: Array) -> None:
        """Take note of a command (dof,) that is sent at a time (s)."""
        self._hold(t)
        self._command = command

    def measured(self, t: float, nu: Array) -> None:
        """Take note of measured speeds (dof,) at a time (s), later than those before."""
        elapsed = t - self._time
        if not elapsed <= max(SILENCE, 5.0 * self._half):
            return self._restart(t, nu)
        self._hold(t)
        self._speeds += 0.5 * elapsed * (self._nu + nu)
        self._time, self._nu = t, nu
        self._passed += elapsed
        if self._passed > self._stride - self._half:
            self._advance(t, self._passed)
            self._compare(nu if self._held else self._speeds / self._passed)
            self._speeds, self._passed = 0.0 * nu, 0.0
        if not self._settled:
            rate, gap = -math.expm1(-elapsed / TAKEN_IN), self._found - self.lag
            self.lag = self.lag + rate * gap
            self.dead_times += rate * (self._found_dead - self.dead_times)
        return None

    def sentence(self, names: Sequence[str]) -> str:
        """Return what was learnt, and how to tell it, in words; "" if nothing was.

        Args:
            names: Of the quasi-velocities.
        """
        if not self.learnt.any():
            return ""
        rows = np.flatnonzero(self.learnt)
        each = ", ".join(
            f"{self._found[k]:.2g} s of {names[k]} ({self._told[k]:g} s set)" for k in rows.tolist()
        )
        lag, dead = (float(np.median(of[rows])) for of in (self._found, self._found_dead))
        return (
            f"the robot follows its speeds differently from the settings: with a lag of {each}, "
            f"after a dead time of {dead:.2g} s ({np.median(self._told_dead[rows]):g} s set); the "
            f"controller uses these values. Set them with --actuator-lag {lag:.2g} --dead-time "
            f"{dead:.2g}, or rpctl.VelocityOutput({lag:.2g}, {dead:.2g})"
        )

    def _restart(self, t: float, nu: Array) -> None:
        """Begin anew with speeds (dof,) at a time (s); what was learnt stays."""
        fresh = math.isnan(self._time)
        self._models = np.tile(nu, (len(self._dead_times), len(self._lags), 1))
        if fresh:
            self._command = nu
            self._errors = np.zeros_like(self._models)
            self._count, self._sum, self._squares = 0.0, np.zeros(len(nu)), np.zeros(len(nu))
        # The way that was commanded, at times between which it is taken for a straight one.
        self._times = t + self._stride * np.arange(1.0 - self._knots, 1.0)
        self._ways = (self._times - t)[:, None] * self._command
        self._way = np.zeros(len(nu))
        self._asked = np.tile(self._command, (len(self._dead_times), 1))
        self._before = -self._dead_times * self._command
        self._known_from = t if fresh else t + self._dead_times.max() + RESUMED
        self._decide = DECIDED
        self._speeds, self._passed = 0.0 * nu, 0.0
        self._nu, self._time, self._sent_at = nu, t, t

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
        # Of the straight pieces, that in which each lies; before all of them the first goes on.
        after = np.clip(np.searchsorted(times, acts), 1, len(times) - 1)
        start, end = times[after - 1], times[after]
        first, last = ways[after - 1, self._each], ways[after, self._each]
        way = first + (acts - start) / (end - start) * (last - first)
        asked = (way - self._before) / width
        self._before = way
        if width != self._width:
            self._width, x = width, width / self._lags
            self._left = np.exp(-x)
            self._new = -np.expm1(-x) if self._held else 1.0 + np.expm1(-x) / x
            self._old = 1.0 - self._left - self._new
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
        # Of each dead time, how far the best lags are from what was measured, all of a group.
        misses = np.where(explained, errors.min(axis=1) / variance, 0.0) @ self._group
        row, every = misses.argmin(axis=0), self._each
        gain = misses[self._row, every] - misses[row, every]
        self._row = np.where(gain > SURE + CLEARLY * misses[row, every], row, self._row)
        found = errors[self._row, :-1, every].T
        lag, least = _lowest(found)
        told, used = errors[self._at, -1], _at(found, self._found)
        sure = np.maximum(told, used) - least > SURE * variance + CLEARLY * least
        far = np.abs(lag - self._told) > TOLERANCE[0] + TOLERANCE[1] * self._told
        far |= self._row != self._at
        self._found = np.where(explained & sure, np.where(far, lag, self._told), self._found)
        self.learnt = np.where(explained & sure, far, self.learnt)
        if self.learnt.any() or not self._settled:
            self._settled = False
            row = np.where(self.learnt @ self._group, self._row, self._at)
            self._found_dead = self._dead_times[row, every]


def _lowest(errors: Array) -> tuple[Array, Array]:
    """Return the lags (n,) with the least errors, s, by parabolas through three; and the least.

    Args:
        errors: Of the models' lags (len(LAGS), n).
    """
    every, best = np.arange(errors.shape[1]), errors.argmin(axis=0)
    k = np.clip(best, 1, len(LAGS) - 2)
    x0, x1, x2 = LAGS[k - 1], LAGS[k], LAGS[k + 1]
    y0, y1, y2 = errors[k - 1, every], errors[k, every], errors[k + 1, every]
    left, right = (y1 - y0) / (x1 - x0), (y2 - y1) / (x2 - x1)
    bend = (right - left) / (x2 - x0)
    bent = bend > 0.0
    lag = 0.5 * (x0 + x1) - 0.5 * left / np.where(bent, bend, 1.0)
    return np.where(bent, np.clip(lag, x0, x2), LAGS[best]), errors[best, every]


def _at(errors: Array, lag: Array) -> Array:
    """Return the errors (n,) at lags (n,), s, between those of the models (len(LAGS), n)."""
    k = np.clip(np.searchsorted(LAGS, lag) - 1, 0, len(LAGS) - 2)
    share = np.clip((lag - LAGS[k]) / (LAGS[k + 1] - LAGS[k]), 0.0, 1.0)
    every = np.arange(len(lag))
    return np.asarray((1.0 - share) * errors[k, every] + share * errors[k + 1, every])
