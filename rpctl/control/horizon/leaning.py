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

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from scipy.linalg import solve_discrete_are

from rpctl.arrays import Array
from rpctl.control.balance import Posture, sampled
from rpctl.control.horizon.planner import SOFTENED_SLACK
from rpctl.control.horizon.regulation import Box, Regulated, Regulator, Steps
from rpctl.control.law import EffortCommand, Efforts, Limit
from rpctl.control.output_groups import DEAD_TIME
from rpctl.control.sampling import TIME_ROUNDING
from rpctl.dynamics.reduced import ReducedDynamics
from rpctl.errors import SolverError, UnfitLawError
from rpctl.files.records import POSITIVE, Range, Record, Setting
from rpctl.reference.motion import Reference, ReferenceState
from rpctl.robot.model import BASE_NV

STRIDE = 5  # steps between motions that are linearised exactly
DIGITS = 9  # of speeds and positions: motions that are the same to that are one
MAX_REMEMBERED = 64  # of them
DIFFERENCE = 1e-5  # rad or m: of differences of P's twist
SLOW, FORGETS = 0.1, 0.05  # m/s, 1/s: beside a reference that stands nothing brings a base back
REDUNDANT = 1e-6  # of the largest cost: that of efforts which work against each other
LATENESS_S = 0.01  # s: what nobody tells, and is foretold
ANGLE = 1.0  # rad: heading errors are taken for less


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
    leash: Annotated[
        float, POSITIVE, Setting("m", "", "Position errors are taken for less than that.")
    ] = 0.25
    lateness: Annotated[
        float | None,
        DEAD_TIME,
        Setting("s", "", "From a measurement to its efforts; 10 ms if nobody tells a delay."),
    ] = None

    def weights(self, posture: Posture) -> Array:
        """Return the diagonal of Q (n,)."""
        rates = np.full(posture.robot.dof, self.rate)
        rates[: posture.first] = (self.speed, self.turn)[: posture.first]
        places = [self.position, self.position, self.heading, self.tilt]
        joints = [self.joint] * (len(posture.index) - 1)
        return 1.0 / np.concatenate([places, joints, rates]) ** 2

    def input_weights(self, posture: Posture, B: Array) -> Array:
        """Return R (m, m): the cost of the accelerations that efforts give.

        Args:
            B: Derivatives of ν̇ by efforts (dof, m).
        """
        most = np.full(posture.robot.dof, self.joints)
        most[: posture.first] = (self.acceleration, self.turning)[: posture.first]
        driven = np.delete(B / most[:, None], posture.first, axis=0)
        R = driven.T @ driven
        return np.asarray(R + REDUNDANT * np.diag(R).max() * np.diag(
            (posture.scale.min() / posture.scale) ** 2
        ))  # fmt: skip


class Point(NamedTuple):
    """The steady motion that the reference asks for at an instant, and what is linear about it."""

    own: Array  # (1 + n_steered,) tilt and steering, rad
    tau: Array  # (m,)
    F: Array  # (n, n) of a step
    G: Array  # (n, m)
    D: Array  # (n, n): what a drift does to ξ in a step
    R: Array  # (m, m)
    P: Array  # (n, n) cost of going on for ever
    brief: Array  # (n, n + m) F and G of a control period


