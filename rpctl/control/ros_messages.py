"""Messages of ROS as samples of a robot, and commands as messages; it imports nothing of ROS.

It reads and writes the fields of messages alone: of ``sensor_msgs/JointState``,
``nav_msgs/Odometry``, ``geometry_msgs/TransformStamped``, ``geometry_msgs/TwistStamped``,
``std_msgs/Float64MultiArray``, ``ackermann_msgs/AckermannDriveStamped`` and
``trajectory_msgs/JointTrajectory``.
"""

from __future__ import annotations

import math
from collections import Counter
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.control.group_commands import GroupCommand
from rpctl.control.output_groups import BASE, EFFORT, POSITION, RATES, STEERING, TWIST, WHEELS
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

SECOND = 1_000_000_000  # ns
MAX_AGE = 0.1  # s: older readings make a bad sample
NUMBERS = "std_msgs/Float64MultiArray"
COMMANDS = {  # by what a group is sent: the kind of message, and its topic
    EFFORT: (NUMBERS, "~/efforts"),
    RATES: (NUMBERS, "~/speeds"),
    WHEELS: (NUMBERS, "~/wheel_speeds"),
    TWIST: ("geometry_msgs/TwistStamped", "~/cmd_vel"),
    STEERING: ("ackermann_msgs/AckermannDriveStamped", "~/ackermann_cmd"),
    POSITION: ("trajectory_msgs/JointTrajectory", "~/joint_trajectory"),
}
POINT = "trajectory_msgs/JointTrajectoryPoint"


class Reading(NamedTuple):
    """What is known of a joint, or of the base; rates are NaN where nobody knows them."""

    stamp: int  # ns
    at: Any  # rad or m; of the base (3,): x, y in m, heading in rad
    rate: Any  # of the base (3,): its twist in its own axes


class Readings:
    """The latest readings of one robot, whatever the order in which they came.

    Attributes:
        refused: How many readings were not used, by reason.

    Args:
        robot: The robot.
        frame: In which the reference is, and poses are given; or those of the frame that odometry
            is in, as a map in which a localisation moves odom.
        base_frame: The frame that is located; None: the root link.
    """

    def __init__(self, robot: Robot, frame: str = "odom", base_frame: str | None = None) -> None:
        self.robot, self.refused = robot, Counter[str]()
        self._dynamics = ReducedDynamics(robot)
        self._frame, self._base_frame = frame, base_frame or robot.description.root
        self._carrier, self._base = frame, _pose_in(frame, self._base_frame)
        self._poses = {self._base}
        swivels = (*robot.drive.steered, *robot.drive.powered_casters)
        self._needed = {self._base, *robot.joint_names, *(swivel.joint for swivel in swivels)}
        self._known: dict[str, Reading] = {}
        self._origin: int | None = None  # ns, of the first sample

    def take_joints(self, message: Any) -> None:
        """Take a JointState: some joints in any order.

        Rates of wheels that it lacks are differences in time; those of others are not known.
        """
        count = len(message.name)
        rates = message.velocity if len(message.velocity) == count else [math.nan] * count
        for name, position, rate in zip(message.name, message.position, rates, strict=False):
            self._take(name, message, position, rate)

    def take_odometry(self, message: Any) -> None:
        """Take an Odometry: the pose in the frame, and the twist in the base's own axes."""
        pose, twist = message.pose.pose, message.twist.twist
        speeds = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        self._take_pose(message, pose.position, pose.orientation, speeds)

    def take_transforms(self, message: Any) -> None:
        """Take a TFMessage: one transform may locate the base; its motion is left to the joints."""
        for each in message.transforms:
            at, unknown = each.transform, np.full(BASE_NV, math.nan)
            self._take_pose(each, at.translation, at.rotation, unknown)

    def _take_pose(self, message: Any, at: Any, turned: Any, twist: Array) -> None:
        x, y, z, w = turned.x, turned.y, turned.z, turned.w
        yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        frame, child = message.header.frame_id, message.child_frame_id
        name = _pose_in(frame, child)
        before = self._known.get(name)
        if before is not None and np.isfinite(before.rate).all() and np.isnan(twist).all():
            return  # a transform says less than the odometry that it is from
        if child == self._base_frame:
            self._carrier = frame
        if child == self._base_frame or frame == self._frame:
            self._poses.add(name)
        self._take(name, message, np.array([at.x, at.y, yaw]), twist)
        below = self._known.get(_pose_in(self._carrier, self._base_frame))
        above = self._known.get(_pose_in(self._frame, self._carrier))
        if below is not None and above is not None:
            (x, y, yaw), (px, py, own) = above.at, below.at
            cos, sin = math.cos(yaw), math.sin(yaw)
            place = np.array([x + cos * px - sin * py, y + sin * px + cos * py, yaw + own])
            self._known[self._base] = Reading(below.stamp, place, below.rate)

    def _take(self, name: str, message: Any, at: Any, rate: Any) -> None:
        stamp = int(message.header.stamp.sec) * SECOND + int(message.header.stamp.nanosec)
        before, entry = self._known.get(name), self.robot.entries.get(name)
        if entry is None and name not in self._poses:
            self.refused[f"{name}: not asked for"] += 1
        elif not np.isfinite(at).all() or (before is not None and stamp <= before.stamp):
            self.refused[f"{name}: not finite, or no newer than before"] += 1
        else:
            rolls = entry is not None and name not in self.robot.quasi_velocities
            if before is not None and entry is not None and rolls and not math.isfinite(rate):
                way = at - before.at
                way = math.remainder(way, math.tau) if entry.is_pair else way
                rate = way * SECOND / (stamp - before.stamp)
            self._known[name] = Reading(stamp, at, rate)

    def missing(self) -> list[str]:
        """Return what was never read, and a sample needs."""
        return sorted(self._needed - self._known.keys())

    def sample(self, now: int) -> tuple[float, Array, Array] | None:
        """Return what :meth:`rpctl.Controller.step` takes at a time (ns): t in s, q and ν.

        The pose is moved on from its stamp by the base's twist, if that is known. Rates that
        nobody tells are NaN: the controller estimates them. Where readings are too old, q and ν
        are NaN: the controller holds, then stops. None as long as something is missing.
        """
        if self.missing():
            return None
        self._origin = now if self._origin is None else self._origin
        t, robot, place = (now - self._origin) / SECOND, self.robot, self._known[self._base]
        joints = {name: each.at for name, each in self._known.items() if name not in self._poses}
        x, y, theta = place.at
        q, way = robot.configuration(x, y, theta, joints=joints), np.zeros(robot.nv)
        if now - min(self._known[name].stamp for name in self._needed) <= MAX_AGE * SECOND:
            with suppress(SingularBasisError):
                nu = self._speeds(S := self._dynamics.basis(q), place.rate)
                moves = S[:BASE_NV] @ np.nan_to_num(nu)
                way[:BASE_NV] = moves * max(now - place.stamp, 0) / SECOND
                return t, self._dynamics.integrate(q, way), nu
        return t, np.full(robot.nq, math.nan), np.full(robot.dof, math.nan)

    def _speeds(self, S: Array, twist: Array) -> Array:
        """Return ν (dof,): by the rates of joints, and the base's twist where they lack.

        It is NaN of joints that tell none, and of a base of which too little is told.
        """
        robot, names = self.robot, self.robot.quasi_velocities
        known = {
            robot.velocity_index(name): self._known[name].rate
            for name in {*robot.actuators, *names} & self._known.keys()
            if math.isfinite(self._known[name].rate)
        }
        own = {k: robot.velocity_index(n) for k, n in enumerate(names) if n in robot.entries}
        nu = np.array([known.get(own.get(k, -1), math.nan) for k in range(len(names))])
        base = np.array([k not in own for k in range(len(names))], dtype=bool)
        silent = np.isnan(nu) & ~base
        for more in ({}, dict(enumerate(twist))):  # the base's rows of S are its twist
            known |= more
            rows = [i for i in known if not S[i, silent].any() and math.isfinite(known[i])]
            left = np.array([known[i] for i in rows]) - S[rows][:, ~base] @ np.nan_to_num(nu[~base])
            found, _, rank, _ = np.linalg.lstsq(S[rows][:, base], left, rcond=None)
            if rank == base.sum():
                nu[base] = found
                break
        return nu


