"""The horizon law on robots that lean: their efforts over the next second, before a bend comes.

About the steady motions that its reference asks for one after the other, the robot is linear in

    x = (P ahead of, to the left of and turned from its reference; tilt, steering, arm; ν),

less the steady motion's, and in its efforts less the steady motion's. Where the steady motion
changes, that it is not the robot's own is a drift d = −ẋ_s that is known ahead: so the robot leans
before it turns, and before it speeds up. The cost is that of
:class:`~rpctl.control.balance.Balance`; the cost beyond the horizon is the Riccati equation's, of
the last step's motion going on for ever. So where no bound binds and the reference is steady, this
is that equation's regulator.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Annotated, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.balance import LATENESS_S, Balance, cost_to_go
from rpctl.control.error import base_error
from rpctl.control.horizon.planner import Asked, Planned
from rpctl.control.horizon.regulation import Box, Regulated, Regulator, Steps
from rpctl.control.steady_motion import ERRORS, Posture, sampled
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, Range, Record, Setting
from rpctl.reference.motion import Reference, ReferenceState

STRIDE = 5  # steps between motions that are linearised exactly
DIGITS = 9  # of speeds and positions: motions that are the same to that are one
MAX_REMEMBERED = 256  # of them, and of steps: those of a horizon and more
SLOW, FORGETS = 0.1, 0.05  # m/s, 1/s: beside a reference that stands nothing brings a base back
TOLD = 15  # steps of a plan that its follower gets: until then it has a better one
REACH = STRIDE + 2  # steps of the reference that are read beyond a plan's end
NOTHING = Regulated(*np.empty((3, 0)))
LEASH = 5.0  # the base's errors are taken for less than so often what costs as much as any other


@dataclass(frozen=True)
class LeaningHorizon(Record):
    """The horizon law of robots that lean; see this module."""

    steps: Annotated[int, Range(2, 200, "2 to 200"), Setting("", "", "Number of steps N.")] = 60
    dt: Annotated[
        float, POSITIVE, Setting("s", "", "Length of a step, and time between two solves.")
    ] = 0.02
    max_tilt: Annotated[
        float, POSITIVE, Setting("rad", "", "Tilt beyond which the cost is high.")
    ] = 0.5
    regulator: Annotated[Balance, Setting("", "", "Its cost, and how late it is.")] = field(
        default_factory=partial(Balance, place=0.05, heading=0.2, speed=0.15, turn=0.3)
    )

    @property
    def lateness(self) -> float:
        """From a measurement to its efforts, s."""
        late = self.regulator.lateness
        return LATENESS_S if late is None else late


class Point(NamedTuple):
    """The steady motion that the reference asks for at an instant, and what is linear about it."""

    own: Array  # (1 + n_steered,) tilt and steering, rad
    tau: Array  # (m,)
    F: Array  # (n, n) of a step
    G: Array  # (n, m)
    D: Array  # (n, n): what a drift does to x in a step
    Q: Array  # (n, n)
    R: Array  # (m, m)
    P: Array  # (n, n) cost of going on for ever
    F_brief: Array  # (n, n) of a control period
    G_brief: Array  # (n, m)


class Course:
    """The reference as steady motions at multiples of a step.

    Args:
        law: The law.
        posture: The robot's coordinates.
        period: Control period, s.
    """

    def __init__(self, law: LeaningHorizon, posture: Posture, period: float) -> None:
        self._law, self._posture, self._period = law, posture, period
        self._exact = lru_cache(MAX_REMEMBERED)(self._about)

    def follow(self, reference: Reference) -> None:
        """Follow a reference from now on."""
        self.state = reference
        self.point = lru_cache(MAX_REMEMBERED)(self._point)
        self.wanted = lru_cache(MAX_REMEMBERED)(self._wanted)

    def _point(self, k: int) -> Point:
        """Return the steady motion at k steps: between exact ones, in proportion."""
        first, share = k - k % STRIDE, k % STRIDE / STRIDE
        ends = [self._exact(*self._speeds(end)) for end in (first, first + STRIDE)]
        return Point(*((1.0 - share) * a + share * b for a, b in zip(*ends, strict=True)))

    def _wanted(self, k: int) -> Array:
        """Return tilt and steering of the steady motion at k steps, and the reference's arm and ν.

        Its speed may be none of a steady motion: a bicycle's that sets off.
        """
        state = self.state(k * self._law.dt)
        speeds = dict(zip(("v", "vl", "omega"), state.twist.tolist(), strict=True))
        rates = (speeds.get(name, 0.0) for name in self._posture.robot.drive.base_speeds)
        return np.array([*self.point(k).own, *state.joints, *rates, *state.joint_rates])

    def steps(self, first: int) -> tuple[Steps, Array, Array]:
        """Return N steps from a multiple on, and the steady motions' efforts and states.

        Returns:
            The steps, efforts (N, m) and what :meth:`wanted` is after each (N, n − 3).
        """
        numbers, count = range(first, first + self._law.steps + 1), len(self._posture.index)
        *points, last = map(self.point, numbers)
        wanted = np.array([self.wanted(k) for k in numbers])
        drift, middle = -np.diff(wanted, axis=0) / self._law.dt, 0.5 * (wanted[:-1] + wanted[1:])
        drift[:, :count] += middle[:, count + self._posture.index]
        tau, F, G, D, _, R = map(np.array, zip(*(point[1:7] for point in points), strict=True))
        return Steps(F, G, np.matvec(D[:, :, ERRORS:], drift), last.Q, R, last.P), tau, wanted[1:]

    def _speeds(self, k: int) -> tuple[float, float, tuple[float, ...]]:
        """Return speed, turning rate and arm's positions at k steps, to 1e-9."""
        state = self._posture.possible(self.state(k * self._law.dt))
        v, omega = state.twist[[0, 2]].tolist()
        return round(v, DIGITS), round(omega, DIGITS), tuple(state.joints.round(DIGITS).tolist())

    def _about(self, v: float, omega: float, joints: tuple[float, ...]) -> Point:
        """Return the steady motion of a speed (m/s), a turning rate (rad/s) and an arm.

        Raises:
            RpctlError: There is none.
            UnfitLawError: No efforts bring the robot back to it.
        """
        posture, law = self._posture, self._law
        steady = posture.steady(v, omega, np.array(joints))
        A, B = posture.linear(steady)
        A[1, 1] = -FORGETS * max(1.0 - abs(v) / SLOW, 0.0)
        F, both = sampled(A, np.hstack([B, np.eye(len(A))]), law.dt)
        G, D = np.hsplit(both, [B.shape[1]])
        Q, R = law.regulator.costs(posture, B)
        P = cost_to_go(posture, steady, F, G, Q, R)
        return Point(steady.posture, steady.tau, F, G, D, Q, R, P, *sampled(A, B, self._period))


