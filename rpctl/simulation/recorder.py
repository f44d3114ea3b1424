"""Records a closed loop: samples are copied, the rest of the log follows batch by batch."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.law import Command, Limit
from rpctl.errors import DivergedError, RpctlError
from rpctl.reference.motion import ReferenceState
from rpctl.simulation.columns import release, scratch
from rpctl.simulation.derived import Carry, Derivation
from rpctl.simulation.log import DeferredLog, Log
from rpctl.simulation.samples import SampleBuffer, Samples
from rpctl.simulation.spool import Spool

BATCH = 256  # samples that are derived at once: a tenth of a second's work at most
RELEASED_ROWS = 4096  # of a column in a file, that stay in memory until they are let go
NO_SPEEDS = np.empty(0)
NOTHING_FELT: Mapping[str, Array] = MappingProxyType({})
FELT = ("root_pose", "ground_load", "wheel_slip")  # columns that only some plants know
NOT_FINITE = ("load_range", "slip_range")  # columns in which NaN and inf have a meaning


class _Done(NamedTuple):
    """How far the log is; replaced at once, so that what ends the run leaves whole batches."""

    samples: int = 0  # derived
    rows: int = 0  # logged
    carry: Carry | None = None
    bound: tuple[Limit, ...] = ()  # limits, in the order in which they first bound


class Recorder:
    """Collects the samples of one run.

    Args:
        derivation: Computes the rest of the log.
        steps: Number of control periods that are simulated; there is one sample more.
        every: Each ``every``-th sample is logged, and the last.
        spool: Gets what is logged, on disk; None: nothing does.
        known: Returns what is known of the run besides its samples, for the spool.
        speeds: Whether the controller sends speeds, not efforts.
    """

    def __init__(
        self,
        derivation: Derivation,
        steps: int,
        every: int = 1,
        spool: Spool | None = None,
        known: Callable[[], Mapping[str, Any]] = dict,
        speeds: bool = False,
    ) -> None:
        self._derivation, self._every = derivation, every
        self._deferred = False
        self._steps, self._spool, self._known = steps, spool, known
        self._felt: dict[str, tuple[int, ...]] = {}  # shapes of what only the plant knows
        self._speeds, self._buffer = speeds, self._make_buffer(speeds)
        self._count, self._done = 0, _Done()
        self._batch: Samples | None = None  # that was handed over whole, and waits
        self._columns: dict[str, Array] = {}
        self._sets: dict[tuple[Limit, ...], int] = {}  # of limits that bound, numbered

    @property
    def rows(self) -> int:
        """How many samples have been logged."""
        return self._done.rows

    @property
    def steps(self) -> int:
        """How many control periods the log covers."""
        return self._done.samples - 1

    def defer(self) -> None:
        """Compute the columns that follow from the states alone when one of them is read.

        With a spool, which writes them, and with samples behind it, it changes nothing.
        """
        self._deferred = self._spool is None and not self._count

    def add(
        self,
        t: float,
        q: Array,
        nu: Array,
        tau: Array,
        e: Array,
        state: ReferenceState,
        command: Command,
        work: float,
        limits: tuple[Limit, ...],
        lost: float = 0.0,
        speeds: Array = NO_SPEEDS,
        felt: Mapping[str, Array] = NOTHING_FELT,
    ) -> None:
        """Add a sample.

        Args:
            t: Time, s.
            q: Configuration (nq,).
            nu: Quasi-velocities (dof,).
            tau: Actuator efforts (n_act,) from now on, N·m or N.
            e: Tracking error (3 + n_joints,).
            state: The reference.
            command: What the kinematic law asks for.
            work: Work of the actuators so far, J.
            limits: The limits that bind the efforts.
            lost: What damping and friction have taken so far, J.
            speeds: Quasi-velocities (dof,) that are sent; (0,) where efforts are.
            felt: What only the plant knows, by the names of the log's columns; the same ones and
                the same shapes in every sample.

        Raises:
            RpctlError: A sample of the last batch is nothing that a log can hold.
        """
        if felt and not self._count:
            self._felt = {name: array.shape for name, array in felt.items()}
            self._buffer = self._make_buffer(self._speeds)
        number = self._sets.setdefault(limits, len(self._sets))
        place = self._count - self._done.samples
        arrays = (q, nu, tau, command.nu_d, speeds, e)
        self._buffer.put(place, (t, work, lost, number), arrays, state, tuple(felt.values()))
        self._count += 1
        late = self._spool is not None and self._spool.is_late()
        if late or place + 1 == len(self._buffer):
            self.derive()

    def add_batch(self, samples: Samples, sets: Sequence[tuple[Limit, ...]]) -> None:
        """Add samples that follow one another, as if they were added one by one.

        They are derived at once: some hundred at a time take least. They are not copied before
        that, and not needed after it.

        Args:
            samples: The samples; their ``limits`` are indices of ``sets``.
            sets: Limits that bind the efforts together.

        Raises:
            RpctlError: A sample is nothing that a log can hold.
        """
        if not len(samples.t):
            return
        self.derive()
        numbers = [float(self._sets.setdefault(each, len(self._sets))) for each in sets]
        limits = np.array(numbers)[samples.limits.astype(int)]
        self._batch = samples._replace(limits=limits)
        self._count += len(samples.t)
        self.derive()

    def _make_buffer(self, speeds: bool) -> SampleBuffer:
        """Return room for the samples that wait."""
        rows = min(BATCH, self._steps + 1)
        felt = sum(map(math.prod, self._felt.values()))
        return SampleBuffer(self._derivation.robot, rows, speeds, felt)

    def _felt_columns(self, rows: Array) -> dict[str, Array]:
        """Return what only the plant knows (K, w) by name; (K, 0) where it does not."""
        columns = {name: np.empty((len(rows), 0)) for name in FELT}
        ends = np.cumsum([math.prod(shape) for shape in self._felt.values()])
        parts = np.split(rows, ends[:-1], axis=1)
        for part, (name, shape) in zip(parts, self._felt.items(), strict=False):
            columns[name] = part.reshape(len(rows), *shape)
        return columns

    def _waiting(self) -> Samples:
        """Return the samples that wait to be derived."""
        count = self._count - self._done.samples
        if self._batch is None:
            return self._buffer.first(count)
        return self._batch.rows(slice(len(self._batch.t) - count, None))

    def derive(self, ends: bool = False) -> None:
        """Derive and log the samples that wait for it.

        Args:
            ends: Whether the last of them is logged in any case, for none will follow.

        Raises:
            RpctlError: One of them is nothing that a log can hold; those before it are logged.
        """
        samples = self._waiting()
        try:
            if len(samples.t):
                self._log(samples, ends)
            self._batch = None
        except RpctlError:
            count = self._sound(samples)
            if count:
                self._log(samples.rows(slice(count)), ends=True)
            self._count, self._batch = self._done.samples, None  # what follows is no motion
            raise
        finally:
            if self._spool is not None:
                self._spool.take(self._done.rows, self._content, ends)

    def _sound(self, samples: Samples) -> int:
        """Return how many samples, up to the first of which no log can be made, can be logged."""
        sound, unsound = 0, len(samples.t)
        while unsound - sound > 1:
            middle = (sound + unsound) // 2
            try:
                self._derived(samples.rows(slice(middle)), ends=True)
                sound = middle
            except RpctlError:
                unsound = middle
        return sound

    def _derived(self, samples: Samples, ends: bool) -> tuple[dict[str, Array], Carry]:
        """Return the columns of samples that follow those that are logged."""
        offset, count = -self._done.samples % self._every, len(samples.t)
        chosen = np.arange(offset, count, self._every)
        last = self._done.samples + count > self._steps or ends
        if last and (not len(chosen) or chosen[-1] != count - 1):
            chosen = np.append(chosen, count - 1)
        bad = np.flatnonzero(~samples.is_finite())
        if not len(bad):
            with np.errstate(all="ignore"):  # what is not finite is refused below
                columns, carry = self._derivation.columns(samples, chosen, self._done.carry)
                if len(chosen) and not self._deferred:
                    columns |= self._derivation.motion.of(columns)
            if columns:
                columns |= self._felt_columns(samples.felt[chosen])
            _require_finite(columns)
            columns["limits"] = samples.limits[chosen]
        if len(bad):
            raise _left(samples.t[bad[0]])
        return columns, carry

    def _log(self, samples: Samples, ends: bool) -> None:
        """Write the columns of samples behind those that are logged."""
        columns, carry = self._derived(samples, ends)
        first = self._done.rows
        rows = first + len(columns["limits"])
        for name, values in columns.items():
            self._column(name, values.shape[1:])[first:rows] = values
        if first // RELEASED_ROWS != rows // RELEASED_ROWS:
            for column in self._columns.values():
                release(column, 0, rows)
        sets = list(self._sets)
        numbers = dict.fromkeys(columns["limits"].astype(int).tolist())
        bound = dict.fromkeys((*self._done.bound, *(x for n in numbers for x in sets[n])))
        self._done = _Done(self._done.samples + len(samples.t), rows, carry, tuple(bound))

    def _column(self, name: str, shape: tuple[int, ...]) -> Array:
        """Return a column of the log, with room for the whole run."""
        if name not in self._columns:
            whole = -(-self._steps // self._every) + 1
            self._columns[name] = scratch((whole, *shape))
        return self._columns[name]

    def _content(self, rows: slice) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return some rows of the log and what else is known, as the spool wants it."""
        columns = {name: column[rows] for name, column in self._columns.items()}
        columns["active_limits"] = self._active_limits(columns.pop("limits"))
        return columns, {**self._known(), "bound_limits": self._done.bound}

    def log(self) -> Log:
        """Return the log of the samples that have been derived, one at least."""
        rows = self._done.rows
        columns = {name: column[:rows] for name, column in self._columns.items()}
        columns["active_limits"] = self._active_limits(columns.pop("limits"))
        for column in columns.values():
            column.setflags(write=False)
        bound = tuple((limit.joint, limit.kind) for limit in self._done.bound)
        if self._deferred:
            return DeferredLog(lambda: self._motion(rows), **columns, bound_limits=bound)
        return Log(**columns, bound_limits=bound)

    def _motion(self, rows: int) -> dict[str, Array]:
        """Return the columns of the first rows that follow from the states alone.

        Raises:
            RpctlError: The motion left the finite numbers, or fixes no one motion.
        """
        of, found = self._derivation.motion.of, dict[str, Array]()
        for first in range(0, rows, RELEASED_ROWS):
            chosen = slice(first, min(first + RELEASED_ROWS, rows))
            known = {name: column[chosen] for name, column in self._columns.items()}
            with np.errstate(all="ignore"):
                columns = of(known)
            _require_finite({"t": known["t"], **columns})
            for name, values in columns.items():
                if name not in found:
                    found[name] = scratch((rows, *values.shape[1:]))
                found[name][chosen] = values
                release(found[name], first, chosen.stop)
        for column in found.values():
            column.setflags(write=False)
        return found

    def _active_limits(self, numbers: Array) -> Array:
        """Return which limits bound (K, n_bound), 1 or 0, by the numbers (K,) of their sets."""
        bound = self._done.bound
        table = np.array([[float(limit in limits) for limit in bound] for limits in self._sets])
        active = scratch((len(numbers), len(bound)))
        for first in range(0, len(numbers), RELEASED_ROWS):
            rows = slice(first, first + RELEASED_ROWS)
            active[rows] = table[numbers[rows].astype(int)]
            release(active, first, first + RELEASED_ROWS)
        return active


def _require_finite(columns: Mapping[str, Array]) -> None:
    """Refuse columns, the time among them, of which a row holds numbers that are not finite."""
    finite = [_is_finite(column) for name, column in columns.items() if name not in NOT_FINITE]
    bad = np.flatnonzero(~np.all(finite, axis=0)).tolist() if finite else []
    if bad:
        raise _left(float(columns["t"][bad[0]]))


def _left(t: float) -> DivergedError:
    """Return the error of a motion that left the finite numbers at a time, s."""
    return DivergedError(
        f"the motion left the finite numbers at t = {t:g} s; shorten the control period or "
        "lengthen the horizons"
    )


def _is_finite(column: Array) -> NDArray[np.bool_]:
    """Return whether each row (K,) of a column holds finite numbers."""
    return np.asarray(np.isfinite(column.reshape(len(column), -1)).all(axis=1))
