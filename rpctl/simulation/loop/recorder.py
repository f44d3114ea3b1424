"""Takes the samples of a closed loop and keeps of them what a log needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.control.law import Limit
from rpctl.reference.motion import ReferenceState, reference_rates, steering
from rpctl.simulation.run.derived import TURN, Derivation, left, reference_configurations
from rpctl.simulation.run.facts import reference_wheels
from rpctl.simulation.run.log import Log
from rpctl.simulation.run.part import PartWriter

BATCH = 256  # samples that wait at most until they are kept
NOTHING = np.empty(0)
NOTHING_FELT: Mapping[str, Array] = MappingProxyType({})
FELT = ("root_pose", "ground_load", "wheel_slip")  # what only some plants know
NO_DIRECTION = np.full(9, np.nan)  # of a reference that gives none


class LoopSample(NamedTuple):
    """A sample of a closed loop.

    Attributes:
        t: Time, s.
        q: Configuration (nq,).
        e: Tracking error (3 + n_joints,).
        tau: Actuator efforts (n_act,) from now on, N·m or N.
        state: The reference.
        nu: Quasi-velocities (dof,).
        nu_d: Those that the kinematic law asks for (dof,).
        nu_cmd: Those that are sent (dof,); (0,) where efforts are.
        work: Of the actuators so far, J.
        lost: What damping and friction have taken so far, J.
        limits: The limits that bind the efforts.
        felt: What only the plant knows, by the names of the log's arrays; the same ones and the
            same shapes in every sample.
    """

    t: float
    q: Array
    e: Array
    tau: Array
    state: ReferenceState
    nu: Array = NOTHING
    nu_d: Array = NOTHING
    nu_cmd: Array = NOTHING
    work: float = 0.0
    lost: float = 0.0
    limits: tuple[Limit, ...] = ()
    felt: Mapping[str, Array] = NOTHING_FELT


class Samples(NamedTuple):
    """K samples, a row each; those from ``pose`` on are of the reference's state.

    Its nine numbers of direction are NaN where it gives none. Joint accelerations are not kept.
    """

    t: Array  # (K,)
    work: Array  # (K,)
    lost: Array  # (K,)
    limits: Array  # (K,) number of the set of limits that bind
    q: Array
    nu: Array
    tau: Array
    nu_d: Array
    nu_cmd: Array  # (K, 0) where efforts are sent
    pose: Array
    twist: Array
    twist_dot: Array
    joints: Array
    joint_rates: Array
    direction: Array
    felt: Mapping[str, Array] = NOTHING_FELT

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All of them that are not what only the plant knows."""
        return tuple(getattr(self, name) for name in self._fields[:-1])

    def rows(self, chosen: slice | NDArray[np.intp]) -> Samples:
        """Return some of them."""
        felt = {name: each[chosen] for name, each in self.felt.items()}
        rest = self._fields[:-1]
        return Samples(**{name: getattr(self, name)[chosen] for name in rest}, felt=felt)

    def first_not_finite(self) -> int | None:
        """Return the number of the first that holds numbers that are not finite."""
        given = [*self.arrays[:-1], *self.felt.values()]
        flat = (each.reshape(len(self.t), -1) for each in given)
        bad = np.flatnonzero(~np.isfinite(np.hstack(list(flat))).all(axis=1))
        return int(bad[0]) if len(bad) else None

    def state(self, k: int | slice = slice(None)) -> ReferenceState:
        """Return the reference's state at a sample, or at some of them, a row each.

        Of several samples the direction is left out.
        """
        direction = self.direction[k].reshape(-1, 3, 3)[0] if isinstance(k, int) else NO_DIRECTION
        return ReferenceState(
            self.pose[k],
            self.twist[k],
            self.twist_dot[k],
            self.joints[k],
            self.joint_rates[k],
            np.zeros_like(self.joints[k]),
            None if np.isnan(direction.flat[0]) else direction,
        )


def _stacked(waiting: Sequence[LoopSample], numbers: Mapping[tuple[Limit, ...], int]) -> Samples:
    """Return samples as arrays."""
    states = [sample.state for sample in waiting]
    directions = [NO_DIRECTION if s.direction is None else np.ravel(s.direction) for s in states]
    own = ("t", "work", "lost", "q", "nu", "tau", "nu_d", "nu_cmd")
    of_state = ("pose", "twist", "twist_dot", "joints", "joint_rates")
    return Samples(
        **{name: np.array([getattr(sample, name) for sample in waiting]) for name in own},
        **{name: np.array([getattr(state, name) for state in states]) for name in of_state},
        limits=np.array([numbers[sample.limits] for sample in waiting]),
        direction=np.array(directions),
        felt={name: np.array([s.felt[name] for s in waiting]) for name in waiting[0].felt},
    )


