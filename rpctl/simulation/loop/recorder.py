"""Takes the samples of a closed loop and keeps of them what a log needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from rpctl import math as casadi  # imported when a function is asked for
from rpctl.arrays import NOTHING, Array
from rpctl.control.law import Limit
from rpctl.dynamics.symbols.basis import SINGULAR
from rpctl.dynamics.symbols.dynamics import SymbolicDynamics
from rpctl.kernels.machine_code import RowFunction
from rpctl.kernels.program import dense_function
from rpctl.reference.motion import (
    ReferenceState,
    ReferenceTable,
    reference_rates,
    steering,
    table_of,
)
from rpctl.reference.sizing import wheel_rates
from rpctl.robot.inspection import robot_identity
from rpctl.robot.model import Robot
from rpctl.simulation.run.derived import TURN, Derivation, left, reference_configurations
from rpctl.simulation.run.facts import reference_wheels
from rpctl.simulation.run.log import Log
from rpctl.simulation.run.part import PartWriter

BATCH = 256  # samples that wait at most until they are kept
NOTHING_FELT: Mapping[str, Array] = MappingProxyType({})
FELT = ("root_pose", "ground_load", "wheel_slip")  # what only some plants know


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
        lost: What damping, friction and stops have taken so far, J.
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
    """K samples, a row each.

    Attributes:
        reference: Their times, and the reference then.
        columns: Columns of the log that plant and controller tell, by name.
        limits: Number of the set of limits that bind (K,).
    """

    reference: ReferenceTable
    columns: Mapping[str, Array]
    limits: Array

    def rows(self, chosen: slice) -> Samples:
        """Return some of them."""
        columns = {name: each[chosen] for name, each in self.columns.items()}
        return Samples(self.reference.at(chosen), columns, self.limits[chosen])

    def first_not_finite(self) -> int | None:
        """Return the number of the first that holds numbers that are not finite."""
        flat = [each.reshape(len(self.limits), -1) for each in self.columns.values()]
        bad = np.flatnonzero(~np.isfinite(np.hstack(flat)).all(axis=1))
        return int(bad[0]) if len(bad) else None


class _Reference:
    """Follows the reference's speeds, full turns and wheels through all samples of a run."""

    def __init__(self, derivation: Derivation, first: Samples) -> None:
        self._robot = robot = derivation.robot
        self._dynamics = derivation.dynamics
        self._steered = len(robot.drive.steered)
        self._turning = reference_wheels(robot)[self._steered :]
        self._indices = [robot.velocity_index(name) for name in self._turning]
        # Of the sample before: its time (s), headings of base and reference (rad) and full turns
        # added to them, angles (rad) and rates of the reference's wheels and casters. Wheels begin
        # at 0, casters where the robot's are.
        q = first.columns["q"][0]
        casters = {swivel.joint for swivel in robot.drive.swivels if swivel.trails}
        self._t = float(first.reference.t[0])
        self._headings, self._turns = self._headings_of(first)[0], np.zeros(2)
        self._angles = np.array(
            [robot.joint_position(q, name) if name in casters else 0.0 for name in self._turning]
        )
        self._rates = np.zeros(len(self._turning))

    def take(self, samples: Samples) -> dict[str, Array]:
        """Return arrays of the log that follow from consecutive samples, a row each."""
        reference, headings = samples.reference, self._headings_of(samples)
        jumps = np.diff(headings, axis=0, prepend=self._headings[None])
        turns = self._turns + np.cumsum(-np.round(jumps / TURN), axis=0)
        nu = reference_rates(self._robot, reference.state).nu
        steered = steering(self._robot, reference.state)[:, 0]
        wheels = np.hstack([steered, self._rolled(reference, nu, steered)])
        self._headings, self._turns, self._t = headings[-1], turns[-1], float(reference.t[-1])
        return {
            "nu_ref": nu,
            "base_ref": reference.state.pose + TURN * turns[:, 1:] * [0.0, 0.0, 1.0],
            "joints_ref": reference.state.joints,
            "wheels_ref": wheels,
            "turns": turns[:, 0],
        }

    def _headings_of(self, samples: Samples) -> Array:
        """Return the headings (K, 2) of the base and of its reference, rad."""
        base = self._robot.base_poses(samples.columns["q"])[:, 2]
        return np.column_stack([base, samples.reference.state.pose[:, 2]])

    def _rolled(self, reference: ReferenceTable, nu: Array, steered: Array) -> Array:
        """Return the angles (K, n) of the reference's wheels and casters, integrated from ν.

        Args:
            reference: The reference.
            nu: Its quasi-velocities (K, dof).
            steered: Positions of its steered joints (K, n_steered), rad.
        """
        steps = np.diff(reference.t, prepend=self._t)
        if self._dynamics.constant or self._robot.drive.leans:
            if self._robot.drive.leans:
                rates = reference.state.twist @ wheel_rates(self._robot).T
            else:
                rates = nu @ self._dynamics.basis(self._robot.configuration())[self._indices].T
            before = np.vstack([self._rates, rates[:-1]])
            rolled = np.cumsum(np.vstack([self._angles, steps[:, None] * before]), axis=0)[1:]
            self._angles, self._rates = rolled[-1], rates[-1]
            return rolled
        standing = np.hstack([steered, np.zeros((len(nu), len(self._turning)))])
        state = reference.state
        q = reference_configurations(self._robot, state.pose, state.joints, standing)
        angles, margin = self._rolling(q, nu, steps[:, None], kept=(self._angles, self._rates))
        for k in np.flatnonzero(~(margin[:, 0] > SINGULAR)):
            self._dynamics.basis(q[k])  # refuses steering that fixes no one motion
        return angles

    @cached_property
    def _rolling(self) -> RowFunction:
        """Returns angles of wheels and casters by q of the robot without them, ν and time steps."""
        robot, count = self._robot, len(self._turning)
        return RowFunction(
            ((robot.nq, robot.dof, 1), (count, 1)),
            ("rolling", robot_identity(robot)),
            lambda: rolling_step(robot, self._turning),
            (count, count),
        )


