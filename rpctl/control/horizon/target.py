"""Targets of the horizon law: the reference ahead, its time scaling, and detours round obstacles.

A reference that would tip the robot or exceed its limits is followed along the same path more
slowly, and the lag is made up later.
"""

from __future__ import annotations

import math as numbers
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from rpctl import math
from rpctl.arrays import Array
from rpctl.control.horizon.forces import ForceModel
from rpctl.control.horizon.prediction import Model, PredictedMotion
from rpctl.control.horizon.qp import LinearRows
from rpctl.control.horizon.settings import Bounds
from rpctl.control.obstacles import Obstacle
from rpctl.drive.steering import trailing_positions
from rpctl.kernels.sheet import Evaluator
from rpctl.reference.motion import (
    Reference,
    ReferenceState,
    direction,
    reference_rates,
    steering,
    trailing,
)
from rpctl.robot.model import BASE_NV, Robot

TIME_DIGITS = 11  # of a time in s: two sums that mean the same instant differ by rounding
MAX_REMEMBERED = 4000  # instants: 20 steps of .1 s at a period of .5 ms
LIMIT_FRACTION = 0.9  # of the margins at rest: the remainder is left for correcting errors
MAX_PACE = 1.5  # largest pace, while a lag is made up


class ReferencePoint(NamedTuple):
    """The reference at one instant, in the robot's quasi-velocities."""

    state: ReferenceState
    nu: Array  # (dof,)
    nu_dot: Array  # (dof,)
    angles: Array  # (n_steered,) rad, of the steered joints


class Preview:
    """Reads the reference of one robot, as a function of time.

    Args:
        reference: The reference; None: :meth:`follow` sets it.
    """

    def __init__(self, robot: Robot, reference: Reference | None = None) -> None:
        self._robot, self._reference = robot, reference
        self._points = lru_cache(MAX_REMEMBERED)(self._read)

    def follow(self, reference: Reference) -> bool:
        """Set the reference that is read from now on; return whether it is another."""
        if reference is self._reference:
            return False
        self._reference = reference
        self._points.cache_clear()
        return True

    def __call__(self, t: float) -> ReferencePoint:
        """Return the reference at a time (s), to 1e-11 s.

        Raises:
            ValueError: There is no reference yet.
        """
        return self._points(round(t, TIME_DIGITS))

    def _read(self, t: float) -> ReferencePoint:
        if self._reference is None:
            raise ValueError("no reference to read")
        state = self._reference(t)
        angles = steering(self._robot, state)[0]
        return ReferencePoint(state, *reference_rates(self._robot, state), angles)


class PaceLimit(NamedTuple):
    """What an instant of the reference asks of the robot."""

    pace: float  # the largest at which it can be followed
    speed: float  # of the base, m/s


class PaceLimits:
    """The largest pace at multiples of the prediction's step, each computed once.

    Args:
        forces: Efforts and ground reactions; its contacts become those of the reference's posture.
    """

    def __init__(self, model: Model, forces: ForceModel, bounds: Bounds, preview: Preview) -> None:
        self._model, self._forces, self._preview = model, forces, preview
        self._rates = bounds.rates(model.robot)
        self._limits = lru_cache(MAX_REMEMBERED)(self._limit)

    def forget(self) -> None:
        """Forget the limits: they were of another reference."""
        self._limits.cache_clear()

    def between(self, first: int, last: int) -> list[PaceLimit]:
        """Return the limits at these multiples of the step, both included."""
        return [self._limits(index) for index in range(first, last + 1)]

    def _limit(self, index: int) -> PaceLimit:
        point, model = self._preview(index * self._model.dt), self._model
        posture = np.concatenate([point.angles, point.state.joints])
        q = model.configuration(posture, casters=trailing(model.robot, point.state))
        self._forces.update(self._with_idle_casters(q, point))
        still = np.zeros_like(point.nu)
        rest = -self._forces.foreseen(q, still, still)[:, 0]  # margins, of each limit
        used = rest + self._forces.foreseen(q, point.nu, point.nu_dot)[:, 0]
        limiting = (rest > 0.0) & (used > 0.0)
        square = (LIMIT_FRACTION * rest[limiting] / used[limiting]).min(initial=MAX_PACE**2)
        B = model.dynamics.actuation(q)
        limited, limit_values = self._rates
        speed = (np.abs(B.T[limited] @ point.nu) / limit_values).max(initial=1.0 / MAX_PACE)
        return PaceLimit(
            min(numbers.sqrt(square), 1.0 / float(speed)), numbers.hypot(*point.state.twist[:2])
        )

    def _with_idle_casters(self, q: Array, point: ReferencePoint) -> Array:
        """Return q (nq,) with the casters that nothing drives trailing behind the motion."""
        robot = self._model.robot
        idle = robot.drive.idle_casters
        if not idle:
            return q
        q, twist = q.copy(), robot.root_velocity @ direction(point.state)[0]
        positions = trailing_positions(robot.drive, twist, idle).tolist()
        for swivel, position in zip(idle, positions, strict=True):
            robot.set_joint(q, swivel.joint, position)
        return q


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


