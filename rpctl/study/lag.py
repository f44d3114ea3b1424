"""Lag and dead time of a robot's actuators, identified from commanded and measured speeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rpctl.arrays import Array, read_only
from rpctl.control.output_groups import MAX_LAG
from rpctl.control.velocity_output import VelocityOutput
from rpctl.errors import RpctlError, fault_at, require_known, require_positive
from rpctl.reference.recorded.table_file import (
    read_rows,
    read_values,
    refusal,
    separator_fault,
)
from rpctl.simulation.run.run import Run

MAX_DEAD_TIME = 1.0  # s, if not asked for another
MAX_SAMPLES = 5_000  # that are fitted: of a longer log those in which the commands change most
DEAD_TIMES, STARTS = 25, 3  # that are tried with each lag, and of all pairs those that are refined
LAGS = (0.0, 0.01, 0.02, 0.04, 0.08, 0.15, 0.3, 0.6, 1.2)  # s, that are tried
NO_CHANGE = 1e-6  # m/s or rad/s: a command that changes by less does not excite
WORST_RESIDUAL = 0.3  # of the rms of the change: a motion that follows so badly has another model
# F statistic of a fit with one parameter less: the gain of the second is beyond chance. Errors that
# follow one another, as a model's do, count as a few independent ones; so it is a strict one.
SURE = 50.0

MIN_SAMPLES = 10
MAX_STEP_S = 0.5  # s between samples: motors follow within tenths of a second
MIN_SPAN_S = 0.1  # s: nothing moves within less
# What a commanded column's name holds, and what the measured one holds in its place.
PAIRS = (("commanded", "measured"), ("nu_cmd_", "nu_"))
EXAMPLE = "t,commanded,measured, or t,v_commanded,v_measured,omega_commanded,omega_measured"


@dataclass(frozen=True)
class SpeedLog:
    """Commanded and measured speeds of n channels at K times.

    Attributes:
        t: Times (K,), increasing, s.
        commanded: Commanded speeds (K, n), m/s or rad/s, each held until the next; a single channel
            may have the shape (K,).
        measured: Measured speeds, of the same shape and unit.
        names: Names of the channels; empty: their numbers.

    Raises:
        RpctlError: The shapes do not agree, numbers are not finite, times do not increase, or the
            log is too short or too coarse.
    """

    t: Array
    commanded: Array
    measured: Array
    names: tuple[str, ...] = field(default=(), kw_only=True)

    def __post_init__(self) -> None:
        """Copy the arrays, read-only; refuse an unusable log."""
        given = self.t, self.commanded, self.measured
        t, commanded, measured = (np.array(each, dtype=float) for each in given)
        if commanded.ndim == 1:
            commanded, measured = commanded[:, None], measured.reshape(len(measured), -1)
        if t.ndim != 1 or commanded.ndim != 2 or not len(t) == len(commanded) == len(measured):
            raise RpctlError("give as many commanded and measured speeds as times")
        count, finite = commanded.shape[1], [np.isfinite(x).all() for x in (t, commanded, measured)]
        names = tuple(self.names) or tuple(f"channel {k + 1}" for k in range(count))
        faults = {
            f"{count} channels are commanded and {measured.shape[1]} measured; give the same": (
                commanded.shape != measured.shape
            ),
            f"{len(t)} samples; give {MIN_SAMPLES} or more": len(t) < MIN_SAMPLES,
            "the log has numbers that are not finite; leave out those rows": not all(finite),
            "the log's times do not increase; sort it, and leave out duplicates": not (
                np.diff(t) > 0.0
            ).all(),
            f"{len(names)} names for {count} channels; give the same": len(names) != count,
        }
        for fault in (fault for fault, there in faults.items() if there):
            raise RpctlError(fault)
        step, span = float(np.median(np.diff(t))), float(t[-1] - t[0])
        if not step <= MAX_STEP_S:
            raise RpctlError(f"a sample every {step:.3g} s is too coarse to identify a lag; log "
                             f"one every {MAX_STEP_S:g} s or less, and give t in s")  # fmt: skip
        if span < MIN_SPAN_S:
            raise RpctlError(f"the log lasts {span:.3g} s; give {MIN_SPAN_S:g} s or more, t in s")
        for name, value in (("t", t), ("commanded", commanded), ("measured", measured)):
            object.__setattr__(self, name, read_only(value))
        object.__setattr__(self, "names", names)


def read_speed_log(path: str | Path) -> SpeedLog:
    """Read a log in CSV: a header that names ``t`` and pairs of columns, and a row a sample.

    A pair is ``NAME_commanded`` and ``NAME_measured``, or just ``commanded`` and ``measured``, or
    the ``nu_cmd_NAME`` and ``nu_NAME`` of :meth:`Run.to_csv`. Other columns are not read.

    Raises:
        DescriptionError: The file is missing or has faults; they are named with their lines.
        RpctlError: It holds too few samples, or times that do not increase.
    """
    rows = read_rows(path)
    header = next(rows, None)
    if header is None:
        raise fault_at(path, None, f"empty; give a header such as {EXAMPLE}, and rows")
    (line, names), fault = header, ""
    channels = _channels(names)
    if "t" not in names:
        fault = separator_fault(names) or f"no column t; name the columns as {EXAMPLE}"
    elif not channels:
        fault = f"no commanded speed has a measured one beside it; name the columns as {EXAMPLE}"
    if fault:
        raise fault_at(path, line, fault)
    wanted = ["t", *(name for pair in channels.values() for name in pair)]
    table, _, faults = read_values(rows, names, wanted)
    if faults:
        raise refusal(path, faults)
    return SpeedLog(table[:, 0], table[:, 1::2], table[:, 2::2], names=tuple(channels))


def _channels(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return the names of the columns of commanded and measured speeds by the channel's name."""
    found = {}
    for commanded, measured in PAIRS:
        for name in names:
            other = name.replace(commanded, measured, 1)
            if commanded in name and other in names:
                label = name.replace(commanded, "", 1).strip("_ .") or "speed"
                found[label] = name, other
    return found