@dataclass(frozen=True, eq=False)
class _Carry:
    """What a batch needs of the sample before it.

    Attributes:
        headings: Of base and reference (2,), as they were measured, rad.
        turns: Full turns that have been added to them (2,).
        t: Time, s.
        rolled: Angles of the reference's wheels and casters (n_turning,), rad.
        rolling: Their rates (n_turning,), rad/s.
    """

    headings: Array
    turns: Array
    t: float
    rolled: Array
    rolling: Array


class _Reference:
    """Follows the reference's speeds, full turns and wheels through all samples of a run."""

    def __init__(self, derivation: Derivation) -> None:
        self._robot, self._dynamics = derivation.robot, derivation.dynamics
        self._steered = len(self._robot.drive.steered)
        self._turning = reference_wheels(self._robot)[self._steered :]
        self._indices = [self._robot.velocity_index(name) for name in self._turning]
        self._carry: _Carry | None = None

    def take(self, samples: Samples) -> dict[str, Array]:
        """Return arrays of the log that follow from consecutive samples, a row each."""
        carry = self._start(samples) if self._carry is None else self._carry
        headings = np.column_stack([self._headings(samples.q), samples.pose[:, 2]])
        jumps = np.diff(headings, axis=0, prepend=carry.headings[None])
        turns = carry.turns + np.cumsum(-np.round(jumps / TURN), axis=0)
        nu, steered = self._speeds(samples)
        wheels, rolling = self._rolled(samples, nu, steered, carry)
        last = float(samples.t[-1])
        self._carry = _Carry(headings[-1], turns[-1], last, wheels[-1, self._steered :], rolling)
        return {
            "nu_ref": nu,
            "base_ref": samples.pose + TURN * turns[:, 1:] * [0.0, 0.0, 1.0],
            "joints_ref": samples.joints,
            "wheels_ref": wheels,
            "turns": turns[:, 0],
        }

    def _headings(self, q: Array) -> Array:
        return np.asarray(np.arctan2(q[:, 3], q[:, 2]) + self._robot.drive.heading)

    def _start(self, samples: Samples) -> _Carry:
        """Return what is before the first sample: wheels at 0, casters where the robot's are."""
        robot = self._robot
        headings = np.array([self._headings(samples.q[:1])[0], samples.pose[0, 2]])
        casters = {swivel.joint for swivel in robot.drive.swivels if swivel.role == "caster"}
        rolled = [
            robot.joint_position(samples.q[0], name) if name in casters else 0.0
            for name in self._turning
        ]
        return _Carry(
            headings,
            np.zeros(2),
            float(samples.t[0]),
            np.array(rolled),
            np.zeros(len(rolled)),
        )

    def _speeds(self, samples: Samples) -> tuple[Array, Array]:
        """Return ν (K, dof) of the reference, and positions (K, n_steered) of steered joints."""
        robot, count = self._robot, len(samples.t)
        if not self._steered:
            return reference_rates(robot, samples.state()).nu, np.empty((count, 0))
        states = [samples.state(k) for k in range(count)]
        return (
            np.array([reference_rates(robot, state).nu for state in states]),
            np.array([steering(robot, state)[0] for state in states]),
        )

    def _rolled(
        self, samples: Samples, nu: Array, steered: Array, carry: _Carry
    ) -> tuple[Array, Array]:
        """Return the reference's wheels (K, n), integrated from ν, and their last rates.

        Args:
            samples: The samples.
            nu: Quasi-velocities of the reference (K, dof).
            steered: Positions of its steered joints (K, n_steered), rad.
            carry: Of the sample before.
        """
        steps = np.diff(samples.t, prepend=carry.t)
        if self._dynamics.constant:
            rates = nu @ self._dynamics.basis(samples.q[0])[self._indices].T
            before = np.vstack([carry.rolling, rates[:-1]])
            rolled = np.cumsum(np.vstack([carry.rolled, steps[:, None] * before]), axis=0)[1:]
            return np.hstack([steered, rolled]), rates[-1]
        standing = np.hstack([steered, np.zeros((len(nu), len(self._turning)))])
        q = reference_configurations(self._robot, samples.pose, samples.joints, standing)
        entries = [self._robot.entries[name] for name in self._turning]
        angles, rate = carry.rolled, carry.rolling
        for row, wheels, now, step in zip(q, standing, nu, steps, strict=True):
            angles = angles + step * rate
            for entry, angle in zip(entries, angles.tolist(), strict=True):
                entry.write(row, angle)
            rate = (self._dynamics.basis(row) @ now)[self._indices]
            wheels[self._steered :] = angles
        return standing, rate


