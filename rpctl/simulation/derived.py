"""What a log says besides the samples themselves, computed from a batch of them at once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.quasi_velocities import configurations, reference_rates, steering
from rpctl.robot.model import Robot
from rpctl.simulation.facts import other_joints, steered_joints
from rpctl.simulation.motion_columns import MotionColumns
from rpctl.simulation.plants.wrench import Wrench
from rpctl.simulation.samples import Samples

TURN = 2.0 * math.pi


@dataclass(frozen=True, eq=False)
class Carry:
    """What the columns of a batch need of the sample before it.

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


class Derivation:
    """Computes the columns of a log that follow from the samples.

    Args:
        dynamics: The robot's dynamics.
        contacts: How it stands on the ground, or None for a fixed base.
        bias: Efforts (n_act,) that push besides the controller's, N·m or N.
        wrenches: What pushes the robot from outside.

    Attributes:
        motion: Computes the columns that follow from these.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        contacts: Contacts | None,
        bias: Array,
        wrenches: Sequence[Wrench] = (),
    ) -> None:
        self._dynamics = dynamics
        self.robot = robot = dynamics.robot
        self.motion = MotionColumns(dynamics, contacts, bias, wrenches)
        self._steered, self._others = steered_joints(robot), other_joints(robot)
        self._casters = [s.joint for s in robot.drive.swivels if s.role == "caster"]
        self._turning = [wheel.joint for wheel in robot.drive.wheels] + self._casters
        self._turning_indices = [robot.velocity_index(name) for name in self._turning]

    def columns(
        self, samples: Samples, logged: NDArray[np.intp], carry: Carry | None
    ) -> tuple[dict[str, Array], Carry]:
        """Return columns of a log of some samples, by name, and what the next batch needs.

        They are those that the samples and their order say; :attr:`motion` has the others.

        Args:
            samples: Consecutive samples, K > 0.
            logged: Which of them are logged (indices); the others count for the reference's wheels
                and for full turns only.
            carry: Of the batch before; None: it is the first.
        """
        robot = self._dynamics.robot
        carry = self._start(samples) if carry is None else carry
        base = _base_poses(robot, samples.q)
        turns = self._turns(np.column_stack([base[:, 2], samples.pose[:, 2]]), carry)
        nu_ref = _reference_nu(robot, samples)
        q_ref, rolled, rolling = self._reference_wheels(samples, nu_ref, carry)
        last = np.array([base[-1, 2], samples.pose[-1, 2]])
        following = Carry(last, turns[-1], float(samples.t[-1]), rolled, rolling)
        if not len(logged):
            return {}, following
        kept, ahead = samples.rows(logged), TURN * turns[logged]
        columns = {
            name: np.array(getattr(kept, name))
            for name in ("t", "q", "nu", "tau", "nu_d", "nu_cmd", "e", "work", "lost")
        }
        columns |= {
            "nu_ref": nu_ref[logged],
            "base": base[logged] + ahead[:, :1] * [0.0, 0.0, 1.0],
            "base_ref": kept.pose + ahead[:, 1:] * [0.0, 0.0, 1.0],
            "joints": _positions(robot, kept.q, robot.joint_names),
            "joints_ref": np.array(kept.joints),
            "steering": _positions(robot, kept.q, self._steered),
            "others": _positions(robot, kept.q, self._others),
            "q_ref": q_ref[logged],
        }
        return columns, following

    def _start(self, samples: Samples) -> Carry:
        """Return what is before the first sample: wheels at 0, casters where the robot's are."""
        robot = self._dynamics.robot
        headings = np.array([robot.base_pose(samples.q[0])[2], samples.pose[0, 2]])
        start = [robot.joint_position(samples.q[0], name) for name in self._casters]
        rolled = np.concatenate([np.zeros(len(self._turning) - len(start)), start])
        return Carry(headings, np.zeros(2), float(samples.t[0]), rolled, np.zeros(len(rolled)))

    def _turns(self, headings: Array, carry: Carry) -> Array:
        """Return how many full turns (K, 2) make headings (K, 2) continue those before them."""
        jumps = np.diff(headings, axis=0, prepend=carry.headings[None])
        return np.asarray(carry.turns + np.cumsum(-np.round(jumps / TURN), axis=0))

    def _reference_wheels(
        self, samples: Samples, nu_ref: Array, carry: Carry
    ) -> tuple[Array, Array, Array]:
        """Return q (K, nq) of the reference, wheels and casters integrated from ν_ref.

        Args:
            samples: The samples.
            nu_ref: Quasi-velocities of the reference (K, dof).
            carry: Of the sample before.

        Returns:
            Also the angles and the rates of wheels and casters at the last sample.
        """
        robot, dynamics = self._dynamics.robot, self._dynamics
        steps = np.diff(samples.t, prepend=carry.t)
        if robot.drive.steered:
            q = _steered(robot, samples)
        else:
            q = configurations(robot, samples.pose, samples.joints)
        entries = [robot.entries[name] for name in self._turning]
        if dynamics.constant:
            rates = nu_ref @ dynamics.basis(q[0])[self._turning_indices].T
            before = np.vstack([carry.rolling, rates[:-1]])
            rolled = np.cumsum(np.vstack([carry.rolled, steps[:, None] * before]), axis=0)[1:]
            for entry, angles in zip(entries, rolled.T, strict=True):
                entry.write_all(q, angles)
            return q, rolled[-1], rates[-1]
        angles, rate = carry.rolled, carry.rolling
        for row, nu, step in zip(q, nu_ref, steps, strict=True):
            angles = angles + step * rate
            for entry, angle in zip(entries, angles.tolist(), strict=True):
                entry.write(row, angle)
            rate = (dynamics.basis(row) @ nu)[self._turning_indices]
        return q, angles, rate


def _base_poses(robot: Robot, q: Array) -> Array:
    """Return the poses (K, 3) of P at q (K, nq); m, rad."""
    x, y, cos, sin = q[:, :4].T
    px, py = robot.drive.point
    heading = np.arctan2(sin, cos) + robot.drive.heading
    return np.column_stack([x + cos * px - sin * py, y + sin * px + cos * py, heading])


def _positions(robot: Robot, q: Array, names: tuple[str, ...]) -> Array:
    """Return the positions (K, n) of joints at q (K, nq), rad or m."""
    found = np.empty((len(q), len(names)))
    for column, name in enumerate(names):
        entry = robot.entries.get(name)
        found[:, column] = robot.locked[name] if entry is None else entry.read_all(q)
    return found


def _reference_nu(robot: Robot, samples: Samples) -> Array:
    """Return the quasi-velocities (K, dof) of the reference."""
    if robot.drive.steered:
        count = len(samples.t)
        return np.array([reference_rates(robot, samples.state(k)).nu for k in range(count)])
    return reference_rates(robot, samples.state()).nu


def _steered(robot: Robot, samples: Samples) -> Array:
    """Return q (K, nq) of the reference, wheels at 0 and steering as the reference has it."""
    states = (samples.state(k) for k in range(len(samples.t)))
    return np.array(
        [robot.configuration_at(s.pose, s.joints, steering(robot, s)[0]) for s in states]
    )
