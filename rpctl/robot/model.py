"""``Robot``: a Pinocchio model on a planar root, its drive, and the names of its coordinates."""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array, read_only
from rpctl.description.frozen_tree import FrozenTree
from rpctl.description.records import Description, Joint
from rpctl.drive.drive import Drive
from rpctl.drive.steering import SteeringLimits, follower_positions, is_regular, steering_limits
from rpctl.errors import Finding, RpctlError, require_known
from rpctl.libraries import library
from rpctl.robot.coordinates import (
    BASE_NQ,
    ROOT_JOINT,
    JointEntry,
    joint_entries,
    read_root,
    write_root,
)
from rpctl.robot.load_settings import LoadSettings
from rpctl.robot.losses import Losses

BASE_NV = 3  # entries of v that are the planar root's
HOME_MARGIN = 0.3  # of a joint's range: home keeps this far from its limits


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Robot:
    """A wheeled robot on flat ground; robots are compared by identity.

    Attributes:
        name: Name of the robot.
        source: What it was loaded from: an absolute path or a catalogue name.
        description: Its URDF.
        model: ``pinocchio.Model`` with a ``JointModelPlanar`` root (``JointModelFreeFlyer`` for a
            robot that leans) and locked joints frozen.
        drive: Its wheels and how they move it.
        locked: Frozen joints and their positions (rad or m).
        joints: The arm: moving joints other than wheels, swivels and mimic joints, in file order.
        end_effector: Link whose pose is tracked; None for a robot without an arm.
        findings: Errors, warnings and notes on the description and the model.
        loaded_with: The other arguments of :func:`rpctl.load`.
        losses: Damping and dry friction of its joints; None: it has no losses.
    """

    name: str
    source: str
    description: Description
    model: pin.Model
    drive: Drive
    locked: Mapping[str, float]
    joints: tuple[Joint, ...]
    end_effector: str | None
    findings: tuple[Finding, ...]
    loaded_with: LoadSettings = field(default_factory=LoadSettings)
    losses: Losses | None = None

    def __repr__(self) -> str:
        wheels = [wheel.joint for wheel in self.drive.wheels]
        lines = [f"<Robot {self.name}: {self.drive.type} drive, {self.source}"]
        lines += [f" wheels: {', '.join(wheels) or 'none'}; end effector: {self.end_effector}"]
        return "\n".join([*lines, f" quasi-velocities: {', '.join(self.quasi_velocities)}>"])

    def _repr_html_(self) -> str:
        """Return what a notebook shows."""
        return str(library("rpctl.view.pages.page").render("notebook_robot.html", robot=self))

    @cached_property
    def tree(self) -> FrozenTree:
        """The tree of its links, with the locked joints frozen."""
        return FrozenTree(self.description, self.locked)

    @cached_property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the arm's joints."""
        return tuple(joint.name for joint in self.joints)

    def require_level(self) -> None:
        """Raise for a robot that leans; for functions that require a level root link.

        Raises:
            RpctlError: The robot leans.
        """
        if self.drive.leans:
            raise RpctlError(
                f"{self.name} leans on two wheels, and this is for robots whose root link stays "
                "level; inspect, verify (--contact too), track and Controller on all plants but "
                "slipping, study, stress, compare, attraction and linearize take it (--root planar "
                "holds it upright where its wheels allow that)"
            )

    @cached_property
    def legs(self) -> frozenset[str]:
        """Names of the joints that carry wheels at their ends."""
        parts = (self.description.joint[wheel.joint] for wheel in self.drive.wheels)
        carriers = {above.name for part in parts for above in self.tree.free_joints(part.parent)}
        return frozenset(carriers.intersection(self.joint_names))

    @cached_property
    def entries(self) -> dict[str, JointEntry]:
        """The entries in q of all joints of the model, by name."""
        return joint_entries(self.model)

    @property
    def moving_joint_names(self) -> tuple[str, ...]:
        """Names of all joints of the model: wheels, swivels, the arm's and mimic joints."""
        return tuple(self.entries)

    @cached_property
    def quasi_velocities(self) -> tuple[str, ...]:
        """Names of the entries of ν: the base's speeds (as v of P and omega), then joint rates."""
        return self.drive.base_speeds + self.joint_names

    @cached_property
    def actuators(self) -> tuple[str, ...]:
        """Names of the entries of τ: driven wheels, driven swivels, then the arm's joints.

        A joint of the arm with an effort limit of 0 has no actuator.
        """
        wheels = tuple(wheel.joint for wheel in self.drive.wheels if wheel.driven)
        swivels = tuple(swivel.joint for swivel in self.drive.swivels if swivel.driven)
        return wheels + swivels + tuple(joint.name for joint in self.joints if joint.effort)

    @property
    def dof(self) -> int:
        """Number of quasi-velocities."""
        return len(self.quasi_velocities)

    @property
    def nq(self) -> int:
        """Length of q."""
        return int(self.model.nq)

    @property
    def nv(self) -> int:
        """Length of v."""
        return int(self.model.nv)

    @property
    def mass(self) -> float:
        """Total mass, kg."""
        return float(pin.computeTotalMass(self.model))

    @property
    def armature(self) -> Array:
        """Rotor inertia seen from each joint (nv,), I n², kg·m² or kg; M contains it."""
        return np.array(self.model.armature)

    @cached_property
    def mimics(self) -> tuple[Joint, ...]:
        """The moving mimic joints."""
        return tuple(
            joint
            for joint in self.description.joints
            if joint.moving and joint.mimic is not None and self.model.existJointName(joint.name)
        )

    def frame(self, link: str) -> pin.Frame:
        """Return the frame of a link in the model: its parent joint and its pose therein."""
        return self.model.frames[self.model.getFrameId(link, pin.FrameType.BODY)]

    def end_effector_pose(self, data: pin.Data, q: Array) -> pin.SE3:
        """Return the pose of the end effector in the world (m) at q (nq,); overwrites ``data``.

        Raises:
            RpctlError: The robot has no end effector.
        """
        if self.end_effector is None:
            raise RpctlError(f"{self.name} has no arm, so no end effector")
        frame = self.model.getFrameId(self.end_effector, pin.FrameType.BODY)
        pin.forwardKinematics(self.model, data, q)
        return pin.updateFramePlacement(self.model, data, frame).copy()

    def end_effector_poses(self, q: Array) -> Array:
        """Return the poses (K, 4, 4) of the end effector in the world, m, at q (K, nq)."""
        frame = self.frame(str(self.end_effector))
        pose = self.joint_poses(q, [frame.parentJoint])[frame.parentJoint]
        found = np.tile(np.eye(4), (len(q), 1, 1))
        found[:, :3] = np.einsum("ijk,jl->kil", pose[:, :3], frame.placement.homogeneous[:3])
        found[:, :3, 3] += pose[:, 3].T
        return found

    def joint_poses(self, q: Array, joints: Iterable[int]) -> dict[int, Array]:
        """Return the poses in the world of some joints and all their ancestors at q (K, nq).

        Args:
            q: Configurations (K, nq).
            joints: Indices of the joints in the model.

        Returns:
            By index of the joint, its axes and its origin (m) as columns, in (3, 4, K).
        """
        found = {0: np.repeat(np.eye(3, 4)[:, :, None], len(q), axis=2)}
        for joint in sorted({above for below in joints for above in self.model.supports[below]}):
            if joint:
                placed = self.model.jointPlacements[joint].homogeneous[:3]
                above = found[int(self.model.parents[joint])]
                found[joint] = np.einsum("ijk,jl->ilk", above[:, :3], placed)
                found[joint][:, 3] += above[:, 3]
                self._move(found[joint], joint, q)
        return found

    def _move(self, pose: Array, joint: int, q: Array) -> None:
        """Move poses (3, 4, K) in place as a joint moves at q (K, nq)."""
        if joint == ROOT_JOINT:
            self._move_root(pose, q)
            return
        name = self.model.names[joint]
        axis, entry = self.description.joint[name].axis, self.entries[name]
        if self.description.joint[name].kind == "prismatic":
            pose[:, 3] += np.einsum("ijk,j->ik", pose[:, :3], axis) * q[:, entry.index]
            return
        _turn(pose, axis, *entry.directions(q))

    def _move_root(self, pose: Array, q: Array) -> None:
        """Move poses (3, 4, K) in place as the root does at q (K, nq)."""
        x, y, cos, sin = q[:, :BASE_NQ].T
        pose[:, 3] += pose[:, 0] * x + pose[:, 1] * y
        _turn(pose, np.array([0.0, 0.0, 1.0]), cos, sin)

    @cached_property
    def effort_limits(self) -> Array:
        """Limits of τ (n_act,), N·m or N; inf where the URDF gives none."""
        return np.array([self.description.joint[name].effort for name in self.actuators])

    @cached_property
    def velocity_limits(self) -> Array:
        """Velocity limits of the actuators' joints (n_act,), rad/s or m/s; inf where none."""
        return np.array([self.description.joint[name].velocity for name in self.actuators])

    @cached_property
    def steering_limits(self) -> SteeringLimits:
        """Limits of the steered joints that follow from their own and their followers' limits."""
        return steering_limits(self.drive, self.description.joint)

    def velocity_index(self, joint: str) -> int:
        """Return a joint's index in v."""
        return int(self.model.joints[self.model.getJointId(joint)].idx_v)

    def configuration(
        self,
        x: float = 0.0,
        y: float = 0.0,
        theta: float = 0.0,
        *,
        joints: Mapping[str, float] | None = None,
    ) -> Array:
        """Return q (nq,) for a pose of the root link and joint positions.

        Args:
            x: Position of the root link, m.
            y: Position of the root link, m.
            theta: Heading of the root link, rad.
            joints: Positions (rad or m) by joint name; 0 for missing ones. Mimic joints and swivels
                that follow others are computed from the given positions, including the full turns
                of continuous joints, which q does not contain.

        Raises:
            UnknownNameError: The model has no joint with a given name.
        """
        q: Array = pin.neutral(self.model)
        write_root(q, x, y, theta)
        given = {**self.locked, **(joints or {})}
        for name, position in (joints or {}).items():
            self.set_joint(q, name, position)
        for joint in self.mimics:
            if joint.mimic is not None:
                multiplier, offset = joint.mimic.multiplier, joint.mimic.offset
                followed = given.get(joint.mimic.joint, 0.0)
                self.set_joint(q, joint.name, multiplier * followed + offset)
        for name, position in follower_positions(self.drive, given).items():
            self.set_joint(q, name, position)
        return q

    def state(
        self,
        pose: Sequence[float] = (0.0, 0.0, 0.0),
        twist: Sequence[float] = (),
        *,
        joints: Mapping[str, float] | None = None,
        rates: Mapping[str, float] | None = None,
        twist_frame: str = "body",
    ) -> tuple[Array, Array]:
        """Return q (nq,) and ν (dof,) of a state given by names; :meth:`state_of` is the inverse.

        Missing entries of ν are NaN: :class:`rpctl.Controller` estimates these rates. A missing
        rate never counts as zero.

        Args:
            pose: Pose of the root link: x, y (m) and heading (rad), in the frame of the reference,
                such as map or odom; it may jump as a localisation does.
            twist: The base's quasi-velocities in the order of ``drive.base_speeds``, m/s and rad/s;
                NaN if it is left out. They are P's in the base's axes, as in odometry messages,
                whatever the frame of the pose.
            joints: Positions by joint name, rad or m, as in :meth:`configuration`.
            rates: Rates of the arm's joints by name, rad/s or m/s; NaN for missing ones.
            twist_frame: ``"body"``, or ``"world"`` if the twist begins with P's velocity (v_x, v_y)
                along the axes of the pose's frame, followed by the remaining body entries.

        Raises:
            RpctlError: There are too few or too many numbers, a position is not finite, or a rate
                is infinite.
            UnknownNameError: A joint is not known.
        """
        speeds, rates = self.drive.base_speeds, rates or {}
        if len(pose) != 3:
            raise RpctlError(f"the pose {tuple(pose)} must be x, y in m and a heading in rad")
        given = len(speeds) + (twist_frame == "world" and "vy" not in speeds)
        if len(twist) not in (0, given):
            raise RpctlError(
                f"the twist {tuple(twist)} must be {', '.join(speeds) or 'empty'} of {self.name}"
            )
        require_known("joint of the arm", rates, self.joint_names)
        frames = ("body", "world")[: 1 + (self.drive.type != "steered")]
        require_known(f"twist_frame of {self.drive.type} bases", [twist_frame], frames)
        if twist_frame == "world" and twist:
            turned = complex(*twist[:2]) * cmath.rect(1.0, -(pose[2] + self.drive.heading))
            ahead = (turned.real, turned.imag) if "vy" in speeds else (turned.real,)
            twist = (*ahead, *twist[2:])
        base = tuple(twist) or (math.nan,) * len(speeds)
        nu = np.array([*base, *(rates.get(name, math.nan) for name in self.joint_names)])
        x, y, theta = pose
        q = self.configuration(x, y, theta, joints=joints)
        if not np.isfinite(q).all() or np.isinf(nu).any():
            raise RpctlError("the state has numbers that are not finite; give finite ones")
        return q, nu

    def state_of(self, q: Array, nu: Array) -> NamedState:
        """Return the state (q (nq,), ν (dof,)) by names, the inverse of :meth:`state`."""
        count = len(self.drive.base_speeds)
        positions = {name: self.joint_position(q, name) for name in self.moving_joint_names}
        rates = dict(zip(self.joint_names, nu[count:].tolist(), strict=True))
        return NamedState(read_root(q), tuple(nu[:count].tolist()), positions, rates)

    def set_joint(self, q: Array, joint: str, position: float) -> None:
        """Set a joint's position in q, in place.

        Args:
            q: Configuration (nq,).
            joint: Name of the joint.
            position: rad or m.

        Raises:
            UnknownNameError: The model has no such joint.
        """
        require_known("joint", [joint], self.entries)
        self.entries[joint].write(q, position)

    def joint_position(self, q: Array, joint: str) -> float:
        """Return a joint's position (rad or m) in q (nq,), or its locked position."""
        return self.locked[joint] if joint in self.locked else self.entries[joint].read(q)

    def joint_positions(self, q: Array) -> Array:
        """Return the arm's positions (n_joints,), rad or m; continuous joints in (−π, π]."""
        return np.array([self.joint_position(q, joint.name) for joint in self.joints])

    @cached_property
    def point_velocity(self) -> Array:
        """The map (3, 3) from the root link's velocity in its own axes to the twist of P.

        The twist is the speed of P along the heading and to its left (m/s), and the turning rate
        (rad/s).
        """
        px, py = self.drive.point
        cos, sin = math.cos(self.drive.heading), math.sin(self.drive.heading)
        return np.array(
            [[cos, sin, sin * px - cos * py], [-sin, cos, cos * px + sin * py], [0.0, 0.0, 1.0]]
        )

    @cached_property
    def root_velocity(self) -> Array:
        """The map (3, 3) from the twist of P to the root link's velocity in its own axes."""
        return np.asarray(np.linalg.inv(self.point_velocity), dtype=float)

    def base_pose(self, q: Array) -> Array:
        """Return the pose (x, y, θ) of P in the world, θ of the forward direction; m, rad."""
        cos, sin = q[2], q[3]
        px, py = self.drive.point
        theta = math.atan2(sin, cos) + self.drive.heading
        return np.array([q[0] + cos * px - sin * py, q[1] + sin * px + cos * py, theta])

    def base_poses(self, q: Array) -> Array:
        """Return the poses (K, 3) of P at q (K, nq), as :meth:`base_pose` does for one."""
        x, y, cos, sin = q[:, :BASE_NQ].T
        px, py = self.drive.point
        heading = np.arctan2(sin, cos) + self.drive.heading
        return np.column_stack([x + cos * px - sin * py, y + sin * px + cos * py, heading])

    def level_place(self, q: Array) -> list[float]:
        """Return the planar pose of the root link: x and y (m), cosine and sine of its heading."""
        found: list[float] = q[:BASE_NQ].tolist()
        return found

    def root_pose(self, pose: Array) -> tuple[float, float, float]:
        """Return the root link's pose (x, y, θ) for that of P (3,): :meth:`base_pose` inverted."""
        theta = pose[2] - self.drive.heading
        cos, sin = math.cos(theta), math.sin(theta)
        px, py = self.drive.point
        return pose[0] - cos * px + sin * py, pose[1] - sin * px - cos * py, theta

    def configuration_at(self, pose: Array, joints: Array, steering: Array | None = None) -> Array:
        """Return q (nq,) for a pose of P and positions of the joints.

        Args:
            pose: x, y (m) and heading (rad) of P.
            joints: Positions of the arm (n_joints,), rad or m.
            steering: Positions of the steered joints (n_steered,), rad; None for 0.
        """
        positions = dict(zip(self.joint_names, joints, strict=True))
        if steering is not None:
            names = (swivel.joint for swivel in self.drive.steered)
            positions |= dict(zip(names, steering, strict=True))
        return self.configuration(*self.root_pose(pose), joints=positions)

    def random_configuration(self, rng: np.random.Generator) -> Array:
        """Return a random q (nq,): base within ±10 m along x and y, joints within their limits.

        Unlimited revolute joints are drawn from (−π, π), unlimited prismatic ones from ±1 m.
        Steering angles keep away from those at which the motion is not unique.
        """
        x, y = rng.uniform(-10.0, 10.0, 2)
        positions = {name: self._draw(name, rng) for name in self.moving_joint_names}
        while not is_regular(self.drive, positions):
            positions |= {s.joint: self._draw(s.joint, rng) for s in self.drive.steered}
        return self.configuration(x, y, float(rng.uniform(-math.pi, math.pi)), joints=positions)

    def _draw(self, name: str, rng: np.random.Generator) -> float:
        """Return a random position of a joint within its limits."""
        joint = self.description.joint[name]
        reach = 1.0 if joint.kind == "prismatic" else math.pi
        return float(rng.uniform(*joint.span(reach)))

    @cached_property
    def home(self) -> Array:
        """Home posture of the arm (n_joints,), rad or m: as given, or 0, well inside the limits."""
        given = self.loaded_with.home
        positions = given if isinstance(given, Mapping) else {}
        return read_only([positions.get(joint.name, _home(joint)) for joint in self.joints])