class Recorder:
    """Collects the samples of one run.

    Args:
        derivation: Computes the rest of the log.
        steps: Number of control periods that are simulated; there is one sample more.
        every: Each ``every``-th sample is logged, and the last.
        part: Gets what is logged, on disk; None: nothing does.
        known: Returns what is known of the run besides its samples, for the part.
    """

    def __init__(
        self,
        derivation: Derivation,
        steps: int,
        every: int = 1,
        part: PartWriter | None = None,
        known: Callable[[], Mapping[str, Any]] = dict,
    ) -> None:
        self._derivation, self._every, self._part, self._known = derivation, every, part, known
        self._reference = _Reference(derivation)
        self._total, self._room = steps + 1, -(-steps // every) + 1
        self._waiting: list[LoopSample] = []
        self._taken = self.rows = 0  # samples that were looked at, and logged
        self._columns: dict[str, Array] = {}
        self._sets: dict[tuple[Limit, ...], int] = {}  # of limits that bound, numbered
        self._bound: dict[Limit, None] = {}  # in the order in which they first bound

    @property
    def steps(self) -> int:
        """How many control periods the log covers."""
        return self._taken - 1

    def add(self, sample: LoopSample) -> None:
        """Add a sample.

        Raises:
            RpctlError: A sample is nothing that a log can hold; those before it are logged.
        """
        self._sets.setdefault(sample.limits, len(self._sets))
        self._waiting.append(sample)
        if len(self._waiting) >= BATCH or (self._part is not None and self._part.is_late()):
            self.flush()

    def add_batch(self, samples: Samples, sets: Sequence[tuple[Limit, ...]]) -> None:
        """Add samples that follow one another, as if they were added one by one.

        Args:
            samples: The samples; their ``limits`` are indices of ``sets``.
            sets: Limits that bind the efforts together.

        Raises:
            RpctlError: A sample is nothing that a log can hold; those before it are logged.
        """
        if not len(samples.t):
            return
        self.flush()
        numbers = np.array([self._sets.setdefault(each, len(self._sets)) for each in sets])
        self._take(samples._replace(limits=numbers[samples.limits.astype(int)]))

    def flush(self, ends: bool = False) -> None:
        """Log the samples that wait.

        Args:
            ends: Whether the last of them is logged in any case, for none will follow.

        Raises:
            RpctlError: One of them is nothing that a log can hold; those before it are logged.
        """
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._take(_stacked(waiting, self._sets), ends)
        elif ends:
            self._write(ends)

    def _take(self, samples: Samples, ends: bool = False) -> None:
        bad = samples.first_not_finite()
        if bad != 0:
            self._log(samples.rows(slice(bad)), ends or bad is not None)
        self._write(ends or bad is not None)
        if bad is not None:
            raise left(float(samples.t[bad]))

    def _log(self, samples: Samples, ends: bool) -> None:
        """Keep those samples whose turn it is."""
        count = len(samples.t)
        chosen = np.arange(-self._taken % self._every, count, self._every)
        self._taken += count
        if (ends or self._taken == self._total) and (not len(chosen) or chosen[-1] != count - 1):
            chosen = np.append(chosen, count - 1)
        reference = self._reference.take(samples)
        kept = samples.rows(chosen)
        names = ("t", "q", "nu", "tau", "nu_d", "nu_cmd", "work", "lost", "limits")
        columns = {name: getattr(kept, name) for name in names}
        columns |= {name: each[chosen] for name, each in reference.items()}
        nothing = np.empty((len(chosen), 0))
        columns |= dict.fromkeys(FELT, nothing) | dict(kept.felt)
        rows = slice(self.rows, self.rows + len(chosen))
        for name, values in columns.items():
            if name not in self._columns:
                self._columns[name] = np.empty((self._room, *values.shape[1:]))
            self._columns[name][rows] = values
        self.rows = rows.stop
        sets = list(self._sets)
        for number in dict.fromkeys(kept.limits.astype(int).tolist()):
            self._bound |= dict.fromkeys(sets[number])

    def _write(self, ends: bool) -> None:
        if self._part is not None:
            self._part.take(self.rows, self._content, ends)

    def _content(self, rows: slice) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return what is kept of some rows, and what else is known of the run by now."""
        columns = {name: each[rows] for name, each in self._columns.items()}
        columns["active_limits"] = self._active_limits(columns.pop("limits"))
        return columns, {**self._known(), "bound_limits": self._bound_limits()}

    def log(self) -> Log:
        """Return the log of the samples that were added, one at least."""
        columns, _ = self._content(slice(self.rows))
        return Log(columns, self._bound_limits(), self._derivation)

    def _bound_limits(self) -> tuple[tuple[str, str], ...]:
        return tuple((limit.joint, limit.kind) for limit in self._bound)

    def _active_limits(self, numbers: Array) -> Array:
        """Return which limits bound (K, n_bound), 1 or 0, by the numbers (K,) of their sets."""
        rows = [[float(limit in limits) for limit in self._bound] for limits in self._sets]
        return np.array(rows).reshape(len(rows), len(self._bound))[numbers.astype(int)]