def rolling_step(robot: Robot, joints: tuple[str, ...]) -> Any:
    """Return the ``casadi.Function`` of a step in which joints roll, by Euler's method.

    Its inputs are q (nq, 1), in which it puts the angles, ν (dof, 1), the time since the step
    before, s, and the angles and rates then (n, 1), rad and rad/s; its outputs are the angles,
    how far the steering is from a singular one, and again the angles and their rates.

    Args:
        robot: The robot.
        joints: The joints.
    """
    sizes = robot.nq, robot.dof, 1, len(joints), len(joints)
    q, nu, step, angles, rates = symbols = [casadi.SX.sym(f"x{k}", n) for k, n in enumerate(sizes)]
    angles, place = angles + step * rates, casadi.vertsplit(q)
    for k, name in enumerate(joints):
        i, is_pair = robot.entries[name].index, robot.entries[name].is_pair
        place[i : i + 1 + is_pair] = (
            [casadi.cos(angles[k]), casadi.sin(angles[k])] if is_pair else [angles[k]]
        )
    at = SymbolicDynamics(robot).at(casadi.vertcat(*place))
    v = at.S @ nu
    rates = casadi.vertcat(*(v[robot.velocity_index(name)] for name in joints))
    return dense_function("roll", symbols, [angles, at.margin, angles, rates])


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
        self._reference: _Reference | None = None
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
            self._take(self._stacked(waiting), ends)
        elif ends:
            self._write(ends)

    def _stacked(self, waiting: Sequence[LoopSample]) -> Samples:
        """Return samples as arrays."""
        told = ("q", "nu", "tau", "nu_d", "nu_cmd", "work", "lost")
        columns = {name: np.array([getattr(sample, name) for sample in waiting]) for name in told}
        for name in waiting[0].felt:
            columns[name] = np.array([sample.felt[name] for sample in waiting])
        times = np.array([sample.t for sample in waiting])
        states = [sample.state for sample in waiting]
        limits = np.array([self._sets[sample.limits] for sample in waiting])
        return Samples(table_of(self._derivation.robot, times, states), columns, limits)

    def _take(self, samples: Samples, ends: bool = False) -> None:
        bad = samples.first_not_finite()
        if bad != 0:
            self._log(samples.rows(slice(bad)), ends or bad is not None)
        self._write(ends or bad is not None)
        if bad is not None:
            raise left(float(samples.reference.t[bad]))

    def _log(self, samples: Samples, ends: bool) -> None:
        """Keep those samples whose turn it is."""
        count = len(samples.limits)
        chosen = np.arange(-self._taken % self._every, count, self._every)
        self._taken += count
        if (ends or self._taken == self._total) and (not len(chosen) or chosen[-1] != count - 1):
            chosen = np.append(chosen, count - 1)
        self._reference = self._reference or _Reference(self._derivation, samples)
        columns = {
            "t": samples.reference.t,
            "limits": samples.limits,
            **dict.fromkeys(FELT, np.empty((count, 0))),
            **samples.columns,
            **self._reference.take(samples),
        }
        rows = slice(self.rows, self.rows + len(chosen))
        for name, values in columns.items():
            if name not in self._columns:
                self._columns[name] = np.empty((self._room, *values.shape[1:]))
            self._columns[name][rows] = values[chosen]
        self.rows = rows.stop
        sets = list(self._sets)
        for number in dict.fromkeys(samples.limits[chosen].astype(int).tolist()):
            self._bound |= dict.fromkeys(sets[number])

    def _write(self, ends: bool) -> None:
        if self._part is not None:
            self._part.take(self.rows, self._content, ends)

    def _content(self, rows: slice) -> tuple[dict[str, Array], dict[str, Any]]:
        """Return what is kept of some rows, and what else is known of the run by now."""
        columns = {name: each[rows] for name, each in self._columns.items()}
        columns["active_limits"] = self._active_limits(columns.pop("limits"))
        return columns, {**self._known(), "bound_limits": self.bound_limits}

    def log(self) -> Log:
        """Return the log of the samples that were added, one at least."""
        columns, _ = self._content(slice(self.rows))
        return Log(columns, self.bound_limits, self._derivation)

    @property
    def bound_limits(self) -> tuple[tuple[str, str], ...]:
        """Joint and kind of each limit that has bound the efforts so far."""
        return tuple((limit.joint, limit.kind) for limit in self._bound)

    def _active_limits(self, numbers: Array) -> Array:
        """Return which limits bound (K, n_bound), 1 or 0, by the numbers (K,) of their sets."""
        rows = [[float(limit in limits) for limit in self._bound] for limits in self._sets]
        return np.array(rows).reshape(len(rows), len(self._bound))[numbers.astype(int)]
