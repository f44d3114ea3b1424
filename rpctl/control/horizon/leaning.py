"""The horizon law on robots that lean: their efforts over the next second, before a bend comes.

About the steady motions that its reference asks for one after the other, the robot is linear in

    ξ = (P ahead of, to the left of and turned from its reference; tilt, steering, arm; ν),

less the steady motion's, and in its efforts less the steady motion's. Where the steady motion
changes, that it is not the robot's own is a drift d = −ẋ_s that is known ahead: so the robot leans
before it turns, and before it speeds up. The cost is that of
:class:`~rpctl.control.balance.Balance` and of ξ's first three; the cost beyond the horizon is the
Riccati equation's, of the last step's motion going on for ever. So where no bound binds and the
reference is steady, this is that equation's regulator.

Every step there is a new plan; until the next, τ = τ_plan − K (ξ − ξ_plan).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.balance import Posture, sampled
from rpctl.control.error import base_error
from rpctl.control.horizon.regulation import Box, Regulated, Regulator, Steps
from rpctl.control.law import EffortCommand, Efforts, Limit
from rpctl.control.output_groups import DEAD_TIME
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import UnfitLawError
from rpctl.files.records import POSITIVE, Range, Record, Setting
from rpctl.reference.motion import Reference
from rpctl.robot.model import BASE_NV

STRIDE = 5  # steps between motions that are linearised exactly
DIGITS = 9  # of speeds and positions: motions that are the same to that are one
MAX_REMEMBERED = 256  # of them, and of steps: those of a horizon and more
DIFFERENCE = 1e-5  # rad or m: of differences of P's twist
SLOW, FORGETS = 0.1, 0.05  # m/s, 1/s: beside a reference that stands nothing brings a base back
REDUNDANT = 1e-6  # of the largest cost: that of efforts which work against each other
LATENESS_S = 0.01  # s: what nobody tells, and is foretold
LEASH = 5.0  # the base's errors are taken for less than so often what costs as much as any other


@dataclass(frozen=True)
class LeaningHorizon(Record):
    """The horizon law of robots that lean; see this module.

    Settings of the cost are deviations, or accelerations, that cost as much as any other.
    """

    steps: Annotated[int, Range(2, 200, "2 to 200"), Setting("", "", "Number of steps N.")] = 60
    dt: Annotated[
        float, POSITIVE, Setting("s", "", "Length of a step, and time between two solves.")
    ] = 0.02
    position: Annotated[float, POSITIVE, Setting("m", "", "P off its reference.")] = 0.05
    heading: Annotated[float, POSITIVE, Setting("rad", "", "Off the reference's.")] = 0.2
    tilt: Annotated[float, POSITIVE, Setting("rad", "", "Off the steady motion's.")] = 0.1
    speed: Annotated[float, POSITIVE, Setting("m/s", "", "Off the reference's.")] = 0.15
    turn: Annotated[float, POSITIVE, Setting("rad/s", "", "Off the reference's.")] = 0.3
    joint: Annotated[float, POSITIVE, Setting("rad or m", "", "Arm and steering.")] = 0.1
    rate: Annotated[float, POSITIVE, Setting("rad/s", "", "Of tilt and joints.")] = 1.0
    acceleration: Annotated[
        float, POSITIVE, Setting("m/s²", "", "Of the wheels along the ground.")
    ] = 3.0
    turning: Annotated[float, POSITIVE, Setting("rad/s²", "", "Acceleration.")] = 5.0
    joints: Annotated[
        float, POSITIVE, Setting("rad/s²", "", "Accelerations of arm and steering.")
    ] = 10.0
    max_tilt: Annotated[float, POSITIVE, Setting("rad", "", "Beyond, it costs much.")] = 0.5
    lateness: Annotated[
        float | None,
        DEAD_TIME,
        Setting("s", "", "From a measurement to its efforts; 10 ms if nobody tells a delay."),
    ] = None

    def costs(self, posture: Posture) -> tuple[Array, Array]:
        """Return the deviations of ξ (n,), and the accelerations (dof,), that cost 1/2."""
        names, base = posture.robot.quasi_velocities, (self.position, self.position, self.heading)
        joints = [self.joint] * (len(posture.index) - 1)
        rates, accelerations = (
            [{"v": ahead, "omega": turning}.get(name, others) for name in names]
            for ahead, turning, others in (
                (self.speed, self.turn, self.rate),
                (self.acceleration, self.turning, self.joints),
            )
        )
        return np.array([*base, self.tilt, *joints, *rates]), np.array(accelerations)


class Point(NamedTuple):
    """The steady motion that the reference asks for at an instant, and what is linear about it."""

    own: Array  # (1 + n_steered,) tilt and steering, rad
    tau: Array  # (m,)
    F: Array  # (n, n) of a step
    G: Array  # (n, m)
    D: Array  # (n, n): what a drift does to ξ in a step
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
        self.deviations, self._accelerations = law.costs(posture)
        self._Q = np.diag(1.0 / self.deviations**2)
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
        """Return tilt, steering, arm and ν (n − 3,) of the steady motion at k steps."""
        state, (v, omega, joints) = self.state(k * self._law.dt), self._speeds(k)
        names, speeds = self._posture.robot.drive.base_speeds, {"v": v, "omega": omega}
        rates = [*(speeds.get(name, 0.0) for name in names), *state.joint_rates]
        return np.array([*self.point(k).own, *joints, *rates])

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
        tau, F, G, D, R = map(np.array, zip(*(point[1:6] for point in points), strict=True))
        d, Q = np.matvec(D[:, :, BASE_NV:], drift), self._Q
        return Steps(F, G, d, Q, R, last.P), tau, wanted[1:]

    def _speeds(self, k: int) -> tuple[float, float, tuple[float, ...]]:
        """Return speed, turning rate and arm's positions at k steps, to 1e-9."""
        state = self.state(k * self._law.dt)
        v, omega = self._posture.possible(*state.twist[[0, 2]].tolist())
        return round(v, DIGITS), round(omega, DIGITS), tuple(state.joints.round(DIGITS).tolist())

    def _about(self, v: float, omega: float, joints: tuple[float, ...]) -> Point:
        """Return the steady motion of a speed (m/s), a turning rate (rad/s) and an arm.

        Raises:
            RpctlError: There is none.
            UnfitLawError: No efforts bring the robot back to it.
        """
        posture, law, dynamics = self._posture, self._law, self._posture.dynamics
        steady = posture.steady(v, omega, np.array(joints))
        (own, B), q, nu = posture.linear(steady), steady.q, steady.nu
        speed, aside, _ = dynamics.twist(q, nu)
        left, n = -FORGETS * max(1.0 - abs(speed) / SLOW, 0.0), BASE_NV + len(own)
        A, count = np.zeros((n, n)), len(posture.index)
        A[:BASE_NV, :BASE_NV] = [[0.0, omega, -aside], [-omega, left, speed], [0.0, 0.0, 0.0]]
        A[BASE_NV:, BASE_NV:] = own
        A[:BASE_NV, BASE_NV + count :] = dynamics.at(q).twist
        for k, along in enumerate(dynamics.basis(q)[:, posture.index].T, start=BASE_NV):
            sides = (dynamics.twist(dynamics.integrate(q, h * along), nu)
                     for h in (DIFFERENCE, -DIFFERENCE))  # fmt: skip
            A[:BASE_NV, k] = np.subtract(*sides) / (2.0 * DIFFERENCE)
        driven = np.delete(B[count:] / self._accelerations[:, None], posture.first, axis=0)
        least = (driven**2).sum(axis=0).max() * (posture.scale.min() / posture.scale) ** 2
        R = driven.T @ driven + REDUNDANT * np.diag(least)
        B = np.vstack([np.zeros((BASE_NV, B.shape[1])), B])
        F, both = sampled(A, np.hstack([B, np.eye(n)]), law.dt)
        G, D = np.hsplit(both, [B.shape[1]])
        try:
            P = solve_discrete_are(F, G, self._Q, R)
        except (np.linalg.LinAlgError, ValueError):
            raise UnfitLawError(
                f"{posture.robot.name} cannot be balanced at {v:.3g} m/s: no efforts bring it back"
            ) from None
        return Point(steady.posture, steady.tau, F, G, D, R, P, *sampled(A, B, self._period))


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
        self._late = LATENESS_S if law.lateness is None else law.lateness
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
        xi[BASE_NV:] += course.at(t) - course.at(acts)
        if other or acts - self._begins > dt - TIME_ROUNDING:
            self._begins, self._plan = acts, self._solved(first, xi)
        (x, planned, gain, *_), steady = self._plan
        share = (acts - self._begins) / dt
        now, held = x[0] + share * (x[1] - x[0]), steady[0] + share * (steady[1] - steady[0])
        tau = np.clip(asked := held + planned[0] - gain @ (xi - now), -limits, limits)
        self._sent = [*self._sent, tau - held][1:]
        change = (x[1] - x[0])[BASE_NV:] + course.wanted(first + 1) - course.wanted(first)
        nu_d = course.at(acts) + now[BASE_NV:]  # finite as τ is, and looked at
        command = EffortCommand(nu_d[-len(nu) :], change[-len(nu) :] / dt)
        binding = np.array(self._robot.actuators)[np.abs(asked) >= limits].tolist()
        command.efforts = Efforts(tau, tuple(Limit(name, "effort") for name in binding))
        return command

    def report(self) -> dict[str, float]:
        """Return how many solves there were, and of how many failed."""
        return {"solves": self.solves, "fallbacks": self.fallbacks}

    def _deviation(self, t: float, q: Array, nu: Array) -> Array:
        """Return ξ (n,) as measured, with the base's errors on their leash."""
        posture, course = self._posture, self._course
        base = np.array(base_error(self._robot.base_pose(q), course.state(t).pose))
        size = float(np.linalg.norm(base / course.deviations[:BASE_NV])) / LEASH or 1.0
        own = np.concatenate([posture.of(q), nu]) - course.at(t)
        return np.concatenate([np.tanh(size) / size * base, posture.short(own)])

    def _solved(self, first: int, xi: Array) -> tuple[Regulated, Array]:
        """Return the motion from ξ on, and the steady motions' efforts (N, m).

        Args:
            first: The step that is nearest.
            xi: ξ (n,).
        """
        steps, tau, wanted = self._course.steps(first)
        count, most = self._ranges.shape[1], self._robot.effort_limits
        lower, upper = (
            np.hstack([limits - tau, ends - wanted[:, :count]])
            for limits, ends in zip((-most, most), self._ranges, strict=True)
        )
        motion = Regulator(steps)(xi, Box(lower, upper, np.arange(BASE_NV, BASE_NV + count)))
        self.solves, self.fallbacks = self.solves + 1, self.fallbacks + (not motion.solved)
        return motion, tau