@dataclass(frozen=True)
class ChannelLag:
    """Lag and dead time of one channel.

    Attributes:
        name: Of the quasi-velocity, or the column.
        lag: T, s.
        dead_time: T_d, s.
        residual: Rms of what the model leaves of the measured speed, m/s or rad/s.
    """

    name: str
    lag: float
    dead_time: float
    residual: float


@dataclass(frozen=True)
class ActuatorLag:
    """Lag and dead time of a robot's actuators: T ν̇(t) = c(t − T_d) − ν(t).

    Attributes:
        lag: T that fits all channels best, s.
        dead_time: T_d that fits all channels best, s.
        residual: Root mean square residual of this model, relative to that of each channel's
            change.
        channels: The fit of each channel.
        left_out: By name, why other channels were not used.
    """

    lag: float
    dead_time: float
    residual: float
    channels: tuple[ChannelLag, ...]
    left_out: dict[str, str]

    def channel(self, name: str) -> ChannelLag:
        """Return a channel by its name.

        Raises:
            UnknownNameError: There is none such.
        """
        channels = {channel.name: channel for channel in self.channels}
        require_known("channel", [name], channels)
        return channels[name]

    def output(self) -> VelocityOutput:
        """Return the output that compensates this lag and dead time."""
        return VelocityOutput(lag=self.lag, dead_time=self.dead_time)

    def to_dict(self) -> dict[str, Any]:
        """Return it as JSON says it."""
        return asdict(self)


