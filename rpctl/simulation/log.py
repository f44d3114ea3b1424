"""What a closed loop logs: a row a sample, then the arrays and facts of a ``Run``."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from itertools import chain
from typing import Any

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.command import Command
from rpctl.control.law import Limit
from rpctl.dynamics.ground_reaction import Contacts, GroundReaction, ground_reaction
from rpctl.dynamics.load_ranges import find_ranges
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.end_effector import end_effector_reference
from rpctl.reference.motion import ReferenceState
from rpctl.reference.quasi_velocities import reference_rates, steering
from rpctl.robot.model import Robot

LogRow = dict[str, Any]


class Recorder:
    """Collects the rows of one run.

    Args:
        dynamics: The robot's dynamics.
        contacts: How it stands on the ground, or None for a fixed base.
        bias: Efforts (n_act,) that push besides the controller's, N·m or N.
    """

    def __init__(self, dynamics: ReducedDynamics, contacts: Contacts | None, bias: Array) -> None:
        self._dynamics, self._contacts, self._bias = dynamics, contacts, bias
        self._data = dynamics.robot.model.createData()
        self._steered, self._others = _steered_joints(dynamics.robot), _other_joints(dynamics.robot)
        self._other_indices = [dynamics.robot.velocity_index(name) for name in self._others]
        self._rows: list[LogRow] = []
        self._limits: list[tuple[Limit, ...]] = []
        self._reactions: list[GroundReaction] = []

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
        """Add a sample: time (s), motion, efforts, error, reference, command, work so far (J).

        Last come the limits that bound the efforts.
        """
        self._limits.append(limits)
        dynamics, robot = self._dynamics, self._dynamics.robot
        at = dynamics.at(q)
        v = at.S @ nu
        if self._contacts is not None:
            push = tau + self._bias
            self._reactions.append(ground_reaction(dynamics, self._contacts, q, nu, push))
        self._rows.append(
            {
                "t": t,
                "q": q,
                "nu": nu,
                "tau": tau,
                "rates": at.B.T @ nu,
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
                **_ground(self._reactions[-1] if self._reactions else None),
                **_end_effector(robot, self._data, q, state),
            }
        )

    def arrays(self) -> dict[str, Any]:
        """Return the arrays of a Run, read-only, samples first, and the limits that ever bound."""
        log: dict[str, Array] = {
            key: np.array([row[key] for row in self._rows]) for key in self._rows[0]
        }
        for heading in (log["base"][:, 2], log["base_ref"][:, 2]):
            heading[:] = np.unwrap(heading)
        log["q_ref"] = _reference_configurations(self._dynamics, log)
        del log["steering_ref"]  # it is part of q_ref
        log["load_range"] = log["slip_range"] = np.empty((len(self._rows), 0))
        if self._contacts is not None and not self._contacts.determinate:
            ranges = find_ranges(self._contacts, self._reactions)
            log["load_range"], log["slip_range"] = ranges.load, ranges.slip
        bound = tuple(dict.fromkeys(chain.from_iterable(self._limits)))
        active = [[float(limit in limits) for limit in bound] for limits in self._limits]
        log["active_limits"] = np.array(active)
        for array in log.values():
            array.setflags(write=False)
        return {**log, "bound_limits": tuple(map(tuple, bound))}


def run_facts(robot: Robot, contacts: Contacts | None) -> dict[str, Any]:
    """Return what a Run tells of its robot."""
    joints = robot.joints
    return {
        "robot": robot.name,
        "source": robot.source,
        "urdf_sha256": robot.description.sha256,
        "locked": dict(robot.locked),
        "drive": dataclasses.asdict(robot.drive),
        "density": robot.density,
        "package_dirs": tuple(map(str, robot.description.package_dirs)),
        "quasi_velocities": robot.quasi_velocities,
        "actuators": robot.actuators,
        "joint_names": tuple(joint.name for joint in joints),
        "units": tuple("m" if joint.kind == "prismatic" else "rad" for joint in joints),
        "effort_limits": tuple(robot.effort_limits.tolist()),
        "velocity_limits": tuple(robot.description.joint[n].velocity for n in robot.actuators),
        "lower_limits": tuple(joint.lower for joint in joints),
        "upper_limits": tuple(joint.upper for joint in joints),
        "steering_names": _steered_joints(robot),
        "steering_limits": tuple(
            (robot.description.joint[name].lower, robot.description.joint[name].upper)
            for name in _steered_joints(robot)
        ),
        "other_names": _other_joints(robot),
        "other_limits": tuple(
            (limited.lower, limited.upper, limited.velocity)
            for limited in (robot.description.joint[name] for name in _other_joints(robot))
        ),
        "end_effector": robot.end_effector,
        "contacts": contacts.names if contacts else (),
        "contact_points": tuple(map(tuple, contacts.points.tolist())) if contacts else (),
        "axles": contacts.axles if contacts else (),
        "ground_notes": contacts.notes if contacts else (),
    }


def _steered_joints(robot: Robot) -> tuple[str, ...]:
    """Return the joints that turn wheels, but for casters."""
    return tuple(swivel.joint for swivel in robot.drive.swivels if swivel.role != "caster")


def _other_joints(robot: Robot) -> tuple[str, ...]:
    """Return the moving joints that are not the arm's: wheels', swivels, and mimic joints."""
    arm = {joint.name for joint in robot.joints}
    return tuple(name for name in robot.model.names[2:] if name not in arm)


def describe(law: object) -> dict[str, Any]:
    """Return a law's name and settings, those of laws and obstacles within it as well."""
    if dataclasses.is_dataclass(law) and not isinstance(law, type):
        settings = ((item.name, getattr(law, item.name)) for item in dataclasses.fields(law))
        return {"law": type(law).__name__, **{name: _json_value(value) for name, value in settings}}
    return {"law": getattr(law, "__name__", type(law).__name__)}


def _json_value(value: object) -> Any:
    """Return what JSON can say of a setting."""
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, Mapping):
        return {str(key): _json_value(each) for key, each in value.items()}
    if isinstance(value, tuple | list | np.ndarray):
        return [_json_value(each) for each in value]
    return value.item() if isinstance(value, np.generic) else describe(value)


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
    """Return q (K, nq) of the reference, its wheels and casters turned as they would have been."""
    robot, drive = dynamics.robot, dynamics.robot.drive
    turning = [wheel.joint for wheel in drive.wheels]
    turning += [swivel.joint for swivel in drive.swivels if swivel.role == "caster"]
    index = [robot.velocity_index(name) for name in turning]
    turned, configurations = np.zeros(len(turning)), []
    steps = np.diff(log["t"], append=log["t"][-1:])
    rows = (log[key] for key in ("base_ref", "joints_ref", "steering_ref", "nu_ref"))
    for pose, joints, steered, nu, step in zip(*rows, steps, strict=True):
        q = robot.configuration_at(pose, joints, steered)
        for name, angle in zip(turning, turned, strict=True):
            robot.set_joint(q, name, float(angle))
        configurations.append(q)
        turned = turned + step * (dynamics.basis(q) @ nu)[index]
    return np.array(configurations)
