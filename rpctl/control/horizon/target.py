"""Targets of the horizon law: the reference ahead, its time scaling, and detours round obstacles.

A reference that would tip the robot or exceed its limits is followed along the same path more
slowly, and the lag is made up later.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from rpctl.arrays import Array
from rpctl.control.horizon.pace import MAX_PACE, PaceLimits, Preview
from rpctl.control.horizon.prediction import Model, PredictedMotion
from rpctl.control.obstacles import Obstacle

NO_LAG_S = 1e-6  # s: a lag below it is rounding
SLOW_REFERENCE_SPEED = 1e-2  # m/s: the leash does not hold a reference slower than this
NEWTON_STEPS = 3  # Newton steps to the time at which the leash is taut


class TimeScaling(NamedTuple):
    """Reference times at the ends of the N steps, and the rates of reference time there."""

    times: Array  # (N + 1,) s
    paces: Array  # (N + 1,) seconds of reference time a second


class Target(NamedTuple):
    """The reference at the start and after each of the N steps."""

    pose: Array  # (N + 1, 3) of P
    joints: Array  # (N + 1, n_joints)
    nu: Array  # (N + 1, dof)


class EndEffectorPoints(NamedTuple):
    """The end effector after some steps, with its derivatives by pose and joints."""

    positions: Array  # (K, 3) m
    goals: Array  # (K, 3) m, where it should be
    jacobian: Array  # (K, 3, 3 + n_joints), or (K, 3, n_joints) for a fixed base


class Sample(NamedTuple):
    """The predicted motion and its target, about which a QP is linearised."""

    motion: PredictedMotion
    target: Target
    end_effector: EndEffectorPoints | None


class TimeScaler:
    """Scales the reference's time so that the robot can keep up with it.

    The largest admissible pace is known ahead (:class:`~rpctl.control.horizon.pace.PaceLimits`),
    and the pace is lowered in advance at a rate ṗ that costs at most half of the base's
    acceleration. In addition the lag keeps the base within the leash of the reference.

    Args:
        base_acceleration: Largest acceleration of the base, m/s².
        leash: Largest distance of the base behind the reference, m.
    """

    def __init__(
        self, model: Model, limits: PaceLimits, base_acceleration: float, leash: float
    ) -> None:
        self._model, self._limits = model, limits
        self._base_acceleration, self._leash = base_acceleration, leash
        self._last_call: float | None = None
        self._reference_time, self._pace = 0.0, 1.0
        self.largest_lag = 0.0

    def __call__(self, read: Preview, t: float, pose: Array) -> TimeScaling:
        """Return the reference times of the steps.

        Args:
            pose: Measured pose of P (3,).
        """
        model, latest = self._model, self.reference_time(t)
        if self._last_call is None:
            self._last_call = self._reference_time = t
        elapsed, self._last_call = t - self._last_call, t
        self._reference_time = max(
            self._time_within_leash(read, pose, latest), self._reference_time
        )
        self.largest_lag = max(self.largest_lag, t - self._reference_time)
        first = math.floor(self._reference_time / model.dt)
        ahead = self._limits.between(first, first + model.steps + 1)
        fastest = max(SLOW_REFERENCE_SPEED, max(each.speed for each in ahead))
        change = 0.5 * self._base_acceleration / fastest  # 1/s: rate at which the pace may change
        squares = [min(each.pace, MAX_PACE) ** 2 for each in ahead]
        for j in range(len(squares) - 2, -1, -1):  # in time for what comes
            squares[j] = min(squares[j], squares[j + 1] + 2.0 * change * model.dt)
        self._pace += change * elapsed
        return self._advance(t, first, squares, change)

    def reference_time(self, t: float) -> float:
        """Return the reference time (s) that a time (s) would have at the last pace."""
        if self._last_call is None:
            return t
        return min(self._reference_time + self._pace * (t - self._last_call), t)

    def _advance(self, t: float, first: int, squares: list[float], change: float) -> TimeScaling:
        """Return the reference times and paces of the N steps, never ahead of real time.

        Args:
            first: Multiple of the step from which on the limits are given.
            squares: Squares of the largest paces, linear in between.
            change: Rate at which the pace grows, 1/s.
        """
        model = self._model
        times, paces = np.empty(model.steps + 1), np.empty(model.steps + 1)
        at, pace = self._reference_time, self._pace
        for k in range(model.steps + 1):
            now = t + k * model.dt
            if at > now - NO_LAG_S:
                at, pace = now, min(pace, 1.0)
            since = min(max(at / model.dt - first, 0.0), len(squares) - 1.0)
            j = min(int(since), len(squares) - 2)
            square = squares[j] + (since - j) * (squares[j + 1] - squares[j])
            pace = min(pace, math.sqrt(square))
            times[k], paces[k] = at, pace
            at, pace = at + pace * model.dt, pace + change * model.dt
        self._pace = float(paces[0])
        return TimeScaling(times, paces)

    def _time_within_leash(self, read: Preview, pose: Array, latest: float) -> float:
        """Return the last time up to ``latest`` at which the base is within the leash."""
        at = latest
        for _ in range(NEWTON_STEPS):
            state = read(at).state
            cos, sin = math.cos(state.pose[2]), math.sin(state.pose[2])
            vx, vy, _ = state.twist
            speed = math.hypot(vx, vy)
            if speed < SLOW_REFERENCE_SPEED:
                break
            x, y = state.pose[0] - pose[0], state.pose[1] - pose[1]
            behind = (x * (cos * vx - sin * vy) + y * (sin * vx + cos * vy)) / speed
            at = min(at - (behind - self._leash) / speed, latest)
        return at


def look_ahead(model: Model, read: Preview, time_scaling: TimeScaling, joints: Array) -> Target:
    """Return the reference at the start and after each step.

    Args:
        time_scaling: Reference times and their rates.
        joints: Present positions (n_joints,). Steering angles are unwrapped modulo π from there,
            because a wheel may as well roll backwards.
    """
    count = model.steered
    points = [read(t) for t in time_scaling.times.tolist()]
    pose = np.array([point.state.pose for point in points])
    arm = np.array([point.state.joints for point in points])
    nu = time_scaling.paces[:, None] * np.array([point.nu for point in points])
    if not count:
        return Target(pose, arm, nu)
    angles = np.array([point.angles for point in points])
    near = np.unwrap(np.vstack([joints[:count], angles]), axis=0, period=math.pi)[1:]
    if not model.robot.drive.has_axle:  # the base's speed is the first wheel's, along its heading
        nu[:, 0] *= np.where(np.rint((near[:, 0] - angles[:, 0]) / math.pi) % 2.0, -1.0, 1.0)
    return Target(pose, np.hstack([near, arm]), nu)


class EndEffectorKinematics:
    """The end effector along predicted motions; holds Pinocchio's workspace.

    Args:
        stages: Stages at which the end effector is computed.
    """

    def __init__(self, model: Model, stages: list[int]) -> None:
        robot = model.robot
        self._model, self._data = model, robot.model.createData()
        self._frame = robot.model.getFrameId(robot.end_effector, pin.FrameType.BODY)
        self._after = [k + 1 for k in stages]

    def end_effector(self, motion: PredictedMotion, target: Target) -> EndEffectorPoints:
        """Return the end effector along a motion and where its target has it."""
        found = [self.jacobian(motion.pose[k], motion.joints[k]) for k in self._after]
        goals = [self.position(target.pose[k], target.joints[k]) for k in self._after]
        positions, jacobian = zip(*found, strict=True)
        return EndEffectorPoints(np.array(positions), np.array(goals), np.array(jacobian))

    def position(self, pose: Array, joints: Array) -> Array:
        """Return its position (3,), m, at a pose of P (3,) and joints (n_joints,)."""
        model = self._model.robot.model
        pin.forwardKinematics(model, self._data, self._model.configuration(joints, pose))
        return pin.updateFramePlacement(model, self._data, self._frame).translation.copy()

    def jacobian(self, pose: Array, joints: Array) -> tuple[Array, Array]:
        """Return its position (3,), m, and the derivatives by pose and joints (3, 3 + n_joints)."""
        model, data = self._model.robot.model, self._data
        pin.computeJointJacobians(model, data, self._model.configuration(joints, pose))
        position = pin.updateFramePlacement(model, data, self._frame).translation.copy()
        J = pin.getFrameJacobian(model, data, self._frame, pin.LOCAL_WORLD_ALIGNED)
        by_joints = J[:3] @ self._model.joint_columns
        if not self._model.base:
            return position, by_joints
        by_pose = np.eye(3)
        by_pose[:, 2] = pose[1] - position[1], position[0] - pose[0], 0.0
        return position, np.hstack([by_pose, by_joints])


def base_detour(
    target: Target, start: Array, obstacles: tuple[Obstacle, ...], radius: float, turns: bool
) -> Target:
    """Return the target with goals behind an obstacle replaced by a detour around it.

    Args:
        start: Present position of P (2,), m.
        radius: Radius of the base, m.
        turns: Whether the base heads where it drives, or away from there if the reference reverses.
    """
    goals = target.pose[:, :2]
    for obstacle in obstacles:
        goals = obstacle.around(start, goals, radius)
    changed = (goals != target.pose[:, :2]).any(axis=1)
    if not changed.any():
        return target
    pose = target.pose.copy()
    pose[:, :2] = goals
    if turns:
        ahead = goals - start
        back = np.where(target.nu[:, 0] < 0.0, math.pi, 0.0)
        pose[:, 2] = np.where(changed, np.arctan2(ahead[:, 1], ahead[:, 0]) + back, pose[:, 2])
    return target._replace(pose=pose)


def arm_detour(
    end_effector: EndEffectorPoints, obstacles: tuple[Obstacle, ...], radius: float
) -> EndEffectorPoints:
    """Return the end effector with goals behind an obstacle replaced by a detour around it.

    Args:
        end_effector: The end effector and its goals.
        obstacles: Obstacles of the end effector.
        radius: Radius of the end effector, m.
    """
    goals = end_effector.goals.copy()
    for obstacle in obstacles:
        goals[:, :2] = obstacle.around(end_effector.positions[0, :2], goals[:, :2], radius)
    return end_effector._replace(goals=goals)