def _pose_in(frame: str, base_frame: str) -> str:
    return f"the pose of {base_frame} in {frame}"


def commands_of(sent: ControllerOutput) -> dict[str, GroupCommand]:
    """Return what is sent by group; efforts and speeds without groups are one, "" by name."""
    efforts, speeds = ({str(k): x for k, x in enumerate(each.tolist())} for each in sent[:2])
    whole = GroupCommand(EFFORT if efforts else RATES, speeds, {}, {}, efforts)
    return dict(sent.commands) or {"": whole}


def topic(pattern: str, kind: str) -> str:
    """Return where a group is published: with its name, but for the base and a whole arm.

    Args:
        pattern: The group's.
        kind: What it is sent.
    """
    own = "".join(c for c in pattern if c.isalnum() or c == "_")
    return COMMANDS[kind][1] if own in ("", BASE) else f"{COMMANDS[kind][1]}/{own}"


def fill(message: Any, point: Any, command: GroupCommand, period: float) -> None:
    """Put what a group is sent into an empty message of its kind.

    Numbers are efforts in the order of the robot's actuators or of the group's joints, speeds in
    that of its quasi-velocities, or rates of driven wheels, and then angles of what steers.

    Args:
        point: An empty ``POINT``, for a trajectory.
        period: Time until a position is to be reached, s.
    """
    kind, speeds, positions, accelerations, efforts = command
    if kind == TWIST:
        linear, turning = message.twist.linear, message.twist.angular
        linear.x, linear.y = speeds.get("v", speeds.get("vx")), speeds.get("vy", 0.0)
        turning.z = speeds["omega"]
    elif kind == STEERING:
        drive = message.drive
        drive.speed, drive.acceleration = speeds["v"], accelerations["v"]
        drive.steering_angle = positions[STEERING]
        drive.steering_angle_velocity = abs(speeds[STEERING])
    elif kind == POSITION:
        message.joint_names, message.points = list(positions), [point]
        rows = (list(each.values()) for each in (positions, speeds, accelerations))
        point.positions, point.velocities, point.accelerations = rows
        span = divmod(round(period * SECOND), SECOND)
        point.time_from_start.sec, point.time_from_start.nanosec = span
    else:
        message.data = [*efforts.values(), *speeds.values(), *positions.values()]