def lag_from(
    log: Run | SpeedLog | str | Path, *, max_dead_time: float = MAX_DEAD_TIME
) -> ActuatorLag:
    """Identify lag and dead time from a log of commanded and measured speeds.

    The motion must be exciting: a step, or any motion whose commands change faster than the lag.
    The response of the model T ν̇(t) = c(t − T_d) − ν(t) to held commands is computed exactly;
    least squares fit T and T_d to the measurement, starting from the best of a grid of dead times.

    Args:
        log: A run with speeds as output, a :class:`SpeedLog`, or the file of either: ``run.npz``,
            or CSV as in :func:`~rpctl.study.lag.read_speed_log`.
        max_dead_time: The longest dead time to consider, s.

    Returns:
        Lag and dead time (s), for all channels together and for each.

    Raises:
        RpctlError: No channel is excited and follows its command like the model; the message gives
            the reason for each.
        DescriptionError: The file cannot be read.
    """
    require_positive("max_dead_time", max_dead_time)
    if isinstance(log, str | Path):
        log = read_speed_log(log) if str(log).lower().endswith(".csv") else Run.load(log)
    if isinstance(log, Run):
        if not log.log.nu_cmd.shape[1]:
            raise RpctlError("the run has no commanded speeds, as its output was efforts; track "
                             "with --output velocity")  # fmt: skip
        log = SpeedLog(log.t, log.log.nu_cmd, log.nu, names=log.robot.quasi_velocities)
    longest = min(max_dead_time, 0.5 * float(log.t[-1] - log.t[0]))
    found = [_identify(log, index, longest) for index in range(len(log.names))]
    fits = {k: each for k, each in enumerate(found) if isinstance(each, _Fit)}
    left_out = {log.names[k]: each for k, each in enumerate(found) if isinstance(each, str)}
    if not fits:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise RpctlError(f"no lag can be identified: {reasons}")
    channels = tuple(
        ChannelLag(log.names[k], each.lag, each.dead_time, each.residual * _size(log, k))
        for k, each in fits.items()
    )
    common = _Model(log, [*fits], longest).fit()
    return ActuatorLag(common.lag, common.dead_time, common.residual, channels, left_out)


class _Fit(NamedTuple):
    lag: float  # s
    dead_time: float  # s
    cost: float  # sum of squares, relative to the channels' rms changes
    squares: int  # their number

    @property
    def residual(self) -> float:
        """Rms, relative to the channels' rms changes."""
        return float(np.sqrt(self.cost / self.squares))


class _Model:
    """Channels of a log, and how far a lag and a dead time leave them from what was measured.

    Args:
        log: The log.
        channels: Their indices.
        longest: The longest dead time to look for, s.
    """

    def __init__(self, log: SpeedLog, channels: Sequence[int], longest: float) -> None:
        rows, columns = _window(log), list(channels)
        self._t, self._command = log.t[rows], log.commanded[rows][:, columns]
        self._measured = log.measured[rows][:, columns]
        self._size = np.array([_size(log, index) for index in columns])
        self._longest = longest

    def residuals(self, x: Array) -> Array:
        """Return what lag and dead time x (2,) leave, relative to the channels' rms changes."""
        found = response(self._t, self._command, self._measured[0], *x)
        return np.ravel((found - self._measured) / self._size)

    def fit(self, only: str = "") -> _Fit:
        """Return the least-squares fit, from the best pairs of a grid on.

        Args:
            only: ``"lag"`` or ``"dead_time"``: the other one is 0.
        """
        dead_times = np.linspace(0.0, self._longest, DEAD_TIMES)
        pairs = [
            np.array([lag, dead])
            for lag in ((0.0,) if only == "dead_time" else LAGS)
            for dead in ((0.0,) if only == "lag" else dead_times)
        ]
        pairs.sort(key=lambda x: float(np.square(self.residuals(x)).sum()))
        free = np.array([only in ("", "lag"), only in ("", "dead_time")])
        fits = [self._refined(x, free) for x in pairs[:STARTS]]
        best = min(fits, key=lambda fit: fit.cost)
        if only:
            return best
        # The cost has kinks, where a change of the command comes to pass a sample: its neighbours.
        step = float(np.median(np.diff(self._t)))
        for change in (-2.0 * step, -step, step, 2.0 * step):
            start = np.maximum([best.lag - change, best.dead_time + change], 0.0)
            fits.append(self._refined(start, free))
        return min(fits, key=lambda fit: fit.cost)

    def _refined(self, start: Array, free: NDArray[np.bool_]) -> _Fit:
        """Return the local fit of the free ones of lag and dead time, beginning at ``start``."""
        upper = np.array([MAX_LAG, self._longest])
        x = start.copy()

        def residuals(part: Array) -> Array:
            x[free] = part
            return self.residuals(x)

        inside = np.clip(start, 1e-3 * self._longest, 0.999 * upper)[free]
        found = least_squares(
            residuals, inside, bounds=(0.0, upper[free]), x_scale=0.1, diff_step=1e-4,
            xtol=1e-12, ftol=1e-12, gtol=1e-14,
        )  # fmt: skip
        x[free] = found.x
        return _Fit(float(x[0]), float(x[1]), 2.0 * float(found.cost), len(found.fun))


