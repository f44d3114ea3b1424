"""What a controller follows while it runs: its reference, smooth ways over to it, and stops."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rpctl.arrays import Array
from rpctl.control.error import joint_errors
from rpctl.control.sampling import MeasuredSample
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.reference.paths import smooth_step

PACE_TIME = 1.0  # s in which a reference comes to its pace, and a robot that pauses to a stop
NEAR = 0.2  # m: a robot that is farther off leaves its reference, if it was as near as half of it
SLOWEST = 1.0 / 16.0  # of its pace: no reference gets slower that a robot leaves
CALM = 1.5  # s: half of how long a robot follows what was slowed before that runs faster again
STEEPEST = 15.0 / 8.0  # of the way that C² steps take, over its mean


def step_within(t: float, duration: float) -> tuple[float, float, float]:
    """Return a step from 0 to 1 within a duration (s), and its first two derivatives, at t (s)."""
    if t >= duration:
        return 1.0, 0.0, 0.0
    rise = smooth_step(max(t / duration, 0.0))
    return rise.value, rise.slope / duration, rise.bend / duration**2


def smooth_pace(t: float, first: float, last: float) -> tuple[float, float, float]:
    """Return for how long a reference has run at t (s), its pace and the rate of that.

    Args:
        first: Pace at t = 0 and before.
        last: Pace from ``PACE_TIME`` on.
    """
    share, rate, _ = step_within(t, PACE_TIME)
    area = smooth_step(min(max(t / PACE_TIME, 0.0), 1.0)).area
    passed = PACE_TIME * area + max(t - PACE_TIME, 0.0)
    change = last - first
    return first * t + change * passed, first + change * share, change * rate


@dataclass(frozen=True, eq=False)
class Transition:
    """A reference with a pace of its own, and where the robot was beside it, which fades.

    Base and arm are given the reference plus an offset d(t) that falls from what it was to nothing
    along a step of two continuous derivatives. The arm is given its rates as well. A base that
    rolls cannot follow those of its offset, and sees a small error instead.

    Attributes:
        reference: What it leads to.
        since: When it begins, s.
        at: The reference's time then, s.
        first: Its pace then; 0 stands still, 1 is as fast as time.
        last: Its pace ``PACE_TIME`` later.
        offset: d then (3 + n_joints,): m, m, rad, then rad or m.
        fading: How long d takes to fade, s.
    """

    reference: Reference
    since: float
    at: float
    first: float
    last: float
    offset: Array
    fading: float

    def time(self, t: float) -> tuple[float, float]:
        """Return the reference's time (s) at a time (s), and its pace."""
        passed, pace, _ = smooth_pace(t - self.since, self.first, self.last)
        return self.at + passed, pace

    def left(self, t: float) -> tuple[Array, Array, Array]:
        """Return the offset at a time (s) and its first two derivatives, each (3 + n_joints,)."""
        share, *rates = step_within(t - self.since, self.fading)
        rate, acceleration = (-each * self.offset for each in rates)
        return (1.0 - share) * self.offset, rate, acceleration

    def __call__(self, t: float) -> ReferenceState:
        """Return the state at a time (s)."""
        passed, pace, rate = smooth_pace(t - self.since, self.first, self.last)
        state = self.reference(self.at + passed)
        d, d_dot, d_ddot = self.left(t)
        toward = state.direction
        if toward is not None:
            one, two, three = np.asarray(toward)
            toward = np.array([one, pace * two, pace**2 * three + rate * two])
        return ReferenceState(
            state.pose + d[:3],
            pace * state.twist,
            pace**2 * state.twist_dot + rate * state.twist,
            state.joints + d[3:],
            pace * state.joint_rates + d_dot[3:],
            pace**2 * state.joint_accelerations + rate * state.joint_rates + d_ddot[3:],
            toward,
        )


@dataclass(frozen=True, eq=False)
class Stop:
    """A reference that comes to rest within ``PACE_TIME``, from where the robot is.

    The base goes on along the arc that it is on, and slows down.

    Attributes:
        since: When, s.
        pose: Of P then (3,).
        twist: Of the robot then (3,), as a reference has it.
        joints: The arm's positions then (n_joints,).
        rates: Their rates (n_joints,).
    """

    since: float
    pose: Array
    twist: Array
    joints: Array
    rates: Array

    def __call__(self, t: float) -> ReferenceState:
        """Return the state at a time (s)."""
        passed, pace, rate = smooth_pace(t - self.since, 1.0, 0.0)
        turned = passed * self.twist[2]
        chord = complex(*self.twist[:2]) * passed * np.sinc(turned / (2.0 * np.pi))
        step = chord * np.exp(1j * (self.pose[2] + 0.5 * turned))
        return ReferenceState(
            self.pose + np.array([step.real, step.imag, turned]),
            pace * self.twist,
            rate * self.twist,
            self.joints + passed * self.rates,
            pace * self.rates,
            rate * self.rates,
        )


