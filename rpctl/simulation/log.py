"""The log of a closed loop: a row a sample, then arrays."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.law import Command, Limit
from rpctl.dynamics.ground_reaction import Contacts, GroundReaction, ground_reaction
from rpctl.dynamics.load_ranges import find_ranges
from rpctl.dynamics.motion import friction_efforts
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import ReferenceState, end_effector_reference
from rpctl.reference.quasi_velocities import reference_rates, steering
from rpctl.robot.model import Robot
from rpctl.simulation.facts import other_joints, steered_joints

LogRow = dict[str, Any]


@dataclass(frozen=True, eq=False, repr=False)
class Log:
    """The samples of a run: K rows in each array; arrays are read-only.

    Attributes:
        t: Time (K,), s.
        q: Configuration (K, nq).
        nu: Quasi-velocities (K, dof); m/s, rad/s.
        tau: Actuator efforts from each sample on (K, n_act); N·m or N.
        rates: Rate of each actuator's joint (K, n_act), wheels included; rad/s or m/s.
        nu_d: Quasi-velocities that the kinematic law asks for (K, dof).
        nu_ref: Quasi-velocities of the reference (K, dof).
        base: Pose of P (K, 3): x, y in m, heading in rad.
        base_ref: Reference pose of P (K, 3).
        joints: Positions of the arm (K, n_joints); rad or m.
        joints_ref: Their references (K, n_joints).
        steering: Positions of the joints that steer wheels (K, n_steering), rad.
        others: Positions of the other moving joints (K, n_others), wheels and mimic joints
            included; rad or m, those of continuous joints in (−π, π].
        other_rates: Their rates (K, n_others); rad/s or m/s.
        e: Tracking error (K, 3 + n_joints): longitudinal, lateral, heading, joints.
        q_ref: Configuration of the reference robot (K, nq), wheels turned as they would roll.
        ee: Position of the end effector (K, 3), m; (K, 0) for a robot without an arm.
        ee_ref: Its reference (K, 3), m.
        ee_angle: Angle between the end effector's and its reference's orientation (K,), rad.
        energy: Kinetic plus potential energy (K,), J.
        work: Work done by the actuators since the start (K,), J.
        constraint_residual: Largest entry of |A v| (K,); m/s, rad/s.
        wheel_force: Force of the ground on each wheel, forward (K, n_wheels), N.
        axle_force: Force of the ground on each axle, to the left (K, n_axles), N.
        contact_load: Vertical force of the ground on each contact (K, n_contacts), N; (K, 0) where
            the contacts known do not hold a balance. Beyond three contacts, of equal springs.
        zmp: Zero-moment point (K, 2), m; (K, 0) for a fixed base.
        tip_margin: Distance of the zero-moment point to the edge of the support polygon (K,), m;
            negative outside; (K, 0) where it is not defined.
        slip_ratio: Largest of the wheels' horizontal force over friction times load (K,); above 1
            a wheel slips; (K, 0) where it is not defined. The loads are ``contact_load``.
        load_range: Least and largest load of each contact (K, n_contacts, 2) of all splits that
            statics admit, N; NaN where the robot tips. (K, 0) where ``contact_load`` is the only
            split or not defined, and in files of versions that logged none.
        slip_range: Least and largest ``slip_ratio`` of those splits (K, 2); inf where a wheel that
            pushes may bear nothing, NaN where the robot tips; (K, 0) where ``load_range`` is.
        active_limits: 1 where a limit bound the efforts, else 0 (K, n_bound).
        bound_limits: Joint and kind of each limit that ever bound the efforts, a column of
            ``active_limits`` each.
    """

    t: Array
    q: Array
    nu: Array
    tau: Array
    rates: Array
    nu_d: Array
    nu_ref: Array
    base: Array
    base_ref: Array
    joints: Array
    joints_ref: Array
    steering: Array
    others: Array
    other_rates: Array
    e: Array
    q_ref: Array
    ee: Array
    ee_ref: Array
    ee_angle: Array
    energy: Array
    work: Array
    constraint_residual: Array
    wheel_force: Array
    axle_force: Array
    contact_load: Array
    zmp: Array
    tip_margin: Array
    slip_ratio: Array
    load_range: Array
    slip_range: Array
    active_limits: Array
    bound_limits: tuple[tuple[str, str], ...]


class Recorder:
    """Collects the rows of one run.

    Args:
        dynamics: The robot's dynamics.
        contacts: How it stands on the ground, or None for a fixed base.
        bias: Efforts (n_act,) that push besides the controller's, N·m or N.
        friction: Dry friction of the actuators' joints (n_act,), N·m or N; None: none.
    """

    def __init__(
        self,
        dynamics: ReducedDynamics,
        contacts: Contacts | None,
        bias: Array,
        friction: Array | None = None,
    ) -> None:
        self._dynamics, self._contacts = dynamics, contacts
        self._bias, self._friction = bias, friction
        self._data = dynamics.robot.model.createData()
        self._steered, self._others = steered_joints(dynamics.robot), other_joints(dynamics.robot)
        self._other_indices = [dynamics.robot.velocity_index(name) for name in self._others]
        # One list, so that what ends the run at any moment leaves whole samples.
        self._samples: list[tuple[LogRow, GroundReaction | None, tuple[Limit, ...]]] = []

    def finite_count(self) -> int:
        """Return the number of samples up to the first that is not finite."""
        for k, (row, _, _) in enumerate(self._samples):
            if not all(np.isfinite(value).all() for value in row.values()):
                return k
        return len(self._samples)

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
        """
        dynamics, robot = self._dynamics, self._dynamics.robot
        at = dynamics.at(q)
        v = at.S @ nu
        reaction, rates = None, at.B.T @ nu
        if self._contacts is not None:
            push = tau + self._bias
            if self._friction is not None:
                push = push + friction_efforts(self._friction, rates)
            reaction = ground_reaction(dynamics, self._contacts, q, nu, push)
        row = {
            "t": t,
            "q": q,
            "nu": nu,
            "tau": tau,
            "rates": rates,
            "nu_d": command.nu_d,
            "nu_ref": reference_rates(robot, state).nu,
            "base": robot.base_pose(q),
            "base_ref": state.pose,
            "joints": robot.joint_positions(q),
            "joints_ref": state.joints,
            "steering_ref": steering(robot, state)[0],
            "steering": np.array([robot.joint_position(q, name) for name in self._steered]),
            "others": np.array([robot.joint_position(q, name) for name in self._others]),
            "other_rates": v[self._other_indices],
            "e": e,
            "energy": dynamics.energy(q, nu),
            "work": work,
            "constraint_residual": _constraint_residual(dynamics, q, v),
            **_ground(reaction),
            **_end_effector(robot, self._data, q, state),
        }
        self._samples.append((row, reaction, limits))

    def log(self, count: int | None = None) -> Log:
        """Return the log, samples first: all of them, or the first ``count``."""
        samples = self._samples[:count]
        rows = [row for row, _, _ in samples]
        log: dict[str, Array] = {key: np.array([row[key] for row in rows]) for key in rows[0]}
        for heading in (log["base"][:, 2], log["base_ref"][:, 2]):
            heading[:] = np.unwrap(heading)
        log["q_ref"] = _reference_configurations(self._dynamics, log)
        del log["steering_ref"]  # it is part of q_ref
        log["load_range"] = log["slip_range"] = np.empty((len(rows), 0))
        if self._contacts is not None and not self._contacts.determinate:
            reactions = [reaction for _, reaction, _ in samples if reaction is not None]
            ranges = find_ranges(self._contacts, reactions)
            log["load_range"], log["slip_range"] = ranges.load, ranges.slip
        bound = tuple(dict.fromkeys(chain.from_iterable(limits for _, _, limits in samples)))
        active = [[float(limit in limits) for limit in bound] for _, _, limits in samples]
        log["active_limits"] = np.array(active)
        for array in log.values():
            array.setflags(write=False)
        return Log(**log, bound_limits=tuple((limit.joint, limit.kind) for limit in bound))


