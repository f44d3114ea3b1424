"""Messages of ROS as samples of a robot, and commands as messages; it imports nothing of ROS.

It reads and writes the fields of messages alone: of ``sensor_msgs/JointState``,
``nav_msgs/Odometry``, ``geometry_msgs/TransformStamped``, ``geometry_msgs/Twist``,
``std_msgs/Float64MultiArray`` and ``trajectory_msgs/JointTrajectory``.
"""

from __future__ import annotations

import math
from collections import Counter
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.controller import ControllerOutput
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SingularBasisError
from rpctl.robot.model import BASE_NV, Robot

SECOND = 1_000_000_000  # ns
MAX_AGE = 0.1  # s: older readings make a bad sample


class JointReading(NamedTuple):
    """What is known of a joint: rad or m, and its rate, NaN as long as nobody knows it."""

    stamp: int  # ns
    position: float
    rate: float


class PlaceReading(NamedTuple):
    """Where the root link was, and how it moved there in its own axes; NaN where unknown."""

    stamp: int  # ns
    pose: Array  # (3,) x, y in m, heading in rad
    twist: Array  # (3,) m/s, m/s, rad/s


class Sample(NamedTuple):
    """What :meth:`rpctl.Controller.step` takes."""

    t: float  # s
    q: Array  # (nq,)
    nu: Array  # (dof,)


class Readings:
    """The latest readings of one robot, whatever the order in which they came.

    Attributes:
        refused: How many messages, and joints of messages, were not used, by reason.

    Args:
        robot: The robot.
        frame: In which poses are given, as of the reference.
        base_frame: The frame that is located; None: the root link.
        max_age: Of readings, s; older ones make a bad sample, which the controller answers.
    """

    def __init__(
        self,
        robot: Robot,
        frame: str = "odom",
        base_frame: str | None = None,
        max_age: float = MAX_AGE,
    ) -> None:
        self.robot, self.frame = robot, frame
        self.base_frame = base_frame or robot.description.root
        self.refused: Counter[str] = Counter()
        self._dynamics, self._max_age = ReducedDynamics(robot), max_age
        swivels = (*robot.drive.steered, *robot.drive.powered_casters)
        self._needed = {*robot.joint_names, *(swivel.joint for swivel in swivels)}
        self._joints: dict[str, JointReading] = {}
        self._place: PlaceReading | None = None
        self._origin: int | None = None  # ns, of the first sample

    def take_joints(self, message: Any) -> None:
        """Take a JointState: some joints in any order; rates it lacks are differences in time."""
        stamp, rates = nanoseconds(message.header.stamp), message.velocity
        if len(rates) != len(message.name):
            rates = [math.nan] * len(message.name)
        for name, position, rate in zip(message.name, message.position, rates, strict=False):
            before = self._joints.get(name)
            if name not in self.robot.entries:
                continue  # another robot's, or a locked joint
            if not math.isfinite(position):
                self.refused[f"a position of {name} that is not finite"] += 1
            elif before is not None and stamp <= before.stamp:
                self.refused[f"a position of {name} that is no newer than the one before"] += 1
            else:
                known = rate if math.isfinite(rate) else self._rate(name, before, stamp, position)
                self._joints[name] = JointReading(stamp, position, known)

    def _rate(self, name: str, before: JointReading | None, stamp: int, position: float) -> float:
        """Return a joint's mean rate since the reading before; NaN without one."""
        if before is None:
            return math.nan
        way = position - before.position
        if self.robot.entries[name].is_pair:
            way = math.remainder(way, math.tau)
        return way * SECOND / (stamp - before.stamp)

    def take_odometry(self, message: Any) -> None:
        """Take an Odometry: the pose in ``frame``, and the twist in the base's own axes."""
        pose, twist = message.pose.pose, message.twist.twist
        speeds = np.array([twist.linear.x, twist.linear.y, twist.angular.z])
        self._take_place(message, pose.position, pose.orientation, speeds)

    def take_transform(self, message: Any) -> None:
        """Take a TransformStamped; where the base moves, the joints have to tell."""
        where = message.transform
        self._take_place(message, where.translation, where.rotation, np.full(BASE_NV, math.nan))

    def _take_place(self, message: Any, at: Any, turned: Any, twist: Array) -> None:
        frames = message.header.frame_id, message.child_frame_id
        pose = np.array([at.x, at.y, yaw(turned)])
        stamp, before = nanoseconds(message.header.stamp), self._place
        if frames != (self.frame, self.base_frame):
            self.refused[f"a pose of {frames[1]} in {frames[0]}"] += 1
        elif not np.isfinite(pose).all():
            self.refused["a pose that is not finite"] += 1
        elif before is not None and stamp <= before.stamp:
            self.refused["a pose that is no newer than the one before"] += 1
        else:
            self._place = PlaceReading(stamp, pose, twist)

    def missing(self) -> tuple[str, ...]:
        """Return what was never read, and a sample needs."""
        place = () if self._place else (f"the pose of {self.base_frame} in {self.frame}",)
        return (*place, *sorted(self._needed - self._joints.keys()))

    def sample(self, now: int) -> Sample | None:
        """Return the state at a time (ns); None as long as something is missing.

        The pose is moved on from its stamp by the base's twist. Where readings are too old, or
        rates unknown, the sample holds NaN: the controller holds, then stops.
        """
        if self._place is None or self.missing():
            return None
        self._origin = now if self._origin is None else self._origin
        t, place = (now - self._origin) / SECOND, self._place
        joints = {name: joint.position for name, joint in self._joints.items()}
        q = self.robot.configuration(*place.pose, joints=joints)
        stamps = [place.stamp, *(self._joints[name].stamp for name in self._needed)]
        nu = np.full(self.robot.dof, math.nan)
        if now - min(stamps) <= self._max_age * SECOND:
            with suppress(SingularBasisError):
                nu = self._speeds(self._dynamics.basis(q), place.twist)
        return Sample(t, self._moved(q, nu, max(now - place.stamp, 0) / SECOND), nu)

    def _moved(self, q: Array, nu: Array, time: float) -> Array:
        """Return q (nq,) with the base moved on at a constant twist; NaN where ν is."""
        if not np.isfinite(nu).all():
            return np.full_like(q, math.nan)
        way = np.zeros(self.robot.nv)
        way[:BASE_NV] = time * (self._dynamics.basis(q)[:BASE_NV] @ nu)
        return self._dynamics.integrate(q, way)

    def _speeds(self, S: Array, twist: Array) -> Array:
        """Return ν (dof,): by the rates of driven joints, and the base's twist where they lack."""
        model, rows, values = self.robot.model, [], []
        for name in self.robot.actuators:
            joint = self._joints.get(name)
            if joint is not None and math.isfinite(joint.rate):
                rows.append(S[model.joints[model.getJointId(name)].idx_v])
                values.append(joint.rate)
        if np.linalg.matrix_rank(np.reshape(rows, (-1, S.shape[1]))) < S.shape[1]:
            rows, values = [*S[:BASE_NV], *rows], [*twist, *values]
        if not np.isfinite(values).all():
            return np.full(S.shape[1], math.nan)
        nu, _, rank, _ = np.linalg.lstsq(np.array(rows), np.array(values), rcond=None)
        return nu if rank == S.shape[1] else np.full_like(nu, math.nan)