class Following:
    """What the laws of one controller are given to follow.

    Args:
        dynamics: The robot's dynamics, as far as the controller knows them.
        reference: What is to be followed in the end.
        fading: How fast an error that comes at once is let in, m/s and rad/s.

    Attributes:
        reference: What is to be followed in the end.
        now: What the laws are given: the same, a way over to it, or a stop.
        pace: How fast the reference's time runs, or will soon, of time.
        slowest: The least that was.
    """

    def __init__(self, dynamics: ReducedDynamics, reference: Reference, fading: float) -> None:
        self._dynamics, self._fading = dynamics, fading
        self.reference = self.now = reference
        self._stands, self._stands_at = False, 0.0  # the reference's time, while it stands
        self.pace = self.slowest = 1.0
        self._paced_at, self._calm = -math.inf, CALM
        self._left_by = math.inf  # m: how far the robot was off when it left; 0 if it is near

    def stand(self, t: float) -> None:
        """Let the reference's time stand from a time (s) on."""
        self._stands_at, self._stands = self._time(max(t, 0.0))[0], True
        self.now = self.reference

    def stop(self, sample: MeasuredSample) -> None:
        """Give the laws a stop from where the robot is; the reference's time stands already."""
        robot, (t, q, nu) = self._dynamics.robot, sample
        rates = nu[robot.dof - len(robot.joints) :]
        self.now = Stop(t, robot.base_pose(q), self._twist(sample), robot.joint_positions(q), rates)

    def go_on(self, t: float, sample: MeasuredSample | None) -> None:
        """Go on from where the robot is, about as fast, from the time at which the reference is.

        Args:
            t: Time, s.
            sample: Where the robot is, if that is known.
        """
        at, _ = self._time(t)
        pace = 0.0 if sample is None else self._pace(at, sample)
        self._go(t, at, pace, self._gap(at, sample))

    def change(self, reference: Reference, t: float, sample: MeasuredSample | None) -> None:
        """Follow another reference from its time 0 on, about as fast as the robot is.

        Where the reference stands, the other one waits at its time 0.

        Args:
            reference: What is to be followed in the end.
            t: Time, s.
            sample: Where the robot is, if that is known.
        """
        self.reference, self._stands_at = reference, 0.0
        if not self._stands:
            pace = 1.0 if sample is None else self._pace(0.0, sample)
            self._go(t, 0.0, pace, self._gap(0.0, sample))

    def jumped(self, before: MeasuredSample, after: MeasuredSample) -> None:
        """Let what is followed jump along with a measured pose, and come back."""
        robot = self._dynamics.robot
        jump = robot.base_pose(after.q) - robot.base_pose(before.q)
        offset = np.array([*jump, *[0.0] * len(robot.joints)])
        offset[2] = math.remainder(offset[2], math.tau)
        if isinstance(self.now, Stop):  # the robot stands where it stood
            self.now = replace(self.now, pose=self.now.pose + offset[:3])
            return
        self._move(after.t, offset)

    def keep_up(self, t: float, error: float) -> bool:
        """Let a reference run slower that the robot leaves, and faster again once it follows.

        Return whether it is slowed at this sample.

        A robot that was near and is not any more has its reference at half the pace a second later,
        and so on until its error falls or it is near. Then it gets a quarter more each time that it
        has followed for ``CALM``, which lasts twice as long each time that it has left again.

        Args:
            t: Time, s.
            error: Distance from what is followed, m.
        """
        self._left_by = 0.0 if error < 0.5 * NEAR else self._left_by
        far = NEAR if self.pace == 1.0 else 0.5 * NEAR
        leaves, waits = error > max(far, 0.95 * self._left_by), t - self._paced_at
        if leaves and waits >= PACE_TIME:
            self._calm *= 1.0 if self._left_by else 2.0
            self._left_by, self.pace = error, max(0.5 * self.pace, SLOWEST)
        elif error < far and self.pace < 1.0 and waits >= self._calm:
            self.pace = min(1.25 * self.pace, 1.0)
        else:
            return False
        self._paced_at, self.slowest = t, min(self.slowest, self.pace)
        self._move(t, np.zeros(3 + len(self._dynamics.robot.joints)))
        return leaves and self.pace > SLOWEST

    def _move(self, t: float, offset: Array) -> None:
        """Go on from an offset more (3 + n_joints,) beside what is followed at a time (s)."""
        if isinstance(self.now, Transition):
            offset = offset + self.now.left(t)[0]
        self._go(t, *self._time(t), offset)

    def _go(self, t: float, at: float, pace: float, offset: Array) -> None:
        way = max(math.hypot(*offset[:2]), float(np.abs(offset[2:]).max()))
        fading, self._stands = STEEPEST * way / self._fading, False
        self.now = Transition(self.reference, t, at, pace, self.pace, offset, fading)

    def _time(self, t: float) -> tuple[float, float]:
        """Return the reference's time (s) at a time (s), and its pace."""
        if self._stands:
            return self._stands_at, 0.0
        return self.now.time(t) if isinstance(self.now, Transition) else (t, 1.0)

    def _pace(self, at: float, sample: MeasuredSample) -> float:
        """Return how fast the robot is on the reference at its time ``at``, from 0 to 1."""
        n, state = len(self._dynamics.robot.joints), self.reference(at)
        own = np.concatenate([self._twist(sample), sample.nu[len(sample.nu) - n :]])
        wanted = np.concatenate([state.twist, state.joint_rates])
        square = float(wanted @ wanted)
        return min(max(float(own @ wanted) / square, 0.0), 1.0) if square else 1.0

    def _gap(self, at: float, sample: MeasuredSample | None) -> Array:
        """Return where the robot is beside the reference at its time ``at`` (3 + n_joints,)."""
        robot = self._dynamics.robot
        if sample is None:
            return np.zeros(3 + len(robot.joints))
        state = self.reference(at)
        joints = joint_errors(robot, robot.joint_positions(sample.q), state.joints)
        base = robot.base_pose(sample.q) - state.pose
        return np.array([*base[:2], math.remainder(base[2], math.tau), *joints])

    def _twist(self, sample: MeasuredSample) -> Array:
        """Return the twist (3,) of P, as a reference has it."""
        drive = self._dynamics.robot.drive
        if not drive.base_speeds:
            return np.zeros(3)
        return self._dynamics.twist(*sample[1:]) * [1.0, 0.0 if drive.has_axle else 1.0, 1.0]