class Course:
    """The reference as steady motions at multiples of a step.

    Args:
        law: The law.
        posture: The robot's coordinates.
        period: Control period, s.
    """

    def __init__(self, law: LeaningHorizon, posture: Posture, period: float) -> None:
        self._law, self._posture, self._period = law, posture, period
        self.Q = np.diag(law.weights(posture))
        self._exact = lru_cache(MAX_REMEMBERED)(self._about)
        self._reference: Reference | None = None
        self._points: dict[int, Point] = {}
        self._wanted: dict[int, Array] = {}

    def follow(self, reference: Reference, first: int) -> bool:
        """Follow a reference, and forget all before a multiple; return whether it is another."""
        other = reference is not self._reference
        if other:
            self._reference, self._points, self._wanted = reference, {}, {}
        for k in [k for k in self._points if k < first]:
            del self._points[k]
            self._wanted.pop(k, None)
        return other

    def state(self, t: float) -> ReferenceState:
        """Return the reference at a time (s)."""
        assert self._reference is not None
        return self._reference(t)

    def point(self, k: int) -> Point:
        """Return the steady motion at k steps: between exact ones, in proportion."""
        if k not in self._points:
            share = k % STRIDE / STRIDE
            one = self._exact(*self._speeds(k - k % STRIDE))
            other = self._exact(*self._speeds(k - k % STRIDE + STRIDE)) if share else one
            pairs = zip(one, other, strict=True)
            self._points[k] = Point(*((1.0 - share) * x + share * y for x, y in pairs))
        return self._points[k]

    def wanted(self, k: int) -> Array:
        """Return tilt, steering, arm and ν (n − 3,) at k steps."""
        if k not in self._wanted:
            posture, state = self._posture, self.state(k * self._law.dt)
            speeds = posture.possible(*state.twist[[0, 2]].tolist())[: posture.first]
            still = np.zeros(len(posture.index) - len(state.joints))
            self._wanted[k] = np.concatenate(
                [self.point(k).own, state.joints, speeds, still, state.joint_rates]
            )
        return self._wanted[k]

    def steps(self, first: int) -> tuple[Steps, Array]:
        """Return the steps from a multiple on, and the steady motions' efforts (N, m)."""
        law, N = self._law, self._law.steps
        points = [self.point(k) for k in range(first, first + N + 1)]
        wanted = np.array([self.wanted(k) for k in range(first, first + N + 1)])
        count, index = len(self._posture.index), self._posture.index
        drift = np.zeros((N, BASE_NV + wanted.shape[1]))
        drift[:, BASE_NV:] = -np.diff(wanted, axis=0) / law.dt
        middle = 0.5 * (wanted[:-1] + wanted[1:])
        drift[:, BASE_NV : BASE_NV + count] += middle[:, count + index]
        F, G, D, R = (np.array(each) for each in zip(*(p[2:6] for p in points[:N]), strict=True))
        tau = np.array([point.tau for point in points[:N]])
        return Steps(F, G, np.matvec(D, drift), self.Q, R, points[N].P), tau

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
        posture, law = self._posture, self._law
        steady = posture.steady(v, omega, np.array(joints))
        own, B = posture.linear(steady)
        A, n = self._beside(steady.q, steady.nu, own, omega), BASE_NV + len(own)
        B = np.vstack([np.zeros((BASE_NV, B.shape[1])), B])
        F, both = sampled(A, np.hstack([B, np.eye(n)]), law.dt)
        G, D = np.hsplit(both, [B.shape[1]])
        R = law.input_weights(posture, B[n - posture.robot.dof :])
        try:
            P = solve_discrete_are(F, G, self.Q, R)
        except (np.linalg.LinAlgError, ValueError):
            raise UnfitLawError(
                f"{posture.robot.name} cannot be balanced at {v:.3g} m/s: no efforts bring it back"
            ) from None
        brief = np.hstack(sampled(A, B, self._period))
        return Point(steady.posture, steady.tau, F, G, D, R, P, brief)

    def _beside(self, q: Array, nu: Array, own: Array, omega: float) -> Array:
        """Return A of ξ about a motion, of which that of the other states is known."""
        dynamics, index = self._posture.dynamics, self._posture.index
        v, w, _ = dynamics.twist(q, nu)
        left = -FORGETS * max(1.0 - abs(v) / SLOW, 0.0)
        A = np.zeros((BASE_NV + len(own),) * 2)
        A[:BASE_NV, :BASE_NV] = [[0.0, omega, -w], [-omega, left, v], [0.0, 0.0, 0.0]]
        A[BASE_NV:, BASE_NV:] = own
        for k, along in enumerate(dynamics.basis(q)[:, index].T, start=BASE_NV):
            sides = (dynamics.twist(dynamics.integrate(q, h * along), nu)
                     for h in (DIFFERENCE, -DIFFERENCE))  # fmt: skip
            A[:BASE_NV, k] = np.subtract(*sides) / (2.0 * DIFFERENCE)
        for k, unit in enumerate(np.eye(len(nu)), start=BASE_NV + len(index)):
            A[:BASE_NV, k] = dynamics.twist(q, unit)
        return A