def fill_efforts(message: Any, sent: ControllerOutput) -> None:
    """Put efforts into a Float64MultiArray, in the order of the robot's actuators."""
    message.data = sent.efforts.tolist()


def fill_twist(message: Any, dynamics: ReducedDynamics, q: Array, speeds: Array) -> None:
    """Put the root link's twist into a Twist.

    Args:
        message: The message.
        dynamics: The robot's dynamics.
        q: Configuration (nq,).
        speeds: Quasi-velocities (dof,).
    """
    vx, vy, omega = (dynamics.basis(q)[:BASE_NV] @ speeds).tolist()
    message.linear.x, message.linear.y, message.angular.z = vx, vy, omega


def fill_trajectory(
    message: Any, point: Any, robot: Robot, q: Array, speeds: Array, period: float
) -> None:
    """Put where the arm shall be a period (s) on, and its rates, into a JointTrajectory.

    Args:
        message: The message.
        point: A JointTrajectoryPoint.
        robot: The robot.
        q: Configuration (nq,).
        speeds: Quasi-velocities (dof,).
        period: Control period, s.
    """
    rates = speeds[len(robot.drive.base_speeds) :]
    message.joint_names = list(robot.joint_names)
    point.positions = (robot.joint_positions(q) + period * rates).tolist()
    point.velocities = rates.tolist()
    whole, part = divmod(round(period * SECOND), SECOND)
    point.time_from_start.sec, point.time_from_start.nanosec = whole, part
    message.points = [point]


def nanoseconds(stamp: Any) -> int:
    """Return a stamp in ns, exactly."""
    return int(stamp.sec) * SECOND + int(stamp.nanosec)


def yaw(turned: Any) -> float:
    """Return the heading of a quaternion, rad."""
    x, y, z, w = turned.x, turned.y, turned.z, turned.w
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