def _turn(pose: Array, axis: Array, cos: Array, sin: Array) -> None:
    """Turn poses (3, 4, K) in place about an axis (3,) of theirs, by cosines and sines (K,)."""
    skew = np.cross(np.eye(3), axis)
    across = np.einsum("ijk,jl->ilk", pose[:, :3], skew)
    pose[:, :3] += sin * across + (1.0 - cos) * np.einsum("ijk,jl->ilk", across, skew)


def _home(joint: Joint) -> float:
    if math.isinf(joint.lower) or math.isinf(joint.upper):
        return joint.nearest_to_zero
    margin = HOME_MARGIN * (joint.upper - joint.lower)
    return float(np.clip(0.0, joint.lower + margin, joint.upper - margin))


class NamedState(NamedTuple):
    """A robot's pose and speeds: what :meth:`Robot.state` takes and :meth:`Robot.state_of` gives.

    Attributes:
        pose: Of the root link: x and y in m, heading in rad.
        twist: The base's quasi-velocities in the order of ``robot.drive.base_speeds``; m/s, rad/s.
        joints: Position of each moving joint by name, wheels included; rad or m.
        rates: Rate of each of the arm's joints by name; rad/s or m/s.
    """

    pose: tuple[float, float, float]
    twist: tuple[float, ...]
    joints: dict[str, float]
    rates: dict[str, float]