def _identify(log: SpeedLog, channel: int, longest: float) -> _Fit | str:
    """Return the fit of a channel, or why there is none worth having."""
    if np.ptp(log.commanded[:, channel]) < NO_CHANGE:
        return "its command does not change; send a step, such as from rest to half of its speed"
    if np.ptp(log.measured[:, channel]) < NO_CHANGE:
        return "it does not move when commanded"
    model = _Model(log, [channel], longest)
    found = model.fit()
    if found.residual > WORST_RESIDUAL:
        return (
            f"it does not follow its command as a lag of first order does ({found.residual:.0%} "
            "of its motion remains); is this the command of this speed?"
        )
    if found.dead_time > longest * (1.0 - 1e-6):
        return f"its dead time is longer than the {longest:.3g} s that were tried"
    spread = SURE * found.cost / found.squares
    if all(model.fit(only=one).cost < found.cost + spread for one in ("lag", "dead_time")):
        return (
            "its command changes too slowly to tell a lag from a dead time; send a step, such as "
            "from rest to half of its speed"
        )
    return found


def response(t: Array, command: Array, start: Array, lag: float, dead_time: float) -> Array:
    """Return ν (K, n) of T ν̇ = c(t − T_d) − ν at the samples' times; exact.

    Args:
        t: Times (K,), s.
        command: c (K, n), each held until the next.
        start: ν at the first time (n,), and c before it.
        lag: T, s; 0 for none.
        dead_time: T_d, s.
    """
    changes = t + dead_time
    times = np.union1d(t, changes[(changes > t[0]) & (changes < t[-1])])
    middles = 0.5 * (times[1:] + times[:-1]) - dead_time
    acting = np.searchsorted(t, middles, side="right")[:, None]
    held = np.where(acting, command[np.maximum(acting[:, 0] - 1, 0)], start)
    left = np.exp(-np.diff(times) / max(lag, 1e-9))[:, None]
    return _scan(left, (1.0 - left) * held, start)[np.searchsorted(times, t)]


def _scan(factors: Array, terms: Array, start: Array) -> Array:
    """Return x (K + 1, n) of x_{k+1} = a_k x_k + b_k from a start, by doubling the stretch.

    Args:
        factors: a (K, 1).
        terms: b (K, n).
        start: x_0 (n,).
    """
    a = np.vstack([[[1.0]], factors])
    b = np.vstack([start, terms])
    stretch = 1
    while stretch < len(b):
        b[stretch:] = b[stretch:] + a[stretch:] * b[:-stretch]
        a[stretch:] = a[stretch:] * a[:-stretch]
        stretch *= 2
    return b


def _size(log: SpeedLog, channel: int) -> float:
    """Return the rms of a channel's motion about its mean."""
    return max(float(log.measured[:, channel].std()), NO_CHANGE)


def _window(log: SpeedLog) -> slice:
    """Return the samples to fit: all, or as many as may be where the commands change most."""
    if len(log.t) <= MAX_SAMPLES:
        return slice(None)
    scale = np.maximum(np.ptp(log.commanded, axis=0), NO_CHANGE)
    change = np.abs(np.diff(log.commanded, axis=0) / scale).sum(axis=1)
    total = np.concatenate([[0.0], np.cumsum(change)])
    first = int(np.argmax(total[MAX_SAMPLES - 1 :] - total[: len(total) - MAX_SAMPLES + 1]))
    return slice(first, first + MAX_SAMPLES)