class Sample(NamedTuple):
    """The predicted motion and its target, about which a QP is linearised."""

    motion: PredictedMotion
    target: Target
    end_effector: list[LinearRows]  # its positions at some stages, m; none without one


class TimeScaler:
    """Scales the reference's time so that the robot can keep up with it.

    The largest admissible pace is known ahead (:class:`~rpctl.control.horizon.target.PaceLimits`),
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
        first = numbers.floor(self._reference_time / model.dt)
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
            pace = min(pace, numbers.sqrt(square))
            times[k], paces[k] = at, pace
            at, pace = at + pace * model.dt, pace + change * model.dt
        self._pace = float(paces[0])
        return TimeScaling(times, paces)

    def _time_within_leash(self, read: Preview, pose: Array, latest: float) -> float:
        """Return the last time up to ``latest`` at which the base is within the leash."""
        at = latest
        for _ in range(NEWTON_STEPS):
            state = read(at).state
            cos, sin = numbers.cos(state.pose[2]), numbers.sin(state.pose[2])
            vx, vy, _ = state.twist
            speed = numbers.hypot(vx, vy)
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
    near = np.unwrap(np.vstack([joints[:count], angles]), axis=0, period=numbers.pi)[1:]
    if not model.robot.drive.has_axle:  # the base's speed is the first wheel's, along its heading
        nu[:, 0] *= np.where(np.rint((near[:, 0] - angles[:, 0]) / numbers.pi) % 2.0, -1.0, 1.0)
    return Target(pose, np.hstack([near, arm]), nu)


class EndEffectorKinematics:
    """The end effector along predicted motions.

    Args:
        stages: Stages at which the end effector is computed.
    """

    def __init__(self, model: Model, stages: list[int]) -> None:
        pose, joints = math.SX.sym("pose", BASE_NV), math.SX.sym("joints", len(model.joints))
        symbols, at = model.symbolic, math.vertcat(pose, joints)
        q = symbols.configuration(pose, model.named(joints))
        _, position = symbols.placement(q, str(model.robot.end_effector))
        jacobian = math.densify(math.jacobian(position, at).T)
        function = math.Function("end_effector", [at], math.cse([position, jacobian]))
        self._after, self._run = [k + 1 for k in stages], Evaluator(function.map(len(stages)))
        self._unknowns = model.pose_and_joints(stages)

    def __call__(self, motion: PredictedMotion | Target) -> LinearRows:
        """Return the positions (K, 3), m, along a motion, and their derivatives."""
        at = np.hstack([motion.pose[self._after], motion.joints[self._after]])
        positions, jacobian = self._run(at.ravel())
        count = len(at)
        return LinearRows(
            self._unknowns, positions.reshape(count, 3), jacobian.reshape(count, 3, -1)
        )


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
        back = np.where(target.nu[:, 0] < 0.0, numbers.pi, 0.0)
        pose[:, 2] = np.where(changed, np.arctan2(ahead[:, 1], ahead[:, 0]) + back, pose[:, 2])
    return target._replace(pose=pose)


def arm_detour(goals: Array, start: Array, obstacles: tuple[Obstacle, ...], radius: float) -> Array:
    """Return the end effector's goals (K, 3) with those behind an obstacle replaced by a detour.

    Args:
        start: Present position of the end effector, m.
        obstacles: Obstacles of the end effector.
        radius: Radius of the end effector, m.
    """
    goals = goals.copy()
    for obstacle in obstacles:
        goals[:, :2] = obstacle.around(start[:2], goals[:, :2], radius)
    return goals