class LeaningPlan(NamedTuple):
    """A motion about the steady motions."""

    begins: float  # s
    motion: Regulated
    tau: Array  # (N, m) of the steady motions


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
        self._law, self._posture = law, Posture(ReducedDynamics(dynamics.robot))
        self._course = Course(law, self._posture, period)
        robot = dynamics.robot
        self._late = LATENESS_S if law.lateness is None else law.lateness
        self._sent = deque([np.zeros(len(robot.actuators))] * round(self._late / period))
        names = [*self._posture.steered, *robot.joint_names]
        limited = [robot.description.joint[name] for name in names]
        self._range = (
            np.array([-law.max_tilt, *(joint.lower for joint in limited)]),
            np.array([law.max_tilt, *(joint.upper for joint in limited)]),
        )
        self._plan: LeaningPlan | None = None
        self.solves = self.fallbacks = self.softened = 0

    def __call__(
        self, dynamics: ReducedDynamics, reference: Reference, t: float, q: Array, nu: Array
    ) -> EffortCommand:
        """Return the efforts, from a new plan if it is time for one."""
        law, posture, course = self._law, self._posture, self._course
        acts = t + self._late
        first, other = round(acts / law.dt), course.follow(reference, math.floor(t / law.dt))
        xi = self._foretold(self._deviation(t, q, nu), course.point(first).brief)
        xi[BASE_NV:] += self._wanted(t) - self._wanted(acts)
        plan = self._plan
        if plan is None or other or acts - plan.begins > law.dt - TIME_ROUNDING:
            self._plan = plan = LeaningPlan(acts, *self._solved(first, xi))
        motion, share = plan.motion, (acts - plan.begins) / law.dt
        planned = (1.0 - share) * motion.x[0] + share * motion.x[1]
        steady = (1.0 - share) * plan.tau[0] + share * plan.tau[1]
        u = motion.u[0] - motion.gain @ (xi - planned)
        limits = posture.robot.effort_limits
        tau = np.clip(asked := steady + u, -limits, limits)
        if not np.isfinite(tau).all():
            raise SolverError("the horizon law's plan left the finite numbers")
        if self._sent:
            self._sent.append(tau - steady)
            self._sent.popleft()
        change = motion.x[1] - motion.x[0]
        change[BASE_NV:] += course.wanted(first + 1) - course.wanted(first)
        nu_d, nu_d_dot = (self._wanted(acts) + planned[BASE_NV:])[-len(nu) :], change[-len(nu) :]
        names = (posture.robot.actuators[i] for i in np.flatnonzero(np.abs(asked) >= limits))
        bind = tuple(Limit(name, "effort") for name in names)
        return EffortCommand(nu_d, nu_d_dot / law.dt, Efforts(tau, bind))

    def report(self) -> dict[str, float]:
        """Return how many solves there were, failed ones, and those that softened a bound."""
        return {name: getattr(self, name) for name in ("solves", "fallbacks", "softened")}

    def _wanted(self, t: float) -> Array:
        """Return tilt, steering, arm and ν (n − 3,) of the steady motion at a time (s)."""
        k, share = divmod(t / self._law.dt, 1.0)
        one, other = self._course.wanted(int(k)), self._course.wanted(int(k) + 1)
        return np.asarray((1.0 - share) * one + share * other)

    def _deviation(self, t: float, q: Array, nu: Array) -> Array:
        """Return ξ (n,) as measured; errors of the base on their leash."""
        posture, state = self._posture, self._course.state(t)
        x, y, turned = posture.robot.base_pose(q) - state.pose
        cos, sin, turned = math.cos(state.pose[2]), math.sin(state.pose[2]), _short(turned)
        size = math.hypot(x, y) / self._law.leash
        scale = math.tanh(size) / size if size else 1.0
        base = [scale * (cos * x + sin * y), scale * (cos * y - sin * x),
                ANGLE * math.tanh(turned / ANGLE)]  # fmt: skip
        own = posture.short(np.concatenate([posture.of(q), nu]) - self._wanted(t))
        return np.concatenate([base, own])

    def _foretold(self, xi: Array, brief: Array) -> Array:
        """Return ξ (n,) when what is sent now acts."""
        for u in self._sent:
            xi = brief @ np.concatenate([xi, u])
        return xi

    def _solved(self, first: int, xi: Array) -> tuple[Regulated, Array]:
        """Return the motion from ξ on, and the steady motions' efforts (N, m).

        Args:
            first: The step that is nearest.
            xi: ξ (n,).
        """
        steps, tau = self._course.steps(first)
        count, N = len(self._range[0]), self._law.steps
        wanted = np.array([self._course.wanted(k) for k in range(first + 1, first + N + 1)])
        limits = self._posture.robot.effort_limits
        lower, upper = (each - wanted[:, :count] for each in self._range)
        which = np.arange(BASE_NV, BASE_NV + count)
        box = Box((-limits - tau, limits - tau), (lower, upper), which)
        motion = Regulator(steps)(xi, box)
        self.solves += 1
        self.fallbacks += not motion.solved
        self.softened += motion.slack > SOFTENED_SLACK
        return motion, tau


def _short(angle: float) -> float:
    return math.remainder(angle, math.tau)
