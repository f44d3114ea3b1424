"""What a log says besides the samples themselves, computed from a batch of them at once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rpctl.arrays import Array
from rpctl.dynamics.ground_reaction import Contacts, GroundReactions, ground_reactions
from rpctl.dynamics.load_ranges import find_ranges
from rpctl.dynamics.many_states import ManyStates, Reactions
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.quasi_velocities import configurations, reference_rates, steering
from rpctl.robot.model import Robot
from rpctl.robot.placements import EndEffectorFrame, aligned_tree, end_effector_frame
from rpctl.simulation.facts import other_joints, steered_joints
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
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        contacts: Contacts | None,
        bias: Array,
    ) -> None:
        self._dynamics, self._contacts, self._bias = dynamics, contacts, bias
        self.robot = robot = dynamics.robot
        self._frame: EndEffectorFrame | None = None
        if robot.end_effector is not None:
            self._frame = end_effector_frame(aligned_tree(robot))
        self._many = ManyStates(dynamics) if dynamics.constant else None
        self._steered, self._others = steered_joints(robot), other_joints(robot)
        self._other_indices = [robot.velocity_index(name) for name in self._others]
        self._casters = [s.joint for s in robot.drive.swivels if s.role == "caster"]
        self._turning = [wheel.joint for wheel in robot.drive.wheels] + self._casters
        self._turning_indices = [robot.velocity_index(name) for name in self._turning]

    def columns(
        self, samples: Samples, logged: NDArray[np.intp], carry: Carry | None
    ) -> tuple[dict[str, Array], Carry]:
        """Return the columns of a log of some samples, by name, and what the next batch needs.

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
        arms = configurations(robot, samples.pose, samples.joints)
        q_ref, rolled, rolling = self._reference_wheels(samples, nu_ref, arms, carry)
        last = np.array([base[-1, 2], samples.pose[-1, 2]])
        following = Carry(last, turns[-1], float(samples.t[-1]), rolled, rolling)
        if not len(logged):
            return {}, following
        kept, ahead = samples.rows(logged), TURN * turns[logged]
        reactions = None
        if self._many is not None:
            reactions = self._many.reactions(kept.q, kept.nu, kept.tau + self._bias)
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
            **self._motion(kept, reactions),
            **_end_effector(self._frame, kept.q, arms[logged]),
        }
        return columns | self._ground(kept, reactions), following

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
        self, samples: Samples, nu_ref: Array, arms: Array, carry: Carry
    ) -> tuple[Array, Array, Array]:
        """Return q (K, nq) of the reference, wheels and casters integrated from ν_ref.

        Args:
            samples: The samples.
            nu_ref: Quasi-velocities of the reference (K, dof).
            arms: Its configurations (K, nq), wheels and steering at 0.
            carry: Of the sample before.

        Returns:
            Also the angles and the rates of wheels and casters at the last sample.
        """
        robot, dynamics = self._dynamics.robot, self._dynamics
        steps = np.diff(samples.t, prepend=carry.t)
        q = _steered(robot, samples) if robot.drive.steered else arms.copy()
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

    def _motion(self, samples: Samples, reactions: Reactions | None) -> dict[str, Array]:
        """Return what velocities say: rates, energy, and how well the constraints are kept."""
        dynamics, q, nu = self._dynamics, samples.q, samples.nu
        if dynamics.constant:
            at = dynamics.at(q[0])
            v, rates = nu @ at.S.T, nu @ at.B
            slip = v @ at.A.T
        else:
            v, rates = np.empty((len(q), dynamics.robot.nv)), np.empty(samples.tau.shape)
            slip = np.empty((len(q), len(dynamics.rolling.matrix.constant)))
            for k in range(len(q)):
                at = dynamics.at(q[k])
                v[k] = at.S @ nu[k]
                rates[k], slip[k] = at.B.T @ nu[k], at.A @ v[k]
        if reactions is None:
            energy = np.array([dynamics.energy(*state) for state in zip(q, nu, strict=True)])
        else:
            energy = reactions.energy
        return {
            "rates": rates,
            "other_rates": v[:, self._other_indices],
            "energy": energy,
            "constraint_residual": np.abs(slip).max(axis=1, initial=0.0),
        }

    def _ground(self, samples: Samples, reactions: Reactions | None) -> dict[str, Array]:
        """Return what the ground does; (K, 0) where it is not defined."""
        contacts, nothing = self._contacts, np.empty((len(samples.t), 0))
        if contacts is None:
            return dict.fromkeys(GROUND_COLUMNS, nothing)
        push = samples.tau + self._bias
        found = ground_reactions(self._dynamics, contacts, samples.q, samples.nu, push, reactions)
        columns = _ground_columns(found)
        if not contacts.determinate:
            ranges = find_ranges(contacts, found)
            columns |= {"load_range": ranges.load, "slip_range": ranges.slip}
        return dict.fromkeys(GROUND_COLUMNS, nothing) | columns


GROUND_COLUMNS = (
    "wheel_force",
    "axle_force",
    "contact_load",
    "zmp",
    "tip_margin",
    "slip_ratio",
    "load_range",
    "slip_range",
)


def _ground_columns(reactions: GroundReactions) -> dict[str, Array]:
    """Return what the log keeps of the ground's forces, but for the ranges."""
    found = {
        "wheel_force": reactions.longitudinal,
        "axle_force": reactions.lateral,
        "contact_load": reactions.load,
        "zmp": reactions.zmp,
    }
    if reactions.tip_margin is not None:
        found["tip_margin"] = reactions.tip_margin
    if reactions.slip_ratio.size:
        found["slip_ratio"] = reactions.slip_ratio.max(axis=1)
    return found


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


def _end_effector(frame: EndEffectorFrame | None, q: Array, q_ref: Array) -> dict[str, Array]:
    """Return where the end effector is (K, 3), where it should be, and the angle between (K,).

    Args:
        frame: The end effector; None: there is none.
        q: Configurations (K, nq).
        q_ref: Those of the reference (K, nq).
    """
    if frame is None:
        none = np.empty((len(q), 0))
        return {"ee": none, "ee_ref": none, "ee_angle": np.zeros(len(q))}
    (axes, place), (wanted_axes, wanted) = frame.at(q), frame.at(q_ref)
    # The reference's base is turned by Δ against the robot's.
    (cos, sin), (cos_ref, sin_ref) = q[:, 2:4].T, q_ref[:, 2:4].T
    c, s = cos * cos_ref + sin * sin_ref, cos * sin_ref - sin * cos_ref
    x, y = wanted_axes[:, 0].copy(), wanted_axes[:, 1].copy()
    wanted_axes[:, 0], wanted_axes[:, 1] = c * x - s * y, s * x + c * y
    turn = np.einsum("iak,jak->ijk", axes, wanted_axes)
    twice = [turn[j, i] - turn[i, j] for i, j in ((1, 2), (2, 0), (0, 1))]
    sine, cosine = np.sqrt(sum(each * each for each in twice)), np.einsum("iik->k", turn) - 1.0
    return {"ee": place, "ee_ref": wanted, "ee_angle": np.arctan2(sine, cosine)}