class LeaningPlan(NamedTuple):
    """A motion from a time on, and the steady motions about which it is: those of its first steps.

    What is of steady motions has a row for each multiple of dt from ``first`` dt on.
    """

    t: float  # s, when it begins
    dt: float  # s
    first: int
    wanted: Array  # (rows, n − 3), as Course.wanted
    tau: Array  # (rows, m) efforts of the steady motions
    F: Array  # (rows, n, n) of a control period
    G: Array  # (rows, n, m)
    motion: Regulated

    @property
    def ends(self) -> float:
        """When nothing is planned any more, s."""
        return self.t + len(self.motion.u) * self.dt

    def nearest(self, t: float) -> int:
        """Return the row that is nearest to a time (s)."""
        return min(max(round(t / self.dt) - self.first, 0), len(self.tau) - 2)

    def at(self, t: float) -> Array:
        """Return what is wanted at a time (s)."""
        k, share = divmod(t / self.dt, 1.0)
        row = min(max(int(k) - self.first, 0), len(self.tau) - 2)
        return np.asarray((1.0 - share) * self.wanted[row] + share * self.wanted[row + 1])

    def deviation(
        self, law: LeaningHorizon, posture: Posture, state: ReferenceState, asked: Asked
    ) -> Array:
        """Return x (n,) when what is sent now acts, with the base's errors on their leash.

        Args:
            law: The law.
            posture: The robot's coordinates.
            state: What the reference asks for.
            asked: What was measured, and the efforts that do not act yet.
        """
        cost, acts, (t, q, nu, _, sent, _) = law.regulator, asked.t + law.lateness, asked
        base = np.array(base_error(posture.robot.base_pose(q), state.pose))
        size = float(np.linalg.norm(base / [cost.place, cost.place, cost.heading])) / LEASH or 1.0
        own = posture.short(np.concatenate([posture.of(q), nu]) - self.at(t))
        x, row = np.concatenate([np.tanh(size) / size * base, own]), self.nearest(acts)
        for u in sent.reshape(-1, self.tau.shape[1]):
            x = self.F[row] @ x + self.G[row] @ u
        x[ERRORS:] += self.at(t) - self.at(acts)
        return x


class LeaningPlanner:
    """Makes the plans of one robot.

    Args:
        law: Its settings.
        period: Control period, s.
        dynamics: The robot's dynamics, as far as the controller knows them.

    Raises:
        UnfitLawError: Something of the robot that has to be driven is not.
    """

    def __init__(self, law: LeaningHorizon, period: float, dynamics: ReducedDynamics) -> None:
        self.dt, self._law, self._posture = law.dt, law, Posture(dynamics)
        posture, robot = self._posture, self._posture.robot
        self._course = Course(law, posture, period)
        joint = robot.description.joint
        names = (*posture.steered, *robot.joint_names)
        ranges = ((joint[name].lower, joint[name].upper) for name in names)
        self._ranges = np.array([(-law.max_tilt, law.max_tilt), *ranges]).T
        self._followed: Reference | None = None
        # What takes long is made before the first sample.
        posture.linear(posture.steady(max(posture.slowest, 0.0), 0.0, robot.home))

    def __call__(self, reference: Reference, asked: Asked) -> Planned:
        """Return the plan from when efforts act that are sent now; it does not know of delays."""
        course, acts = self._course, asked.t + self._law.lateness
        if reference is not self._followed:
            self._followed = reference
            course.follow(reference)
        first, since, count = round(acts / self.dt), int(asked.t // self.dt), self._law.steps
        rows = range(since, first + min(count, TOLD) + 2)
        _, tau, *_, F, G = map(np.array, zip(*map(course.point, rows), strict=True))
        wanted = np.array([course.wanted(k) for k in rows])
        plan = LeaningPlan(acts, self.dt, since, wanted, tau, F, G, NOTHING)
        x = plan.deviation(self._law, self._posture, course.state(asked.t), asked)
        found = self._solved(first, x)
        told = found.x[: TOLD + 1], found.u[:TOLD], found.gains[:TOLD]
        return Planned(plan._replace(motion=Regulated(*told, found.solved)))

    def _solved(self, first: int, xi: Array) -> Regulated:
        """Return the motion from x on.

        Args:
            first: The step that is nearest.
            xi: x (n,).
        """
        steps, tau, wanted = self._course.steps(first)
        count, most = self._ranges.shape[1], self._posture.robot.effort_limits
        lower, upper = (
            np.hstack([limits - tau, ends - wanted[:, :count]])
            for limits, ends in zip((-most, most), self._ranges, strict=True)
        )
        return Regulator(steps)(xi, Box(lower, upper, np.arange(ERRORS, ERRORS + count)))
