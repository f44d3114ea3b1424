"""The horizon law on robots that lean: their efforts over the next second, before a bend comes.

About the steady motions that its reference asks for one after the other, the robot is linear in

    x = (P ahead of, to the left of and turned from its reference; tilt, steering, arm; ν),

less the steady motion's, and in its efforts less the steady motion's. Where the steady motion
changes, that it is not the robot's own is a drift d = −ẋ_s that is known ahead: so the robot leans
before it turns, and before it speeds up. The cost is that of
:class:`~rpctl.control.balance.Balance`; the cost beyond the horizon is the Riccati equation's, of
the last step's motion going on for ever. So where no bound binds and the reference is steady, this
is that equation's regulator.

Every step there is a new plan, made within its sample; until the next, τ = τ_plan − K (x − x_plan).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache, partial
from typing import Annotated, NamedTuple

import numpy as np

from rpctl.arrays import Array
from rpctl.control.balance import ERRORS, LATENESS_S, Balance, Posture, cost_to_go, sampled
from rpctl.control.error import base_error
from rpctl.control.horizon.regulation import Box, Regulated, Regulator, Steps
from rpctl.control.law import EffortCommand, Efforts, Limit
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.files.records import POSITIVE, Range, Record, Setting
from rpctl.reference.motion import Reference

STRIDE = 5  # steps between motions that are linearised exactly
DIGITS = 9  # of speeds and positions: motions that are the same to that are one
MAX_REMEMBERED = 256  # of them, and of steps: those of a horizon and more
SLOW, FORGETS = 0.1, 0.05  # m/s, 1/s: beside a reference that stands nothing brings a base back
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

    def at(self, t: float) -> Array:
        """Return what :meth:`wanted` is at a time (s)."""
        k, share = divmod(t / self._law.dt, 1.0)
        return np.asarray((1.0 - share) * self.wanted(int(k)) + share * self.wanted(int(k) + 1))

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


class LeaningHorizonLaw:
    """:class:`LeaningHorizon` on one robot in one run: its plan, and its counts.

    Args:
        law: Its settings.
        dynamics: The robot's dynamics, as far as the controller knows them.
        period: Control period, s.

    Raises:
        UnfitLawError: Something of the robot that has to be driven is not.
    """

    def __init__(self, law: LeaningHorizon, dynamics: ReducedDynamics, period: float) -> None:
        self._law, self._robot, self._posture = law, dynamics.robot, Posture(dynamics)
        self._course = Course(law, self._posture, period)
        late, cost = law.regulator.lateness, law.regulator
        self._late = LATENESS_S if late is None else late
        self._deviations = np.array([cost.place, cost.place, cost.heading])
        self._sent = [np.zeros(len(self._robot.actuators))] * round(self._late / period)
        joint = self._robot.description.joint
        names = (*self._posture.steered, *self._robot.joint_names)
        ranges = ((joint[name].lower, joint[name].upper) for name in names)
        self._ranges = np.array([(-law.max_tilt, law.max_tilt), *ranges]).T
        self._followed: Reference | None = None
        self._begins = -np.inf  # s: when what was planned last begins
        self._plan: tuple[Regulated, Array]
        self.solves = self.fallbacks = 0

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> EffortCommand:
        """Return the efforts, from a new plan if it is time for one."""
        dt, course, acts, limits = (
            self._law.dt, self._course, t + self._late, self._robot.effort_limits
        )  # fmt: skip
        other, first, self._followed = reference is not self._followed, round(acts / dt), reference
        if other:
            course.follow(reference)
        xi = self._deviation(t, q, nu)
        for u in self._sent:
            xi = course.point(first).F_brief @ xi + course.point(first).G_brief @ u
        xi[ERRORS:] += course.at(t) - course.at(acts)
        if other or acts - self._begins > dt - TIME_ROUNDING:
            self._begins, self._plan = acts, self._solved(first, xi)
        (x, planned, gain, *_), steady = self._plan
        share = (acts - self._begins) / dt
        now, held = x[0] + share * (x[1] - x[0]), steady[0] + share * (steady[1] - steady[0])
        tau = np.clip(asked := held + planned[0] - gain @ (xi - now), -limits, limits)
        self._sent = [*self._sent, tau - held][1:]
        change = (x[1] - x[0])[ERRORS:] + course.wanted(first + 1) - course.wanted(first)
        nu_d = course.at(acts) + now[ERRORS:]  # finite as τ is, and looked at
        binding = np.array(self._robot.actuators)[np.abs(asked) >= limits].tolist()
        efforts = Efforts(tau, tuple(Limit(name, "effort") for name in binding))
        return EffortCommand(nu_d[-len(nu) :], change[-len(nu) :] / dt, efforts)

    def report(self) -> dict[str, float]:
        """Return how many solves there were, and of how many failed."""
        return {"solves": self.solves, "fallbacks": self.fallbacks}

    def _deviation(self, t: float, q: Array, nu: Array) -> Array:
        """Return x (n,) as measured, with the base's errors on their leash."""
        posture, course = self._posture, self._course
        base = np.array(base_error(self._robot.base_pose(q), course.state(t).pose))
        size = float(np.linalg.norm(base / self._deviations)) / LEASH or 1.0
        own = np.concatenate([posture.of(q), nu]) - course.at(t)
        return np.concatenate([np.tanh(size) / size * base, posture.short(own)])

    def _solved(self, first: int, xi: Array) -> tuple[Regulated, Array]:
        """Return the motion from x on, and the steady motions' efforts (N, m).

        Args:
            first: The step that is nearest.
            xi: x (n,).
        """
        steps, tau, wanted = self._course.steps(first)
        count, most = self._ranges.shape[1], self._robot.effort_limits
        lower, upper = (
            np.hstack([limits - tau, ends - wanted[:, :count]])
            for limits, ends in zip((-most, most), self._ranges, strict=True)
        )
        motion = Regulator(steps)(xi, Box(lower, upper, np.arange(ERRORS, ERRORS + count)))
        self.solves, self.fallbacks = self.solves + 1, self.fallbacks + (not motion.solved)
        return motion, tau