def _constraint_residual(dynamics: ReducedDynamics, q: Array, v: Array) -> float:
    """Return the largest entry of |A v|: m/s, rad/s."""
    return float(np.abs(dynamics.constraint(q) @ v).max(initial=0.0))


def _ground(reaction: GroundReaction | None) -> dict[str, Any]:
    nothing = np.empty(0)
    if reaction is None:
        names = ("wheel_force", "axle_force", "contact_load", "zmp", "tip_margin", "slip_ratio")
        return dict.fromkeys(names, nothing)
    slip = reaction.slip_ratio
    return {
        "wheel_force": reaction.longitudinal,
        "axle_force": reaction.lateral,
        "contact_load": reaction.load,
        "zmp": reaction.zmp,
        "tip_margin": nothing if reaction.tip_margin is None else reaction.tip_margin,
        "slip_ratio": slip.max() if slip.size else nothing,
    }


def _end_effector(robot: Robot, data: pin.Data, q: Array, state: ReferenceState) -> dict[str, Any]:
    if robot.end_effector is None:
        return {"ee": np.empty(0), "ee_ref": np.empty(0), "ee_angle": 0.0}
    actual = robot.end_effector_pose(data, q)
    wanted = end_effector_reference(robot, data, state)
    turn = pin.log3(actual.rotation.T @ wanted.rotation)
    return {
        "ee": actual.translation,
        "ee_ref": wanted.translation,
        "ee_angle": float(np.linalg.norm(turn)),
    }


def _reference_configurations(dynamics: ReducedDynamics, log: dict[str, Array]) -> Array:
    """Return q (K, nq) of the reference, wheels and casters integrated from ν_ref.

    Wheels start at 0, casters where the robot's do.
    """
    robot, drive = dynamics.robot, dynamics.robot.drive
    turning = [wheel.joint for wheel in drive.wheels]
    casters = [swivel.joint for swivel in drive.swivels if swivel.role == "caster"]
    start = [robot.joint_position(log["q"][0], name) for name in casters]
    turned, configurations = np.concatenate([np.zeros(len(turning)), start]), []
    turning += casters
    index = [robot.velocity_index(name) for name in turning]
    steps = np.diff(log["t"], append=log["t"][-1:])
    rows = (log[key] for key in ("base_ref", "joints_ref", "steering_ref", "nu_ref"))
    for pose, joints, steered, nu, step in zip(*rows, steps, strict=True):
        q = robot.configuration_at(pose, joints, steered)
        for name, angle in zip(turning, turned, strict=True):
            robot.set_joint(q, name, float(angle))
        configurations.append(q)
        turned = turned + step * (dynamics.basis(q) @ nu)[index]
    return np.array(configurations)
